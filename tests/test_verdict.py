"""The verdict is a function of the budget and of the names, and no combination contradicts itself."""

from dataclasses import replace

import numpy as np
import pytest
from diagnoses import made_up, remainder

from contactlearn.diagnosis.error_budget import NoiseFloor, error_budget, verdict
from contactlearn.diagnosis.result import ErrorLimits, Finding, Level, NoiseSource, Verdict, clearly_better
from contactlearn.diagnosis.stages import trust_balance
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text import headline, phrase, support

MUCH = Thresholds().form_error
NAMES = EffectId("surface_tilt", "computed"), EffectId("spin_damping", "after")


def around(mean: float, width: float) -> Interval:
    return Interval(mean, mean * (1 - width), mean * (1 + width))


def random_case(rng: np.random.Generator):
    """A budget whose errors have the only order that a ladder guarantees, and what the search tells beside it."""
    width = rng.uniform(0.01, 0.2)
    base = rng.uniform(0.01, 0.5)
    named = base * rng.choice([1.0, rng.uniform(0.05, 1.0)])
    with_candidates = rng.choice([None, named * rng.uniform(0.3, 1.0)])
    flexible, floor = named * rng.uniform(0.3, 1.1), named * rng.uniform(0.05, 1.5)
    source = NoiseSource(rng.choice([str(one) for one in NoiseSource]))
    budget = error_budget(
        ErrorLimits(base=around(base, width), ceiling=around(flexible, width), bound=around(base / 2, width)),
        base=around(base, width),
        named=around(named, width),
        flexible=around(flexible, width),
        floor=NoiseFloor(error=around(floor, width), source=source),
        with_candidates=with_candidates,
    )
    flags = {name: bool(rng.integers(2)) for name in ("named", "predictable", "complete")}
    return budget, flags


def test_no_verdict_contradicts_its_budget():
    rng, seen = np.random.default_rng(0), set()
    found = made_up(12, *NAMES)
    for _ in range(2000):
        budget, flags = random_case(rng)
        flags["better_law"] = clearly_better(found.laws, budget.named.mean, Thresholds()) is not None
        physics = verdict(budget, **flags, thresholds=Thresholds())
        shares = budget.shares
        seen.add(physics)
        if physics is Verdict.NONE:
            assert shares.unnamed <= MUCH
            assert not flags["predictable"] or flags["better_law"]
            limit = 2 * MUCH if budget.noise_source is NoiseSource.ESTIMATED else MUCH
            exceeds = budget.noise is not None and budget.named.low > budget.noise.high
            assert not (exceeds and shares.left > limit)
        if shares.noise is not None:
            assert shares.noise * budget.base.mean <= min(budget.flexible.mean, budget.named.mean) * (1 + 1e-12)
            assert shares.noise + shares.explained + shares.left == pytest.approx(1.0)
        missing = tuple(
            replace(one, confidence=p, level=Level.of(p)) for one, p in zip(found.missing, (0.95, 0.6), strict=True)
        )
        shown = replace(found, physics=physics, budget=budget, missing=missing if flags["named"] else ())
        text = headline(shown)
        assert ("no effect missing" in text) == (physics is Verdict.NONE and not flags["named"])
        assert ("unknown" in text or "does not describe" in text) == (physics is Verdict.UNKNOWN), text
        assert ("is missing from Wang–Mason, and probably" in text) <= flags["named"]
        assert ("noise floor is unknown" in support(shown)) == (budget.noise is None)
        assert ("rest is noise or unexplained" in phrase("shares", budget)) == (budget.noise is None)
    assert seen == {Verdict.NONE, Verdict.EFFECTS, Verdict.UNKNOWN, Verdict.UNFINISHED}


@pytest.mark.parametrize(("probability", "level"), [
    (1.0, "found"), (0.9, "found"), (0.8999, "probable"), (0.5, "probable"), (0.4999, "candidate"), (0.0, "candidate"),
])  # fmt: skip
def test_levels(probability, level):
    assert Level.of(probability) == level


def test_a_verdict_without_names_says_what_could_be_hidden():
    found = replace(made_up(12), missing=(), physics=Verdict.NONE, hidden=0.031)
    assert headline(found).replace("\u00a0", " ").endswith("one that removes up to 3 % of its error could be hidden.")
    assert "hidden" not in headline(replace(found, remainder=remainder(Interval(0.05, 0.02, 0.08))))


def test_effects_that_are_found_explain_an_open_balance():
    opened = Finding(name="moment_balance_open", sentence="it does not close", evidence=())
    found = replace(made_up(12, *NAMES), verdict=Verdict.BAD_DATA, findings=(opened,))
    sure = trust_balance(found)
    assert (sure.verdict, sure.findings[0].mistake) == (Verdict.EFFECTS, False)
    unsure = replace(found, missing=tuple(replace(one, level=Level.PROBABLE) for one in found.missing))
    assert trust_balance(unsure) is unsure
    other = replace(found, findings=(opened, replace(opened, name="contradictions")))
    assert trust_balance(other).verdict is Verdict.BAD_DATA
