"""Names as a person writes them: laws, models, effects, rungs of the ladder, components; lists and sentences."""

import re
from collections.abc import Iterable, Sequence
from pathlib import PurePath

from contactlearn import laws
from contactlearn.diagnosis.result import (
    FLOORS,
    PROCESSES,
    Coefficient,
    Diagnosis,
    NoiseSource,
    Rung,
    RungKind,
    WrenchComponent,
)
from contactlearn.effects import EffectId
from contactlearn.report.text.numbers import fix_spacing
from contactlearn.results.types import Evaluation, Training

WRENCH = {WrenchComponent.TANGENTIAL: "P_t", WrenchComponent.NORMAL: "P_n", WrenchComponent.MOMENT: "τ"}
"""Components of the wrench."""

COEFFICIENTS = {Coefficient.FRICTION: "friction", Coefficient.RESTITUTION: "restitution", None: "the outcome"}
"""Coefficients that vary; None where it is the outcome and no coefficient."""

NOISE_SOURCES = {
    NoiseSource.STATED: "from the stated noise",
    NoiseSource.MEASURED: "from the covariances of the measurements",
    NoiseSource.ESTIMATED: "from differences between similar trials",
    NoiseSource.SCATTER: "of the instrument and of the contact's scatter",
}
"""Origins of the noise floor."""

MODELS = {
    "best_post_hoc": "Best Post Hoc",
    "irb": "IRB bound",
    "state_velocity": "10-D → velocity",
    "x1_impulse": "X1 → impulse",
    "x2_impulse": "X2 → impulse",
    "x1_wrench": "X1 → wrench",
    "residual_impulse": "Law + impulse GP",
    "residual_wrench": "Law + wrench GP",
    "parameters_identified": "Law, (μ, ε) GP, identified",
    "parameters_likelihood": "Law, (μ, ε) GP, likelihood",
}
"""Bounds, and learned models by the name of their recipe."""


_SPELT = {
    "com_offset": "centre-of-mass offset", "_dependent_": "-dependent ", "kuwabara_kono": "Kuwabara–Kono",
    "stribeck": "Stribeck", "r_squared": "R²",
}  # fmt: skip


def label(name: str) -> str:
    """Write an identifier in words: velocity_dependent_friction as velocity-dependent friction."""
    for code, words in _SPELT.items():
        name = name.replace(code, words)
    return name.replace("_", " ")


def effect_label(effect: EffectId) -> str:
    """Write an effect with its form: velocity-dependent friction (Stribeck)."""
    return label(effect.name) + (f" ({label(effect.form)})" if effect.form is not None else "")


def source_label(source: str) -> str:
    """Write a data source without folders and corrections, a law by its authors: drops.csv, tracks of takes."""
    source = re.sub(r"\((\w+)(?=, seed )", lambda law: f"({law_label(law[1])}", source)
    kind, of, path = source.partition(" (corrected: ")[0].rpartition("tracks of ")
    return f"{kind}{of}{PurePath(path).name or path}"


def law_label(name: str) -> str:
    """Write a law by its authors; any other name as it is."""
    return laws.find(name).label if name in laws.names() else name


def model_label(name: str) -> str:
    """Write a law, bound or learned model by its name; any other name as it is."""
    return MODELS.get(name) or law_label(name)


def model_labels(result: Training | Evaluation) -> dict[str, str]:
    """Write each model of an evaluation, by name: laws by their authors, with effects as Whittaker + side drag."""
    alone = {fit.law for fit in result.fits}
    labels = {name: model_label(name) for name in result.errors}
    for name, fit in result.joint.items():
        labels[name] = " + ".join((law_label(fit.law), *map(effect_label, fit.effects)))
        if not fit.effects and fit.law in alone:
            labels[name] += " (joint)"
    return labels


def base_label(diagnosis: Diagnosis) -> str:
    """Write the law of a diagnosis with the effects that were given."""
    given = [effect_label(effect) for effect in diagnosis.given]
    return (law_label(diagnosis.law) if diagnosis.law else "any law") + (f" with {join_words(given)}" if given else "")


def rung_label(rung: Rung, base: str) -> str:
    """Write a rung of the ladder, the law's as `base`."""
    if rung.kind is RungKind.EFFECT:
        return f"+ {effect_label(rung.effect)}" if rung.effect is not None else "+ effect"
    return {RungKind.LAW: base, RungKind.PROCESSES: f"+ {PROCESSES}", **FLOORS}[rung.kind]


def join_words(names: Iterable[str], word: str = "and") -> str:
    """Write a list of one or more names: one, two and three."""
    *first, last = names
    return f"{', '.join(first)} {word} {last}" if first else last


def shortened(names: Sequence[str], most: int, kind: str) -> list[str]:
    """The first names of a list that is longer than `most`, and the number of the others of their kind."""
    rest = len(names) - most
    if rest <= 0:
        return list(names)
    return [*names[:most], f"one other {kind}" if rest == 1 else f"{rest} other {kind}s"]


def capitalize_first(text: str) -> str:
    """Write a capital first, unless the text opens with a number or a symbol, such as x."""
    first = text.partition(" ")[0].rstrip(",:")
    word = first == "a" or (len(first) > 1 and first.isascii() and first.replace("-", "").isalpha())
    return text[0].upper() + text[1:] if word else text


def sentence(text: str) -> str:
    """Write a clause as a sentence: a capital first, a full stop last, spaces before %."""
    return fix_spacing(capitalize_first(text)) + ("" if text.endswith((".", "?", "!")) else ".")
