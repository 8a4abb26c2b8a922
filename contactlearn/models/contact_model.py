"""ContactModel: what predicts the outcome of an impact, with one `predict` for every kind.

    base         an analytical law, another model, or nothing: no impulse at all
    effects      physical effects around the law, by name, see `contactlearn.effects`
    parameters   Gaussian processes for (μ, ε) of each impact in place of the law's own
    residual     Gaussian processes on what the base leaves, as impulse, wrench or post velocity
    scatter      components of the contact's scatter around the law, see `contactlearn.scatter`
    noise        covariance of the measured post velocity that none of these can predict

A purely learned model has no base; a law alone has nothing else.  Leading axes, such as training
subsets, may come before the impacts in every part.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from types import MappingProxyType
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import measured
from contactlearn.effects import PLACES, Effect, State
from contactlearn.laws import Law
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.body_state import BodyOutcome, BodyState
from contactlearn.mechanics.impacts import Impacts, Prediction, require_impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Shape
from contactlearn.models.regressor import Regressor
from contactlearn.models.roll_out import RollOut, Until, follow
from contactlearn.scatter.base import Component

_DRAWS = 128  # of deviations: Sobol's points, whose variances are right to a few percent
_AT_ONCE = 100_000  # impacts that are drawn at once

ErrorOfImpacts = Callable[[Impacts, Prediction], Tensor]
"""Error [..., N] of each impact."""
Deviations = Sequence[tuple[Component, Tensor]]
"""Components of the contact's scatter with the deviations [..., N, k] of each impact."""
RESIDUALS = ("velocity", "impulse", "wrench")
"""Quantity to which a residual is added: v_post, (P_t, P_n) or (P_t, P_n, τ)."""


@dataclass(frozen=True)
class ContactModel:
    """See the module; `target` is one of `RESIDUALS`, `noise` [..., D, D] in squares of (m/s, rad/s).

    In space residual and noise are in the axes of the slip (`Impacts.slip_axes`): what is learnt turns with the impact.
    `parameter_covariance` [..., K, K] is that of the fitted μ, ε and parameters of the effects, in this order.
    `scatter` are the components of the contact's scatter by name.
    `provenance` is what a checkpoint says of the data and settings that made the model; empty for any other model.

    Raises:
        ContactLearnError: effects without a law for them to act on.
    """

    base: "Law | ContactModel | None" = None
    residual: Regressor | None = None
    target: str = "wrench"
    parameters: Regressor | None = None
    noise: Tensor | None = None
    effects: Mapping[str, Effect] = field(default_factory=dict)
    parameter_covariance: Tensor | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any], compare=False)
    scatter: Mapping[str, Component] = field(default_factory=dict[str, Component])

    def __post_init__(self):
        if not (self.base is None or isinstance(self.base, Law | ContactModel)):
            raise ContactLearnError(
                "a model is built on a law with its μ and ε, such as laws.find('mirtich').at(0.2, 0.5), or on a model; "
                f"got {self.base!r}"
            )
        if not isinstance(self.effects, Mapping):
            raise ContactLearnError(
                f"a model has effects by name with their values, got {self.effects!r}; contactlearn.fit finds them"
            )
        if self.effects and not isinstance(self.base, Law):
            raise ContactLearnError(f"effects act around a law, got {self.base}; name one, such as law=wang_mason")

    def predict(self, impacts: Impacts) -> Prediction:
        """Post velocity, wrench and, where noise is known, covariance of every impact.

        The covariance is that of the processes, carried through the equation of motion (and
        linearly through the law and its effects), plus that of the contact's scatter and the noise.
        """
        require_impacts(impacts)
        parts = list[Tensor]()
        if self.regressor is None:
            prediction = self.base_prediction(impacts)
        else:
            mean, variance = self.regressor.predict(impacts)
            prediction = self.complete(impacts, mean)
            if self.noise is None:
                return prediction
            parts.append(self.spread(impacts, mean, variance))
        parts += [] if self.noise is None else [self._noise_of(impacts)]
        parts += [self.scatter_covariance(impacts)] if self.law_model.scatter else []
        return replace(prediction, covariance=sum(parts[1:], parts[0])) if parts else prediction

    def outcome(self, impacts: Impacts, deviations: Deviations = ()) -> Prediction:
        """Return what `predict` does without its covariance, with given deviations of the contact."""
        if self.regressor is None:
            return self.base_prediction(impacts, deviations)
        return self.complete(impacts, self.regressor.predict(impacts)[0], deviations)

    def score(self, impacts: Impacts, metric: ErrorOfImpacts) -> Float[Tensor, "*batch"]:
        """Compute the mean error over the impacts, one for each leading axis of the model.

        Args:
            impacts: measurements, best held out from the fit.
            metric: the error of each impact, such as `contactlearn.metrics.mass_error`.

        Raises:
            ContactLearnError: the metric is no function.
        """
        require_metric(metric)
        return metric(impacts, self.predict(impacts)).mean(-1)

    def step(self, state: BodyState, *, uncertainty: bool = False) -> BodyOutcome:
        """Return the velocity after contact of one body or of many, without a data set.

        Args:
            state: before contact; its leading axes stay, behind those of the model.
            uncertainty: whether the covariance is wanted, of the fitted parameters to first order, of the processes and
                of what none of these can predict, as far as the model has them.

        Raises:
            ContactLearnError: the model has no covariance of its parameters, and neither processes nor noise.
            DataError: the contact point is not known, or does not approach; see `BodyState`.
        """
        impacts = state.as_impacts()
        predicted = self.predict(impacts) if uncertainty else self.outcome(impacts)
        offset = actual_state(self.law_model.effects, State.of(impacts)).mass_centre
        outcome = BodyOutcome(
            pose=impacts.q.expand(*predicted.v_post.shape[:-1], -1),
            velocity=predicted.v_post,
            wrench=predicted.wrench,
            mass_centre=None if offset is None else offset.expand(*predicted.v_post.shape[:-1], -1),
            covariance=self._covariance(impacts, predicted) if uncertainty else None,
        )
        return outcome.reshaped(state.batch)

    def contact_heights(self, impacts: Impacts) -> Float[Tensor, "... n"]:
        """Return the heights [N] in m of the contact points of the body as its roll-outs have it."""
        return actual_state(self.physical.law_model.effects, State.of(impacts)).height

    def roll_out(
        self,
        state: BodyState,
        shape: Shape | None = None,
        *,
        until: Until = Until(),
        gravity: float = GRAVITY,
        drag: float = 0.0,
        friction: float | None = None,
        acceleration: Float[Tensor, "*#batch d"] | None = None,
        samples: int | None = None,
        generator: torch.Generator | None = None,
    ) -> RollOut:
        """Follow bodies through flights and bounces; see `roll_out.follow`.

        With `samples` each body is followed so many times, along a new first axis: a fan of trajectories.  Parameters
        are drawn from their covariance once for each, the contact's scatter anew at every bounce.  `friction` is
        that of bodies whose contacts have piled up, by default the law's with its effects, and `acceleration`
        [..., d] is that of each body in flight beside gravity.  Effects of the recording, such as a sampling delay, are
        left out.

        Raises:
            ContactLearnError: samples of a model without scatter and without a covariance of its parameters.
            DataError: the shape is not known, or a body starts inside the floor.
        """
        model, scatters = self.physical, samples is not None and bool(self.law_model.scatter)
        values: list[Tensor] | None = None
        if samples is not None:
            if self.parameter_covariance is not None:
                root = torch.linalg.cholesky(self.parameter_covariance)
                normal = torch.randn(samples, len(root), generator=generator, dtype=torch.float64)
                drawn = self.at((torch.stack(self.values) + normal @ root.mT).unbind(-1)).physical
                values = [x.repeat_interleave(state.batch.numel()) for x in drawn.values]
            elif not scatters:
                raise ContactLearnError("the model has neither scatter nor a covariance of its parameters to draw from")
            state = state.repeated(samples)

        def at(rows: Tensor) -> ContactModel:
            return model if values is None else model.at([x[rows] for x in values])

        def steady(impacts: Impacts, rows: Tensor) -> Prediction:
            physics = at(rows).law_model
            places = ("state", "law") if friction is None else ("state",)
            acting = {name: effect for name, effect in physics.effects.items() if effect.place in places}
            law = physics.law if friction is None else physics.law.at(friction, physics.law.eps)
            return ContactModel(law, effects=acting).predict(impacts)

        def bounced(impacts: Impacts, rows: Tensor) -> Prediction:
            return at(rows).scattered(impacts, generator) if scatters else at(rows).outcome(impacts)

        found = follow(
            bounced,
            None if self.law_model.base is None else steady,
            lambda measured, rows: actual_state(at(rows).law_model.effects, measured),
            *(state, shape, until, gravity, drag, acceleration),
        )
        return replace(found, left_out=self.recorded)

    def scattered(self, impacts: Impacts, generator: torch.Generator | None, samples: int | None = None) -> Prediction:
        """Draw the outcomes [samples, N] of a contact that scatters, or [N], without noise of an instrument."""
        shape = (len(impacts),) if samples is None else (samples, len(impacts))
        return self.outcome(
            impacts,
            [
                (one, one.draw(shape, impacts.space, generator).to(impacts.v_pre))
                for one in self.law_model.scatter.values()
            ],
        )

    def scatter_covariance(self, impacts: Impacts) -> Float[Tensor, "n D D"]:
        """Covariance [N, D, D] of v_post by the contact's scatter, about the outcome without it.

        It is that of the full law at the same deviations for every impact and call: a linear one would not see that
        scatter makes sliding impacts stick.
        """
        none = impacts.v_pre.new_zeros(len(impacts), *[impacts.space.D] * 2)
        return sum((torch.einsum("sni,snj->nij", away, away) for away in self._away(impacts)), none) / _DRAWS

    def scatter_shift(self, impacts: Impacts) -> Float[Tensor, "n D"]:
        """Mean change [N, D] of v_post by the contact's scatter: sliding impacts that stick do so in one direction."""
        return sum((away.sum(0) for away in self._away(impacts)), torch.zeros_like(impacts.v_pre)) / _DRAWS

    def _away(self, impacts: Impacts) -> Iterator[Float[Tensor, "s n D"]]:
        """Yield changes of v_post by the `_DRAWS` deviations in blocks [S, N, D]; none without scatter."""
        if isinstance(self.base, ContactModel):  # what is learnt on top is added to every outcome
            yield from self.base._away(impacts)
        elif self.scatter:
            n, components = len(impacts), self.scatter.values()
            sizes, mean = [one.deviations(impacts.space) for one in components], self.outcome(impacts).v_post
            for some in _sobol_normals(sum(sizes)).to(mean).split(max(1, _AT_ONCE // max(n, 1))):
                parts = some[:, None].expand(-1, n, -1).split(sizes, -1)
                drawn = [(one, one.sigma * u) for one, u in zip(components, parts, strict=True)]
                yield self.outcome(impacts, drawn).v_post - mean

    def _covariance(self, impacts: Impacts, predicted: Prediction) -> Float[Tensor, "... n 3 3"]:
        """Covariance [..., N, 3, 3] of v_post; see `step`."""
        parts = [] if predicted.covariance is None else [predicted.covariance]
        under = self.law_model
        if under.parameter_covariance is not None and self.parameters is None:
            shape = predicted.v_post.shape[:-1]

            def outcome(*values: Tensor) -> Tensor:
                moved = under.at(values)
                return resolve(moved.law, moved.effects, State.of(impacts), *values[:2]).v_post

            _, slope = linearised(outcome, [value.expand(shape) for value in under.values])
            parts.append(slope @ under.parameter_covariance[..., None, :, :] @ slope.mT)
        if not parts:
            raise ContactLearnError(
                "the model states no uncertainty: give it a parameter_covariance, as contactlearn.fit does, or a noise"
            )
        return torch.stack(torch.broadcast_tensors(*parts)).sum(0)

    def _noise_of(self, impacts: Impacts) -> Tensor:
        """Noise of each impact [..., N, D, D] in world axes."""
        assert self.noise is not None
        return impacts.slip_axes @ self.noise[..., None, :, :] @ impacts.slip_axes.mT

    @property
    def law_model(self) -> "ContactModel":
        """The model that has the law and the effects: this one, or the one that it is built on."""
        return self.base.law_model if isinstance(self.base, ContactModel) else self

    @property
    def recorded(self) -> tuple[str, ...]:
        """Names of the effects of the recording, which `physical` leaves out."""
        return tuple(name for name, effect in self.law_model.effects.items() if effect.of_recording)

    @property
    def physical(self) -> "ContactModel":
        """The model without effects of the recording, as roll-outs and simulators have it."""
        if isinstance(self.base, ContactModel):
            return replace(self, base=self.base.physical)
        owners = ["μ", "ε", *(name for name, effect in self.effects.items() for _ in effect.parameters)]
        kept = torch.tensor([place for place, owner in enumerate(owners) if owner not in self.recorded])
        covariance = self.parameter_covariance
        return replace(
            self,
            effects={name: effect for name, effect in self.effects.items() if name not in self.recorded},
            parameter_covariance=None if covariance is None else covariance[..., kept, :][..., kept],
        )

    @property
    def values(self) -> tuple[Tensor, ...]:
        """μ, ε and the parameters of the effects, in the order of `parameter_covariance`."""
        return *self.law.coefficients, *(value for effect in self.effects.values() for value in effect.values)

    def at(self, values: Sequence[Tensor | float]) -> "ContactModel":
        """Return the model with other values of μ, ε and the effects' parameters, each broadcast against [..., N]."""
        left = iter(values)
        law = self.law.at(next(left), next(left))
        effects = {name: one.at([next(left) for _ in one.parameters]) for name, one in self.effects.items()}
        return replace(self, base=law, effects=effects)

    def constants(self) -> dict[str, Any]:
        """Return law, effects and every constant of theirs in full, with standard errors, as JSON takes them.

        Values are nested lists where the model has leading axes.
        """
        errors = iter(self.standard_errors())

        def entry(symbol: str, value: Tensor, unit: str) -> dict[str, Any]:
            return {"symbol": symbol, "value": value.tolist(), "unit": unit, "standard_error": next(errors)}

        found: dict[str, Any] = {}
        if isinstance(self.base, ContactModel):
            found["base"] = self.base.constants()
        elif self.base is not None:
            mu, eps = (entry(*one, "–") for one in zip(("μ", "ε"), self.law.coefficients, strict=True))
            options = {name: x.tolist() if isinstance(x, Tensor) else x for name, x in self.law.options.items()}
            law = {"name": self.law.name, "variant": self.law.variant, "options": options, "mu": mu, "eps": eps}
            found["law"] = law if self.parameters is None else law | {"mu": None, "eps": None}
        for name, effect in self.effects.items():
            values = {
                p.name: entry(p.symbol, value, p.unit)
                for p, value in zip(effect.parameters, effect.values, strict=True)
            }
            about = {"form": effect.form, "equation": effect.equation, "options": effect.options, "parameters": values}
            found.setdefault("effects", {})[name] = about
        for name, one in self.scatter.items():
            found.setdefault("scatter", {})[name] = {
                "symbol": f"σ_{one.symbol}", "value": one.sigma, "unit": one.unit, "deviates": one.in_words
            }  # fmt: skip
        for name, processes in (("parameters", self.parameters), ("residual", self.residual)):
            if processes is not None:
                target = {} if name == "parameters" else {"target": self.target}
                found[name] = target | {"processes": processes.space, "trials": processes.gps.train_targets.shape[-1]}
        return found

    def __str__(self) -> str:
        """Write the equation of the model, a line for each effect.

        wang_mason (textbook): μ = 0.120 ± 0.001, ε = 0.550 ± 0.002
          + spin_damping: τ ← τ − c I ω⁺, c = 0.105 ± 0.004
          + scatter: the normal by 0.65°, friction by 0.016
          + wrench(x1)
        """
        lines = [] if self.base is None else [str(self.base)]
        if isinstance(self.base, Law) and self.parameter_covariance is not None:
            both = _mean(self.base.mu), _mean(self.base.eps)
            values = zip("με", both, self.standard_errors()[:2], ("", ""), strict=True)
            lines = [f"{self.base.name} ({self.base.variant}): {_listed(values)}"]
        if self.parameters is not None:
            lines = [f"{self.law.name} ({self.law.variant}): (μ, ε)({self.parameters.space})"]
        errors = iter(self.standard_errors()[2:])
        for name, effect in self.effects.items():
            known = (math.nan if error is None else error for error in errors)
            values = (
                (p.symbol, *effect.in_shown_unit(p.name, _mean(v), next(known), p.unit))
                for p, v in zip(effect.parameters, effect.values, strict=True)
            )
            lines.append(f"{name}: {effect.shown_equation}, {_listed(values)}")
        if self.scatter:
            lines.append(f"scatter: {', '.join(map(str, self.scatter.values()))}")
        if self.residual is not None:
            lines.append(f"{self.target}({self.residual.space})")
        return ("\n  + " if self.effects or self.scatter else " + ").join(lines) or "no impulse"

    def __repr__(self) -> str:
        """Write the model with every constant in full, as `constants`."""
        return f"ContactModel({json.dumps(self.constants(), ensure_ascii=False)})"

    def standard_errors(self) -> list[float | None]:
        """Standard errors of μ, ε and the parameters of the effects, means over leading axes; None where unknown."""
        if self.parameter_covariance is None:
            return [None] * (2 + sum(len(effect.parameters) for effect in self.effects.values()))
        errors = self.parameter_covariance.diagonal(dim1=-2, dim2=-1).sqrt()
        means = errors.reshape(-1, errors.shape[-1]).mean(0).tolist()
        return [None if math.isnan(x) else x for x in means]

    @property
    def name(self) -> str:
        """Names of the law, the effects and the learned part, such as `wang_mason + side_drag + wrench(x1)`."""
        base = self.base.name if isinstance(self.base, Law | ContactModel) else ""
        parameters = "" if self.parameters is None else f"(μ, ε)({self.parameters.space})"
        residual = "" if self.residual is None else f"{self.target}({self.residual.space})"
        return " + ".join(filter(None, (base, *self.effects, parameters, residual))) or "no impulse"

    @property
    def law(self) -> Law:
        """The analytical law that the model is built on.

        Raises:
            ContactLearnError: the base is another model, or there is none.
        """
        if not isinstance(self.base, Law):
            raise ContactLearnError(
                f"the model is built on {self.base}, not on a law; name one, such as law=wang_mason"
            )
        return self.base

    @property
    def regressor(self) -> Regressor | None:
        """The learned part: the processes of the parameters or of the residual; None if nothing is learned."""
        return self.parameters or self.residual

    @property
    def processes(self) -> Regressor:
        """The learned part, as `regressor`, of a model that has one.

        Raises:
            ContactLearnError: nothing is learned.
        """
        if self.regressor is None:
            raise ContactLearnError("the model has no learned part; make one with contactlearn.learn")
        return self.regressor

    def base_prediction(self, impacts: Impacts, deviations: Deviations = ()) -> Prediction:
        """Predict with the base and its effects."""
        if isinstance(self.base, ContactModel):
            return self.base.outcome(impacts, deviations)
        if self.base is None:
            return Prediction.from_wrench(impacts, torch.zeros_like(impacts.v_pre))
        return resolve(self.base, self.effects, State.of(impacts), self.base.mu, self.base.eps, deviations=deviations)

    def complete(self, impacts: Impacts, learned: Tensor, deviations: Deviations = ()) -> Prediction:
        """Prediction from the value [..., N, O] of the learned part: (μ, ε) or the residual."""
        if self.parameters is not None:
            return predict_with(self.law, impacts, learned, self.effects, deviations)
        base, size = self.base_prediction(impacts, deviations), learned.shape[-1]
        learned = rigid_body.matvec(impacts.slip_axes[:, :size, :size], learned)
        if self.target == "velocity":
            v_post = base.v_post + learned
            body = impacts.mass, impacts.world_inertia, impacts.r, impacts.v_pre
            return Prediction(v_post, rigid_body.measured_wrench(*body, v_post))
        return Prediction.from_wrench(impacts, base.wrench + pad(learned, (0, impacts.space.D - size)))

    def spread(self, impacts: Impacts, learned: Tensor, variance: Tensor) -> Tensor:
        """Covariance [..., N, 3, 3] of v_post from the variance [..., N, O] of the learned part."""
        slope = impacts.slip_axes
        if self.parameters is not None or self.target != "velocity":
            slope = rigid_body.velocity_per_wrench(impacts.mass, impacts.world_inertia, impacts.r)
            turn = (
                impacts.slip_axes
                if self.parameters is None
                else wrench_per_parameter(self.law, impacts, learned, self.effects)
            )
            slope = slope @ turn
        slope = slope[..., : variance.shape[-1]]
        return (slope * variance[..., None, :]) @ slope.mT


def require_metric(metric: object) -> None:
    """Check that a metric is a function.

    Raises:
        ContactLearnError: it is none.
    """
    if not callable(metric):
        raise ContactLearnError(f"a metric is a function, such as contactlearn.metrics.mass_error; got {metric!r}")


def resolve(
    law: Law,
    effects: Mapping[str, Effect],
    measured: State,
    mu: Tensor | float,
    eps: Tensor | float,
    *,
    deviations: Deviations = (),
) -> Prediction:
    """The outcome of a law with effects around it, with μ and ε broadcast against the impacts [..., N].

    Effects act in the order of their places, and in the given order within one, `last` ones last.  The wrench of
    the prediction is the one that takes the measured body from its measured v_pre to the predicted v_post.
    """
    for effect in effects.values():
        effect.require_space(measured.space)
    ordered = sorted(effects.values(), key=lambda effect: effect.last)
    at = {place: [effect for effect in ordered if effect.place == place] for place in PLACES}
    state = actual_state(effects, measured)
    mu, eps = actual_coefficients(effects, state, mu, eps)
    for component, u in deviations:
        state, mu, eps = component.perturb(state, mu, eps, u)
    moved = bool(at["state"] or at["velocity"] or deviations)
    state = state.replace(mu=mu, eps=eps)
    P = law.at(mu, eps).impulse(state.W, state.approach)
    wrench = pad(P, (0, measured.space.D - measured.space.d))
    for effect in at["wrench"]:
        wrench = effect.wrench(state, wrench)
    if not moved:
        return Prediction(measured.v_after(wrench), wrench)
    v_post = state.as_measured(state.v_after(wrench))
    for effect in at["velocity"]:
        v_post = effect.velocity(state, v_post)
    missing = v_post - measured.v_after(wrench)  # exactly 0 where the effects vanish
    still = torch.zeros_like(missing)
    body = measured.mass, measured.world_inertia, measured.r
    return Prediction(v_post, wrench + rigid_body.measured_wrench(*body, still, missing))


def actual_state(effects: Mapping[str, Effect], measured: State) -> State:
    """Return the state as it is according to the effects of the place `state`, from the state as it was measured."""
    for effect in sorted(effects.values(), key=lambda effect: effect.last):
        if effect.place == "state":
            measured = effect.state(measured)
    return measured


def actual_coefficients(
    effects: Mapping[str, Effect], state: State, mu: Tensor | float, eps: Tensor | float
) -> tuple[Tensor, Tensor]:
    """Return (μ, ε) of each impact according to the effects of the place `law`, from those of the law."""
    mu, eps = (torch.as_tensor(x, dtype=torch.float64, device=state.mass.device) for x in (mu, eps))
    acting = [effect for effect in sorted(effects.values(), key=lambda effect: effect.last) if effect.place == "law"]
    for effect in acting:
        mu, eps = effect.law(state, mu, eps)
    return _clamped(mu, eps) if acting else (mu, eps)


def predict_with(
    law: Law,
    impacts: Impacts,
    parameters: Tensor,
    effects: Mapping[str, Effect] = MappingProxyType({}),
    deviations: Deviations = (),
) -> Prediction:
    """Prediction with (μ, ε) [..., N, 2] of each impact's own; negative ones count as 0, ε ends at 1."""
    return resolve(law, effects, State.of(impacts), *_clamped(*parameters.unbind(-1)), deviations=deviations)


def wrench_per_parameter(
    law: Law, impacts: Impacts, parameters: Tensor, effects: Mapping[str, Effect] = MappingProxyType({})
) -> Tensor:
    """Derivative [..., N, 3, 2] of the wrench in (μ, ε) at parameters [..., N, 2] of each impact's own."""
    state = State.of(impacts)
    _, slope = linearised(lambda *own: resolve(law, effects, state, *own).wrench, _clamped(*parameters.unbind(-1)))
    return slope


def linearised(outcome: Callable[..., Tensor], parameters: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Outcomes [..., N, D], and their derivative [..., N, D, K] in parameters [..., N] of their own impacts alone.

    Both can be differentiated in the parameters and in whatever else the outcomes depend on.
    """
    follows = torch.is_grad_enabled() and outcome(*parameters).requires_grad
    with torch.enable_grad():
        try:
            own = [part.clone().requires_grad_() for part in parameters]
        except RuntimeError:  # within a transform of torch.func, such as jacrev, which has its own way
            value, back, *_ = torch.func.vjp(outcome, *parameters)
            rows = torch.vmap(back)(_units(value))
        else:
            value = outcome(*own)
            options = {"create_graph": follows, "allow_unused": True, "materialize_grads": True}
            # is_grads_batched=True does the same, but loops over the units in operations such as torch.where.
            rows = torch.vmap(lambda unit: torch.autograd.grad(value, own, unit, **options))(_units(value))
    slope = torch.stack(rows, -1).movedim(0, -2)
    return (value, slope) if follows else (value.detach(), slope)


def _units(value: Tensor) -> Tensor:
    """Each component's unit vector [D, ..., N, D], of outcomes [..., N, D]."""
    size = value.shape[-1]
    return torch.eye(size).to(value).expand(*value.shape[:-1], size, size).movedim(-2, 0)


def _clamped(mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    return mu.clamp_min(0), eps.clamp(0, 1)


@cache
def _sobol_normals(size: int) -> Float[Tensor, "draws {size}"]:
    """Normal deviates of unit variance, by Sobol's points."""
    uniform = torch.quasirandom.SobolEngine(size, scramble=True, seed=0).draw(_DRAWS, dtype=torch.float64)
    return torch.special.ndtri(uniform)


def _mean(value: Tensor | float) -> float:
    """The mean over a batch."""
    return torch.as_tensor(value, dtype=torch.float64).mean().item()


def _listed(values: Iterable[tuple[str, float, float | None, str]]) -> str:
    """Write symbols, values, standard errors and units as `c = 0.1051 ± 0.0041 m, …`."""
    return ", ".join(f"{symbol} = {measured(value, error, unit)}" for symbol, value, error, unit in values)
