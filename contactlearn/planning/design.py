"""The design: a batch of drops within the limits of a rig, chosen one by one.

    settings    drawn within the limits and at them (Sobol), with realisations of what the rig does not reach or set
    criteria    what a drop at each setting is expected to tell, see `criteria`
    batch       a part of the drops for the goal, a part for effects that are not seen yet, a part that fills the space,
                since the truth may be in no model; each drop is the best after all before it
    forecast    the same criteria after the batch, and after further ones like it

Before anything is measured each effect of the catalogue may be the one that is missing: the batch separates every one
from the law alone and from every other, about a law at several (μ, ε).  After a diagnosis it does so about the chosen
model, and about its law alone.  A setting whose change has a cost must bring that much more.
Sources: see `criteria`; Chaloner & Larntz 1989, for the average over values of parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits
from torch import Tensor
from torch.nn.functional import pad

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import is_whole
from contactlearn.diagnosis.discrimination.experiment import parameter_slopes
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.search.candidates import all_laws
from contactlearn.inference.evaluation.variables import symmetry
from contactlearn.inference.validation import robust_covariance
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models.contact_model import ContactModel
from contactlearn.planning.criteria import (
    Criterion,
    EffectSeparation,
    MeanCriterion,
    NameInformation,
    ParameterInformation,
    PredictionVariance,
    SpaceFilling,
)
from contactlearn.planning.hypotheses import Candidates, PossibleModel, hypotheses, visible
from contactlearn.planning.result import (
    Forecast,
    Goal,
    Look,
    ParameterForecast,
    Plan,
    PlannedDrop,
    Possibility,
    Purpose,
)
from contactlearn.planning.rig import Rig, Specimen, states
from contactlearn.planning.stopping import WORTHWHILE, decide

NOISE = {PLANE: (0.01, 0.01, 0.3), SPACE: (0.01, 0.01, 0.01, 0.3, 0.3, 0.3)}
"""Noise before anything is measured, of a rig that states none: m/s and rad/s, as of a good camera."""
_DRAWN, _SETTINGS, _REPEATS = 2048, 512, 2  # settings drawn, kept, and realisations of each
_BEYOND = 0.25  # of the width: a sixth of the settings is at each limit, where most is learnt
_COEFFICIENTS = (0.1, 0.5), (0.2, 0.6), (0.3, 0.7)  # (μ, ε) about which effects are looked for before a diagnosis
_SCHEDULE = {
    None: (*[Purpose.EFFECTS] * 7, Purpose.SPACE),
    Goal.NAMES: (*[Purpose.NAMES, Purpose.EFFECTS] * 3, Purpose.NAMES, Purpose.SPACE),
    Goal.PARAMETERS: (*[Purpose.PARAMETERS] * 7, Purpose.SPACE),
    Goal.PREDICTION: (Purpose.PREDICTION, Purpose.PREDICTION, Purpose.PREDICTION, Purpose.SPACE),
}
"""What the drops of a batch are for, in turn: by goal, and before anything is diagnosed."""
_TRIES = 10  # to find settings of which every realisation approaches
_NATS = 1e-3  # below which a drop tells nothing of the names in question
_BATCHES = 8  # of the forecast
_MEASURED = 500  # impacts about which the space is filled
_BUDGET, _BEYOND_MEASURED = 400, 100  # impacts in all, and beyond those that were measured before the first plan
_SAME_CONTACT = 0.02  # relative spread of contact points that are one


def plan(
    known: Diagnosis | Impacts | Specimen,
    rig: Rig,
    *,
    goal: Goal | str = Goal.NAMES,
    count: int = 20,
    budget: int | None = None,
    looks: Sequence[Look] = (),
    seed: int = 0,
) -> Plan:
    """Choose the drops to measure next.

    Args:
        known: a diagnosis, measured impacts, or before any a body.
        rig: limits of the apparatus.
        goal: what the drops are to make known.
        count: number of drops.
        budget: impacts to measure at most, those that are measured among them; by default 400, or 100 beyond those that
            were measured before the first plan.
        looks: of earlier plans, see `Plan.looks`; they decide when to stop.
        seed: of the settings to choose from.

    Raises:
        DataError: a rig that can set nothing, limits that contradict the body, or within which all contacts are alike.
        ContactLearnError: no such goal, or no whole number of drops.
    """
    if goal not in [*Goal]:
        raise ContactLearnError(f"goal must be one of {', '.join(Goal)}, got {goal!r}")
    for name, value in (("count", count), ("budget", budget)):
        if value is not None and not is_whole(value, 1):
            raise ContactLearnError(f"{name} must be a whole number, 1 or more, got {value!r}")
    with threadpool_limits(1):  # tensors here are small
        return _plan(known, rig, Goal(goal), count, budget, tuple(looks), seed)


def _plan(
    known: Diagnosis | Impacts | Specimen,
    rig: Rig,
    goal: Goal,
    count: int,
    budget: int | None,
    looks: tuple[Look, ...],
    seed: int,
) -> Plan:
    diagnosis = known if isinstance(known, Diagnosis) else None
    measured = None if isinstance(known, Specimen) else known if isinstance(known, Impacts) else _recorded(known)
    specimens = (known,) if isinstance(known, Specimen) else Specimen.of(measured) if measured is not None else ()
    rig = rig.completed(specimens)
    settings = _drawn(rig, specimens, count, seed)
    _refuse_alike(settings.states, rig.noise or NOISE[settings.states.space])
    belief = _belief(diagnosis, measured, settings.states, rig)
    features = _Features.of(settings.states)
    criteria = _criteria(belief, features, settings.states, measured)
    picked, purposes = _greedy(criteria, _SCHEDULE[goal if diagnosis else None], settings, rig, count)
    forecast = _forecast(criteria, belief, goal if diagnosis else None, picked)
    if diagnosis is not None:
        looks = (*looks, Look.of(diagnosis, gain=forecast.gain or 0.0))
    if budget is None:
        budget = max(_BUDGET, looks[0].trials + _BEYOND_MEASURED) if looks else _BUDGET
    order = _ordered(rig, settings, picked)
    return Plan(
        goal=goal,
        space=settings.states.space.name,
        rig=dict(rig.limits),
        noise=tuple(belief.noise.diagonal(dim1=-2, dim2=-1).mean(0).sqrt().tolist()),
        drops=tuple(
            PlannedDrop(
                settings={
                    name: settings.values[name][picked[k]].item() for name, one in rig.limits.items() if one.settable
                },
                purpose=purposes[k],
                body=specimens[int(settings.body[picked[k]])].name,
            )
            for k in order
        ),
        budget=budget,
        possibilities=belief.possibilities,
        forecast=forecast,
        hidden=belief.hidden,
        looks=looks,
        stop=decide(goal, looks, budget, count),
        bodies={one.name: one.moments for one in specimens},
    )


def _recorded(diagnosis: Diagnosis) -> Impacts:
    """The impacts of a diagnosis."""
    if diagnosis.record is None:
        raise ContactLearnError(
            f"the diagnosis has no record of its trials, and so nothing to plan from: {diagnosis!r}"
        )
    return diagnosis.record.impacts


# --- Settings ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Settings:
    """Settings to choose from by name [n], the body of each, and the states [n R] to which they lead."""

    values: Mapping[str, Float[Tensor, "n"]]
    body: Int[Tensor, "n"]
    states: Impacts


def _drawn(rig: Rig, specimens: Sequence[Specimen], count: int, seed: int) -> _Settings:
    """Settings of which every realisation approaches the floor."""
    generator = torch.Generator().manual_seed(seed)
    values, body = rig.draw(_DRAWN, seed, beyond=_BEYOND), torch.arange(_DRAWN) % len(specimens)

    def lead(rows: Tensor) -> tuple[Impacts | None, Tensor]:
        every = rows.repeat_interleave(_REPEATS)
        reached = rig.reached({name: value[every] for name, value in values.items()}, generator)
        return states(specimens, body[every], reached, generator)

    rows = torch.arange(_DRAWN)
    for _ in range(_TRIES):
        reached, good = lead(rows)
        if reached is not None and len(rows) <= _SETTINGS and good.all():
            values = {name: value[rows] for name, value in values.items()}
            return _Settings(values=values, body=body[rows], states=reached)
        rows = rows[good.unflatten(0, (-1, _REPEATS)).all(1)][:_SETTINGS]
        if len(rows) < count:
            break
    down = "v_y" if specimens[0].space is PLANE else "v_z"
    raise DataError(
        f"the limits contradict the body: its contact point approaches the floor in {len(rows)} of {_DRAWN} settings "
        f"within them, and {count} drops are wanted; {down} < 0 is downwards, and a spin lifts a contact point"
    )


def _refuse_alike(drops: Impacts, noise: Sequence[float]) -> None:
    """Refuse limits within which all contacts are the same one."""
    sizes, spread = drops.r.norm(dim=-1).mean(), drops.v_pre.std(0) / torch.tensor(noise, dtype=torch.float64)
    inertia = drops.world_inertia.reshape(len(drops), -1)
    moments = inertia.std(0).norm() / inertia.norm(dim=1).mean()
    if (spread < 1).all() and (drops.r.std(0) < _SAME_CONTACT * sizes).all() and moments < _SAME_CONTACT:
        slip = drops.v_c[:, :-1].norm(dim=-1).mean().item()
        friction = "" if slip > noise[0] else ", and no friction, since nothing slips"
        raise DataError(
            f"every contact within the limits is alike (v_n = {drops.v_c[:, -1].mean():.3g} m/s, slip {slip:.2g} m/s): "
            f"no dependence on speed, spin, orientation or contact point can be learnt{friction}; widen a limit"
        )


@dataclass(frozen=True, kw_only=True)
class _Features:
    """Places of states in which drops are spread: the part that lands, velocities and place in widths of the limits."""

    low: Float[Tensor, "s"]
    width: Float[Tensor, "s"]
    folds: int

    @classmethod
    def of(cls, drops: Impacts) -> "_Features":
        every = cls._columns(drops)
        width = every.amax(0) - every.amin(0)
        return cls(
            low=every.amin(0),
            width=torch.where(width > 1e-9, width, torch.inf),
            folds=symmetry(drops.shape) if drops.space is PLANE else 1,
        )

    def __call__(self, drops: Impacts) -> Float[Tensor, "n s"]:
        if drops.space is SPACE:
            lands = rotation(drops.q[:, 3:])[:, 2]
        else:
            theta = self.folds * drops.q[:, 2:]
            lands = torch.cat((theta.cos(), theta.sin()), 1)
        return torch.cat((lands / 2, (self._columns(drops) - self.low) / self.width), 1)

    @staticmethod
    def _columns(drops: Impacts) -> Float[Tensor, "n s"]:
        return torch.cat((drops.q[:, : drops.space.d - 1], drops.v_pre), 1)


# --- What is known ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Belief:
    """What is known of the outcomes of drops.

    Args:
        models: in question, none before a diagnosis.
        means: of v_post by each at the states.
        slopes: derivatives of it in the parameters of each, with their covariances.
        noise: covariance of v_post at the states, of instrument and scatter.
        candidates: effects that may be missing, about several models.
        silent: effects that surely change no outcome.
        unexplained: predictable variance that no model explains, in squares of the noise.
    """

    models: tuple[PossibleModel, ...]
    means: Float[Tensor, "m n D"]
    slopes: tuple[tuple[Float[Tensor, "n D k"], Float[Tensor, "k k"]], ...]
    noise: Float[Tensor, "n D D"]
    candidates: tuple[Candidates, ...]
    silent: set[str]
    unexplained: float

    @property
    def probability(self) -> Float[Tensor, "m"]:
        return torch.tensor([model.probability for model in self.models], dtype=torch.float64)

    @property
    def hidden(self) -> tuple[str, ...]:
        """Effects of the catalogue that no drop shows."""
        shown = set[str]().union(*(candidate.shown() for candidate in self.candidates))
        every = {name for candidate in self.candidates for name in candidate.names} - {"mu", "eps"}
        return tuple(sorted(self.silent | (every - shown)))

    @property
    def possibilities(self) -> tuple[Possibility, ...]:
        """Names in question, the most probable first."""
        probability = dict[tuple[str, ...], float]()
        for model in self.models:
            names = tuple(sorted(model.names))
            probability[names] = probability.get(names, 0.0) + model.probability
        ordered = sorted(probability.items(), key=lambda item: -item[1])
        return tuple(Possibility(effects=names, probability=p) for names, p in ordered)


def _belief(diagnosis: Diagnosis | None, measured: Impacts | None, drops: Impacts, rig: Rig) -> _Belief:
    """What a diagnosis, measurements, or a rig alone tell."""
    stated = torch.tensor(rig.noise or NOISE[drops.space], dtype=torch.float64).square().diag()
    exact = {"v_pre_cov": None, "v_post_cov": None, "outcome_cov": None, "outcome_shift": None}  # for a linearisation
    plain = None if measured is None else measured.replace(**exact)
    added, silent = visible(drops)
    if diagnosis is None:
        noise, law = stated.expand(len(drops), -1, -1), all_laws(drops.space)[0]
        usual = (ContactModel(law.at(mu, eps)) for mu, eps in _COEFFICIENTS)
        about = tuple(Candidates.about(one, added, drops, noise, plain, stated) for one in usual)
        return _Belief(
            models=(), means=drops.v_pre[None], slopes=(), noise=noise, candidates=about, silent=silent, unexplained=1.0
        )
    assert plain is not None
    chosen = diagnosis.model
    spread = robust_covariance(plain.v_post - chosen.outcome(plain).v_post)
    told = chosen.predict(drops).covariance if chosen.law_model.scatter else None
    noise = spread.expand(len(drops), -1, -1) if told is None else told
    models = hypotheses(diagnosis)
    left = 0.0 if diagnosis.remainder is None else min(max(diagnosis.remainder.share.mean, 0.0), 0.9)
    whole = models[0].model
    given = {one.name: whole.effects[one.name] for one in diagnosis.given if one.name in whole.effects}
    bare = ContactModel(whole.law, effects=given)  # about which the effects that were found are in question too
    about = tuple(Candidates.about(one, added, drops, noise, plain, spread) for one in (whole, bare))
    return _Belief(
        models=models,
        means=torch.stack([one.model.outcome(drops).v_post for one in models]),
        slopes=tuple(parameter_slopes(one.model, drops) for one in models),
        noise=noise,
        candidates=about,
        silent=silent,
        unexplained=left / (1 - left),
    )


def _criteria(
    belief: _Belief, features: _Features, drops: Impacts, measured: Impacts | None
) -> dict[Purpose, Criterion]:
    """The criteria of all purposes that there are."""
    places = features(drops)[::_REPEATS]
    some = measured if measured is None or len(measured) <= _MEASURED else measured[-_MEASURED:]
    space = SpaceFilling.of(places, places[:0] if some is None else features(some))
    effects = MeanCriterion(criteria=tuple(EffectSeparation.of(one, repeats=_REPEATS) for one in belief.candidates))
    criteria: dict[Purpose, Criterion] = {Purpose.SPACE: space, Purpose.EFFECTS: effects}
    if not belief.models:
        return criteria
    slopes, covariances = zip(*belief.slopes, strict=True)
    root, most = torch.linalg.cholesky(belief.noise), max(c.shape[-1] for c in covariances)
    white = [torch.linalg.solve_triangular(root, one, upper=False).nan_to_num(0.0, 0.0, 0.0) for one in slopes]
    parameters = ParameterInformation(
        slope=torch.stack([pad(one, (0, most - one.shape[-1])) for one in white]),
        covariance=torch.stack([pad(one, (0, most - one.shape[-1]) * 2) for one in covariances]),
        probability=belief.probability,
        repeats=_REPEATS,
    )
    criteria[Purpose.PARAMETERS] = parameters
    criteria[Purpose.PREDICTION] = PredictionVariance(
        parameters=parameters, space=space, unexplained=belief.unexplained
    )
    if len({model.names for model in belief.models}) > 1:
        criteria[Purpose.NAMES] = NameInformation.of(
            belief.means,
            slopes,
            covariances,
            belief.noise,
            names=[model.names for model in belief.models],
            probability=belief.probability,
            repeats=_REPEATS,
        )
    return criteria


# --- The batch ----------------------------------------------------------------------------------


def _greedy(
    criteria: Mapping[Purpose, Criterion], schedule: Sequence[Purpose], settings: _Settings, rig: Rig, count: int
) -> tuple[list[int], list[Purpose]]:
    """Choose drops one by one, each the best after those before it, and what it is for."""
    picked, purposes = list[int](), list[Purpose]()
    costly = {name: one.cost for name, one in rig.limits.items() if one.chosen and one.cost}
    criteria = {one: criteria[one] for one in dict.fromkeys((*schedule, Purpose.EFFECTS)) if one in criteria}
    for made in range(count):
        purpose = schedule[made % len(schedule)]
        gain = criteria[purpose].gain() if purpose in criteria else None
        if gain is None or (purpose is Purpose.NAMES and gain.max() < _NATS):
            purpose, gain = Purpose.EFFECTS, criteria[Purpose.EFFECTS].gain()
        price = torch.ones_like(gain)
        for name, cost in costly.items():
            value = settings.values[name]
            price += cost * ~torch.isin(value, value[picked])
        worth = gain.clamp_min(0.0) / price
        worth[picked] = -1.0
        best = int(worth.argmax())
        picked.append(best)
        purposes.append(purpose)
        criteria = {one: criterion.after(best) for one, criterion in criteria.items()}
    return picked, purposes


def _ordered(rig: Rig, settings: _Settings, picked: Sequence[int]) -> list[int]:
    """The order of the drops in which what is costly to set, the costliest first, changes least."""
    costly = sorted((one.cost, name) for name, one in rig.limits.items() if one.chosen and one.cost)[::-1]
    return sorted(range(len(picked)), key=lambda k: [settings.values[name][picked[k]].item() for _, name in costly])


# --- The forecast -------------------------------------------------------------------------------


def _forecast(
    criteria: Mapping[Purpose, Criterion], belief: _Belief, goal: Goal | None, picked: Sequence[int]
) -> Forecast:
    """What is known after the batch, and after more like it."""
    names, parameters, prediction = (
        criteria.get(one) for one in (Purpose.NAMES, Purpose.PARAMETERS, Purpose.PREDICTION)
    )
    names = names.at(picked) if isinstance(names, NameInformation) else None
    right, error, after = list[float](), list[float](), list[Tensor]()
    for batch in range(_BATCHES + 1):
        for k, row in enumerate(picked if batch else ()):
            names = None if names is None else names.after(k)
            parameters = None if parameters is None else parameters.after(row)
            prediction = None if prediction is None else prediction.after(row)
        if names is not None:
            right.append(names.right())
        if isinstance(parameters, ParameterInformation) and isinstance(prediction, PredictionVariance):
            error.append(prediction.error())
            after.append(parameters.covariance[0].diagonal().clamp_min(0.0).sqrt())
    gains = {
        Goal.NAMES: [b - a for a, b in pairwise(right)] or [0.0],
        Goal.PARAMETERS: [1 - _ratio(a, b) for a, b in pairwise(after)],
        Goal.PREDICTION: [1 - b / a if a else 0.0 for a, b in pairwise(error)],
    }
    worth = next((k for k, gain in enumerate(gains[goal]) if gain < WORTHWHILE[goal]), None) if goal else None
    chosen = belief.models[0].model if belief.models else None
    return Forecast(
        drops=tuple(len(picked) * batch for batch in range(_BATCHES + 1)),
        right_name=tuple(right),
        error=tuple(error),
        parameters=() if chosen is None else _parameters(chosen, after),
        gain=gains[goal][0] if goal else None,
        worthwhile=None if worth is None else len(picked) * worth,
    )


def _ratio(before: Float[Tensor, "k"], after: Float[Tensor, "k"]) -> float:
    """Mean ratio of the errors of parameters."""
    known = before > 0
    return (after[known] / before[known]).log().mean().exp().item() if known.any() else 1.0


def _parameters(model: ContactModel, errors: Sequence[Float[Tensor, "k"]]) -> tuple[ParameterForecast, ...]:
    """The parameters of the chosen model with their errors now and after the batch."""
    law = model.law
    rows = [("mu", "μ", "–", law.mu), ("eps", "ε", "–", law.eps)]
    rows += [
        (f"{name}.{p.name}", p.symbol, p.unit, value)
        for name, effect in model.effects.items()
        for p, value in zip(effect.parameters, effect.values, strict=True)
    ]
    return tuple(
        ParameterForecast(name=name, symbol=symbol, unit=unit, value=float(value), error=a, error_after=b)
        for (name, symbol, unit, value), a, b in zip(rows, errors[0].tolist(), errors[1].tolist(), strict=False)
    )
