"""Structure before scatter: do the deviations of single impacts depend on anything that is known of them?

What looks like scatter may be a dependence that nobody models: one that turns over every ten degrees of orientation,
a wiggle over a velocity, a memory of the last impact.  The estimated deviations û_k of each component (`Scatter.each`)
are tested like residuals, by random signs of all trials (`sign_flips`):

    state      sums of û_k times cosines over v_n, v_t, ω, x, harmonics of θ, and products of two (`state_dependence`)
    waves      up to forty periods over the place of the contact, as a corrugation has, in space in four directions;
               over each velocity, and the angle of incidence
    pose       harmonics of the orientation up to a period of nine degrees; in space of the angles between the normal
               and the body's axes, and of the normal's direction about each of them
    heading    in space as many harmonics of the direction of the slip, as a weave has, and in the body's axes
    order      spread of sums over windows of 2, 4, 8 … trials, and the peak of the periodogram
    history    sums of û_k times quantities of earlier impacts (`serial_dependence`)

û_k is its variance times Gᵀ S⁻¹ r, the score of a component that follows the tested function: an impact that shows
nothing of a component counts for nothing.  All statistics are compared together, so that the level holds for all.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result import DeviationDependence
from contactlearn.diagnosis.sign_flips import (
    gamma_neg_log_p,
    gumbel_neg_log_p,
    normal_neg_log_p,
    periodogram_peak,
    random_signs,
    screened,
    window_spread,
)
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.serial_dependence import histories
from contactlearn.diagnosis.unexplained.state_dependence import screened_functions, state_variables
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.inference.identification.scatter import Scatter
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec, rotation
from contactlearn.mechanics.space import PLANE, SPACE

_POSE, _HEADING = "pose", "heading"
_SERIAL = {"order", "period"}
_ANGLES = _POSE, _HEADING
_PERIODIC = ", periodically"  # ends the name of any other variable that waves run over
_VELOCITIES = {PLANE: ("vn", "vt", "omega"), SPACE: ("vn", "slip", "spin", "twist")}
_ENDS = 0.02, 0.98  # quantiles of a variable between which its longest wave has a period
_ROUNDING = 1e-9  # of a variable, up to which it never varies
_HARMONICS = 40  # of an orientation or a heading: a period of nine degrees; periods of waves
_TRIALS = 1500  # that are tested, at most
_MAX_DEPENDENCES = 3  # dependences of each component, the most significant ones


def screen_deviations(
    scatter: Scatter, impacts: Impacts, thresholds: Thresholds = Thresholds()
) -> tuple[DeviationDependence, ...]:
    """Find what the deviations of each component depend on, most significant first; nothing is scatter.

    Args:
        scatter: estimated from these impacts.
        impacts: measurements.
        thresholds: the level of the test, `dependence_level`.
    """
    rows = impacts.order.argsort(stable=True)[-_TRIALS:]
    ordered, signs = impacts[rows], random_signs(len(rows))
    columns = [(name, part[rows]) for name, (u, _) in scatter.each.items() for part in u.unbind(-1)]
    if not columns:
        return ()
    named = list(_tested(ordered, scatter))
    functions = torch.stack([function - function.mean() for *_, function in named], -1)
    statistics: list[Tensor] = []
    labels: list[tuple[int, str, float]] = []
    for column, (_, u) in enumerate(columns):
        statistics.append(normal_neg_log_p(signs @ (u[:, None] * functions)))
        labels += [(column, variable, order) for variable, order, _ in named]
        flipped = (signs * u)[..., None]
        spread, (peak, halves) = window_spread(flipped)[..., 0], periodogram_peak(flipped)
        statistics += [gamma_neg_log_p(spread), gumbel_neg_log_p(peak)]
        labels += [(column, "order", 2.0 ** (k + 1)) for k in range(spread.shape[1])]
        labels.append((column, "period", 2 * len(u) / int(halves[0])))
    p_value, refuting = screened(torch.cat(statistics, 1), thresholds.dependence_level)
    best: dict[tuple[str, str], DeviationDependence] = {}
    for k in refuting:
        column, variable, order = labels[k]
        component, u = columns[column]
        count = sum(dependence.component == component for dependence in best.values())
        if (component, variable) not in best and count < _MAX_DEPENDENCES:
            # An angle has more harmonics than there may be trials: its share is that of the strongest one.
            matching = functions[:, [n == variable and (not _waves(n) or k == order) for n, k, _ in named]]
            best[component, variable] = DeviationDependence(
                component=component, variable=variable, order=order, share=_explained(u, matching), p_value=p_value
            )
    return tuple(best.values())


def random_shares(
    scatter: Scatter, impacts: Impacts, dependences: Sequence[DeviationDependence], thresholds: Thresholds
) -> dict[str, float]:
    """Find the share of each component's variance that follows nothing.

    All functions of what its deviations follow are taken from them.  Where the rest still follows something, or what
    it follows is an order whose course is not estimated, no part of the component is random.
    """
    named = list(_tested(impacts, scatter))
    functions = torch.stack([function - function.mean() for *_, function in named], -1)
    rest, shares = dict(scatter.each), dict.fromkeys(scatter.each, 1.0)
    for name, (u, error) in scatter.each.items():
        followed = {d.variable: d.order for d in dependences if d.component == name}
        following = functions[:, [n in followed and (n in _ANGLES or k % followed[n] == 0) for n, k, _ in named]]
        if followed and 0 < following.shape[1] < len(u) - 1 and not followed.keys() & _SERIAL:
            residual, centred = _residual(u, following), u - u.mean(0)
            lost = (len(u) - 1) / (len(u) - following.shape[1] - 1)
            rest[name] = residual, error
            shares[name] = min(1.0, (residual.square().sum() / centred.square().sum() * lost).item())
        elif followed:
            shares[name] = 0.0
    still = screen_deviations(replace(scatter, each=rest), impacts, thresholds)
    return shares | {dependence.component: 0.0 for dependence in still}


def _residual(u: Float[Tensor, "n *k"], functions: Float[Tensor, "n m"]) -> Float[Tensor, "n *k"]:
    """What least squares on functions leave of centred deviations."""
    centred = (u - u.mean(0)).reshape(len(u), -1)
    return (centred - functions @ torch.linalg.lstsq(functions, centred, driver="gelsd").solution).reshape(u.shape)


def _explained(u: Float[Tensor, " n"], functions: Float[Tensor, "n k"]) -> float | None:
    """Adjusted R² of deviations by least squares on functions; None of none."""
    n, k = functions.shape
    if not 0 < k < n - 1:
        return None
    residual, whole = _residual(u, functions).square().sum(), (u - u.mean()).square().sum()
    return 1 - (residual / whole).item() * (n - 1) / (n - k - 1)


def _tested(impacts: Impacts, scatter: Scatter) -> Iterator[tuple[str, float, Float[Tensor, " n"]]]:
    """Variable, order and values of every function that the deviations may follow."""
    for orders, functions in screened_functions(state_variables(impacts)):
        for order, function in zip(orders, functions.unbind(-1), strict=True):
            yield " × ".join(order), max(order.values()), function
    for variable, phase in _phases(impacts):
        for k in range(1, _HARMONICS + 1):
            yield variable, k, (k * phase).cos()
            yield variable, k, (k * phase).sin()
    for memory, values in histories(impacts, scatter.model.base_prediction(impacts)).items():
        yield f"{memory.variable} of earlier impacts", memory.trials, values


def _waves(variable: str) -> bool:
    """Whether the functions of a variable are waves, more than there may be trials."""
    return variable in _ANGLES or variable.endswith(_PERIODIC)


def _phases(impacts: Impacts) -> Iterator[tuple[str, Float[Tensor, " n"]]]:
    """Variables of waves, with the phase in rad of the longest one over each."""
    state, d = State.of(impacts), impacts.space.d
    known, touched = of_state(state), impacts.q[:, : d - 1] + impacts.r[:, : d - 1]
    values = [("x", touched[:, 0]), ("incidence", state.incidence)]
    values += [(name, known[name]) for name in _VELOCITIES[impacts.space]]
    if impacts.space is PLANE:
        yield _POSE, impacts.q[:, 2]
    else:
        turn, slip = rotation(impacts.q[:, 3:]), impacts.v_c * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
        up, along = turn[:, 2], matvec(turn.mT, slip)
        yield _HEADING, torch.atan2(slip[:, 1], slip[:, 0])
        for k in range(3):
            yield _POSE, up[:, k].clamp(-1, 1).acos()
            yield _POSE, torch.atan2(up[:, k - 1], up[:, k - 2])
            yield _HEADING, torch.atan2(along[:, k - 1], along[:, k - 2])
        x, y = touched.unbind(-1)
        values += [("floor_y", y), ("x × floor_y", x + y), ("x × floor_y", x - y)]
    for variable, value in values:
        low, high = value.quantile(torch.tensor(_ENDS, dtype=value.dtype)).tolist()
        if high - low > _ROUNDING * max(abs(low), abs(high)):
            yield variable + _PERIODIC, 2 * math.pi * (value - low) / (high - low)
