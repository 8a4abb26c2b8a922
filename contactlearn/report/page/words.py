"""A verdict in plain words, with its numbers."""

from collections.abc import Iterable, Mapping

from contactlearn.diagnosis.diagnosis import Diagnosis
from contactlearn.report.style import law_style

WRENCH = {"t": "P_t", "n": "P_n", "tau": "τ"}
"""Components of the wrench by their names in a remainder."""

BUDGET = {
    "base": "The law",
    "named": "The law with the effects that were found",
    "ceiling": "The law with Gaussian processes of the whole state",
    "flexible": "With the effects, and Gaussian processes on what remains",
    "bound": "Best impulse of a rigid point contact (IRB bound)",
    "noise": "Noise, {how}",
}
"""What the entries of an error budget are, from the law down."""


def label(name: str) -> str:
    """`spin_damping:after` as a person writes it: spin damping (after)."""
    name, _, form = name.replace("_", " ").partition(":")
    return f"{name} ({form})" if form else name


def listed(names: Iterable[str]) -> str:
    """One, two and three."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def headline(found: Diagnosis) -> str:
    """The verdict in one line."""
    effects, law = listed(label(missing.name) for missing in found.missing) if found.missing else "", base(found)
    if any(finding.fatal for finding in found.findings):
        return "These data contradict themselves, and no correction that is known mends them."
    if found.physics == "unknown":
        known = f" Known are {effects}." if effects else ""
        return f"Something is missing from {law} that none of the known effects explains.{known}{_doubt(found)}"
    if not effects:
        return f"Nothing is missing from {law} that these data could show.{_doubt(found)}"
    verb = "is" if len(found.missing) == 1 else "are"
    return f"{_sentence(effects)} {verb} missing from {law}.{_doubt(found)}"


def _doubt(found: Diagnosis) -> str:
    """What the audit makes of the data, behind a headline."""
    if any(finding.correction for finding in found.findings):
        return " The data had to be corrected first."
    return " The audit doubts the data." if found.findings else ""


def base(found: Diagnosis) -> str:
    """The law, with the effects that were in it already."""
    given = [label(name) for name in found.base.effects] if found.base is not None else []
    return law_style(found.law).label + (f" with {listed(given)}" if given else "")


def sentences(found: Diagnosis) -> list[str]:
    """The numbers behind it, a sentence each."""
    if not found.ladder:
        return [finding.sentence for finding in found.findings if finding.fatal]
    (_, before), (_, after) = found.ladder[0], found.ladder[len(found.missing)]
    said = [f"{base(found)} leaves a held-out mass error of {interval(before._asdict())}."]
    if found.missing:
        these = "this effect" if len(found.missing) == 1 else f"these {len(found.missing)} effects"
        said.append(
            f"With {these} it falls to {interval(after._asdict())}: {1 - after.mean / before.mean:.0%} of the error is "
            "explained."
        )
    left = found.remainder
    if left is not None and left.found:
        said.append(
            f"Gaussian processes that may learn anything take {left.share.mean:.0%} ({left.share.low:.0%} to "
            f"{left.share.high:.0%}) off what remains."
        )
    elif left is not None:
        said.append("Gaussian processes that may learn anything find nothing more.")
    if "noise" in found.budget:
        said.append(f"Noise alone makes {found.budget['noise']['mean']:.4f}.")
    said += [f"{base(found)} fails most where {region}." for region in found.regions[:1]]
    doubtful = [label(name) for name, others in found.equivalents.items() if others]
    if doubtful:
        said.append(
            f"On these data other effects could stand in the place of {listed(doubtful)}; the next experiment would "
            "tell."
        )
    return said


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def interval(x: Mapping[str, float]) -> str:
    """A mean with its 95 % interval."""
    return f"{x['mean']:.4f} (95 %: {x['low']:.4f}–{x['high']:.4f})"
