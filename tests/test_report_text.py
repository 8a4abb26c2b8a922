"""The words of terminal and page: verdicts, names, numbers and comparisons."""

import ast
from dataclasses import replace
from pathlib import Path

import pytest
from diagnoses import SIX, made_up, missing, remainder
from evaluations import evaluation, joint_estimate

import contactlearn
from contactlearn.data.audit.result import Finding
from contactlearn.diagnosis import result
from contactlearn.diagnosis.events import AuditFindings, EffectsFound, RegionsFound
from contactlearn.effects import EffectId, catalogue
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report import text
from contactlearn.report.events import TerminalObserver, show_verdict

TILT, DRAG = EffectId("surface_tilt", "computed"), EffectId("side_drag", "linear")
REGION = result.Region(
    variable="spin", where="-3 ≤ ω < 2.5 rad/s", low=-3.0, high=2.5, ratio=Interval(2.3, 1.5, 3.0), p_value=3e-8,
    rows=(0, 1, 2),
)  # fmt: skip
BEST = result.Formula(
    component=result.WrenchComponent.MOMENT, terms=("omega",), ranges=((-1.0, 1.0),), coefficients=(0.1,),
    error_reduction=0.25, standard_error=0.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def found():
    return made_up(40, TILT, EffectId("spin_damping", "after"))


def plain(text: str) -> str:
    return text.replace("\u00a0", " ")


def test_small_errors_keep_two_digits():
    assert text.measured(0.10512, 0.00412, "m") == "0.1051 ± 0.0041 m"
    assert text.measured(-3.2e-7, 4e-8) == "−3.2e−7 ± 4e−8"
    known = EffectId("velocity_dependent_restitution", "kuwabara_kono")
    assert text.effect_label(known) == "velocity-dependent restitution (Kuwabara–Kono)"
    joint = {"irb": joint_estimate("wang_mason", "side_drag"), "mirtich": joint_estimate("mirtich")}
    assert text.model_labels(replace(evaluation(), joint=joint)) == {
        "mirtich": "Mirtich (joint)", "whittaker": "Whittaker", "best_post_hoc": "Best Post Hoc",
        "irb": "Wang–Mason + side drag",
    }  # fmt: skip
    assert text.sentence("x points left") == "x points left."
    assert text.sentence("no balance. Is it?") == "No balance. Is it?"
    assert [text.error(x) for x in (0.18114, 0.00042, 2e-5, 0.0)] == ["0.1811", "0.00042", "2e−5", "0.0000"]
    assert plain(text.interval(Interval(0.1, -0.02, 0.3))) == "0.1000 (95 %: −0.0200 to 0.3000)"
    effect = EffectId("velocity_dependent_friction", "stribeck")
    rungs = [
        result.Rung(kind=kind, error=Interval(0, 0, 0))
        for kind in result.RungKind
        if kind is not result.RungKind.EFFECT
    ]
    rungs.append(result.Rung(kind=result.RungKind.EFFECT, error=Interval(0, 0, 0), effect=effect))
    assert [text.rung_label(rung, "Mirtich") for rung in rungs] == [
        "Mirtich", "+ Gaussian processes on the residual", "noise floor", "+ velocity-dependent friction (Stribeck)",
    ]  # fmt: skip
    message = text.conclusion(result.Verdict.BAD_DATA, result.Verdict.NONE, ("mirrored_x",))
    assert message == "the data were corrected (mirrored_x); no missing effect is detectable"
    assert text.conclusion(result.Verdict.BAD_DATA, None) == "the measurements are inconsistent"
    assert text.conclusion(result.Verdict.EFFECTS, result.Verdict.EFFECTS) == "effects are missing"


@pytest.mark.parametrize(("x", "y", "message"), [
    (0.1, 0.39, "3.9 times less"), (0.09, 0.1, "10 % less"), (0.11, 0.1, "10 % more"), (0.03988, 0.04, "0.3 % less"),
    (3.0, 0.1, "30 times more"), (0.0, 0.1, "less"), (0.0, 0.0, "no less"),
])  # fmt: skip
def test_errors_are_compared_in_factors_where_percentages_mislead(x, y, message):
    assert plain(text.compared(x, y)) == message


def test_the_headline_names_rivals_and_doubts(found):
    effects = EffectId("com_offset"), EffectId("shape_error"), EffectId("adhesion", "work")
    rivals = tuple(result.Rival(effect=one, similarity=0.9, loss_difference=0.0, standard_error=0.1) for one in effects)
    first, *others = found.missing

    def confused(count):
        return text.headline(replace(found, missing=(replace(first, rivals=rivals[:count]), *others)))

    assert confused(0) == "Surface tilt (computed) and spin damping (after) are missing from Wang–Mason."
    assert confused(1).endswith(
        "missing from Wang–Mason. These data cannot distinguish surface tilt (computed) from com offset."
    )
    assert confused(3).endswith("surface tilt (computed) from com offset, shape error or one other effect.")
    more = remainder(Interval(0.05, 0.02, 0.08))
    assert text.headline(replace(found, remainder=more)).endswith(
        "; no known effect explains the predictable part of the residual."
    )
    unstated = replace(found, shapeless=(EffectId("shape_error"), EffectId("surface_tilt", "computed")))
    assert "data.shape" not in text.headline(unstated)  # no name that a wrong shape could stand for
    patch = result.Candidate(
        effect=EffectId("contact_patch", "linear"), equation="", parameters=(), error_reduction=0.004, confidence=0.26
    )
    unstated = replace(unstated, candidates=(patch,))
    assert text.headline(unstated).startswith(
        "The body's shape is unknown (data.shape): a moment at the contact is not to be told from shape error or "
        "surface tilt. Surface tilt (computed)"
    )
    noted = Finding(name="grams", sentence="grams", evidence=(), correction="grams")
    assert text.headline(replace(found, findings=(noted,))).endswith(" The data were corrected first.")
    outline = replace(noted, correction="traced_shape", mistake=False)
    assert text.headline(replace(found, findings=(outline,))).endswith(" was taken from the contact points.")
    applied = replace(noted, name="rig_applied", sentence="applied first: zero of θ", correction=None, mistake=False)
    assert text.headline(replace(found, findings=(applied,))).startswith("Applied first: zero of θ. Surface tilt")
    doubted = replace(noted, correction=None)
    assert text.headline(replace(found, findings=(doubted,))).endswith(" The audit questions the data.")
    assert text.headline(replace(found, findings=(replace(doubted, fatal=True),))).startswith(
        "The measurements are inconsistent"
    )
    bare = replace(found, missing=(), physics=result.Verdict.NONE)
    assert text.headline(bare) == "These data show no effect missing from Wang–Mason."
    assert text.headline(replace(bare, remainder=more)).endswith("but a small part of its residual is predictable.")
    unknown = text.headline(replace(bare, physics=result.Verdict.UNKNOWN))
    assert unknown.startswith("An unknown effect is missing from Wang–Mason: no effect in the catalogue explains")
    given = replace(bare, given=(DRAG,))
    assert text.headline(given).endswith("from Wang–Mason with side drag (linear).")


def test_something_unknown_has_its_size(found):
    shares = result.ErrorShares(noise=0.0016, explained=0.9947, unnamed=0.0, unexplained=0.0037, beyond_rigid=0.0)

    def message(unexplained):
        budget = replace(found.budget, shares=replace(shares, unexplained=unexplained))
        return plain(text.headline(replace(found, physics=result.Verdict.UNKNOWN, budget=budget)))

    sizes = {0.0037: ", 0.4 %", 0.123: ", 12 %", 0.0002: ", less than 0.1 %"}
    for unexplained, size in sizes.items():
        assert f"and so is something unknown{size} of the law's error: no effect" in message(unexplained)
    assert "and so is something unknown: no effect" in message(0.0)  # noise alone is as large
    written = plain(text.phrase("shares", replace(found.budget, shares=shares)))
    assert "the effects explain 99 %, <1 % is noise and <1 % is unexplained." in written
    whole = replace(shares, explained=0.998, noise=0.0, unexplained=0.002)
    assert "the effects explain over 99 %, 0 % is noise and <1 %" in plain(
        text.phrase("shares", replace(found.budget, shares=whole))
    )


def test_one_sentence_supports_the_headline(found):
    first, second = (
        replace(one, confidence=x, level=result.Level.of(x))
        for one, x in zip(found.missing, (0.9987, 0.62), strict=True)
    )
    assert text.headline(replace(found, missing=(first, second))).startswith(
        "Surface tilt (computed) is missing from Wang–Mason, and probably spin damping (after)."
    )
    message = plain(text.phrase("support", replace(found, missing=(first, second))))
    after, noise = found.ladder[2].error.mean, found.budget.noise.mean
    assert message.startswith(f"The held-out mass error falls from 0.1000 to {after:.4f}, ")
    assert (
        f"and noise alone accounts for {noise:.4f}; the names are correct with a probability of 99 % and 62 %."
        in message
    )
    assert plain(text.phrase("support", replace(found, missing=(second,)))).endswith(
        "the name is correct with a probability of 62 %."
    )
    bare = text.phrase("support", replace(found, missing=(), physics=result.Verdict.NONE))
    assert bare == f"Wang–Mason has a held-out mass error of 0.1000; noise alone accounts for {noise:.4f}."
    assert text.phrase("support", replace(found, ladder=(), budget=None)) == ""
    # Components, variables and the best formula, as the terminal does.
    left = remainder(Interval(0.4, 0.3, 0.5), result.WrenchComponent.MOMENT, result.WrenchComponent.TANGENTIAL)
    written = plain(" ".join(text.phrases("summary", replace(found, remainder=left, formulas=(BEST,)))))
    message = "Gaussian processes on the residual reduce the held-out error by 40 % (30 % to 50 %), in τ and P_t."
    assert message in written
    assert "The predicted residual depends on ω (61 %) and θ (20 %)." in written
    assert "The best formula for the residual: τ ← τ + c1*omega reduces the held-out error by 25 % ± 0 %." in written
    assert text.formula_overrides(BEST) == "'+effect.mine.tau=\"c1*omega\"' '+effect.mine.parameters.c1=[-1,1]'"
    budget = replace(found.budget, noise_source=result.NoiseSource.STATED, noise=Interval(0.02, 0.01, 0.03))
    quiet = remainder(Interval(0.0, -0.1, 0.1))
    message = text.misfit(replace(found, budget=budget, remainder=quiet))
    assert message.startswith("The residual is 5 times as large as the stated noise implies")
    assert text.misfit(replace(found, remainder=quiet)) == ""  # it was estimated
    too_large = replace(budget, noise=None)
    assert text.misfit(replace(found, budget=too_large, remainder=quiet)).endswith("; is fit.noise too large?")
    agreeing = replace(budget, noise=Interval(0.09, 0.08, 0.1))
    assert text.misfit(replace(found, budget=agreeing, remainder=quiet)) == ""


def test_laws_are_compared_with_the_next_and_the_worst():
    errors = {"wang_mason": 0.1, "mirtich": 0.12, "whittaker": 0.4}
    fits = [result.LawFit(name=law, variant="textbook", error=x, mu=0.1, eps=0.5) for law, x in errors.items()]
    assert plain(text.phrase("laws", "wang_mason", fits)) == (
        "Wang–Mason has a held-out mass error of 0.1000, 17 % less than Mirtich; Whittaker has the largest, 0.4000."
    )
    assert plain(text.phrase("laws", "whittaker", fits)) == (
        "Whittaker has a held-out mass error of 0.4000, Wang–Mason 0.1000, 4.0 times less."
    )


def test_an_effect_has_its_parameters_inadmissible_impulses_and_regions():
    parameter = result.FittedParameter(name="c", symbol="c", unit="m", value=0.10512, standard_error=0.00412)
    change, excess = Interval(-0.1, -0.15, -0.05), Interval(-0.08, -0.12, -0.01)
    helped = result.Improvement(
        before=0.25, after=0.15, rest_before=0.1, rest_after=0.08, change=change, excess=excess, share=0.8
    )
    effect = replace(missing(SIX[2]), parameters=(parameter,), inadmissible_after=0.021, improvements=(helped,))
    assert plain(text.phrase("missing_effect", effect)) == (
        "contact patch (linear): held-out error 0.1000 → 0.1000; c = 0.1051 ± 0.0041 m; with this effect 2.1 % of the "
        "impulses gain energy, pull or penetrate, without it 0.0 %"
    )
    message = "-3 ≤ ω < 2.5 rad/s: error 0.25 → 0.15 (rest 0.1 → 0.08)"
    assert text.phrases("improvements", effect, [REGION]) == [message]
    unhelped = replace(effect, improvements=(replace(helped, change=Interval(-0.1, -0.15, 0.05)),))
    assert text.phrases("improvements", unhelped, [REGION]) == []
    assert text.phrase("region", REGION) == "-3 ≤ ω < 2.5 rad/s: 2.3 times the rest's error, 3 trials, p = 3e−8"


def test_the_next_experiment_states_region_and_number():
    separations = (
        result.Separation(effect=TILT, rival=DRAG, drops_needed=4),
        result.Separation(effect=TILT, rival=SIX[5], drops_needed=None),
    )
    drop = result.Drop(theta=0.5, v_x=-1.0, v_y=-2.0, omega=3.0, differences=(3.2, 0.4))
    experiment = result.Experiment(separations=separations, drops=(drop,))
    assert text.phrase("drop", drop, experiment) == (
        "A drop at θ = 28.6°, v = (−1, −2) m/s, ω = 3 rad/s: the prediction differs by 3.2 σ from side drag "
        "(linear) in place of surface tilt (computed) and 0.4 σ from sampling delay in place of surface tilt "
        "(computed)."
    )
    more = replace(separations[0], effect=SIX[1], rival=SIX[2]), replace(separations[0], rival=SIX[3])
    many = replace(experiment, separations=(*separations, *more))
    assert text.phrases("needed_drops", many) == [
        "About 4 drops like these distinguish spin damping (after) from contact patch (linear) and surface tilt "
        "(computed) from side drag (linear) or inertia error.",
        "No feasible drop distinguishes surface tilt (computed) from sampling delay.",
    ]
    state = "θ = 28.6°, v = (−1, −2) m/s, ω = 3 rad/s"
    line = f"4 drops such as {state} distinguish 3 of the 4 pairs of effects; no feasible drop the others"
    assert text.phrase("next_experiment", many) == line
    settled = replace(experiment, separations=(replace(separations[0], drops_needed=1),))
    assert text.phrase("next_experiment", settled) == f"1 drop such as {state} distinguishes these effects"
    hopeless = replace(experiment, separations=separations[1:])
    assert text.phrase("next_experiment", hopeless) == "no feasible drop distinguishes these effects"


def test_a_model_with_fewer_effects_that_does_nearly_as_well_is_named(found):
    tilt, damping = (one.effect for one in found.missing)

    def with_frontier(*models):
        frontier = (result.FrontierModel(law="mirtich", effects=e, error=Interval(x, x, x)) for x, e in models)
        return replace(found, frontier=tuple(frontier))

    one, both = (0.105, (tilt,)), (0.1, (tilt, damping))
    near = with_frontier((0.2, ()), one, both)
    assert near.simpler is near.frontier[1]
    message = "Mirtich + surface tilt (computed) has 5 % more error: spin damping (after) may only compensate for "
    assert plain(text.phrase("simpler", near)) == message + "imperfect functional forms of the others."
    assert text.phrase("simpler", near) in text.phrases("notes", near)
    none = with_frontier((0.109, ()), one, both)
    message = "Mirtich has 9 % more error: surface tilt (computed) and spin damping (after) contribute little."
    assert plain(text.phrase("simpler", none)) == message
    for clear in (with_frontier((0.2, ()), (0.111, (tilt,)), both), replace(near, missing=())):
        assert clear.simpler is None
        assert not text.phrase("simpler", clear)


def test_the_chosen_model_is_listed_first_whatever_its_share(found, capsys):
    effects = tuple(one.effect for one in found.missing)
    laws = ("mirtich", "whittaker", "routh", "ap_newton", "ap_poisson")
    others = tuple(result.PlausibleModel(law=law, effects=effects, share=0.19) for law in laws)
    chosen = result.PlausibleModel(law="wang_mason", effects=effects[::-1], share=0.004)
    many = replace(found, models=(*others, chosen))
    assert text.listed_models(many) == (chosen, *others[:4])
    assert text.listed_name(many, chosen).endswith("surface tilt (computed) (chosen)")
    assert not text.listed_name(many, others[0]).endswith("(chosen)")
    assert plain(text.share_of_whole(chosen.share)) == "<1 %"
    alone = replace(found, models=(replace(chosen, share=1.0),))
    assert [text.listed_name(alone, one) for one in text.listed_models(alone)] == [
        "Wang–Mason + spin damping (after) + surface tilt (computed)"
    ]
    effects = (EffectId("wind"),)
    best = result.FrontierModel(law="mirtich", effects=effects, error=Interval(0.105, 0.1, 0.11))
    likely = result.PlausibleModel(law="mirtich", effects=effects, share=1.0)
    show_verdict(replace(found, given=(EffectId("kick"),), frontier=(best,), models=(likely,)), "", verbose=True)
    assert capsys.readouterr().out.count(" Mirtich + kick + wind\n") == 2
    assert "not selected" not in text.phrase("notes", found)
    rejected = replace(found, unwanted=(EffectId("kick"), EffectId("wind")))
    assert "Tested, not selected: kick and wind." in text.phrases("notes", rejected)


def test_a_law_that_does_better_alone_is_named_once(found, capsys):
    better = result.LawFit(name="mirtich", variant="textbook", error=0.05, mu=0.1, eps=0.5)
    unknown = replace(found, physics=result.Verdict.UNKNOWN, laws=(better,))
    assert text.phrase("better_law", unknown).endswith("try law=mirtich.")
    assert "Mirtich alone has an error of 0.0500" in text.headline(unknown)
    assert text.phrase("better_law", replace(unknown, laws=(replace(better, error=0.095),))) == ""
    for diagnosis in (unknown, replace(unknown, physics=result.Verdict.EFFECTS)):
        show_verdict(diagnosis, "")
        assert capsys.readouterr().out.count("try law=mirtich") == 1


def test_the_terminal_prints_the_sentences_of_the_page(found, capsys):
    finding = Finding(name="grams", sentence="50% in grams", evidence=(), correction="g")
    observer = TerminalObserver(verbose=True)
    observer(AuditFindings(findings=(finding,)))
    observer(RegionsFound(regions=()))
    observer(EffectsFound(effects=found.missing, regions=()))
    left = replace(found, remainder=remainder(Interval(0.4, 0.3, 0.5)), formulas=(BEST,))
    show_verdict(left, "python train.py", verbose=True)
    printed = capsys.readouterr().out
    assert "\u00a0" not in printed
    for message in (
        "audit: 50 % in grams. The data are corrected from here on; data.correct=[g] applies the same correction in "
        "any command.",
        f"region: {text.phrase('no_region')}",
        f"missing: {text.phrase('missing_effect', found.missing[0])}",
        "residual: Gaussian processes on the residual reduce the held-out error by 40 % (30 % to 50 %), in τ.",
        "  0.1000  0.0900–0.1100  + surface tilt (computed)\n",
        f"verdict: {text.headline(left)}",
        "use it: python train.py",
    ):
        assert message in printed


def fitted(effect, *values, error=0.0132):
    symbols = zip(catalogue()[effect.name][0]().parameters, values, strict=True)
    parameters = (
        result.FittedParameter(name=p.name, symbol=p.symbol, unit=p.unit, value=x, standard_error=error * abs(x))
        for p, x in symbols
    )
    return replace(missing(effect), parameters=tuple(parameters))


@pytest.mark.parametrize(("one", "message"), [
    (fitted(EffectId("com_offset", "tracked"), 0.001527, -2e-4),
     "the centre of mass lies 1.527 ± 0.020 mm from the tracked point along the body's x and −0.2000 ± 0.0026 mm along "
     "its y"),
    (fitted(TILT, 0.0398), "the floor is tilted by 2.280 ± 0.030°"),
    (fitted(EffectId("sampling_delay"), -0.0075), "the time from the recorded pose to contact is −7.500 ± 0.099 ms"),
    (fitted(DRAG, 0.08), "the body loses 8.00 ± 0.11 % of its speed after contact"),
    (fitted(EffectId("inertia_error"), 0.2), "the moment of inertia is 1.2214 ± 0.0032 times the stated one"),
    (fitted(EffectId("location_dependent_friction"), 0.1, -0.2, 0.3, 0.0, 0.1),
     "over x in m, μ is a curve with 5 coefficients from c₂ = −0.2000 ± 0.0026 to c₃ = 0.3000 ± 0.0040"),
    (fitted(EffectId("contact_patch", "linear"), -0.2, 0.001),
     "the normal impulse acts at an arm of 1.000 ± 0.013 mm plus 20.00 ± 0.26 % of r_x"),
    (replace(fitted(DRAG, 0.08), effect=EffectId("mine")), "c = 0.0800 ± 0.0011"),
])  # fmt: skip
def test_parameters_are_in_words_with_the_units_that_people_use(one, message):
    assert plain(text.in_words(one)) == message


def test_a_parameter_at_the_end_of_its_range_is_said_to_be_there():
    one = fitted(TILT, 0.2)
    stopped = replace(one, parameters=(replace(one.parameters[0], at_end=True),))
    end = "φ at the end of its range, 11.46 ± 0.15°: the true value may lie beyond"
    message = f"the floor is tilted by 11.46 ± 0.15°; {end}"
    assert plain(text.in_words(stopped)) == message
    assert message in plain(text.phrase("missing_effect", stopped))  # the terminal's line


def test_the_terminal_has_the_verdict_and_no_more_than_fifteen_lines(found, capsys):
    """Even with three levels of names, rivals, laws that do as well, and the next experiment."""
    rival = result.Rival(effect=DRAG, similarity=0.9, loss_difference=0.0, standard_error=0.1)
    _, damping = found.missing
    sure = replace(fitted(TILT, 0.0398), rivals=(rival,), confidence=0.97)
    probable = replace(damping, confidence=0.62, level=result.Level.PROBABLE)
    unsure = result.Candidate(effect=SIX[2], equation="", parameters=(), error_reduction=0.004, confidence=0.26)
    separation = result.Separation(effect=TILT, rival=DRAG, drops_needed=4)
    drop = result.Drop(theta=0.5, v_x=-1.0, v_y=-2.0, omega=3.0, differences=(3.2,))
    other = replace(TILT, form="seen")
    models = (
        result.PlausibleModel(law=law, effects=(one,), share=share)
        for law, one, share in (("wang_mason", TILT, 0.5), ("mirtich", other, 0.47), ("whittaker", TILT, 0.03))
    )
    shown = replace(
        found, missing=(sure, probable),
        candidates=(unsure, replace(unsure, effect=SIX[3], confidence=None, proxy=True)),
        experiment=result.Experiment(separations=(separation,) * 12, drops=(drop,) * 4), models=tuple(models),
        equation="mirtich", remainder=remainder(Interval(0.4, 0.3, 0.5)), formulas=(BEST,) * 3,
    )  # fmt: skip
    show_verdict(shown, "python train.py model=RUN")
    assert capsys.readouterr().out.splitlines() == [
        "verdict: Surface tilt (computed) is missing from Wang–Mason, and probably spin damping (after); no known "
        "effect explains the predictable part of the residual.",
        "error: 0.1000 → 0.1000, 0.0 % less; 100 % is noise and 0 % is unexplained",
        "found: surface tilt (computed) (97 %): the floor is tilted by 2.280 ± 0.030°",
        "probable: spin damping (after) (62 %)",
        "candidates: contact patch (linear) (26 %) and inertia error (a proxy?)",
        "cannot distinguish: surface tilt (computed) or side drag (linear); surface tilt (computed) (53 %) or surface "
        "tilt (seen) (47 %); Wang–Mason (50 %) or Mirtich (47 %)",
        "next experiment: 4 drops such as θ = 28.6°, v = (−1, −2) m/s, ω = 3 rad/s distinguish these effects",
        "use it: python train.py model=RUN",
    ]
    assert [level for level, _ in text.names_by_level(shown)] == ["found", "probable", "candidate", "candidate"]
    show_verdict(shown, "", verbose=True)
    assert "candidate: contact patch (linear) (26 %) would remove 4 % of the error\n" in capsys.readouterr().out


def test_forms_and_laws_that_do_as_well_have_shares_among_each_other(found):
    def listed(*models):
        models = (result.PlausibleModel(law=law, effects=effects, share=share) for law, effects, share in models)
        return [plain(one) for one in text.undecided(replace(found, models=tuple(models)))]

    seen, laws = replace(TILT, form="seen"), [one.name for one in found.laws]
    halves = "surface tilt (computed) (75 %) or surface tilt (seen) (25 %)"
    assert listed((laws[0], (TILT,), 0.6), (laws[0], (seen,), 0.2), (laws[0], (), 0.2)) == [halves]
    assert listed(*((law, (TILT,), 1 / len(laws)) for law in laws)) == ["the laws, which agree on these data"]
    apart = ["the laws but for Drumwright–Shell, which agree on these data"]
    assert listed(*((law, (TILT,), 0.2) for law in laws if law != "drumwright_shell")) == apart
    (four,) = listed(*((law, (TILT,), 0.25) for law in laws[2:]))
    assert four.count("(25 %)") == 4 == len(laws) - 2
    (unlike,) = listed(*((law, (TILT,), share) for law, share in zip(laws, (0.5, *[0.1] * 5), strict=True)))
    assert unlike.count("(10 %)") == 5
    assert listed((laws[0], (TILT,), 1.0)) == []


def test_an_unfinished_search_says_what_is_established_already(found):
    share = Interval(0.3, 0.2, 0.4)
    friction = result.StateDependence(
        coefficient=result.Coefficient.FRICTION, variables=(result.VariableShare(symbol="vx", share=1.0),),
        p_value=1e-9, share=share, large=True,
    )  # fmt: skip
    left = replace(remainder(share), state_dependence=friction)
    unfinished = replace(found, physics=result.Verdict.UNFINISHED, missing=(), remainder=left)
    assert text.headline(unfinished) == (
        "Something is missing from Wang–Mason: the residual behaves like friction that depends on v_x; the search ran "
        "out of time before identifying it; seconds=300 gives it more."
    )
    assert text.headline(replace(unfinished, remainder=remainder(share))).startswith(
        "Something is missing from Wang–Mason; the search ran out of time"
    )
    named = text.headline(replace(unfinished, missing=found.missing))
    assert ", and so is something else: the residual behaves like friction that depends on v_x; the" in named


def test_every_phrase_has_its_macro():
    """A name or a number of values that no template has would fail only where it is shown."""
    for path in Path(contactlearn.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("phrase", "phrases"):
                name, *values = node.args
                if isinstance(name, ast.Constant):
                    assert len(text.sentences.macro(str(name.value)).arguments) == len(values), (
                        f"{path.name}: {name.value}"
                    )
