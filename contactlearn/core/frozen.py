"""Classes that are frozen dataclasses by themselves, as the modules of Equinox are."""

from dataclasses import Field, FrozenInstanceError, dataclass, field
from typing import Any, ClassVar, NoReturn, dataclass_transform


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
class Frozen:
    """A base whose subclasses need no decorator; one that has it all the same stays as it is."""

    compares: ClassVar[bool] = False
    """Whether instances of equal fields are equal; else each equals itself alone."""
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        own = {name: one for name, one in vars(cls).items() if isinstance(one, Field)}
        dataclass(frozen=True, eq=cls.compares)(cls)
        # A decorator of the author's looks for the fields again, and refuses to write these methods.
        for name, one in own.items():
            setattr(cls, name, one)
        del cls.__setattr__, cls.__delattr__

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> NoReturn:
        raise FrozenInstanceError(f"cannot delete field {name!r}")
