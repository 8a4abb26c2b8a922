"""Lines about a table and the audit of measurements, for commands whose result is something else."""

from collections.abc import Sequence

from contactlearn.data.audit.corrections import CORRECTIONS
from contactlearn.data.audit.result import Finding
from contactlearn.report.terminal import say
from contactlearn.report.text import correct_setting, sentence

_COMPUTED = {
    "r": "rx, ry from the shape and theta (rad and counter-clockwise, unless data.units says otherwise)",
    "inertia": "the inertia from the shape and the mass, at uniform density",
}


def show_columns(unused: Sequence[str], computed: Sequence[str]) -> None:
    """Print the columns of a table that are not used, and what its body's shape gave instead of columns."""
    if unused:
        say(f"columns not used: {', '.join(name if name.isprintable() and name else repr(name) for name in unused)}")
    if computed:
        say(f"computed: {'; '.join(_COMPUTED[field] for field in computed)}")


def show_mistakes(findings: Sequence[Finding], corrected: Sequence[str]) -> None:
    """Print a line for each mistake in the measurements, with the setting that corrects all that can be.

    Args:
        findings: mistakes.
        corrected: corrections that were made before.
    """
    setting = correct_setting(corrected, findings)
    for finding in findings:
        name = finding.correction
        if name is None:
            say(f"audit: {sentence(finding.sentence)}")
        else:
            said = CORRECTIONS[name].description if finding.hypothesis else finding.sentence
            say(f"audit: {said}: use {setting}")
