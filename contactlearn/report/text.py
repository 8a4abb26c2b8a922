"""A verdict in plain words, with its numbers."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict

from contactlearn.diagnosis.pipeline import Diagnosis
from contactlearn.diagnosis.search.ladder import Missing
from contactlearn.diagnosis.unexplained.formulas import OUTPUT, Formula
from contactlearn.effects import EffectId
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.report.figures.style import law_style

WRENCH = {"t": "P_t", "n": "P_n", "tau": "τ"}
"""Components of the wrench by their names in a remainder."""

BUDGET = {
    "base": "{law}",
    "named": "The law with the effects that were found",
    "ceiling": "The law with Gaussian processes of the whole state",
    "flexible": "With the effects, and Gaussian processes on what remains",
    "bound": "Best impulse of a rigid point contact (ideal rigid-body bound, IRB)",
    "noise": "Noise, {how}",
}
"""What the entries of an error budget are, from the law down."""


_SPELT = {"_dependent_": "-dependent ", "kuwabara_kono": "Kuwabara–Kono", "stribeck": "Stribeck"}
_RIVALS = 2  # that a headline names


def label(name: str | EffectId) -> str:
    """`velocity_dependent_friction:stribeck` as a person writes it: velocity-dependent friction (Stribeck)."""
    name = str(name)
    for code, words in _SPELT.items():
        name = name.replace(code, words)
    name, _, form = name.replace("_", " ").partition(":")
    return f"{name} ({form})" if form else name


def model_label(name: str) -> str:
    """`wang_mason + side_drag` as Wang–Mason + side drag; any other model as it is drawn."""
    known = law_style(name).label
    if known != name or " + " not in name:
        law = name.removesuffix(" (joint)")
        return known if known != name or law == name else f"{law_style(law).label} (joint)"
    law, *effects = name.split(" + ")
    return " + ".join((law_style(law).label, *map(label, effects)))


def listed(names: Iterable[str], word: str = "and") -> str:
    """One, two and three."""
    *first, last = names
    return f"{', '.join(first)} {word} {last}" if first else last


def headline(found: Diagnosis) -> str:
    """The verdict in one line."""
    effects, law = listed(label(missing.id) for missing in found.missing) if found.missing else "", base(found)
    if any(finding.fatal for finding in found.findings):
        return "These data contradict themselves, and no correction that is known mends them."
    verb = "is" if len(found.missing) == 1 else "are"
    more = found.remainder is not None and found.remainder.found
    if found.physics == "unknown":
        known = f" Known {verb} {effects}{_rivals(found)}." if effects else ""
        return f"Something is missing from {law} that none of the known effects explains.{known}{_doubt(found)}"
    if not effects:
        if more:
            return f"No known effect is missing from {law}, but something small that can be predicted.{_doubt(found)}"
        return f"Nothing is missing from {law} that these data could show.{_doubt(found)}"
    rest = "; more is missing that no known effect explains" if more else ""
    return f"{opened(effects)} {verb} missing from {law}{_rivals(found)}{rest}.{_doubt(found)}"


def _rivals(found: Diagnosis) -> str:
    """What else the effects could be, behind their names."""
    said = ""
    for missing in found.missing:
        others = [label(other.id) for other in found.equivalents.get(missing.id.name, ())]
        if others:
            more = len(others) - _RIVALS
            named = others if more <= 0 else [*others[:_RIVALS], "another effect" if more == 1 else f"{more} others"]
            said += f"; {label(missing.id)} could also be {listed(named, 'or')}"
    return said


def _doubt(found: Diagnosis) -> str:
    """What the audit makes of the data, behind a headline."""
    if any(finding.correction for finding in found.findings):
        return " The data had to be corrected first."
    return " The audit doubts the data." if found.findings else ""


def base(found: Diagnosis) -> str:
    """The law, with the effects that were in it already."""
    given = [label(name) for name in found.base.effects] if found.base is not None else []
    return law_style(found.law).label + (f" with {listed(given)}" if given else "")


def always(found: Diagnosis, ticked: Iterable[str]) -> list[str]:
    """Names of effects of the model that were neither given nor can be ticked, so that every choice has them."""
    apart = {*ticked, *found.base.effects}
    return [name for name in found.model.effects if name not in apart]


def sentences(found: Diagnosis) -> list[str]:
    """The numbers behind it, a sentence each."""
    if not found.ladder:
        return [sentence(finding.sentence) for finding in found.findings if finding.fatal]
    (_, before), (_, after) = found.ladder[0], found.ladder[len(found.missing)]
    said = [f"{base(found)} leaves a held-out mass error of {interval(asdict(before))}."]
    if found.missing:
        these = "this effect" if len(found.missing) == 1 else f"these {len(found.missing)} effects"
        share = 1 - after.mean / before.mean if before.mean else 0.0
        said.append(f"With {these} it falls to {interval(asdict(after))}: {percent(share)} of the error is explained.")
    said += [_size(missing) for missing in found.missing if missing.parameters]
    said += _remaining(found)
    if "noise" in found.budget:
        said.append(f"Noise alone makes {found.budget['noise']['mean']:.4f}.")
    best = min(found.laws, key=found.laws.get, default=found.law)
    if found.physics == "unknown" and found.laws and found.laws[best] < found.budget["named"]["mean"]:
        said.append(
            f"{law_style(best).label} alone leaves {found.laws[best]:.4f}, less than {law_style(found.law).label} with "
            f"all this: try law={best}."
        )
    said += [spaced(f"{base(found)} fails most where {region}.") for region in found.regions[:1]]
    ids = {missing.id.name: missing.id for missing in found.missing}
    doubtful = [label(ids[name]) for name, others in found.equivalents.items() if others]
    if doubtful:
        tell = "; the next experiment would tell" if found.experiment and any(found.experiment.needed.values()) else ""
        said.append(f"On these data other effects could stand in the place of {listed(doubtful)}{tell}.")
    return said


def _size(missing: Missing) -> str:
    """An effect with the first of its parameters."""
    first = next(iter(missing.parameters.values()))
    size = measured(first["value"], first["standard_error"], first["unit"])
    return f"{opened(label(missing.id))}: {first['symbol']} = {size}."


def _remaining(found: Diagnosis) -> list[str]:
    """How much more flexible processes explain, in which components, of which variables, and by which formula."""
    left = found.remainder
    if left is None:
        return []
    if not left.found:
        return ["Gaussian processes that may learn anything find nothing more."]
    share = f"{percent(left.share.mean)} ({percent(left.share.low)} to {percent(left.share.high)})"
    said = [
        f"Gaussian processes that may learn anything take {share} off what remains, in "
        f"{listed(WRENCH[name] for name in left.components)}."
    ]
    if left.variables:
        matter = (f"{SYMBOLS[name].letter} ({percent(part)})" for name, part in left.variables.items())
        said.append(f"What remains depends on {listed(matter)}.")
    return said + [f"The best formula for it is {_formula(one)}." for one in found.formulas[:1]]


def _formula(one: Formula) -> str:
    letter = next(WRENCH[name] for name, output in OUTPUT.items() if output == one.output)
    gain = f"{percent(one.gain)} ± {percent(one.gain_error)}"
    return f"{letter} ← {letter} + {one.text}, which takes {gain} off the held-out error"


def opened(text: str) -> str:
    """With a capital, unless it opens with a number or a symbol, such as x."""
    first = text.partition(" ")[0].rstrip(",:")
    word = first == "a" or (len(first) > 1 and first.isascii() and first.replace("-", "").isalpha())
    return text[0].upper() + text[1:] if word else text


def sentence(text: str) -> str:
    """What a stage says, as a sentence of the page."""
    return spaced(opened(text)) + ("" if text.endswith((".", "?", "!")) else ".")


def percent(x: float, decimals: int = 0) -> str:
    """A share as 78 %."""
    return f"{100 * x:.{decimals}f}\u00a0%"


def spaced(text: str) -> str:
    """`78%` and `3e-5` as 78 % and 3e−5."""
    return re.sub(r"(?<=\de)-(?=\d)", "−", re.sub(r"(?<=\d)%", "\u00a0%", text))


def number(x: float, digits: int = 4) -> str:
    """To significant digits; exponents are written as 3e−5."""
    return re.sub(r"e([+−])0*", lambda e: "e" + e[1].strip("+"), f"{x:.{digits}g}".replace("-", "−"))


def measured(value: float, error: float | None, unit: str = "–") -> str:
    """A value with the digits that its standard error leaves, the error, and the unit."""
    if error is None or not math.isfinite(error) or error == 0:
        text = number(value) + (" ± 0" if error == 0 else "")
    elif error > 10 * abs(value) + 0.1 or error < 1e-6:  # no digit is known, or too many are
        text = f"{number(value, 3)} ± {number(error, 2)}"
    else:
        decimals = max(0, 1 - math.floor(math.log10(error)))
        text = f"{value:.{decimals}f} ± {error:.{decimals}f}".replace("-", "−")
    return text + (f" {unit}" if unit not in ("", "–") else "")


def interval(x: Mapping[str, float]) -> str:
    """A mean with its 95 % interval."""
    dash = " to " if x["low"] < 0 else "–"
    return f"{x['mean']:.4f} (95\u00a0%: {x['low']:.4f}{dash}{x['high']:.4f})".replace("-", "−")
