"""Session: all choices on the workbench, as an immutable value that is the address of the page.

    data     the words of a command line that name the data: data=mystery data.seed=7
    law      name of the law
    effect   effects in the order in which they were ticked, name or name:form
    line     effects as lines of mathematics, see `lines`
    option.X.Y  option Y of effect X, such as velocity_dependent_restitution.v_ref: a number, or low:high
    manual.X parameter X, such as mu or side_drag.c, set by hand; the others keep their fitted values
    seed     of the split into training and held-out trials
    trial    row of the selected trial, counted from 0
    window   variable:low:high; the trials that are selected on the map lie in every window

An address holds what differs from the defaults, in this order, so equal sessions have equal addresses.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from urllib.parse import parse_qsl, urlencode

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.numerics import is_number
from contactlearn.data.audit.corrections import CORRECTIONS
from contactlearn.effects import EffectId

_WORD = re.compile(r"data(\.[a-z_0-9]+)*=[^\n$]*")
_CORRECT = "data.correct="
_MAX_ADDRESS = 20_000  # characters of an address


@dataclass(frozen=True, kw_only=True)
class Window:
    """Trials whose variable lies in [low, high], in the units of the map."""

    variable: str
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Option:
    """A constant of an effect that is not fitted: a number, or two."""

    effect: str
    name: str
    value: tuple[float, ...]

    @property
    def setting(self) -> float | list[float]:
        """The value as a configuration holds it."""
        return self.value[0] if len(self.value) == 1 else list(self.value)


@dataclass(frozen=True, kw_only=True)
class Session:
    """See the module.

    Raises:
        ContactLearnError: words that do not name data, an effect twice, or a number that is not finite.
    """

    data: tuple[str, ...] = ("data=synthetic",)
    law: str = "wang_mason"
    effects: tuple[EffectId, ...] = ()
    lines: tuple[str, ...] = ()
    options: tuple[Option, ...] = ()
    manual: tuple[tuple[str, float], ...] = ()
    seed: int = 0
    trial: int | None = None
    windows: tuple[Window, ...] = ()

    def __post_init__(self) -> None:
        for word in self.data:
            if not _WORD.fullmatch(word):
                raise ContactLearnError(f"data is named as data=mystery data.seed=7, without $; got {word!r}")
        names = [effect.name for effect in self.effects]
        if len(set(names)) < len(names):
            raise ContactLearnError(f"an effect is in the model once, in one form; got {', '.join(names)}")
        numbers = (
            [x for option in self.options for x in option.value]
            + [x for _, x in self.manual]
            + [x for one in self.windows for x in (one.low, one.high)]
        )
        if not all(is_number(x) and math.isfinite(x) for x in numbers):
            raise ContactLearnError(f"an address holds finite numbers only, got {numbers}")

    @property
    def address(self) -> str:
        """The query of the page's address, empty for the defaults."""
        plain = Session()
        pairs: list[tuple[str, str]] = []
        if self.data != plain.data:
            pairs = [(key, value) for key, _, value in (word.partition("=") for word in self.data)]
        pairs += [("law", self.law)] if self.law != plain.law else []
        pairs += [("effect", str(effect)) for effect in self.effects]
        pairs += [("line", line) for line in self.lines]
        pairs += [(f"option.{one.effect}.{one.name}", ":".join(map(repr, one.value))) for one in self.options]
        pairs += [(f"manual.{name}", f"{value!r}") for name, value in self.manual]
        pairs += [("seed", str(self.seed))] if self.seed != plain.seed else []
        pairs += [("trial", str(self.trial))] if self.trial is not None else []
        pairs += [("window", f"{one.variable}:{one.low!r}:{one.high!r}") for one in self.windows]
        return f"?{urlencode(pairs)}" if pairs else ""

    @property
    def corrections(self) -> tuple[str, ...]:
        """The corrections of the data, by name, in the order in which they are made."""
        given = [word.partition("=")[2] for word in self.data if word.startswith(_CORRECT)]
        return tuple(filter(None, (name.strip() for name in given[-1].strip("[]").split(",")))) if given else ()

    def corrected(self, names: Sequence[str]) -> "Session":
        """Return the session with the data corrected by these corrections and no others.

        Raises:
            UnknownNameError: no such correction.
        """
        for name in names:
            if name not in CORRECTIONS:
                raise UnknownNameError("correction", name, CORRECTIONS)
        words = tuple(word for word in self.data if not word.startswith(_CORRECT))
        words += (f"{_CORRECT}[{','.join(names)}]",) if names else ()
        return replace(self, data=words, manual=(), trial=None, windows=())

    @classmethod
    def read(cls, address: str) -> "Session":
        """Read an address; other keys than those of a session are ignored.

        Raises:
            ContactLearnError: an entry that breaks a rule.
        """
        if len(address) > _MAX_ADDRESS:
            raise ContactLearnError(f"an address has up to {_MAX_ADDRESS} characters, got {len(address)}")
        pairs = parse_qsl(address.removeprefix("?"), keep_blank_values=True)
        data = tuple(f"{key}={value}" for key, value in pairs if key == "data" or key.startswith("data."))
        known = {key: value for key, value in pairs}
        plain = cls()
        return cls(
            data=data or plain.data,
            law=known.get("law", plain.law),
            effects=tuple(EffectId.parse(value) for key, value in pairs if key == "effect"),
            lines=tuple(value for key, value in pairs if key == "line"),
            options=tuple(_option(key, value) for key, value in pairs if key.startswith("option.")),
            manual=tuple((key[len("manual.") :], _float(value)) for key, value in pairs if key.startswith("manual.")),
            seed=_whole("seed", known.get("seed", "0")),
            trial=_whole("trial", known["trial"]) if "trial" in known else None,
            windows=tuple(_window(value) for key, value in pairs if key == "window"),
        )

    @property
    def model(self) -> tuple[object, ...]:
        """Law, effects with their options, and lines: what is fitted."""
        names = [effect.name for effect in self.effects]
        return self.law, self.effects, self.lines, tuple(option for option in self.options if option.effect in names)

    @property
    def model_only(self) -> "Session":
        """The session with data and model alone: nothing set by hand or selected."""
        return replace(self, manual=(), trial=None, windows=())

    def with_effect(self, effect: EffectId) -> "Session":
        """Return the session with an effect in the model, which replaces another form of it."""
        if effect.name in [one.name for one in self.effects]:
            effects = tuple(effect if one.name == effect.name else one for one in self.effects)
        else:
            effects = (*self.effects, effect)
        return replace(self.without_effect(effect.name), effects=effects)

    def without_effect(self, name: str) -> "Session":
        """Return the session without an effect and its options."""
        rest = tuple(effect for effect in self.effects if effect.name != name)
        return replace(self, effects=rest, options=tuple(one for one in self.options if one.effect != name), manual=())

    def with_option(self, effect: str, name: str, value: tuple[float, ...]) -> "Session":
        """Return the session with an option of an effect; an empty value restores the default."""
        rest = tuple(option for option in self.options if (option.effect, option.name) != (effect, name))
        rest += (Option(effect=effect, name=name, value=value),) if value else ()
        return replace(self, options=tuple(sorted(rest, key=lambda one: (one.effect, one.name))), manual=())

    def with_value(self, name: str, value: float | None) -> "Session":
        """Return the session with a parameter set by hand; None restores its fitted value."""
        rest = tuple(pair for pair in self.manual if pair[0] != name)
        return replace(self, manual=rest if value is None else (*rest, (name, value)))


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ContactLearnError(f"an address holds numbers such as 0.25, got {text!r}") from None


def _whole(key: str, text: str) -> int:
    if not re.fullmatch(r"\d{1,9}", text):
        raise ContactLearnError(f"{key} is a whole number, 0 or more; got {text!r}")
    return int(text)


def _option(key: str, text: str) -> Option:
    if not re.fullmatch(r"option\.[a-z_0-9]+\.[a-z_0-9]+", key):
        raise ContactLearnError(f"an option is option.EFFECT.NAME=number, or low:high; got {key!r}")
    _, effect, name = key.split(".")
    return Option(effect=effect, name=name, value=tuple(_float(part) for part in text.split(":")))


def _window(text: str) -> Window:
    if not re.fullmatch(r"[a-z_]+:[^:]+:[^:]+", text):
        raise ContactLearnError(f"a window is variable:low:high, such as v_x:-1:0.5; got {text!r}")
    variable, low, high = text.split(":")
    return Window(variable=variable, low=_float(low), high=_float(high))
