"""Settings of the commands: a composed configuration is decoded once, here, and travels on as frozen structs.

    TrainSettings, EvaluateSettings,    all settings of one command, named as in `configs/`
    DiagnoseSettings, PlanSettings
    SourceSettings                      a source of measurements: `data`, or a body of `transfer.bodies`

The structs declare which settings there are, with the type and the rule of each; defaults and explanations stand in
`configs/`.  Laws, effects and learned models are built before any data is read: a wrong setting costs seconds, not a
run.  Laws and effects of the user's own are tried on a few drops; a class that passes may still break a rule, and
`contactlearn.testing` has the whole contract.
"""

import inspect
import re
import traceback
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from itertools import chain
from typing import Annotated, Any, Literal, Self, TypeVar, get_args, get_origin

import msgspec
import torch
from msgspec import Meta, Struct, field
from msgspec.structs import FieldInfo
from omegaconf import MISSING, DictConfig, OmegaConf, open_dict
from torch import Tensor

from contactlearn import laws
from contactlearn.cli.checkpoints import TrainedModel, load_model, load_models
from contactlearn.cli.config_files import BEST, NAME, UNUSED, choices, own_data, shipped_settings, without_hydra
from contactlearn.cli.config_security import leaf_values
from contactlearn.cli.reasons import reason
from contactlearn.cli.resource_limits import usable_cores
from contactlearn.core import devices
from contactlearn.core.errors import ContactLearnError, UnknownNameError, suggest
from contactlearn.core.numerics import is_number, is_whole
from contactlearn.data.recordings import SOURCES
from contactlearn.diagnosis.discrimination.experiment import STATES
from contactlearn.diagnosis.search.candidates import SEARCHED_LAWS
from contactlearn.effects import Effect, catalogue, from_settings
from contactlearn.effects.checks import describe, lost_gradients, violations
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.shared import Box
from contactlearn.inference.learning.recipe import Recipe
from contactlearn.laws import PAPER_LAWS, Contact, Law
from contactlearn.mechanics.impacts import ImpulseTarget
from contactlearn.mechanics.shapes import make_shape
from contactlearn.models.process_options import ProcessOptions
from contactlearn.planning.rig import Limits, Specimen
from contactlearn.simulation import synthetic

_IDENTIFIED = "parameters_identified"  # target of learned models that identify each trial's (μ, ε) with the law alone
_DROPS, _MU, _EPS = 5, 0.2, 0.5
_ROUNDING = 1e-9  # m/s and rad/s
_TORCH_ALONE = "; a parameter has many values and a gradient: let torch alone compute with it, no float() and no numpy"
_HINTS = {
    "Boolean value of Tensor": (
        "; a parameter has many values at once: torch.where(condition, a, b) takes the place of if"
    ),
    "only one element tensors can be converted": _TORCH_ALONE,
    "Can't call numpy() on Tensor that requires grad": _TORCH_ALONE,
}
"""Advice by the start of an error in a class of the user's own."""
_LARGEST_SEED = 2**63 - 1  # that PyTorch's generators take
Base = TypeVar("Base")

_PROCESSES = ("kernel", "mean", "likelihood", "optimiser", "prior")  # of a learned model
_LARGEST = 1e300
_Whole = Annotated[int, Meta(ge=1, description="a whole number, 1 or more")]
_Positive = Annotated[float, Meta(gt=0, le=_LARGEST)]
_Seed = Annotated[int, Meta(ge=0, le=_LARGEST_SEED, description=f"a whole number from 0 to {_LARGEST_SEED}")]


@dataclass(frozen=True, kw_only=True)
class SourceSettings:
    """A source of measurements.

    Args:
        target: its function, such as contactlearn.data.table.load.
        options: its settings as plain values, by name.
        corrections: names of corrections, in the order of application; of recordings the rig card by default.
        missing: dotted names of settings that must be given and are not.
    """

    target: str
    options: Mapping[str, Any]
    corrections: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @classmethod
    def from_values(cls, values: Mapping[str, Any], name: str = "data") -> Self:
        """Decode the part `name` of a configuration.

        Raises:
            ContactLearnError: no source, a setting that it does not have, or corrections that are no list.
        """
        target = str(values.get("_target_", ""))
        shipped = shipped_settings("data")
        sources = [settings for settings in shipped.values() if settings["_target_"] == target]
        if not sources:
            raise ContactLearnError(
                f"{name}._target_ must be a source under contactlearn.data or contactlearn.simulation, got {target!r}"
            )
        known = dict.fromkeys(key for settings in sources for key in settings)
        for key in values.keys() - known.keys():
            (path, _), *_ = leaf_values({name: {key: values[key]}})
            ends = "".join(f".{part}" for part in path[2:])
            near = suggest(f"{name}.{key}{ends}", [f"{name}.{other}{ends}" for other in known])
            holders = ", ".join(f"data={choice}" for choice, settings in shipped.items() if key in settings)
            rule = f"{name}.{key} is a setting of other choices ({holders}), not of these"
            unknown = rule if holders else f"unknown setting '{name}.{key}{ends}'{near}"
            raise ContactLearnError(f"{unknown}; --settings lists all")
        names = values.get("correct", ["rig"] if target in SOURCES else []) or []
        if isinstance(names, str):
            raise ContactLearnError(f"{name}.correct must be a list of names, such as [{names}], got {names!r}")
        return cls(
            target=target,
            options={key: value for key, value in values.items() if key not in ("_target_", "correct")},
            corrections=tuple(names),
            missing=tuple(".".join((name, *path)) for path, value in leaf_values(values) if value == MISSING),
        )

    @classmethod
    def from_config(cls, cfg: DictConfig) -> Self:
        """Decode `data` of a composed configuration.

        Raises:
            ContactLearnError: see `from_values`.
        """
        return cls.from_values(plain_values(cfg.data))

    def refuse_missing(self) -> None:
        """Raise for settings that must be given and are not.

        Raises:
            ContactLearnError: naming all of them.
        """
        if self.missing:
            for choice, settings in shipped_settings("data").items():
                if settings["_target_"] == self.target and settings.get("seed") == MISSING:
                    raise ContactLearnError(f"data={choice} needs a seed, such as {self.missing[0]}=7")
            file, comments = self._file_of_user()
            where = f"{file}" if file else "the file NAME.yaml of data=NAME, which contactlearn init writes"
            said = "".join(f"; {name} is {comments[name]}" for name in self.missing if name in comments)
            raise ContactLearnError(
                f"{', '.join(self.missing)} must be given: {self.missing[0]}=…, or in {where}{said}"
            )

    def _file_of_user(self) -> tuple[str, dict[str, str]]:
        """The file of settings in the working directory with this path, and what it says of names in the data file."""
        files = {
            file: file.read_text(encoding="utf-8", errors="replace") for file in own_data().values() if file.is_file()
        }
        line = re.compile(rf"^path: [\"']?{re.escape(str(self.options.get('path')))}[\"']?\s*(?:#|$)", re.MULTILINE)
        matching = [file for file, text in files.items() if line.search(text)]
        if len(matching) != 1:  # several files of settings may have one path
            return "", {}
        (file,) = matching
        asked = {
            name.rpartition(".")[2]: name for name in self.missing if name.endswith(".body") or ".columns." in name
        }
        comments = re.findall(r"^ *(\w+): \?\?\? *# *(.*\S)", files[file], re.MULTILINE)
        return file.name, {asked[key]: comment for key, comment in comments if key in asked}


def plain_values(part: DictConfig) -> dict[str, Any]:
    """Return a part of a configuration as plain values by name, with every reference replaced by its value."""
    values = OmegaConf.to_container(without_hydra(part) if "hydra" in part else part, resolve=True)
    assert isinstance(values, dict)  # a part that is given and not null
    return {str(name): value for name, value in values.items()}


def parse_law(entry: Any, variant: str) -> Law | None:
    """Return the law of a name, or of a mapping with `_target_` and options; None for `best` and for no `_target_`.

    A class of the variant `textbook` stands for its family, so that the variant is a setting of its own.

    Raises:
        ContactLearnError: a `_target_` that is no law, or a class of the user's own that fails.
        UnknownNameError: no such law, variant or option.
    """
    if not isinstance(entry, Mapping):
        return None if entry == BEST else laws.find(str(entry), variant)
    target = entry.get("_target_")
    if target is None:
        return None
    kind = _subclass(target, Law)
    if inspect.isabstract(kind):
        raise ContactLearnError(f"_target_={target} has no closed form; a law must define solve(contact, mu, eps)")
    options = {key: tuple(x) if isinstance(x, list) else x for key, x in entry.items() if key != "_target_"}
    with located_errors(target, kind):
        law = laws.find(kind.name, variant if kind.variant == "textbook" else kind.variant, **options)
        if not str(target).startswith("contactlearn."):
            check_law(law, target)
    return law


# Values that are more than a number or a text: each is made of its entry, its key, and the settings decoded before it


def _sizes(entry: Any, key: str, _: Any) -> tuple[int, ...]:
    if not isinstance(entry, list) or not entry or not all(is_whole(x, 2) for x in entry) or entry != sorted({*entry}):
        rule = "an increasing list of whole numbers, 2 or more, such as [10, 20, 50]"
        raise ContactLearnError(f"{key} must be {rule}, got {entry!r}")
    return tuple(entry)


def _ends(entry: Any, key: str, _: Any) -> tuple[float, float]:
    example = "[-3, -1]" if key.startswith(("limits.", "rig.")) else "[0, 1]"
    if not isinstance(entry, list) or len(entry) != 2 or not all(map(is_number, entry)) or entry[0] > entry[1]:
        raise ContactLearnError(f"{key} must be [low, high] in order, such as {example}, got {entry!r}")
    return entry[0], entry[1]


def _limits(entry: Any, key: str, _: Any) -> dict[str, tuple[float, float]]:
    states = tuple(dict.fromkeys(chain(*STATES.values())))  # only the data say whether they are in the plane
    found = _entries(entry, key)
    if unknown := [name for name in found if name not in states]:
        raise UnknownNameError("limit of an experiment", unknown[0], states)
    return {name: _ends(ends, f"{key}.{name}", _) for name, ends in found.items()}


def _entries(entry: Any, key: str) -> dict[str, Any]:
    """Entries of a part by the names that the user gives them, which become names of files and charts."""
    found = _mapping({} if entry is None else entry, key)
    for name in found:
        if not NAME.fullmatch(str(name)):
            raise ContactLearnError(f"a name in {key} has 1 to 60 letters, digits, blanks, _ and -, got {name!r}")
    return {str(name): one for name, one in found.items()}


def _source(entry: Any, key: str, _: Any) -> SourceSettings:
    return SourceSettings.from_values(_mapping(entry, key), key)


def _source_or_none(entry: Any, key: str, _: Any) -> SourceSettings | None:
    return None if entry is None else _source(entry, key, _)


def _rig(entry: Any, key: str, _: Any) -> dict[str, Limits]:
    """Limits of what a rig sets: [low, high], or entries of `Limits`."""
    found = dict[str, Limits]()
    for name, given in _entries(entry, key).items():
        place = f"{key}.{name}"
        values = dict(zip(("low", "high"), _ends(given, place, _), strict=True)) if isinstance(given, list) else given
        rule = "be [low, high], or {low: …, high: …} with precision, share, settable and cost"
        found[name] = _entry(Limits, values, place, rule)
    return found


class _Body(Struct):
    mass: _Positive
    shape: Any
    inertia: _Positive | Annotated[tuple[_Positive, ...], Meta(min_length=3, max_length=3)] | None = None
    name: str = "body"


def _body(entry: Any, key: str, _: Any) -> Specimen | None:
    """A body by mass, shape and, if its density is not uniform, inertia."""
    if entry is None:
        return None
    rule = "be {mass: 0.05, shape: {kind: disc, radius: 0.02}}, with inertia in kg m² if the density is not uniform"
    body = _entry(_Body, entry, key, rule)
    shape, moments = make_shape(body.shape), body.inertia
    if shape is None:
        raise ContactLearnError(f"{key}.shape must be given; {key} must {rule}")
    if moments is None:
        uniform = (body.mass * torch.as_tensor(shape.gyration_squared(), dtype=torch.float64)).tolist()
        moments = tuple(uniform) if isinstance(uniform, list) else uniform
    return Specimen(mass=body.mass, inertia=moments, shape=shape, name=body.name)


def _mapping(entry: Any, key: str, rule: str = "") -> dict[str, Any]:
    if not isinstance(entry, dict):
        wanted = rule or f"hold settings by name, such as {key}.NAME=…"
        raise ContactLearnError(f"{key} must {wanted}, got {entry!r}")
    return entry


def _device(entry: Any, _: str, known: Any) -> torch.device:
    return devices.find(str(entry))


def _variant(entry: Any, *_: Any) -> str:
    laws.find(PAPER_LAWS[0], str(entry))
    return str(entry)


def _law_or_best(entry: Any, _: str, known: Mapping[str, Any]) -> Law | None:
    return parse_law(entry, known["variant"])


def _law(entry: Any, key: str, known: Mapping[str, Any]) -> Law:
    law = parse_law(entry, known["variant"])
    if law is None:
        raise ContactLearnError("only diagnose takes law=best; name a law, such as law=wang_mason")
    return law


def _named_law_or_best(entry: Any, _: str, known: Mapping[str, Any]) -> Law | None:
    """The law of a name in the variant of the configuration, None for `best`; `law` has the options given to it."""
    return None if entry == BEST else _laws_of([str(entry)], known["law"], known["variant"])[str(entry)]


def _laws_of(names: Iterable[str], law: Law | None, variant: str) -> dict[str, Law]:
    return {name: law if law is not None and law.name == name else laws.find(name, variant) for name in names}


def _named_laws(entry: Any, key: str, known: Mapping[str, Any]) -> dict[str, Law]:
    if not isinstance(entry, list) or not entry:
        raise ContactLearnError(f"{key} must be a list of at least one law, such as [whittaker], got {entry!r}")
    own = [] if known["law"].name in PAPER_LAWS else [known["law"].name]
    return _laws_of(map(str, (*entry, *own)), known["law"], known["variant"])


class _Recipe(Struct):
    features: str = ""
    target: str = ""
    law: Any = None
    kernel: dict[str, Any] | None = None  # a class by _target_ and its arguments, as the next three
    mean: dict[str, Any] | None = None
    likelihood: dict[str, Any] | None = None
    optimiser: dict[str, Any] | None = None
    prior: bool | None = None


def _recipes(entry: Any, key: str, known: Mapping[str, Any]) -> dict[str, Recipe | None]:
    """The learned models by name; None for a law alone."""
    found = dict[str, Recipe | None]()
    for name, settings in _entries(entry, key).items():
        place = f"{key}.{name}"
        if not isinstance(settings, dict) or not settings:
            raise ContactLearnError(
                f"{place} must hold features, target and law, got {settings!r}; the settings of a model stand under "
                f"its name, {key}.NAME.{name}=…, for there may be several"
            )
        recipe = _entry(_Recipe, settings, place, "hold features, target and law")
        if settings.keys() == {"law"}:
            found[name] = None
            continue
        if missing := {"features", "target"} - settings.keys():
            if kept := known.get("checkpoint"):
                why = f"checkpoint={kept} keeps the features and target that it was trained with"
                raise ContactLearnError(f"{why}; take out {place}")
            lacks = f"it lacks {', '.join(sorted(missing))}"
            raise ContactLearnError(f"{place}: {_not_chosen(key, name, lacks)}")
        law = None if recipe.law is None else parse_law(recipe.law, known["variant"])
        try:
            processes = _processes({key: x for key in _PROCESSES if (x := getattr(recipe, key)) is not None})
            found[name] = Recipe(recipe.features, recipe.target, law, processes)
        except ContactLearnError as error:
            raise ContactLearnError(f"{place}: {error}") from error
    return found


def _not_chosen(group: str, name: str, error: str) -> str:
    """An error of an entry without `_target_`, which may set something of a choice that is not made, or misspelt."""
    if name in choices(group):
        return f"{name} is not chosen; add {group}=[{name}]"
    near = suggest(name, choices(group))
    return f"no {group} is called {name!r}{near}; {error}" if near else error


def _processes(settings: Mapping[str, Any]) -> ProcessOptions:
    """Options of processes; a class of the user's own is imported."""
    for path, target in leaf_values(settings):
        if path[-1:] == ("_target_",) and not str(target).startswith(("gpytorch.", "torch.")):
            _subclass(target, torch.nn.Module)
    return ProcessOptions(**settings)


def _effects(entry: Any, key: str, _: Any) -> dict[str, Effect]:
    found = {}
    for name, settings in _entries(entry, key).items():
        if not isinstance(settings, dict) or not settings:
            raise ContactLearnError(
                f"{key}.{name} must hold _target_, a class, or a line of mathematics such as tau: '-c*rx*Pn'; "
                f"got {settings!r}"
            )
        try:
            found[name] = _effect(settings)
        except ContactLearnError as error:
            own = "_target_" in settings or key != "effect"
            why = str(error) if own else _not_chosen(key, name, str(error))
            raise ContactLearnError(f"{key}.{name}: {why}") from error
    return found


def _candidates(entry: Any, key: str, known: Mapping[str, Any]) -> dict[str, Effect]:
    found = _effects(entry, key, known)
    for name, effect in found.items():  # a class that was imported is in the catalogue under its own name
        if name in known["effects"] or (name in catalogue() and type(effect) not in catalogue()[name]):
            raise ContactLearnError(f"candidate.{name} has the name of another effect; give it one of its own")
    return found


def _effect(entry: Mapping[str, Any]) -> Effect:
    """The effect of a class or of lines of mathematics; that of a foreign class is tried on a few drops."""
    settings = dict(entry)
    target = settings.pop("_target_", None)
    if target is None:
        return formula(**settings)
    kind = _subclass(target, Effect)
    with located_errors(target, kind):
        effect = from_settings(kind, settings)
        if not isinstance(getattr(effect, "formula", None), str):
            raise ContactLearnError(f'{target} must describe what it does, such as formula = "v_x⁺ ← v_x⁺ + u"')
        if not str(target).startswith("contactlearn."):
            check_effect(effect, target)
    return effect


def _checkpoint(entry: Any, *_: Any) -> str | None:
    if isinstance(entry, list):
        raise ContactLearnError("training goes on from one checkpoint; sweep over several with -m checkpoint=A,B")
    return None if entry is None else str(entry)


def _trained(entry: Any, _: str, known: Mapping[str, Any]) -> dict[str, TrainedModel]:
    if entry and known["transfer"] is not None:
        raise ContactLearnError("a transfer trains its own models; take out checkpoint=… or transfer")
    paths = entry if isinstance(entry, list) else [entry] if entry else []
    return load_models([str(path) for path in paths], (*known["laws"], *known["models"]))


def _bodies(entry: Any, key: str, known: Mapping[str, Any]) -> dict[str, SourceSettings]:
    """Other bodies; one without a source of its own is `data` with some changes."""
    bodies, data = {}, known["data"]
    same = {"_target_": data.target, "correct": [*data.corrections], **data.options}
    for name, changes in _entries(entry, key).items():
        own = "_target_" in _mapping(changes, f"{key}.{name}")
        bodies[name] = SourceSettings.from_values(changes if own else same | changes, f"{key}.{name}")
    return bodies


class Published(Struct, frozen=True):
    """Published parameters, (mean, standard deviation) each, and the published number of trials to settle."""

    mu: tuple[float, float] | None = None
    eps: tuple[float, float] | None = None
    settled: _Whole | None = None

    def __post_init__(self) -> None:
        if (self.mu is None) != (self.eps is None) or (self.mu is None and self.settled is None):
            raise ValueError("mu and eps come together")


def _published(entry: Any, key: str, _: Any) -> dict[str, Published]:
    rule = "hold mu: [mean, std] and eps: [mean, std], settled: trials, or all"
    return {name: _entry(Published, values, f"{key}.{name}", rule) for name, values in _entries(entry, key).items()}


# What the commands take


class IdentificationSettings(Struct, frozen=True):
    """Training trials (`size`), random subsets of them, the compared impulse, and the limits of (μ, ε)."""

    size: Annotated[_Whole | None, Meta(description="a whole number, 1 or more, or null for as many as there are")]
    repetitions: _Whole
    target: ImpulseTarget
    mu: Annotated[tuple[float, float], _ends]
    eps: Annotated[tuple[float, float], _ends]

    @property
    def box(self) -> Box:
        """Limits of (μ, ε)."""
        return Box(self.mu, self.eps)


class BoundsSettings(Struct, frozen=True):
    """The norm that the bounds minimise and models are compared in."""

    norm: metrics.Norm


class PatchSettings(BoundsSettings, frozen=True):
    """Also the largest half-width of a contact patch in the curve of the bound, m."""

    patch: Annotated[float, Meta(gt=0, le=_LARGEST, description="a positive half-width in m")]


class NoiseSettings(Struct, frozen=True):
    """Standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), where they are known."""

    noise: Annotated[
        tuple[float, ...] | None, Meta(description="standard deviations of (v_x, v_y, ω) in m/s and rad/s, or null")
    ]


class FitSettings(NoiseSettings, frozen=True):
    """Also the compared quantity and the number of starts of a joint fit."""

    target: str
    starts: Annotated[int, Meta(ge=2, description="a whole number, 2 or more")]


class CurveSettings(Struct, frozen=True):
    """Numbers of training trials, and subsets at each."""

    sizes: Annotated[tuple[int, ...], _sizes]
    seeds: _Whole


class TransferSettings(CurveSettings, frozen=True):
    """Numbers of trials of another body, subsets at each, and the source of each body by name."""

    bodies: Annotated[Mapping[str, SourceSettings], _bodies]


class FigureSettings(Struct, frozen=True):
    """The trial to draw, the laws of cost surface and of per-trial parameters, and subsets of the convergence.

    A law is None where it is the one with the lowest held-out error.
    """

    trial: str | int | float | None
    surface: Annotated[Law | None, _named_law_or_best]
    parameters: Annotated[Law | None, _named_law_or_best]
    repetitions: _Whole


class _Decoded(Struct, frozen=True):
    """Settings of a command, from its configuration."""

    @classmethod
    def from_config(cls, cfg: DictConfig) -> Self:
        """Decode the configuration of the command.

        Raises:
            ContactLearnError: a setting that is missing, that breaks its rule, or that contradicts another one.
        """
        values = dict[str, Any]()
        _decode(cls, plain_values(cfg), "", values, values)
        return cls(**cls._completed(values))

    @classmethod
    def _completed(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Check settings against each other, and fill in what one of them leaves to another."""
        return values


class _Settings(_Decoded, frozen=True):
    """Of every command that fits."""

    variant: Annotated[str, _variant]
    data: Annotated[SourceSettings, _source]
    effects: Annotated[Mapping[str, Effect], _effects] = field(name="effect")
    seed: _Seed
    threads: _Whole


class SplitSettings(_Settings, frozen=True):
    """The measurements, how they are split, and how laws are identified from them: of `train` and `evaluate`.

    `split_seed` chooses the trials to hold out, a share `test`; `seed` is that of everything drawn afterwards.
    """

    test: Annotated[float, Meta(gt=0, lt=1, description="a share in (0, 1)")]
    split_seed: _Seed
    device: Annotated[torch.device, _device]
    train: IdentificationSettings
    fit: FitSettings
    bootstrap: Annotated[int, Meta(ge=10, description="a whole number, 10 or more")]

    @property
    def fits_all(self) -> bool:
        """Whether the model is fitted to all trials that are not held out, where no number is given."""
        return False

    @property
    def fit_options(self) -> FitOptions:
        """Of fits of a law together with its effects."""
        return FitOptions(box=self.train.box, **msgspec.structs.asdict(self.fit))

    def __post_init__(self) -> None:
        _ = self.fit_options  # which has rules of its own


class TrainSettings(SplitSettings, frozen=True):
    """One model to train, with the law and the effects that it has; `start` is the one that training goes on from.

    Raises:
        ContactLearnError: no model, or several; effects around a model that has no law, or that takes (μ, ε) from the
            law alone; a checkpoint that is no learned model.
    """

    law: Annotated[Law | None, _law]
    bounds: BoundsSettings
    checkpoint: Annotated[str | None, _checkpoint]
    recipes: Annotated[Mapping[str, Recipe | None], _recipes] = field(name="model")
    start: TrainedModel | None = None

    @property
    def model(self) -> str:
        """Name of the model."""
        return next(iter(self.recipes))

    @property
    def recipe(self) -> Recipe | None:
        """What is learnt; None for a law alone."""
        return self.recipes[self.model]

    @property
    def fits_all(self) -> bool:
        """A law with effects is, as in a diagnosis."""
        return self.recipe is None and bool(self.effects)

    @property
    def laws(self) -> dict[str, Law]:
        """Those of Best Post Hoc, the paper's and `law`."""
        return _laws_of((*PAPER_LAWS, *([self.law.name] if self.law else [])), self.law, self.variant)

    @classmethod
    def _completed(cls, values: dict[str, Any]) -> dict[str, Any]:
        path, effects, names = values["checkpoint"], values["effects"], list(values["recipes"])
        if path is not None:
            for part, chosen in (("model", names), ("effect", effects)):
                if chosen:
                    raise ContactLearnError(f"checkpoint={path} has its own {part}; take out {part}=…")
            start = load_model(path)
            try:
                recipe = Recipe.of(start.model)
            except ContactLearnError as error:
                raise ContactLearnError(f"{start.path}: training cannot go on from it: {error}") from error
            own = {"recipes": {start.learned: recipe}, "law": start.law, "effects": start.effects}
            return values | own | {"start": start}
        if len(names) != 1:
            raise ContactLearnError(
                f"one model is trained at a time, got {names}; sweep over several with -m model=a,b"
            )
        recipe = values["recipes"][names[0]]
        if effects and recipe is not None and recipe.law is None:
            raise ContactLearnError(f"effects act around a law, and model {names[0]} has none: {', '.join(effects)}")
        if effects and recipe is not None and recipe.target == _IDENTIFIED:
            raise ContactLearnError(
                f"model {names[0]} takes each trial's (μ, ε) from the law alone, but there are effects "
                f"({', '.join(effects)}); use model=parameters_likelihood"
            )
        return values if recipe is None or effects else values | {"law": recipe.law}


class EvaluateSettings(SplitSettings, frozen=True):
    """Laws, learned models and bounds to compare; `laws` are those of the error table, `law` has the effects.

    `trained` are models from checkpoints, by name in the error table.
    """

    law: Annotated[Law, _law]
    workers: Annotated[_Whole | None, Meta(description="a whole number, 1 or more, or null for one a core")]
    models: Annotated[Mapping[str, Recipe | None], _recipes] = field(name="model")
    laws: Annotated[Mapping[str, Law], _named_laws]
    bounds: PatchSettings
    curves: CurveSettings
    transfer: TransferSettings | None
    trained: Annotated[Mapping[str, TrainedModel], _trained] = field(name="checkpoint")
    figures: FigureSettings
    tables: Literal["parquet", "csv"]
    reference: Annotated[Mapping[str, Published], _published]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.device.type != "cpu" and (self.workers or 1) > 1:
            raise ContactLearnError(f"workers={self.workers} is for the CPU; with device={self.device} use workers=1")
        if self.transfer is not None and self.effects:
            raise ContactLearnError("transfer is studied without effects; use effect=[]")
        if self.transfer is not None and not (self.recipes and self.transfer.bodies):
            raise ContactLearnError("transfer needs a learned model and a body; see configs/experiment/transfer.yaml")

    @property
    def recipes(self) -> dict[str, Recipe]:
        """The learned models by name; a law alone is none of them."""
        return {name: recipe for name, recipe in self.models.items() if recipe is not None}

    @property
    def learnable(self) -> dict[str, Recipe]:
        """The learned models that can be learnt around the law with its effects; all where there are no effects."""
        return {name: one for name, one in self.recipes.items() if not self.effects or one.target != _IDENTIFIED}

    @property
    def processes(self) -> int:
        """Number of processes to train in: as given, one on a GPU, else one for each core of this process."""
        if self.workers is not None or self.device.type != "cpu":
            return self.workers or 1
        return usable_cores()


class DiagnoseSettings(_Settings, frozen=True):
    """Laws and candidates of a diagnosis, effects in the model already, and limits of proposed drops.

    `law` is None for the one with the least held-out error of `laws`; `limits` are in m, rad, m/s, rad/s by variable;
    `verbose` prints everything, and not the verdict alone.
    """

    law: Annotated[Law | None, _law_or_best]
    candidates: Annotated[Mapping[str, Effect], _candidates] = field(name="candidate")
    limits: Annotated[Mapping[str, tuple[float, float]], _limits]
    seconds: Annotated[float, Meta(gt=0, le=_LARGEST, description="a positive number of seconds")]
    verbose: Annotated[bool, Meta(description="true or false")]
    fit: NoiseSettings

    @property
    def laws(self) -> tuple[Law, ...]:
        """Those that a search for the law tries."""
        return tuple(_laws_of(SEARCHED_LAWS, self.law, self.variant).values())

    def __post_init__(self) -> None:
        FitOptions(noise=self.fit.noise)  # which has rules of its own


class PlanSettings(_Decoded, frozen=True):
    """A rig, a body or data, and what the drops are to tell; None is what a plan before it, or a run, has."""

    rig: Annotated[Mapping[str, Limits], _rig]
    noise: Annotated[tuple[float, ...] | None, Meta(description="standard deviations in m/s and rad/s, or null")]
    body: Annotated[Specimen | None, _body]
    goal: Literal["names", "parameters", "prediction"]
    count: _Whole
    budget: Annotated[_Whole | None, Meta(description="a whole number, 1 or more, or null")]
    after: str | None
    seed: _Seed
    data: Annotated[SourceSettings | None, _source_or_none]


SETTINGS: Mapping[str, type[TrainSettings] | type[EvaluateSettings] | type[DiagnoseSettings] | type[PlanSettings]] = {
    "train": TrainSettings,
    "evaluate": EvaluateSettings,
    "diagnose": DiagnoseSettings,
    "plan": PlanSettings,
}
"""By command."""


# Decoding


def _decode(kind: type[Struct], entry: Any, key: str, known: Mapping[str, Any], found: dict[str, Any]) -> None:
    """Fill in the fields of a struct from the entry under a key; `known` are the settings of the command so far."""
    for one in _settings_of(kind):
        name, rule = one.encode_name, getattr(one.type, "__metadata__", (None,))[0]
        place = f"{key}.{name}" if key else name
        if name not in _mapping(entry, key):
            raise ContactLearnError(f"{place} is missing: the command needs it")
        value, part = entry[name], _part(one.type)
        if callable(rule):
            found[one.name] = rule(value, place, known)
        elif part is None or (value is None and part is not one.type):
            found[one.name] = _value(one.type, value, place)
        else:
            inner = dict[str, Any]()
            _decode(part, value, place, known, inner)
            found[one.name] = part(**inner)


def _settings_of(kind: type[Struct]) -> Iterator[FieldInfo]:
    """Fields that a configuration holds; the others are made of them."""
    return (one for one in msgspec.structs.fields(kind) if one.required)


def _entry(kind: type[Base], entry: Any, key: str, rule: str) -> Base:
    """An entry of a class by the names and types of its fields."""
    fields, given = inspect.signature(kind).parameters, _mapping(entry, key, rule)
    for name in given.keys() - fields.keys():
        raise ContactLearnError(f"unknown setting '{key}.{name}'{suggest(str(name), fields)}; {key} must {rule}")
    for name, one in fields.items():
        if one.default is one.empty and name not in given:
            raise ContactLearnError(f"{key}.{name} must be given; {key} must {rule}")
    try:
        return msgspec.convert(given, kind)
    except msgspec.ValidationError as error:
        why = str(error).replace("$", key)
        raise ContactLearnError(f"{key} must {rule}, got {entry!r} ({why})") from None


def _value(kind: Any, value: Any, key: str) -> Any:
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        if get_origin(kind) is Literal:
            raise UnknownNameError(key, str(value), get_args(kind)) from None
        rule = kind.__metadata__[0].description if hasattr(kind, "__metadata__") else str(error)
        raise ContactLearnError(f"{key} must be {rule}, got {value!r}") from None


def _part(kind: Any) -> type[Struct] | None:
    """The struct of a part of a configuration, which may be null."""
    return next((one for one in (kind, *get_args(kind)) if isinstance(one, type) and issubclass(one, Struct)), None)


@lru_cache
def _keys(kind: type[Struct]) -> dict[str, bool]:
    """Dotted keys of all settings, and whether the user gives names to the settings below."""
    found = dict[str, bool]()
    for one in _settings_of(kind):
        found[one.encode_name] = callable(getattr(one.type, "__metadata__", (None,))[0])
        if (part := _part(one.type)) is not None:
            found |= {f"{one.encode_name}.{key}": is_open for key, is_open in _keys(part).items()}
    return found


def check_names(cfg: DictConfig, command: str, words: Iterable[str]) -> None:
    """Take out the parts of an experiment that a command has no use for, and refuse settings that it does not have.

    Args:
        cfg: a composed configuration.
        command: its name; that of a file of the user's own, by --config-name, is not checked.
        words: of the command line.

    Raises:
        ContactLearnError: with the nearest setting.
    """
    if command not in SETTINGS:
        return
    typed = {name.partition(".")[0]: value for name, _, value in (word.lstrip("+~").partition("=") for word in words)}
    experiment = f"experiment={typed['experiment']}: " if "experiment" in typed else ""
    with open_dict(cfg):
        for part in UNUSED[command] - typed.keys() if experiment else ():
            cfg.pop(part, None)
    own = without_hydra(cfg)
    named = (path for path, _ in leaf_values(OmegaConf.to_container(own)))
    for path in chain(named, ((str(name),) for name in own)):  # also of what holds nothing
        require_setting(path, command, "" if path[0] in typed else experiment)
    if OmegaConf.is_dict(cfg.get("data")):
        SourceSettings.from_config(cfg)


def require_setting(path: Sequence[str], command: str, place: str = "") -> bool:
    """Raise for a setting that a command does not have; return whether the command needs it.

    Raises:
        ContactLearnError: with the nearest setting, or the commands that have it.
    """
    known = _keys(SETTINGS[command])
    for end in range(1, len(path) + 1):
        key = ".".join(path[:end])
        if key not in known:
            holders = [name for name, kind in SETTINGS.items() if key in _keys(kind)]
            if holders:
                full = ".".join(path)
                there = full if any(full in _keys(kind) for kind in SETTINGS.values()) else key
                only = f"{place}{there} is a setting of {' and '.join(holders)} only"
                raise ContactLearnError(f"{only}; --settings lists those of this command")
            last = {name.rpartition(".")[2]: name for name in known}
            near = suggest(key, known) or suggest(last.get(path[end - 1], ""), known)
            raise ContactLearnError(f"{place}unknown setting {key!r}{near}; --settings lists all")
        if known[key]:
            return len(path) == end
    return True


def _subclass(target: object, base: type[Base]) -> type[Base]:
    """The class that a dotted path names; nothing but a subclass of `base`."""
    place, _, name = str(target).rpartition(".")
    if not place:
        raise ContactLearnError(
            f"_target_ must be a class in its module, such as {target}.{base.__name__}, got {target}"
        )
    try:
        module = import_module(place)
    except Exception as error:
        missing = isinstance(error, ModuleNotFoundError) and f"{place}.".startswith(f"{error.name}.")
        why = "is its package installed, or its folder on PYTHONPATH?" if missing else f"fix {place} first"
        seen = f"{type(error).__name__}: {error}".splitlines()[0]
        raise ContactLearnError(f"_target_={target} cannot be imported ({seen}); {why}") from None
    kind = getattr(module, name, None)
    if kind is None:
        raise ContactLearnError(f"_target_={target}: {place} has no {name!r}{suggest(name, vars(module))}")
    if not isinstance(kind, type) or not issubclass(kind, base) or kind is base:
        package = base.__module__.rpartition(".")[0]
        raise ContactLearnError(f"_target_ must be a subclass of {package}.{base.__name__}, got {target}")
    return kind


# Laws and effects of the user's own


@contextmanager
def located_errors(target: object, kind: type) -> Generator[None]:
    """Turn any error of a class into one that names the place in its file.

    Raises:
        ContactLearnError: with the class, the method, the line and the error.
    """
    try:
        yield
    except ContactLearnError:
        raise
    except Exception as error:  # whatever code of the user's own may raise
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if frame.filename == inspect.getfile(kind)]
        where = (own or frames)[-1]
        hint = next((hint for start, hint in _HINTS.items() if str(error).startswith(start)), "")
        message = f"{target} fails in {where.name}, line {where.lineno}: {reason(error)}{hint}"
        raise ContactLearnError(message) from error


def check_effect(effect: Effect, target: object) -> None:
    """Use an effect on a few drops, unless they are none for it.

    Raises:
        ContactLearnError: it has no parameter, returns something else than its method should, changes the outcome
            where it vanishes, or depends on a parameter without a gradient.
    """
    drops = synthetic.load(size=_DROPS)
    broken = None
    with suppress(ContactLearnError):  # an effect may need other drops
        effect = effect.prepare(drops)
        rules = chain(violations(effect, drops, rounding=_ROUNDING), lost_gradients(effect, drops))
        broken = next(rules, None)
    if broken:
        raise ContactLearnError(f"{target} {broken}")


def check_law(law: Law, target: object) -> None:
    """Use a law on a few contacts, with several coefficients at once.

    Raises:
        ContactLearnError: it returns something else than two tensors of impulses, or no numbers.
    """
    drops = synthetic.load(size=_DROPS)
    mu, eps = (torch.tensor(values, dtype=torch.float64)[:, None] for values in ((0.1, _MU), (0.3, _EPS)))
    contact = Contact(drops.W[:, 0, 0], drops.W[:, 0, 1], drops.W[:, 1, 1], *drops.v_c.unbind(-1))
    returned: object = law.solve(contact, mu, eps)
    pair = isinstance(returned, tuple | list) and len(returned) == 2
    if not pair or not all(isinstance(part, Tensor) for part in returned):
        raise ContactLearnError(
            f"{target}.solve must return two tensors (P_t, P_n) of impulses, got {describe(returned)}"
        )
    if not law.at(mu, eps).impulse(drops.W, drops.v_c).isfinite().all():
        raise ContactLearnError(f"{target}.solve gives an impulse that is no finite number on ordinary contacts")
