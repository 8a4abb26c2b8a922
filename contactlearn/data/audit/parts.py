"""Part of a table in other units or axes than the rest: another session, operator or script.

    gain[i] = contradictions of trial i as given − under a hypothesis of `conventions`

No hypothesis about the whole table explains it.  A part is a run of trials in their order, those of one object, or
those of a named group of a covariate: there the hypothesis must gain, and elsewhere lose.  Which rows are right is for
the user to say, so the data are refused and nothing is corrected.
"""

import math
from collections.abc import Callable, Iterable, Iterator

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.conventions import (
    BALANCED,
    EXPLAINED,
    FITTED,
    ConventionComparison,
    Hypothesis,
    combinations,
)
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.moments import Columns, torque
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.mechanics.bodies import numbered
from contactlearn.mechanics.impacts import Impacts

_DEPTH = 2  # corrections of a part at once
_FINALISTS = 8  # hypotheses of the largest gain whose parts are looked for
_COMPARED = 400  # trials on which hypotheses are compared, spread evenly over the order
_MIN_TRIALS, _MIN_SHARE = 8, 0.04  # of a part, and of the rest
_GAIN, _SIGMAS = 0.15, 5.0  # fall of the contradictions in the part, and rise in the rest, and their standard errors
_EXPLAINED = 0.1  # contradictions up to which one hypothesis explains all trials, but for a few
_LEFT, _LEFT_SHARE = 0.15, 0.5  # contradictions that both parts may leave together, and of those that they had


def mixed_findings(comparison: ConventionComparison, every: Callable[[], Iterable[Impacts]]) -> list[Finding]:
    """Find a part of the trials with other units or axes than the rest; fatal.

    Args:
        comparison: of hypotheses about some of the trials.
        every: all trials, in blocks, among which the ends of the part are.
    """
    given, best = comparison.given, comparison.best
    explained = best.names and best.score < _EXPLAINED  # what is left of all trials can be in a part only
    bases = [best] if explained or not best.names else [given, best]
    return next((found for base in bases if (found := _mixed(base, every))), [])


def _mixed(base: Hypothesis, every: Callable[[], Iterable[Impacts]]) -> list[Finding]:
    order = base.impacts.order.argsort(stable=True)
    spread = torch.linspace(0, len(order) - 1, min(len(order), _COMPARED)).round().long()
    impacts = base.impacts[order[spread]]
    given = _by_trial(Columns.of(impacts))[0]
    if given.mean() < _GAIN * _MIN_SHARE:
        return []
    for depth in range(1, _DEPTH + 1):
        names, columns = combinations(impacts, depth, base.thresholds)
        gains = given - _by_trial(columns)
        found = list[tuple[float, tuple[str, ...], str, float]]()  # words are empty for a run of trials
        for k in gains.clamp_min(0).sum(-1).argsort(descending=True)[:_FINALISTS].tolist():
            if FITTED.intersection(names[k]):
                continue
            for part, words in _parts(impacts, gains[k]):
                left = torch.where(part, given - gains[k], given).mean().item()
                few = left < min(_LEFT, _LEFT_SHARE * given.mean().item())
                if few and _differs(gains[k], part) and _explains(impacts[part], names[k]):
                    found.append((left, names[k], words, part.double().mean().item()))
        if found:
            left, best, words, share = min(found)
            words, share = (words, share) if words else _run_of(every, base.names, best)
            return [_finding(base, best, words, share, given.mean().item(), left)]
    return []


def _run_of(
    every: Callable[[], Iterable[Impacts]], names: tuple[str, ...], of_part: tuple[str, ...]
) -> tuple[str, float]:
    """Name the run of all trials in which corrections of a part gain, and its share."""
    gains, orders = list[Tensor](), list[Tensor]()
    for block in every():
        given = correct(block.replace(validate=False), names)
        gains.append((_by_trial(Columns.of(given)) - _by_trial(Columns.of(correct(given, of_part))))[0])
        orders.append(block.order)
    order = torch.cat(orders).argsort(stable=True)
    first, end = _best_run(torch.cat(gains)[order])
    trials = list[str]()
    for row in order[[first, end - 1]].tolist():
        for block, gain in zip(every(), gains, strict=True):
            if 0 <= row < len(gain):
                trials.append(block.trial[row])
            row -= len(gain)
    return f"in trials {trials[0]!r} to {trials[1]!r}", (end - first) / len(order)


def _explains(part: Impacts, names: tuple[str, ...]) -> bool:
    """Whether units explain the spins of a part, and do not merely shrink them."""
    return not BALANCED.intersection(names) or torque(correct(part, names)).explained.item() > EXPLAINED


def _finding(base: Hypothesis, names: tuple[str, ...], words: str, share: float, given: float, left: float) -> Finding:
    """The finding of a part, in words of the whole table."""
    mistake = " and ".join(CORRECTIONS[name].description for name in names)
    beside = f", beside {base} in all" if base.names else ""
    sentence = (
        f"the table mixes units or axes: {words} ({share:.0%} of the trials) {mistake}, elsewhere not"
        f"{beside}: the contradictions per trial fall from {given:.2f} to {left:.2f} if these trials alone are "
        "corrected; convert them, or read the two parts as tables of their own"
    )
    evidence = evidence_of(("share", share), ("contradictions_before", given), ("contradictions_after", left))
    return Finding(name="mixed_units", sentence=sentence, evidence=evidence, fatal=True)


def _by_trial(columns: Columns) -> Float[Tensor, "*batch n"]:
    """Sum of the contradictions of each trial, without the one that is about all of them."""
    answers = contradictions(columns)
    return torch.stack([answer for question, answer in answers.items() if question != "units"]).sum(0)


def _differs(gain: Float[Tensor, " n"], part: Bool[Tensor, " n"]) -> bool:
    """Whether a hypothesis clearly gains in a part, and clearly loses in the rest."""
    least = max(_MIN_TRIALS, _MIN_SHARE * len(gain))
    for inside, sign in ((part, 1.0), (~part, -1.0)):
        some = sign * gain[inside]
        if len(some) < least or some.mean() < _GAIN or some.mean() < _SIGMAS * some.std() / math.sqrt(len(some)):
            return False
    return True


def _parts(impacts: Impacts, gain: Float[Tensor, " n"]) -> Iterator[tuple[Bool[Tensor, " n"], str]]:
    """Yield the run of trials, the objects and the groups in which a hypothesis gains; groups with their names."""
    first, end = _best_run(gain)
    place = torch.arange(len(gain))
    if end > first:
        yield (place >= first) & (place < end), ""
    groups = {"object": impacts.object} | {
        name: values for name, values in impacts.covariates.items() if isinstance(values, tuple)
    }
    for name, values in groups.items():
        which = numbered(values)
        mean = torch.zeros(int(which.max()) + 1, dtype=gain.dtype).index_add(0, which, gain)
        inside = [value for value in dict.fromkeys(values) if mean[which[values.index(value)]] > 0]
        if 0 < len(inside) < len(mean):
            yield mean[which] > 0, f"in trials of {name} {', '.join(map(repr, inside))}"


def _best_run(gain: Float[Tensor, " n"]) -> tuple[int, int]:
    """First trial of the run of the largest gain, and the one after its last."""
    total = torch.cat((gain.new_zeros(1), gain.cumsum(0)))
    lowest = total.cummin(0)
    end = int((total - lowest.values).argmax())
    return int(lowest.indices[end]), end
