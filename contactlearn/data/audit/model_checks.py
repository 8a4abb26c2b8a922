"""Checks of the measurements against fitted models: outliers, and measurements that noise dominates.

**Outliers** are trials that a model makes all but impossible, and spins of the wrong sign.  The residual of v_post has
a multivariate Student's t distribution, whose scatter and degrees of freedom are fitted to it, so that heavy tails are
no outliers.  Where covariances are stated, residuals are in units of them (`noise_weight`).  A trial is an outlier

    where fewer than `false_outliers` trials of the whole table would have so large a residual by chance, or
    in the plane, where another sign of ω before or after impact makes it so much more likely that fewer would by
    chance: the ratio of the densities exceeds its threshold c in at most 1/c of ordinary trials (Markov), whatever
    their distribution.

**Averaging**: a law that is given velocities that vary by no more than their noise (a constant height of the drops, no
spin) predicts worse than one that is given their mean, and an effect that weakens the dependence on them looks as if
it were missing (regression dilution).  Where the spread of a column is not much larger than the residual of flexible
models in the outcome, its mean replaces it if the law then predicts held-out trials at least as well.  So do contact
points of a stated shape in place of measured ones, whose noise looks like a dependence on the lever.
Source: Carroll, Ruppert, Stefanski & Crainiceanu 2006, Ch. 4: the limit of regression calibration.
"""

import math
from collections.abc import Callable, Iterator

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE, mahalanobis
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.noise_weight import noise_weight
from contactlearn.mechanics.rigid_body import orientation_of
from contactlearn.mechanics.space import PLANE, SPACE

_FREEDOM = (2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 100.0)  # of the t distributions that are tried
_ROUNDS = 30
_LISTED = 5  # trials that a sentence names
_NOISY_SPREAD = 1.5  # standard deviation of a velocity before impact over the residual of flexible models after it
_COMPUTED = 1e-4  # of the radius of gyration, up to which contact points are those of the shape but for rounding
_SAME_SPEED = 0.15  # relative spread of |v_y| up to which it may be one speed with noise; a camera at 30 Hz makes 0.1
_SAME_STATE = 1e-3  # m/s, rad/s, or of the radius of gyration, by which states differ that are not one
_FLIPPED = {"spin after": "after", "spin before": "before"}


def find_model_outliers(
    impacts: Impacts,
    predict: Callable[[Impacts], Float[Tensor, "n D"]],
    thresholds: AuditThresholds = AuditThresholds(),
) -> Finding | None:
    """Find the outliers of a model; None where there are none.

    Args:
        impacts: measurements.
        predict: v_post in (m/s, m/s, rad/s) by the model, of impacts.
        thresholds: with the number of false outliers that is expected in a table.
    """
    from scipy.special import fdtrc  # SciPy takes long to load

    residual, weight = impacts.v_post - predict(impacts), noise_weight(impacts, "velocity")
    weight = torch.ones_like(residual) if weight is None else weight
    centre, scatter, freedom = _fitted(weight * residual)
    distance = mahalanobis(weight * residual - centre, scatter)
    D = impacts.space.D
    chance = torch.from_numpy(fdtrc(D, freedom, (distance / D).numpy()))
    bad, signs = chance * len(impacts) < thresholds.false_outliers, dict[int, str]()
    if impacts.space is PLANE:
        flips = _flipped(impacts, predict)
        flipped = torch.stack([mahalanobis(weight * one - centre, scatter) for one in flips.values()])
        gains = 0.5 * (freedom + D) * ((freedom + distance) / (freedom + flipped)).log()  # log ratio of the densities
        gains = gains.nan_to_num(nan=-math.inf)  # where the flip is not predicted
        wrong = gains > math.log(len(flips) * len(impacts) / thresholds.false_outliers)
        which, bad = gains.argmax(0), bad | wrong.any(0)
        signs = {row: list(_FLIPPED)[which[row]] for row in wrong.any(0).nonzero()[:, 0].tolist()}
    if not bad.any():
        return None
    return _finding(impacts, residual, bad, signs, freedom)


def _finding(
    impacts: Impacts, residual: Float[Tensor, "n D"], bad: Bool[Tensor, " n"], signs: dict[int, str], freedom: float
) -> Finding:
    """The outliers in words, those with a spin of the wrong sign first."""
    rows = bad.nonzero()[:, 0].tolist()
    texts = []
    for row in sorted(rows, key=lambda row: (row not in signs, row))[:_LISTED]:
        d, off = impacts.space.d, [f"{value:+.2g}" for value in residual[row].tolist()]
        name = f"row {row + 1} (trial {impacts.trial[row]!r})"
        if row in signs:
            when = _FLIPPED[signs[row]]
            spin = (impacts.v_post if when == "after" else impacts.v_pre)[row, 2].item()
            texts.append(f"the spin of {name} {when} impact, {spin:+.3g} rad/s, has the wrong sign")
        else:
            spins = ", ".join(off[d:]) if impacts.space is SPACE else f"{residual[row, 2].item():+.3g}"
            spins = f"({spins})" if impacts.space is SPACE else spins
            texts.append(f"{name} is off by ({', '.join(off[:d])}) m/s and {spins} rad/s")
    more = f" and {len(rows) - _LISTED} more" if len(rows) > _LISTED else ""
    are = "is an outlier" if len(rows) == 1 else "are outliers"
    sentence = f"{len(rows)} of {len(impacts)} trials {are} of the model: {'; '.join(texts)}{more}"
    evidence = evidence_of(
        ("trials", float(len(rows)), "trials"),
        ("rows", ", ".join(str(row + 1) for row in rows)),
        ("wrong_sign", ", ".join(str(row + 1) for row in signs) or "none"),
        ("degrees_of_freedom", freedom),
    )
    return Finding(name="model_outliers", sentence=sentence, evidence=evidence, mistake=False)


def _flipped(impacts: Impacts, predict: Callable[[Impacts], Float[Tensor, "n D"]]) -> dict[str, Float[Tensor, "n D"]]:
    """Residuals with the other sign of ω after impact, and before it."""
    mirror = torch.tensor((1.0, 1.0, -1.0), dtype=torch.float64)
    after = impacts.v_post * mirror - predict(impacts)
    before = impacts.v_post - predict(impacts.replace(v_pre=impacts.v_pre * mirror, validate=False))
    return {"spin after": after, "spin before": before}


def _fitted(residual: Float[Tensor, "n D"]) -> tuple[Float[Tensor, " D"], Float[Tensor, "D D"], float]:
    """Centre, scatter and degrees of freedom of a multivariate t distribution, by expectation–maximisation for each."""
    best, chosen, D = -math.inf, None, residual.shape[1]
    # Of exact data, and of a component that follows from the others, as a spin that was computed does.
    least = torch.diag(1e-9 * residual.var(0) + 1e-18)
    for freedom in _FREEDOM:
        centre, scatter = residual.median(0).values, torch.cov(residual.mT) + least
        for _ in range(_ROUNDS):
            weight = (freedom + D) / (freedom + mahalanobis(residual - centre, scatter))
            centre = (weight[:, None] * residual).sum(0) / weight.sum()
            off = residual - centre
            scatter = (weight[:, None] * off).mT @ off / len(off) + least
        tails = (1 + mahalanobis(residual - centre, scatter) / freedom).log().mean()
        constant = math.lgamma((freedom + D) / 2) - math.lgamma(freedom / 2) - D / 2 * math.log(freedom)
        likelihood = (constant - 0.5 * (scatter.logdet() + (freedom + D) * tails)).item()  # nats a trial
        if likelihood > best:
            best, chosen = likelihood, (centre, scatter, freedom)
    assert chosen is not None
    return chosen


_COLUMNS = (("averaged_vx", "v_x", "m/s"), ("averaged_vy", "v_y", "m/s"), ("averaged_omega", "ω", "rad/s"))


def noise_notes(
    impacts: Impacts,
    predicted: Float[Tensor, "n D"],
    held_out: Callable[[Impacts], float],
) -> tuple[Finding, ...]:
    """Find measurements that noise dominates: contact points of the shape, or a mean, serve the law at least as well.

    Args:
        impacts: measurements.
        predicted: v_post in (m/s, m/s, rad/s) by flexible models on held-out trials, nan where there is none.
        held_out: error of the law on held-out trials, from the impacts.

    Returns:
        A note for the contact points, and in the plane for each such velocity, with its correction.
    """
    found, error = [], None
    for name, said, spread, unit in (*_doubted_contact(impacts), *_doubted_velocities(impacts, predicted)):
        error = held_out(impacts) if error is None else error
        changed = correct(impacts, [name])
        without = held_out(changed)
        if without <= error:
            sentence = (
                f"{CORRECTIONS[name].description}: {said} {spread:.2g} {unit}; replaced, they leave the law an error "
                f"of {without:.4g} on held-out trials, as measured {error:.4g}"
            )
            evidence = evidence_of(("spread", spread, unit), ("error_before", error), ("error_after", without))
            found.append(Finding(name=name, sentence=sentence, evidence=evidence, correction=name, mistake=False))
            impacts, error = changed, without
    return tuple(found)


def one_state_notes(impacts: Impacts) -> tuple[Finding, ...]:
    """Note that all trials begin in one state, once means have replaced what noise dominates; nothing is corrected."""
    differences = torch.cat((impacts.v_pre.std(0), impacts.r.std(0) / impacts.scales[0]))
    if (differences > _SAME_STATE).any():
        return ()
    sentence = (
        "all trials begin in one state, within its noise: they show one outcome, and neither how it depends on "
        "speed, slip and spin nor which law is right; μ and ε are those that this law needs there; vary speed, "
        "angle and spin"
    )
    return (Finding(name="one_state", sentence=sentence, evidence=(), mistake=False),)


_Doubt = tuple[str, str, float, str]  # a correction, the words before a spread, and that spread with its unit


def _doubted_contact(impacts: Impacts) -> Iterator[_Doubt]:
    """Measured contact points beside a shape."""
    if impacts.shape is not None:
        off = impacts.r - contact_points(impacts.shape, impacts.body, orientation_of(impacts.q))
        spread = off.norm(dim=-1).median().item()
        if spread > _COMPUTED * impacts.scales[0]:
            yield "contact_from_shape", "the measured ones are off by a median of", 1e3 * spread, "mm"


def _doubted_velocities(impacts: Impacts, predicted: Float[Tensor, "n D"]) -> Iterator[_Doubt]:
    """Velocities before impact that vary by little more than what models of the outcome leave; none in space."""
    residual = MAD_SCALE * (impacts.v_post - predicted).abs().nanmedian(0).values
    for k, (name, letter, unit) in enumerate(_COLUMNS if impacts.space is PLANE else ()):
        spread = impacts.v_pre[:, k].std().item()
        if not 0 < spread < _NOISY_SPREAD * residual[k].item():
            continue
        if letter == "v_y" and spread > _SAME_SPEED * impacts.v_pre[:, k].mean().abs().item():
            continue
        yield name, f"{letter} has a standard deviation of", spread, unit
