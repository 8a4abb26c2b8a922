"""Structure before scatter: do the deviations of single impacts depend on anything that is known of them?

What looks like scatter may be a dependence that nobody models: one that turns over every ten degrees of orientation,
a wiggle over a velocity, a memory of the last impact.  The estimated deviations û_k of each component (`Scatter.each`)
are tested like residuals, by random signs of all trials (`sign_flips`):

    state      sums of û_k times cosines over v_n, v_t, ω, x, harmonics of θ, and products of two (`state_dependence`)
    pose       harmonics of the orientation up to a period of nine degrees; in space of the angles between the normal
               and the body's axes
    heading    in space as many harmonics of the direction of the slip, as a weave has
    order      spread of sums over windows of 2, 4, 8 … trials, and the peak of the periodogram
    history    sums of û_k times quantities of earlier impacts (`serial_dependence`)

û_k is its variance times Gᵀ S⁻¹ r, the score of a component that follows the tested function: an impact that shows
nothing of a component counts for nothing.  All statistics are compared together, so that the level holds for all.
"""

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
from contactlearn.inference.identification.scatter import Scatter
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.mechanics.space import PLANE

_POSE, _HEADING = "pose", "heading"
_SERIAL = {"order", "period"}
_HARMONICS = 40  # of an orientation or a heading: a period of nine degrees
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
            matching = functions[:, [n == variable and (n not in (_POSE, _HEADING) or k == order) for n, k, _ in named]]
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
        followed = {dependence.variable for dependence in dependences if dependence.component == name}
        following = functions[:, [variable in followed for variable, *_ in named]]
        if followed and 0 < following.shape[1] < len(u) - 1 and not followed & _SERIAL:
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
    for variable, angle in _angles(impacts):
        for k in range(1, _HARMONICS + 1):
            yield variable, k, (k * angle).cos()
            yield variable, k, (k * angle).sin()
    for memory, values in histories(impacts, scatter.model.base_prediction(impacts)).items():
        yield f"{memory.variable} of earlier impacts", memory.trials, values


def _angles(impacts: Impacts) -> list[tuple[str, Float[Tensor, " n"]]]:
    """Orientation in rad, in space the angles between the normal and the body's axes, and the direction of the slip."""
    if impacts.space is PLANE:
        return [(_POSE, impacts.q[:, 2])]
    tilts = [(_POSE, up.clamp(-1, 1).acos()) for up in rotation(impacts.q[:, 3:])[:, 2].unbind(-1)]
    return [*tilts, (_HEADING, torch.atan2(impacts.v_c[:, 1], impacts.v_c[:, 0]))]
