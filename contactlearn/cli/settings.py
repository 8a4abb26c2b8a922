"""Settings of the commands: a composed configuration is parsed once, here, and travels on as frozen types.

    TrainSettings, EvaluateSettings, DiagnoseSettings   all settings of one command
    SourceSettings                                      a source of measurements: `data`, or a body of `transfer.bodies`

Parsing checks every value against its rule and builds laws, effects and learned models, before any data is read: a
wrong setting costs seconds, not a run.  Laws and effects of the user's own are tried on a few drops; a class that
passes may still break a rule, and `contactlearn.testing` has the whole contract.
"""

import inspect
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import reduce
from importlib import import_module
from itertools import chain
from typing import Any, Literal, TypeVar

import torch
from omegaconf import MISSING, DictConfig, OmegaConf
from torch import Tensor

from contactlearn import laws
from contactlearn.cli.checkpoints import TrainedModel, load_model, load_models
from contactlearn.cli.config_files import BEST, NAME, required_settings
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
from contactlearn.mechanics.impacts import IMPULSE_TARGETS
from contactlearn.models.process_options import ProcessOptions
from contactlearn.results.tables import FORMATS
from contactlearn.simulation import synthetic

_IDENTIFIED = "parameters_identified"  # target of learned models that identify each trial's (μ, ε) with the law alone
_PROCESSES = ("kernel", "mean", "likelihood", "optimiser", "prior")  # of a learned model
_DROPS, _MU, _EPS = 5, 0.2, 0.5
_LARGEST_SEED = 2**63 - 1  # that PyTorch's generators take
_ROUNDING = 1e-9  # m/s and rad/s
_NO_IF = "; a parameter has many values at once: torch.where(condition, a, b) takes the place of if"
Base = TypeVar("Base")
_Rule = tuple[Callable[[Any], bool], str]


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
    def from_values(cls, values: Mapping[str, Any], name: str = "data") -> "SourceSettings":
        """Parse the part `name` of a configuration.

        Raises:
            ContactLearnError: corrections that are no list.
        """
        target = str(values.get("_target_", ""))
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
    def from_config(cls, cfg: DictConfig) -> "SourceSettings":
        """Parse `data` of a composed configuration.

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
            raise ContactLearnError(
                f"{', '.join(self.missing)} must be given: {self.missing[0]}=…, or in the file NAME.yaml of data=NAME, "
                "which contactlearn init writes"
            )


@dataclass(frozen=True, kw_only=True)
class SplitSettings:
    """The measurements, the share `test` to hold out, and the number of training trials; None for the usual one.

    `split_seed` chooses the trials to hold out; `seed` is that of everything drawn afterwards.
    """

    source: SourceSettings
    test: float
    split_seed: int
    seed: int
    train_size: int | None


@dataclass(frozen=True, kw_only=True)
class IdentificationSettings:
    """The compared impulse, the limits of (μ, ε), and the number of random subsets of the trials."""

    target: str
    box: Box
    repetitions: int


@dataclass(frozen=True, kw_only=True)
class TransferSettings:
    """Numbers of trials of another body, subsets at each, and the source of each body by name."""

    sizes: tuple[int, ...]
    seeds: int
    bodies: Mapping[str, SourceSettings]


@dataclass(frozen=True, kw_only=True)
class FigureSettings:
    """The trial to draw, the laws of cost surface and of per-trial parameters, and subsets of the convergence."""

    trial: str | None
    surface: Law
    parameters: Law
    repetitions: int


@dataclass(frozen=True, kw_only=True)
class TrainSettings:
    """One model to train: its name and recipe, None for a law alone, with the law and the effects that it has.

    `laws` are those of Best Post Hoc, the paper's and `law`; `start` is the one whose processes training goes on from.
    """

    split: SplitSettings
    identification: IdentificationSettings
    fit: FitOptions
    device: torch.device
    bootstrap: int
    model: str
    recipe: Recipe | None
    law: Law | None
    laws: Mapping[str, Law]
    effects: Mapping[str, Effect]
    norm: metrics.Norm
    start: TrainedModel | None = None

    @classmethod
    def from_config(cls, cfg: DictConfig) -> "TrainSettings":
        """Parse the configuration of `train`.

        Raises:
            ContactLearnError: a setting that breaks its rule; no model, or several; effects around a model that has
                no law, or that takes (μ, ε) from the law alone; a checkpoint that is no learned model.
        """
        config = _checked(cfg, "train")
        if config["checkpoint"] is not None:
            return cls._from_checkpoint(config)
        law, effects, recipes = _law(config), _effects(config, "effect"), _recipes(config)
        names = list(config["model"] or {})
        if len(names) != 1:
            raise ContactLearnError(
                f"one model is trained at a time, got {names}; sweep over several with -m model=a,b"
            )
        (name,) = names
        recipe = recipes.get(name)
        if effects and recipe is not None and recipe.law is None:
            raise ContactLearnError(f"effects act around a law, and model {name} has none: {', '.join(effects)}")
        if effects and recipe is not None and recipe.target == _IDENTIFIED:
            raise ContactLearnError(
                f"model {name} takes each trial's (μ, ε) from the law alone, but there are effects "
                f"({', '.join(effects)}); use model=parameters_likelihood"
            )
        return cls._of_model(config, name, recipe, law if recipe is None or effects else recipe.law, effects)

    @classmethod
    def _from_checkpoint(cls, config: Mapping[str, Any]) -> "TrainSettings":
        """Settings of a training that goes on from a model: with its recipe, law and effects."""
        for part in ("model", "effect"):
            if config[part]:
                raise ContactLearnError(f"checkpoint={config['checkpoint']} has its own {part}; take out {part}=…")
        if isinstance(config["checkpoint"], list):
            raise ContactLearnError("training goes on from one checkpoint; sweep over several with -m checkpoint=A,B")
        trained = load_model(config["checkpoint"])
        try:
            recipe = Recipe.of(trained.model)
        except ContactLearnError as error:
            raise ContactLearnError(f"{trained.path}: training cannot go on from it: {error}") from error
        settings = cls._of_model(config, trained.learned, recipe, trained.law, trained.effects)
        return replace(settings, start=trained)

    @classmethod
    def _of_model(
        cls, config: Mapping[str, Any], name: str, recipe: Recipe | None, law: Law | None, effects: Mapping[str, Effect]
    ) -> "TrainSettings":
        return cls(
            split=_split(config),
            identification=_identification(config),
            fit=_fit_options(config),
            device=_device(config),
            bootstrap=config["bootstrap"],
            model=name,
            recipe=recipe,
            law=law,
            laws=_named_laws(config, law, (*PAPER_LAWS, *([law.name] if law else []))),
            effects=effects,
            norm=config["bounds"]["norm"],
        )


@dataclass(frozen=True, kw_only=True)
class EvaluateSettings:
    """Laws, learned models and bounds to compare; `laws` are those of the error table, `law` has the effects.

    `trained` are models from checkpoints, by name in the error table.
    """

    split: SplitSettings
    identification: IdentificationSettings
    fit: FitOptions
    device: torch.device
    workers: int | None
    bootstrap: int
    law: Law
    laws: Mapping[str, Law]
    effects: Mapping[str, Effect]
    recipes: Mapping[str, Recipe]
    trained: Mapping[str, TrainedModel]
    norm: metrics.Norm
    patch: float
    curve_sizes: tuple[int, ...]
    curve_seeds: int
    transfer: TransferSettings | None
    figures: FigureSettings
    tables: Literal["parquet", "csv"]
    reference: Mapping[str, Mapping[str, tuple[float, ...]]]
    settled: Mapping[str, int]

    @classmethod
    def from_config(cls, cfg: DictConfig) -> "EvaluateSettings":
        """Parse the configuration of `evaluate`.

        Raises:
            ContactLearnError: a setting that breaks its rule.
        """
        config = _checked(cfg, "evaluate")
        law, effects, recipes = _law(config), _effects(config, "effect"), _recipes(config)
        figures, own = config["figures"], [] if law.name in PAPER_LAWS else [law.name]
        drawn = _named_laws(config, law, (figures["surface"], figures["parameters"]))
        laws = _named_laws(config, law, (*config["laws"], *own))
        parameters, settled = _reference(config)
        return cls(
            split=_split(config),
            identification=_identification(config),
            fit=_fit_options(config),
            device=_device(config),
            workers=config["workers"],
            bootstrap=config["bootstrap"],
            law=law,
            laws=laws,
            effects=effects,
            recipes=recipes,
            trained=_trained(config, (*laws, *recipes)),
            norm=config["bounds"]["norm"],
            patch=config["bounds"]["patch"],
            curve_sizes=tuple(config["curves"]["sizes"]),
            curve_seeds=config["curves"]["seeds"],
            transfer=_transfer(config, recipes, effects),
            figures=FigureSettings(
                trial=None if figures["trial"] is None else str(figures["trial"]),
                surface=drawn[str(figures["surface"])],
                parameters=drawn[str(figures["parameters"])],
                repetitions=figures["repetitions"],
            ),
            tables=config["tables"],
            reference=parameters,
            settled=settled,
        )

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


@dataclass(frozen=True, kw_only=True)
class DiagnoseSettings:
    """Laws and candidates of a diagnosis, effects in the model already, and limits of proposed drops.

    Args:
        law: the law, or None for the one with the least held-out error of `laws`.
        noise: standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), where they are known.
        limits: of the proposed drops by variable, in m, rad, m/s, rad/s.
        seconds: time for the search, s.
        verbose: whether everything is printed, and not the verdict alone.
    """

    source: SourceSettings
    seed: int
    seconds: float
    verbose: bool
    law: Law | None
    laws: tuple[Law, ...]
    effects: Mapping[str, Effect]
    candidates: Mapping[str, Effect]
    noise: tuple[float, ...] | None
    limits: Mapping[str, tuple[float, float]]

    @classmethod
    def from_config(cls, cfg: DictConfig) -> "DiagnoseSettings":
        """Parse the configuration of `diagnose`.

        Raises:
            ContactLearnError: a setting that breaks its rule, or a candidate with the name of another effect.
        """
        config = _checked(cfg, "diagnose")
        law = parse_law(config["law"], str(config["variant"]))
        effects, own = _effects(config, "effect"), _effects(config, "candidate")
        for name, effect in own.items():  # a class that was imported is in the catalogue under its own name
            if name in effects or (name in catalogue() and type(effect) not in catalogue()[name]):
                raise ContactLearnError(f"candidate.{name} has the name of another effect; give it one of its own")
        return cls(
            source=SourceSettings.from_values(config["data"]),
            seed=config["seed"],
            seconds=config["seconds"],
            verbose=config["verbose"],
            law=law,
            laws=tuple(_named_laws(config, law, SEARCHED_LAWS).values()),
            effects=effects,
            candidates=own,
            noise=_fit_options(config).noise,
            limits={name: tuple(ends) for name, ends in (config["limits"] or {}).items()},
        )


def plain_values(part: DictConfig) -> dict[str, Any]:
    """Return a part of a configuration as plain values by name, with every reference replaced by its value."""
    values = OmegaConf.to_container(part, resolve=True)
    assert isinstance(values, dict)  # a part that is given and not null
    return {str(name): value for name, value in values.items() if name != "hydra"}


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


# Rules of single values


def _whole(least: int, most: int | None = None) -> _Rule:
    rule = f"a whole number, {least} or more" if most is None else f"a whole number from {least} to {most}"
    return lambda x: is_whole(x, least) and (most is None or x <= most), rule


def _whole_or_null(rule: str) -> _Rule:
    return lambda x: x is None or is_whole(x, 1), f"a whole number, 1 or more, or null for {rule}"


def _number(accept: Callable[[float], bool], rule: str) -> _Rule:
    return lambda x: is_number(x) and accept(x), rule


def _pair(example: str) -> _Rule:
    return (
        lambda x: isinstance(x, list) and len(x) == 2 and all(map(is_number, x)) and x[0] <= x[1],
        f"[low, high] in order, such as {example}",
    )


_SIZES: _Rule = (
    lambda x: isinstance(x, list) and len(x) > 0 and all(is_whole(one, 2) for one in x) and x == sorted(set(x)),
    "an increasing list of whole numbers, 2 or more, such as [10, 20, 50]",
)
_RULES: Mapping[str, _Rule] = {
    "test": _number(lambda x: 0 < x < 1, "a share in (0, 1)"),
    "checkpoint": (
        lambda x: all(isinstance(one, str) for one in (x if isinstance(x, list) else [x])) or x is None,
        "a file or folder, or a list of them, such as [a/model.pt, b/model.pt]",
    ),
    "seed": _whole(0, _LARGEST_SEED),
    "split_seed": _whole(0, _LARGEST_SEED),
    "threads": _whole(1),
    "seconds": _number(lambda x: x > 0, "a positive number of seconds"),
    "verbose": (lambda x: isinstance(x, bool), "true or false"),
    "train.size": _whole_or_null("as many as there are"),
    "train.repetitions": _whole(1),
    "train.mu": _pair("[0, 1]"),
    "train.eps": _pair("[0, 1]"),
    "bounds.patch": _number(lambda x: x > 0, "a positive half-width in m"),
    "bootstrap": _whole(10),
    "curves.sizes": _SIZES,
    "curves.seeds": _whole(1),
    "transfer.sizes": _SIZES,
    "transfer.seeds": _whole(1),
    "fit.starts": _whole(2),
    "workers": _whole_or_null("one a core"),
    "figures.repetitions": _whole(1),
    "laws": (lambda x: isinstance(x, list) and len(x) > 0, "a list of at least one law, such as [whittaker]"),
}
_CHOICES = {
    "train.target": ("impulse target", IMPULSE_TARGETS),
    "bounds.norm": ("norm", metrics.NORMS),
    "tables": ("table format", FORMATS),
}
_NAMING = ("effect", "candidate", "model", "transfer.bodies")  # parts whose keys become names of files and charts
_NULLABLE = (*_NAMING, "limits", "reference", "transfer")
_PARTS = (*_NULLABLE, "data", "train", "fit", "bounds", "curves", "figures")
_STATES = tuple(dict.fromkeys(chain(*STATES.values())))  # only the data say whether they are in the plane or in space
_ABSENT = object()


def _checked(cfg: DictConfig, command: str) -> dict[str, Any]:
    """Return a configuration as plain values, each of which obeys its rule.

    Raises:
        ContactLearnError: naming the setting, the rule and the value; or a setting that was taken out.
        UnknownNameError: a variant, target, norm or format that does not exist.
    """
    config = plain_values(cfg)
    for key in required_settings(command):
        if _at(config, key, _ABSENT) is _ABSENT and _at(config, key.rpartition(".")[0], {}) is not _ABSENT:
            raise ContactLearnError(f"{key} is missing: {command} needs it")
    for part in sorted(_PARTS):  # transfer before its parts
        entries = _at(config, part, {})
        if not isinstance(entries, dict) and not (entries is None and part in _NULLABLE):
            raise ContactLearnError(f"{part} must hold settings by name, such as {part}.NAME=…, got {entries!r}")
        for name in (entries or ()) if part in _NAMING else ():
            if not NAME.fullmatch(str(name)):
                raise ContactLearnError(f"a name in {part} has 1 to 60 letters, digits, blanks, _ and -, got {name!r}")
    values = {key: _at(config, key, _ABSENT) for key in (*_RULES, *_CHOICES)}
    if unknown := [name for name in config.get("limits") or {} if name not in _STATES]:
        raise UnknownNameError("limit of an experiment", unknown[0], _STATES)
    pairs = {f"limits.{name}": _pair("[-3, -1]") for name in config.get("limits") or {}}
    values |= {f"limits.{name}": ends for name, ends in (config.get("limits") or {}).items()}
    for key, (accept, rule) in {**_RULES, **pairs}.items():
        if values[key] is not _ABSENT and not accept(values[key]):
            raise ContactLearnError(f"{key} must be {rule}, got {values[key]!r}")
    for key, (kind, known) in _CHOICES.items():
        if values[key] is not _ABSENT and values[key] not in known:
            raise UnknownNameError(kind, str(values[key]), known)
    laws.find(PAPER_LAWS[0], str(config["variant"]))
    return config


def _at(config: Mapping[str, Any], key: str, default: Any) -> Any:
    """The value under a dotted key; the default where a part of the way is missing or null."""
    *way, last = key.split(".")
    part = reduce(lambda found, name: found.get(name) if isinstance(found, dict) else None, way, config)
    return part.get(last, default) if isinstance(part, dict) else default


# Parts of the settings


def _split(config: Mapping[str, Any]) -> SplitSettings:
    return SplitSettings(
        source=SourceSettings.from_values(config["data"]),
        test=config["test"],
        split_seed=config["split_seed"],
        seed=config["seed"],
        train_size=config["train"]["size"],
    )


def _identification(config: Mapping[str, Any]) -> IdentificationSettings:
    train = config["train"]
    return IdentificationSettings(target=train["target"], box=_box(config), repetitions=train["repetitions"])


def _box(config: Mapping[str, Any]) -> Box:
    train = config.get("train")
    return Box(tuple(train["mu"]), tuple(train["eps"])) if train else Box()


def _fit_options(config: Mapping[str, Any]) -> FitOptions:
    fit = config["fit"]
    noise = fit["noise"]
    sigma = None if noise is None else tuple(noise if isinstance(noise, list) else [noise])
    return FitOptions(
        box=_box(config), noise=sigma, **{name: fit[name] for name in ("target", "starts") if name in fit}
    )


def _device(config: Mapping[str, Any]) -> torch.device:
    """The device to compute on; processes side by side are for the CPU."""
    found = devices.find(str(config["device"]))
    if found.type != "cpu" and (config.get("workers") or 1) > 1:
        raise ContactLearnError(
            f"workers={config['workers']} is for the CPU; with device={config['device']} use workers=1"
        )
    return found


def _law(config: Mapping[str, Any]) -> Law:
    """The law `law` of a command that cannot choose one."""
    law = parse_law(config["law"], str(config["variant"]))
    if law is None:
        raise ContactLearnError("only diagnose.py takes law=best; name a law, such as law=wang_mason")
    return law


def _named_laws(config: Mapping[str, Any], law: Law | None, names: Iterable[Any]) -> dict[str, Law]:
    """Laws by name in the variant of the configuration; `law` has the options that are given to it."""
    known = {} if law is None else {law.name: law}
    return {name: known.get(name) or laws.find(name, str(config["variant"])) for name in map(str, names)}


def _recipes(config: Mapping[str, Any]) -> dict[str, Recipe]:
    """The learned models of `model` by name; a law alone is none of them."""
    found = {}
    for name, entry in (config.get("model") or {}).items():
        settings = entry if isinstance(entry, dict) else {}
        unknown = settings.keys() - {"features", "target", "law", *_PROCESSES}
        if not settings or unknown:
            wrong = f"unknown {', '.join(sorted(unknown))}" if unknown else repr(entry)
            raise ContactLearnError(f"model.{name} must hold features, target and law; got {wrong}")
        if settings.keys() == {"law"}:
            continue
        missing = {"features", "target"} - settings.keys()
        if missing:
            raise ContactLearnError(f"model.{name} lacks {', '.join(sorted(missing))}; see configs/model")
        base = settings.get("law")
        law = None if base is None else parse_law(base, str(config["variant"]))
        try:
            processes = _processes({key: settings[key] for key in _PROCESSES if settings.get(key) is not None})
            found[name] = Recipe(settings["features"], settings["target"], law, processes)
        except ContactLearnError as error:
            raise ContactLearnError(f"model.{name}: {error}") from error
    return found


def _processes(settings: Mapping[str, Any]) -> ProcessOptions:
    """Options of processes; a class of the user's own is imported."""
    for key, value in settings.items():
        if not isinstance(value, bool if key == "prior" else dict):
            wanted = "true or false" if key == "prior" else "a class by _target_ and its arguments"
            raise ContactLearnError(f"{key} must be {wanted}, got {value!r}")
        for path, target in leaf_values(value):
            if path[-1:] == ("_target_",) and not str(target).startswith(("gpytorch.", "torch.")):
                _subclass(target, torch.nn.Module)
    return ProcessOptions(**settings)


def _effects(config: Mapping[str, Any], part: str) -> dict[str, Effect]:
    """The effects of a part of the configuration, `effect` or `candidate`, by name."""
    found = {}
    for name, entry in (config.get(part) or {}).items():
        if not isinstance(entry, dict) or not entry:
            raise ContactLearnError(
                f"{part}.{name} must hold _target_, a class, or a line of mathematics such as tau: '-c*rx*Pn'; "
                f"got {entry!r}"
            )
        try:
            found[name] = _effect(entry)
        except ContactLearnError as error:
            raise ContactLearnError(f"{part}.{name}: {error}") from error
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


def _trained(config: Mapping[str, Any], taken: Iterable[str]) -> dict[str, TrainedModel]:
    """The models of `checkpoint` by name."""
    entry = config["checkpoint"]
    if entry and config["transfer"] is not None:
        raise ContactLearnError("a transfer trains its own models; take out checkpoint=… or transfer")
    return load_models([entry] if isinstance(entry, str) else entry or [], taken)


def _transfer(
    config: Mapping[str, Any], recipes: Mapping[str, Recipe], effects: Mapping[str, Effect]
) -> TransferSettings | None:
    """Other bodies; one without a source of its own is `data` with some changes."""
    entry = config["transfer"]
    if entry is None:
        return None
    if effects:
        raise ContactLearnError("transfer is studied without effects; use effect=[]")
    if not recipes or not entry.get("bodies") or not entry.keys() >= {"sizes", "seeds"}:
        raise ContactLearnError("transfer needs a learned model and a body; see configs/experiment/transfer.yaml")
    bodies = {}
    for name, changes in entry["bodies"].items():
        key = f"transfer.bodies.{name}"
        if not isinstance(changes, dict):
            raise ContactLearnError(f"{key} must hold settings by name, such as {key}.mass=…, got {changes!r}")
        same = {} if "_target_" in changes else config["data"]
        bodies[name] = SourceSettings.from_values({**same, **changes}, key)
    return TransferSettings(sizes=tuple(entry["sizes"]), seeds=entry["seeds"], bodies=bodies)


def _reference(config: Mapping[str, Any]) -> tuple[dict[str, dict[str, tuple[float, ...]]], dict[str, int]]:
    """Published parameters by law, (mean, standard deviation) each, and published numbers of trials to settle."""
    parameters, settled = {}, {}
    for name, entry in (config["reference"] or {}).items():
        values = dict(entry) if isinstance(entry, dict) else {}
        trials = values.pop("settled", None)
        pairs = [isinstance(pair, list) and len(pair) == 2 and all(map(is_number, pair)) for pair in values.values()]
        if not ((values.keys() == {"mu", "eps"} and all(pairs)) or (is_whole(trials, 1) and not values)):
            raise ContactLearnError(
                f"reference.{name} must hold mu: [mean, std] and eps: [mean, std], settled: trials, or all; got {entry}"
            )
        parameters |= {str(name): {key: tuple(pair) for key, pair in values.items()}} if values else {}
        settled |= {str(name): trials} if trials is not None else {}
    return parameters, settled


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
        hint = _NO_IF if str(error).startswith("Boolean value of Tensor") else ""
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
