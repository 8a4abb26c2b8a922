"""Where to start forms that have a place, a bearing or a width: variable projection about a fitted model.

A form of the place `law` adds Σ a_l s_l(ψ) to μ or ε.  In its amplitudes a, which vanish, the linearised model is
linear; ψ, the middle of a spot or the bearing of a border, is undefined without them.  Of many ψ those are kept that
leave least of the residual with the best a, and with the best steps of all other parameters of the model.  All trials
count alike up to a few standard deviations: to a robust fit a spot is a handful of outliers.
Source: Golub & Pereyra 1973.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.search.pool import Pool, ScoredFit, Spec
from contactlearn.effects import Effect, EffectId, State
from contactlearn.inference.identification.joint import linearise, named_parameters

_POINTS, _KEPT = 512, 4  # ψ that are tried, and kept
_STEP = 1e-3  # of the range of an amplitude
_LEAST = 1e-9  # of the size of a column: what is smaller follows from the others
_FAR = 10.0  # standard deviations at which a residual is curbed, as of a gross outlier


def projects(effect: Effect) -> bool:
    """Whether an effect adds to μ or ε by amplitudes that vanish."""
    return effect.place == "law" and any(p.vanishing == 0.0 for p in effect.parameters)


class Projection:
    """A model without one of its effects, linearised.

    Args:
        pool: of the model.
        model: fitted.
        replaced: an effect of it that others are to replace; None to add to all of them.
    """

    def __init__(self, pool: Pool, model: ScoredFit, replaced: EffectId | None = None) -> None:
        self.pool, self.model = pool, model
        self.spec = Spec(model.spec.law, model.spec.effects - {replaced})
        self.effects = pool.effects(self.spec)
        self.theta = pool.start(self.spec, model, {})
        law, scatter = pool.laws[self.spec.law], model.fit.scatter
        about = linearise(law, self.effects, pool.impacts, self.theta, scatter, options=pool.options)
        curbed = _FAR / about.residual.norm(dim=-1, keepdim=True).clamp_min(_FAR)
        self.slope = (about.slope * curbed[..., None]).nan_to_num(0.0, 0.0, 0.0)
        residual = (about.residual * curbed).flatten()
        self.basis, triangle = torch.linalg.qr(self.slope.flatten(0, 1))
        self.triangle = triangle + _LEAST * triangle.abs().max() * torch.eye(len(triangle)).to(triangle)
        self.steps = self.basis.mT @ residual
        self.residual = residual - self.basis @ self.steps

    def larger(self, other: EffectId) -> Spec:
        """The model with another effect."""
        return Spec(self.spec.law, self.spec.effects | {other})

    def starts(self, other: EffectId) -> Float[Tensor, "c k"]:
        """Return values to fit the model with another effect from, the most promising first; none but of `projects`."""
        effect = self.pool.candidates[other]
        linear = [k for k, p in enumerate(effect.parameters) if p.vanishing == 0.0]
        if not projects(effect):
            return self.theta[None][:0]
        points = self.pool.spread(other, 1 if len(linear) == len(effect.parameters) else _POINTS)
        X = self._columns(effect, linear, points)
        size, along = X.square().sum(1), self.basis.mT @ X
        X = X - self.basis @ along
        gram, right = X.mT @ X, -(X.mT @ self.residual)
        amplitude = torch.linalg.solve(gram + torch.diag_embed(_LEAST * size + 1e-300), right[..., None])[..., 0]
        best = (amplitude * right).sum(-1).topk(min(_KEPT, len(points))).indices
        points[:, linear] = amplitude
        steps = (self.steps + (along @ amplitude[..., None])[..., 0])[best].mT
        others = self.theta - torch.linalg.solve_triangular(self.triangle, steps, upper=True).mT
        return self._complete(other, others, points[best])

    def _columns(self, effect: Effect, linear: list[int], points: Float[Tensor, "c k"]) -> Float[Tensor, "c m l"]:
        """Derivatives of the residual in the amplitudes of an effect, at points of its other parameters."""
        state = State.of(self.pool.impacts)
        coefficients = [part + torch.zeros_like(state.mass) for part in self.theta[:2]]
        derivatives = list[Tensor]()
        for k in linear:
            step = _STEP * (effect.parameters[k].high - effect.parameters[k].low)
            at = points.clone()
            at[:, linear] = 0.0
            at[:, k] = step
            pairs = zip(effect.at(at[:, None]).law(state, *coefficients), coefficients, strict=True)
            by = torch.stack(torch.broadcast_tensors(*((new - was) / step for new, was in pairs)), -1)
            change = (self.slope[..., :2] * by[..., None, :]).sum(-1)
            derivatives.append(change.expand(len(points), -1, -1).flatten(1))
        return torch.stack(derivatives, -1)

    def _complete(
        self, other: EffectId, others: Float[Tensor, "c q"], points: Float[Tensor, "c k"]
    ) -> Float[Tensor, "c m"]:
        """Values of the model with one more effect, from its own and those of the effect, within their ranges."""
        larger, counts = self.larger(other), [len(effect.parameters) for effect in self.effects.values()]
        starts = list[Tensor]()
        for values, point in zip(others, points, strict=True):
            parts = values[2:].split(counts) if counts else ()
            known = {EffectId(name, e.form): x for (name, e), x in zip(self.effects.items(), parts, strict=True)}
            starts.append(torch.cat((values[:2], self.pool.start(larger, self.model, known | {other: point})[2:])))
        parameters = named_parameters(self.pool.effects(larger), self.pool.options.box, self.pool.impacts)
        low, high = torch.tensor([(p.low, p.high) for p in parameters], dtype=torch.float64).T
        return torch.stack(starts).clamp(low, high)
