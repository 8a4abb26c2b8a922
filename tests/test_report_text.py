"""The words of terminal and page, all of them in a snapshot: `python tests/test_report_text.py` writes it again."""

import ast
import io
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

from diagnoses import SIX, made_up, missing, remainder
from evaluations import evaluation, joint_estimate
from rich.console import Console

import contactlearn
from contactlearn.core.numerics import measured
from contactlearn.data.audit.result import Finding
from contactlearn.diagnosis import result
from contactlearn.diagnosis.events import AuditFindings, EffectsFound, RegionsFound
from contactlearn.effects import EffectId, catalogue
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.scatter import StandardDeviation
from contactlearn.report import terminal as terminal_lines
from contactlearn.report.events import TerminalObserver, show_verdict
from contactlearn.report.text import (
    names as text_names,
    numbers as text_numbers,
    sentences as text,
)

SNAPSHOT = Path(__file__).with_name("sentences.txt")
TILT, DRAG = EffectId("surface_tilt", "computed"), EffectId("side_drag", "linear")
FOUND = made_up(40, TILT, EffectId("spin_damping", "after"))
REGION = result.Region(
    variable="spin", where="-3 ≤ ω < 2.5 rad/s", low=-3.0, high=2.5, ratio=Interval(2.3, 1.5, 3.0), p_value=3e-8,
    rows=(0, 1, 2),
)  # fmt: skip
BEST = result.Formula(
    component=result.WrenchComponent.MOMENT, terms=("omega",), ranges=((-1.0, 1.0),), coefficients=(0.1,),
    error_reduction=0.25, standard_error=0.0,
)  # fmt: skip
SHARES = result.ErrorShares(noise=0.0016, explained=0.9947, unnamed=0.0, unexplained=0.0037, beyond_rigid=0.0)
LEFT = remainder(Interval(0.4, 0.3, 0.5))
QUIET = remainder(Interval(0.0, -0.1, 0.1))
NOTED = Finding(name="grams", sentence="grams", evidence=(), correction="grams")
BARE = replace(FOUND, missing=(), physics=result.Verdict.NONE)


def printed(*events, found=None, verbose=False) -> str:
    """What the terminal prints of events, or of a verdict."""
    with redirect_stdout(io.StringIO()) as out:
        observer = TerminalObserver(verbose=verbose)
        for event in events:
            observer(event)
        if found is not None:
            show_verdict(found, verbose=verbose)
    return out.getvalue()


def said(found) -> str:
    """The verdict, and what stands below it but for errors and probabilities."""
    below = (one for macro in ("confused", "qualifications", "doubts") for one in text.phrases(macro, found))
    return " / ".join((text.headline(found), *below))


def numbers() -> Iterator[tuple[str, str]]:
    yield "value and error", measured(0.10512, 0.00412, "m")
    yield "small value", measured(-3.2e-7, 4e-8)
    for x in (0.18114, 0.00042, 2e-5, 0.0):
        yield f"error {x}", text_numbers.error(x)
    yield "interval across 0", text_numbers.interval(Interval(0.1, -0.02, 0.3))
    for x, y in ((0.1, 0.39), (0.09, 0.1), (0.11, 0.1), (0.03988, 0.04), (3.0, 0.1), (0.0, 0.1), (0.0, 0.0)):
        yield f"{x} beside {y}", text_numbers.compared(x, y)


def names() -> Iterator[tuple[str, str]]:
    for effect in (("velocity_dependent_restitution", "kuwabara_kono"), ("velocity_dependent_friction", "stribeck")):
        yield "effect", text_names.effect_label(EffectId(*effect))
        rung = result.Rung(kind=result.RungKind.EFFECT, error=Interval(0, 0, 0), effect=EffectId(*effect))
        yield "rung of an effect", text_names.rung_label(rung, "Mirtich")
    for kind in result.RungKind:
        if kind is not result.RungKind.EFFECT:
            yield f"rung {kind}", text_names.rung_label(result.Rung(kind=kind, error=Interval(0, 0, 0)), "Mirtich")
    joint = {"irb": joint_estimate("wang_mason", "side_drag"), "mirtich": joint_estimate("mirtich")}
    for name, label in text_names.model_labels(replace(evaluation(), joint=joint)).items():
        yield f"model {name}", label
    above = evaluation()
    below = replace(above, errors=above.errors | {"irb": above.errors["whittaker"]})
    for found in (above, below):
        yield "a training", text.phrase("training_headline", text_names.model_labels(found), found)
    yield "clause", text_names.sentence("x points left")
    yield "question", text_names.sentence("no balance. Is it?")
    verdicts = result.Verdict
    yield "corrected", text.conclusion(verdicts.BAD_DATA, verdicts.NONE, ("mirrored_x",))
    yield "refused", text.conclusion(verdicts.BAD_DATA, None)
    yield "missing", text.conclusion(verdicts.EFFECTS, verdicts.EFFECTS)


def headlines() -> Iterator[tuple[str, str]]:
    effects = EffectId("com_offset"), EffectId("shape_error"), EffectId("adhesion", "work")
    rivals = tuple(result.Rival(effect=one, similarity=0.9, loss_difference=0.0, standard_error=0.1) for one in effects)
    first, second = FOUND.missing
    for count in (0, 1, 3):
        confused = replace(FOUND, missing=(replace(first, rivals=rivals[:count]), second))
        yield f"{count} rivals", said(confused)
    more = remainder(Interval(0.05, 0.02, 0.08))
    yield "predictable", said(replace(FOUND, remainder=more))
    unstated = replace(FOUND, shapeless=(EffectId("shape_error"), TILT))
    yield "shape that no name needs", said(unstated)
    patch = result.Candidate(
        effect=EffectId("contact_patch", "linear"),
        equation="",
        parameters=(),
        error_after=0.1,
        error_reduction=0.004,
        confidence=0.26,
    )
    yield "unknown shape", said(replace(unstated, candidates=(patch,)))
    for name, finding in {
        "corrected": NOTED,
        "traced": replace(NOTED, correction="traced_shape", mistake=False),
        "applied": replace(
            NOTED, name="rig_applied", sentence="applied first: zero of θ", correction=None, mistake=False
        ),
        "doubted": replace(NOTED, correction=None),
        "fatal": replace(NOTED, correction=None, fatal=True),
    }.items():
        yield name, said(replace(FOUND, findings=(finding,)))
    unknown = replace(BARE, physics=result.Verdict.UNKNOWN)
    yield "none", said(BARE)
    yield "none, a part predictable", said(replace(BARE, remainder=more))
    yield "unknown", said(unknown)
    yield "none, unknown shape", said(replace(BARE, shapeless=(EffectId("shape_error"), TILT)))
    sigma = StandardDeviation(name="restitution", symbol="σ_ε", unit="–", value=0.07, error=0.004)
    scatter = result.ContactScatter(
        components=(result.ScatterComponent(deviation=sigma, relative=None, share=0.5),), instrument=(), stated=True,
        trials=200, bic=-100.0, confounded=(("normal", "restitution"),), dependences=(), converged=True,
    )  # fmt: skip
    yield "scatter", " ".join(text.phrases("scatter", scatter))
    yield "none beside one that is given", said(replace(BARE, given=(DRAG,)))
    for unexplained in (0.0037, 0.123, 0.0002, 0.0):
        budget = replace(FOUND.budget, shares=replace(SHARES, unexplained=unexplained))
        yield (
            f"unknown, {unexplained} of the error",
            said(replace(FOUND, physics=result.Verdict.UNKNOWN, budget=budget)),
        )
    better = result.LawFit(name="mirtich", variant="textbook", error=0.05, mu=0.1, eps=0.5)
    for error in (0.05, 0.095):
        found = replace(FOUND, physics=result.Verdict.UNKNOWN, laws=(replace(better, error=error),))
        yield f"another law with {error}", said(found)
        yield f"another law with {error}, alone", text.phrase("better_law", found)
        yield f"another law with {error}, printed", printed(found=found)
    friction = result.StateDependence(
        coefficient=result.Coefficient.FRICTION, variables=(result.VariableShare(symbol="vx", share=1.0),),
        p_value=1e-9, share=Interval(0.3, 0.2, 0.4), large=True,
    )  # fmt: skip
    depends = replace(remainder(Interval(0.3, 0.2, 0.4)), state_dependence=friction)
    unfinished = replace(BARE, physics=result.Verdict.UNFINISHED)
    yield "unfinished", said(replace(unfinished, remainder=remainder(Interval(0.3, 0.2, 0.4))))
    yield "unfinished, something established", said(replace(unfinished, remainder=depends))
    named = replace(unfinished, remainder=depends, missing=FOUND.missing)
    yield "unfinished, something named", said(named)


def grounds() -> Iterator[tuple[str, str]]:
    first, second = (
        replace(one, confidence=x, level=result.Level.of(x))
        for one, x in zip(FOUND.missing, (0.9987, 0.62), strict=True)
    )
    for name, those in (("two", (first, second)), ("one", (second,))):
        yield f"headline of {name}", said(replace(FOUND, missing=those))
        yield f"support of {name}", text.phrase("support", replace(FOUND, missing=those))
    yield "support of none", text.phrase("support", BARE)
    yield "support without errors", text.phrase("support", replace(FOUND, ladder=(), budget=None))
    for unexplained, explained in ((0.0037, 0.9947), (0.002, 0.998)):
        shares = replace(SHARES, explained=explained, unexplained=unexplained)
        yield f"shares, {explained}", text.phrase("shares", replace(FOUND.budget, shares=shares))
    left = remainder(Interval(0.4, 0.3, 0.5), result.WrenchComponent.MOMENT, result.WrenchComponent.TANGENTIAL)
    yield "summary", " ".join(text.phrases("summary", replace(FOUND, remainder=left, formulas=(BEST,))))
    yield "formula", text.formula_overrides(BEST)
    stated = replace(FOUND.budget, noise_source=result.NoiseSource.STATED, noise=Interval(0.02, 0.01, 0.03))
    for name, budget in {
        "stated": stated,
        "estimated": FOUND.budget,
        "too large": replace(stated, noise=None),
        "agreeing": replace(stated, noise=Interval(0.09, 0.08, 0.1)),
    }.items():
        yield f"{name} noise", text.misfit(replace(FOUND, budget=budget, remainder=QUIET))
    errors = {"wang_mason": 0.1, "mirtich": 0.12, "whittaker": 0.4}
    fits = [result.LawFit(name=law, variant="textbook", error=x, mu=0.1, eps=0.5) for law, x in errors.items()]
    for law in ("wang_mason", "whittaker"):
        yield f"{law} among laws", text.phrase("laws", law, fits)


def effects() -> Iterator[tuple[str, str]]:
    parameter = result.FittedParameter(name="c", symbol="c", unit="m", value=0.10512, standard_error=0.00412)
    change, excess = Interval(-0.1, -0.15, -0.05), Interval(-0.08, -0.12, -0.01)
    helped = result.Improvement(
        before=0.25, after=0.15, rest_before=0.1, rest_after=0.08, change=change, excess=excess, share=0.8
    )
    effect = replace(missing(SIX[2]), parameters=(parameter,), inadmissible_after=0.021, improvements=(helped,))
    yield "effect", text.phrase("missing_effect", effect)
    unhelped = replace(effect, improvements=(replace(helped, change=Interval(-0.1, -0.15, 0.05)),))
    for name, one in (("region that is helped", effect), ("region that is not", unhelped)):
        yield name, " ".join(text.phrases("improvements", one, [REGION]))
    yield "region", text.phrase("region", REGION)
    tilted = fitted(TILT, 0.2)
    stopped = replace(tilted, parameters=(replace(tilted.parameters[0], at_end=True),))
    for one in (
        fitted(EffectId("com_offset", "tracked"), 0.001527, -2e-4),
        fitted(TILT, 0.0398),
        fitted(EffectId("sampling_delay"), -0.0075),
        fitted(DRAG, 0.08),
        fitted(EffectId("inertia_error", "uniform"), 0.2),
        fitted(EffectId("location_dependent_friction", "along"), 0.1, -0.2, 0.3, 0.0, 0.1),
        fitted(EffectId("contact_patch", "linear"), -0.2, 0.001),
        replace(fitted(DRAG, 0.08), effect=EffectId("mine")),
        stopped,
        replace(fitted(EffectId("parameter_drift", "restitution"), -0.7), coefficient_ends=(0.699, 0.549)),
        replace(fitted(EffectId("parameter_drift", "friction"), 0.2), coefficient_ends=(0.1, 0.3)),
    ):
        yield f"{one.effect} in words", text.in_words(one)
    patch = fitted(EffectId("contact_patch", "linear"), -0.2, 0.001)
    known, open_ = patch.parameters
    open_ = replace(open_, undetermined=True)
    yield "a parameter that is open", text.in_words(replace(patch, parameters=(known, open_)))
    yield "a parameter that is open, alone", text.fitted_value(open_)
    yield "effect at the end of its range", text.phrase("missing_effect", stopped)


def fitted(effect, *values, error=0.0132):
    symbols = zip(catalogue()[effect.name][0]().parameters, values, strict=True)
    parameters = (
        result.FittedParameter(name=p.name, symbol=p.symbol, unit=p.unit, value=x, standard_error=error * abs(x))
        for p, x in symbols
    )
    return replace(missing(effect), parameters=tuple(parameters))


def experiments() -> Iterator[tuple[str, str]]:
    separations = (
        result.Separation(effect=TILT, rival=DRAG, drops_needed=4),
        result.Separation(effect=TILT, rival=SIX[5], drops_needed=None),
    )
    drop = result.Drop(theta=0.5, v_x=-1.0, v_y=-2.0, omega=3.0, differences=(3.2, 0.4))
    experiment = result.Experiment(separations=separations, drops=(drop,))
    yield "drop", text.phrase("drop", drop, experiment)
    more = replace(separations[0], effect=SIX[1], rival=SIX[2]), replace(separations[0], rival=SIX[3])
    many = replace(experiment, separations=(*separations, *more))
    yield "drops needed", " ".join(text.phrases("needed_drops", many))
    settled = replace(experiment, separations=(replace(separations[0], drops_needed=1),))
    hopeless = replace(experiment, separations=separations[1:])
    for name, one in (("many pairs", many), ("one pair", settled), ("no drop", hopeless)):
        yield f"next experiment, {name}", text.phrase("next_experiment", one)


def models() -> Iterator[tuple[str, str]]:
    tilt, damping = (one.effect for one in FOUND.missing)
    one, both, effects = (0.105, (tilt,)), (0.1, (tilt, damping)), (tilt, damping)
    for name, rows in {
        "fewer": ((0.2, ()), one, both), "none": ((0.109, ()), one, both), "clear": ((0.2, ()), (0.111, (tilt,)), both)
    }.items():  # fmt: skip
        frontier = (result.FrontierModel(law="mirtich", effects=e, error=Interval(x, x, x)) for x, e in rows)
        near = replace(FOUND, frontier=tuple(frontier))
        yield f"{name} effects would do", text.phrase("simpler", near)
        yield f"{name} effects would do, nothing is missing", text.phrase("simpler", replace(near, missing=()))
    laws = ("mirtich", "whittaker", "routh", "ap_newton", "ap_poisson")
    others = tuple(result.PlausibleModel(law=law, effects=effects, share=0.19) for law in laws)
    chosen = result.PlausibleModel(law="wang_mason", effects=effects[::-1], share=0.004)
    for name, those in (("many", (*others, chosen)), ("one", (replace(chosen, share=1.0),))):
        found = replace(FOUND, models=those)
        for model in text.listed_models(found):
            yield f"of {name} models", f"{text.listed_name(found, model)} {text_numbers.share_of_whole(model.share)}"
    rejected = replace(FOUND, unwanted=(EffectId("kick"), EffectId("wind")))
    yield "notes", " ".join(text.phrases("notes", FOUND))
    yield "notes, candidates of the user", " ".join(text.phrases("notes", rejected))
    seen, laws = replace(TILT, form="seen"), [one.name for one in FOUND.laws]
    for name, rows in {
        "two forms": ((laws[0], (TILT,), 0.6), (laws[0], (seen,), 0.2), (laws[0], (), 0.2)),
        "all laws": [(law, (TILT,), 1 / len(laws)) for law in laws],
        "all laws but one": [(law, (TILT,), 0.2) for law in laws if law != "drumwright_shell"],
        "four laws": [(law, (TILT,), 0.25) for law in laws[2:]],
        "laws of unlike shares": [(law, (TILT,), share) for law, share in zip(laws, (0.5, *[0.1] * 5), strict=True)],
        "one model": ((laws[0], (TILT,), 1.0),),
    }.items():
        those = tuple(result.PlausibleModel(law=law, effects=effects, share=share) for law, effects, share in rows)
        yield f"undecided, {name}", "; ".join(text.undecided(replace(FOUND, models=those)))
        if forms := text.uncertain_forms(replace(FOUND, models=those), TILT):
            yield f"forms, {name}", forms


def terminal() -> Iterator[tuple[str, str]]:
    finding = Finding(name="grams", sentence="50% in grams", evidence=(), correction="g")
    events = (AuditFindings(findings=(finding,)), RegionsFound(regions=()))
    effects = EffectsFound(effects=FOUND.missing, regions=())
    left = replace(FOUND, remainder=LEFT, formulas=(BEST,))
    yield "verbose", printed(*events, effects, found=left, verbose=True)
    rival = result.Rival(effect=DRAG, similarity=0.9, loss_difference=0.0, standard_error=0.1)
    _, damping = FOUND.missing
    sure = replace(fitted(TILT, 0.0398), rivals=(rival,), confidence=0.97)
    probable = replace(damping, confidence=0.62, level=result.Level.PROBABLE)
    unsure = result.Candidate(
        effect=SIX[2], equation="", parameters=(), error_after=0.1, error_reduction=0.004, confidence=0.26
    )
    separation = result.Separation(effect=TILT, rival=DRAG, drops_needed=4)
    drop = result.Drop(theta=0.5, v_x=-1.0, v_y=-2.0, omega=3.0, differences=(3.2,))
    laws = (("wang_mason", TILT, 0.5), ("mirtich", replace(TILT, form="seen"), 0.47), ("whittaker", TILT, 0.03))
    shown = replace(
        FOUND, missing=(sure, probable),
        candidates=(
            unsure,
            replace(unsure, effect=SIX[3], confidence=None, proxy=True),
            replace(unsure, effect=SIX[4], error_reduction=0.0009),  # below 1 % of the error: not listed
        ),
        experiment=result.Experiment(separations=(separation,) * 12, drops=(drop,) * 4),
        models=tuple(result.PlausibleModel(law=law, effects=(one,), share=share) for law, one, share in laws),
        equation="mirtich", remainder=LEFT, formulas=(BEST,) * 3,
    )  # fmt: skip
    yield "all levels", printed(found=shown)
    yield "all levels, verbose", printed(found=shown, verbose=True)
    yield from text.names_by_level(shown)
    alternatives = [SIX[3]]
    for _ in range(2):
        either = replace(
            probable, confidence=0.4, level=result.Level.EITHER, alternatives=(*alternatives,), joint_confidence=0.93
        )
        yield "either", printed(found=replace(shown, missing=(sure, either)))
        alternatives.append(SIX[5])


PARTS = (numbers, names, headlines, grounds, effects, experiments, models, terminal)


def written() -> str:
    """All sentences, each after its case."""
    lines = (f"{case}: {words}" for part in PARTS for case, words in part())
    return "\n".join(lines).replace("\u00a0", " ") + "\n"


def test_sentences_are_those_of_the_snapshot():
    assert written().splitlines() == SNAPSHOT.read_text("utf-8").splitlines()


def test_the_terminal_has_no_more_than_fifteen_lines_and_no_spaces_of_its_own():
    (short,) = (words for case, words in terminal() if case == "all levels")
    assert short.count("\n") <= 15
    assert "\u00a0" not in short


def test_every_phrase_has_its_macro():
    """A name or a number of values that no template has would fail only where it is shown."""
    for path in Path(contactlearn.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("phrase", "phrases"):
                name, *values = node.args
                if isinstance(name, ast.Constant):
                    macro = text.macro(str(name.value))
                    assert len(macro.arguments) == len(values), f"{path.name}: {name.value}"


def test_friction_is_open_where_no_spin_was_measured():
    mu, eps = (
        result.FittedParameter(name=name, symbol=symbol, unit="–", value=value, standard_error=1e-5, at_end=False)
        for name, symbol, value in (("mu", "μ", 1e-5), ("eps", "ε", 0.78))
    )
    found = replace(FOUND, coefficients=(mu, eps))
    assert "μ = 0.000010" in text.phrase("coefficients", found)
    unspun = replace(found, findings=(replace(NOTED, name="spin_not_measured"),))
    assert "μ is open, ε = 0.78" in text.phrase("coefficients", unspun)


def test_sentences_fold_at_words_of_a_terminal_and_commands_do_not(monkeypatch):
    long = "  " + "a sentence of many words " * 4
    for is_terminal in (True, False):
        shown = io.StringIO()
        monkeypatch.setattr(terminal_lines, "console", Console(file=shown, width=40, force_terminal=is_terminal))
        terminal_lines.print_line(long)
        terminal_lines.print_line(long, copied=True)
        *folded, whole = shown.getvalue().splitlines()
        assert whole.strip() == long.strip()
        assert (len(folded) > 1) is is_terminal
        if is_terminal:
            assert max(map(len, folded)) <= 40
            assert " ".join(line.strip() for line in folded) == long.strip()
            assert all(line.startswith("    ") for line in folded[1:])


def test_the_terminal_says_why_the_data_were_corrected():
    assert "audit: Grams.\n" in printed(found=replace(FOUND, findings=(NOTED,)))


if __name__ == "__main__":
    SNAPSHOT.write_text(written(), "utf-8")
