"""Results of the audit: findings about the measurements, and the numbers behind each."""

from dataclasses import dataclass
from html import escape

from contactlearn.mechanics.apparatus import Row


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """A quantity behind a finding: its name, value and unit (– for a pure number or a name)."""

    quantity: str
    value: float | str
    unit: str = "–"


def evidence_of(*quantities: tuple[str, float | str] | tuple[str, float | str, str]) -> tuple[Evidence, ...]:
    """Return evidence of quantities, each a name, a value and its unit, – by default."""
    return tuple(Evidence(quantity=name, value=value, unit=(*unit, "–")[0]) for name, value, *unit in quantities)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A contradiction between the measurements and any planar rigid impact, or a note about them.

    Args:
        name: of the kind of finding: that of its correction, or `gross_outliers`, `impossible`, ….
        sentence: the finding in words.
        evidence: the numbers behind it.
        grounds: a clause with the most telling of them; of findings that share them the last one has it.
        correction: name of the correction that undoes it, if any.
        fatal: whether no correction helps, so that no model is fitted.
        mistake: whether the data are wrong; False for a note.
        hypothesis: all corrections of the best hypothesis about units and axes, to which this finding belongs.
        alternatives: hypotheses that these data cannot distinguish from it.
        rig: the rig card that it is about.
    """

    name: str
    sentence: str
    evidence: tuple[Evidence, ...]
    correction: str | None = None
    fatal: bool = False
    mistake: bool = True
    hypothesis: tuple[str, ...] = ()
    alternatives: tuple[tuple[str, ...], ...] = ()
    rig: tuple[Row, ...] = ()
    grounds: str = ""

    def __repr__(self) -> str:
        """Write the sentence, and the correction where there is one."""
        fix = f" → {self.correction}" if self.correction else ""
        grounds = f"; {self.grounds}" if self.grounds else ""
        return f"Finding({self.name}: {self.sentence}{grounds}{fix})"

    def value(self, quantity: str) -> float | str:
        """The value of a quantity of the evidence.

        Raises:
            KeyError: the evidence has no such quantity.
        """
        for item in self.evidence:
            if item.quantity == quantity:
                return item.value
        raise KeyError(quantity)


class Audit(tuple[Finding, ...]):
    """The findings of an audit, most fundamental first: mistakes, and notes."""

    __slots__ = ()

    @property
    def mistakes(self) -> tuple[Finding, ...]:
        """The findings that are no notes."""
        return tuple(finding for finding in self if finding.mistake)

    @property
    def corrections(self) -> list[str]:
        """Names of the corrections in their order, as `data.correct` takes them."""
        return [finding.correction for finding in self if finding.correction]

    def __repr__(self) -> str:
        """Write a line for each finding and for what shows it, and the setting that corrects them."""
        lines = list[str]()
        for one in self:
            lines.append(f"{'wrong' if one.mistake else 'note'}: {one.sentence}")
            lines += [f"evidence: {one.grounds}"] if one.grounds else []
        fix = [f"to correct it: data.correct=[{','.join(self.corrections)}]"] * bool(self.corrections)
        return "\n".join([*lines, *fix])

    def _repr_html_(self) -> str:
        return "".join(f"<p>{escape(line)}</p>" for line in repr(self).split("\n"))
