"""The verdict is a function of the budget and of the names, and no combination contradicts itself."""

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnoses import made_up, remainder

from contactlearn.diagnosis.error_budget import NoiseFloor, error_budget, verdict
from contactlearn.diagnosis.result import (
    Candidate,
    Coefficient,
    ContactScatter,
    DeviationDependence,
    Diagnosis,
    ErrorLimits,
    Finding,
    Level,
    NoiseSource,
    Rung,
    RungKind,
    ScatterComponent,
    StateDependence,
    VariableShare,
    Verdict,
    clearly_better,
)
from contactlearn.diagnosis.stages import demote_balance
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.scatter import StandardDeviation
from contactlearn.report.text.names import label
from contactlearn.report.text.sentences import grounds, headline, phrase

MUCH = Thresholds().form_error
FRICTION = StateDependence(
    coefficient=Coefficient.FRICTION, variables=(VariableShare(symbol="vx", share=1.0),), p_value=1e-9,
    share=Interval(0.3, 0.2, 0.4), large=False,
)  # fmt: skip
NORMAL = StandardDeviation(name="normal", symbol="σ_φ", unit="rad", value=0.0113, error=0.0007)
SCATTERED = ContactScatter(
    components=(ScatterComponent(deviation=NORMAL, relative=None, share=0.5),), instrument=(), stated=True, trials=200,
    bic=-100.0, confounded=(), dependences=(), converged=True,
)  # fmt: skip
POSE = DeviationDependence(component="normal", variable="pose", order=24, share=0.9, p_value=0.002)
NAMES = EffectId("surface_tilt", "computed"), EffectId("spin_damping", "after")
OTHERS = (EffectId("sampling_delay"),), (EffectId("contact_patch", "linear"), EffectId("gravity_impulse"))


def around(mean: float, width: float) -> Interval:
    return Interval(mean, mean * (1 - width), mean * (1 + width))


def random_diagnosis(found: Diagnosis, rng: np.random.Generator) -> tuple[Diagnosis, bool]:
    """Make up a diagnosis whose errors have the only order that a ladder guarantees, and whose verdict follows them.

    Whether a better law was among those compared is told as well.
    """
    width = rng.uniform(0.01, 0.2)
    base = rng.uniform(0.01, 0.5)
    names = rng.choice([0, 1, 2])
    named = base * rng.uniform(0.05, 1.0) if names else base
    with_candidates = rng.choice([None, named * rng.uniform(0.3, 1.0)])
    flexible, ceiling, floor = (
        named * rng.uniform(0.3, 1.1),
        base * rng.uniform(0.1, 1.1),
        named * rng.uniform(0.05, 1.5),
    )
    source = NoiseSource(rng.choice([str(one) for one in NoiseSource]))
    apart = source is NoiseSource.SCATTER
    budget = error_budget(
        ErrorLimits(base=around(base, width), ceiling=around(ceiling, width), bound=around(base / 2, width)),
        base=around(base, width),
        named=around(named, width),
        flexible=around(flexible, width),
        floor=NoiseFloor(error=around(floor, width), source=source),
        instrument=around(floor * rng.uniform(0.1, 1.0), width) if apart else None,
        with_candidates=with_candidates,
    )
    share = 1 - flexible / named
    left = replace(
        remainder(around(share, 0.1)), large=bool(rng.integers(2)) and share > MUCH,
        state_dependence=rng.choice([None, replace(FRICTION, large=True), FRICTION]),
    )  # fmt: skip
    levels = sorted(rng.uniform(0.5, 1.0, names), reverse=True)
    missing = tuple(
        replace(one, confidence=p, level=Level.of(p))
        if rng.integers(3)
        else replace(one, confidence=p / 2, level=Level.EITHER, alternatives=others, joint_confidence=p)
        for one, p, others in zip(found.missing, levels, OTHERS, strict=False)
    )
    rungs = (
        Rung(kind=RungKind.EFFECT, effect=one.effect, error=error)
        for one, error in zip(missing, [budget.base, budget.named][-names:] if names else [], strict=True)
    )
    candidate = Candidate(
        effect=EffectId("side_drag", "linear"),
        equation="",
        parameters=(),
        error_after=0.1,
        error_reduction=0.1 * base,
        confidence=0.3,
    )
    laws = tuple(
        replace(
            one,
            error=base * rng.uniform(0.9, 2.0),
            error_with_effects=rng.choice([None, named * rng.uniform(0.8, 2.0)]),
        )
        for one in found.laws
    )
    complete = bool(rng.integers(2))
    shown = replace(
        found, missing=missing, ladder=(Rung(kind=RungKind.LAW, error=budget.base), *rungs, *budget.rungs),
        budget=budget, remainder=left, laws=laws, complete=complete, candidates=(candidate,) if with_candidates else (),
        scatter=SCATTERED if apart else None,
    )  # fmt: skip
    better = shown.better_law is not None
    flags = {"named": bool(names), "predictable": left.unknown, "better_law": better, "complete": complete}
    physics = verdict(budget, **flags, thresholds=Thresholds())
    return replace(shown, physics=physics, verdict=physics), better


def test_the_error_of_an_integrator_is_no_unknown_effect():
    """However predictable it is; a model that errs by more has something unknown."""
    found = made_up(12, *NAMES)
    flags = {"predictable": True, "better_law": False, "complete": True, "thresholds": Thresholds()}
    for error, physics in ((4e-4, Verdict.NONE), (6e-4, Verdict.UNKNOWN)):
        budget = replace(found.budget, named=around(error, 0.1))
        assert verdict(budget, named=False, **flags) is physics
    assert verdict(replace(found.budget, named=around(4e-4, 0.1)), named=True, **flags) is Verdict.EFFECTS


def test_no_verdict_sentence_and_budget_contradict_each_other():
    rng, seen, found = np.random.default_rng(0), set(), made_up(12, *NAMES)
    for _ in range(3000):
        shown, better = random_diagnosis(found, rng)
        budget, left, physics = shown.budget, shown.remainder, shown.physics
        shares = budget.shares
        seen.add(physics)
        if physics in (Verdict.NONE, Verdict.EFFECTS):
            assert not better
            assert not left.unknown
            assert shares.unnamed <= MUCH
            estimated = budget.noise_source in (NoiseSource.ESTIMATED, NoiseSource.SCATTER)
            limit = 2 * MUCH if estimated else MUCH
            exceeds = budget.noise is not None and budget.named.low > budget.noise.high
            assert not (exceeds and shares.remaining > limit)
        if budget.noise is not None:
            models = budget.base, budget.named, budget.flexible, budget.ceiling
            assert budget.noise.low <= budget.noise.mean <= budget.noise.high
            assert budget.noise.mean <= min(one.mean for one in models) * (1 + 1e-12)
            assert shares.noise * budget.base.mean == pytest.approx(budget.noise.mean)
            assert shares.noise + shares.explained + shares.remaining == pytest.approx(1.0)
            assert min(shares.noise, shares.unnamed, shares.unexplained) >= -1e-12
            if shares.scatter is not None:
                assert min(shares.instrument, shares.scatter) >= 0
                assert shares.instrument + shares.scatter == pytest.approx(shares.noise)
        text, size = headline(shown), phrase("size", shown)
        assert ("no effect missing" in text or "No known effect" in text) == (physics is Verdict.NONE), text
        assert ("unknown" in text or "does not describe" in text) == (physics is Verdict.UNKNOWN), text
        scatters = physics in (Verdict.NONE, Verdict.EFFECTS) and (shares.scatter or 0) > MUCH
        assert len(text.replace("\u00a0", " ").split()) <= 25, text
        assert text.count(". ") == 0, text
        below = " ".join(grounds(shown)).replace("\u00a0", " ")
        assert (
            ("and contacts scatter" in text) == ("Contacts scatter: the normal by 0.647 ± 0.040°" in below) == scatters
        )
        assert ("is scatter of the contact" in size) == bool(shares.scatter)
        assert ("out of time" in text) == (physics is Verdict.UNFINISHED)
        named = not better or "does not describe" not in text
        assert all((label(one.effect.name) in text.lower()) == named for one in shown.missing)
        for one in shown.missing:
            in_full = named and (len(one.alternatives) == 1 or len(shown.missing) == 1)
            assert all((label(other.name) in text.lower()) == in_full for other in one.alternatives)
        probable = any(one.claim_level is Level.PROBABLE for one in shown.missing)
        assert ("probably" in text) == (probable and named), text
        assert all(label(one.effect.name) in f"{text} {below}".lower() for one in shown.missing)
        assert ("depends on v_x" in f"{text} {below}") <= (left.state_dependence is not None)
        if physics is Verdict.UNKNOWN and not better:
            established = left.state_dependence is not None and left.state_dependence.large
            assert ("depends on v_x" in f"{text} {below}") == established
            assert "No effect" not in below or " 0\u00a0% is unexplained" not in size or "unnamed" in size, (text, size)
        support = phrase("support", shown)
        assert ("noise floor is unknown" in support) == (budget.noise is None)
        assert (" is noise or unexplained" in size) == (budget.noise is None)
        assert not re.search(r"(?<![\de])−|(?:nan|inf)\b", f"{size} {support}")
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
    sure = demote_balance(found)
    assert (sure.verdict, sure.findings[0].mistake) == (Verdict.EFFECTS, False)
    unsure = replace(found, missing=tuple(replace(one, level=Level.PROBABLE) for one in found.missing))
    assert demote_balance(unsure) is unsure
    other = replace(found, findings=(opened, replace(opened, name="contradictions")))
    assert demote_balance(other).verdict is Verdict.BAD_DATA


def test_scatter_in_the_floor_turns_an_unknown_remainder_into_none_and_never_the_reverse():
    rng, flags = np.random.default_rng(1), {"named": False, "predictable": False, "better_law": False, "complete": True}
    seen = set()
    for _ in range(500):
        named, instrument, floor = (
            sorted(rng.uniform(0.01, 0.2, 3), reverse=True)[0],
            *sorted(rng.uniform(0.01, 0.2, 2)),
        )
        limits = ErrorLimits(base=around(named, 0.1), ceiling=around(named, 0.1), bound=around(named, 0.1))
        verdicts = [
            verdict(
                error_budget(limits, base=limits.base, named=limits.base, flexible=limits.base, **floors),
                **flags, thresholds=Thresholds(),
            )
            for floors in (
                {"floor": NoiseFloor(error=around(instrument, 0.1), source=NoiseSource.MEASURED)},
                {"floor": NoiseFloor(error=around(floor, 0.1), source=NoiseSource.SCATTER),
                 "instrument": around(instrument, 0.1)},
            )
        ]  # fmt: skip
        seen.add(tuple(verdicts))
    unknown, none = Verdict.UNKNOWN, Verdict.NONE
    assert seen == {(none, none), (unknown, unknown), (unknown, none)}


@pytest.mark.parametrize(("alone", "with_effects", "better"), [(2, 0.5, True), (0.5, None, True), (2, None, False)])
def test_another_law_is_better_alone_or_with_the_same_effects(alone, with_effects, better):
    found = made_up(12)
    law = replace(
        found.laws[-1], error=alone * found.budget.named.mean,
        error_with_effects=None if with_effects is None else with_effects * found.budget.named.mean,
    )  # fmt: skip
    assert (clearly_better([law], found.budget.named.mean, Thresholds()) is law) is better


def test_structure_is_named_and_is_no_scatter():
    found = replace(made_up(12), missing=(), physics=Verdict.UNKNOWN, verdict=Verdict.UNKNOWN)
    structured = replace(SCATTERED, dependences=(POSE, replace(POSE, variable="normal_speed of earlier impacts")))
    shown = replace(found, scatter=structured)
    assert "The normal follows the pose with 90 % of its variance (p = 0.002): that part is not scatter." in [
        one.replace("\u00a0", " ") for one in grounds(shown)
    ]
    assert "contacts scatter" not in headline(shown)
    assert SCATTERED.random
    assert not structured.random
