"""Identity of an effect: the name of its family and, where the family has several forms, the form."""

from dataclasses import dataclass
from functools import total_ordering
from typing import Self

from contactlearn.core.errors import ContactLearnError


@total_ordering
@dataclass(frozen=True)
class EffectId:
    """Identifies an effect by family and form; hashable, and ordered by name, then by form.

    `str()` and `parse` convert to and from the text `name` or `name:form` of files and of the terminal; no other
    code takes that text apart.

    Args:
        name: of the family, such as `spin_damping`.
        form: within the family, such as `during`; None for a family of one form.

    Raises:
        ContactLearnError: an empty name or form, or one that contains a colon.
    """

    name: str
    form: str | None = None

    def __post_init__(self) -> None:
        for part in (self.name, self.form):
            if part is not None and (not isinstance(part, str) or not part or ":" in part):
                rule = "the name and the form of an effect must be text without a colon"
                raise ContactLearnError(f"{rule}, got {part!r}; EffectId.parse reads name:form")

    def __str__(self) -> str:
        return self.name if self.form is None else f"{self.name}:{self.form}"

    def __lt__(self, other: "EffectId") -> bool:
        return (self.name, self.form or "") < (other.name, other.form or "")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `name` or `name:form`, as `str` writes it.

        Raises:
            ContactLearnError: neither of the two.
        """
        name, colon, form = text.partition(":")
        return cls(name, form if colon else None)
