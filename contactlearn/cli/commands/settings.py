"""Checks of a composed configuration, before any data is read: a wrong setting costs seconds, not a run."""

import re
from collections.abc import Callable
from typing import Any

import torch
from omegaconf import DictConfig, ListConfig, OmegaConf

from contactlearn.cli.commands.laws import law_of, named_laws
from contactlearn.cli.commands.own import in_one_line, try_effect
from contactlearn.cli.commands.plain import plain_values
from contactlearn.cli.commands.targets import subclass
from contactlearn.core import devices
from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.numerics import is_number, is_whole
from contactlearn.effects import Effect, from_settings
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.shared import Box
from contactlearn.inference.learning.recipe import Recipe
from contactlearn.laws import PAPER_LAWS
from contactlearn.mechanics.impacts import IMPULSE_TARGETS
from contactlearn.results.tables import FORMATS

_Rule = tuple[Callable[[Any], bool], str]


def _whole(least: int) -> _Rule:
    return lambda x: is_whole(x, least), f"a whole number, {least} or more"


def _number(accept: Callable[[float], bool], rule: str) -> _Rule:
    return lambda x: is_number(x) and accept(x), rule


def _pair(rule: str) -> _Rule:
    return lambda x: isinstance(x, ListConfig) and len(x) == 2 and all(map(is_number, x)), rule


def _sizes(least: int) -> _Rule:
    def accept(x: Any) -> bool:
        whole = isinstance(x, ListConfig) and len(x) > 0 and all(is_whole(one, least) for one in x)
        return whole and list(x) == sorted(set(x))

    return accept, f"an increasing list of whole numbers, {least} or more, such as [10, 20, 50]"


_RULES = {
    "test": _number(lambda x: 0 < x < 1, "a share in (0, 1)"),
    "seed": _whole(0),
    "threads": _whole(1),
    "seconds": _number(lambda x: x > 0, "a positive number of seconds"),
    "train.size": (
        lambda x: x is None or _whole(1)[0](x),
        "a whole number, 1 or more, or null for as many as there are",
    ),
    "train.repetitions": _whole(1),
    "train.mu": _pair("[low, high], such as [0, 1]"),
    "train.eps": _pair("[low, high], such as [0, 1]"),
    "bounds.patch": _number(lambda x: x > 0, "a positive half-width in m"),
    "bootstrap": _whole(10),
    "curves.sizes": _sizes(2),
    "curves.seeds": _whole(1),
    "transfer.sizes": _sizes(2),
    "transfer.seeds": _whole(1),
    "fit.starts": _whole(2),
    "workers": (lambda x: x is None or _whole(1)[0](x), "a whole number, 1 or more, or null for one a core"),
    "figures.repetitions": _whole(1),
    "laws": (lambda x: isinstance(x, ListConfig) and len(x) > 0, "a list of at least one law, such as [whittaker]"),
}
_NAMES = {
    "train.target": ("impulse target", IMPULSE_TARGETS),
    "bounds.norm": ("norm", bounds.NORMS),
    "tables": ("table format", FORMATS),
}


_NAMING = ("effect", "candidate", "model", "transfer.bodies")
_NULL = (*_NAMING, "limits", "reference", "transfer")  # parts that may be so
_PARTS = (*_NULL, "train", "fit", "bounds", "curves", "figures")
_NAME = re.compile(r"\w[\w -]{0,59}")  # files and charts are named by it


def check(cfg: DictConfig) -> None:
    """Raise for a setting that breaks its rule.

    Raises:
        ContactLearnError: naming the setting, the rule and the value.
        UnknownNameError: a law, variant, target, norm or format that does not exist.
    """
    _check_parts(cfg)
    missing = object()
    for key, (accept, rule) in _RULES.items():
        value = OmegaConf.select(cfg, key, default=missing)
        if value is not missing and not accept(value):
            raise ContactLearnError(f"{key} must be {rule}, got {value!r}")
    for key, (kind, known) in _NAMES.items():
        value = OmegaConf.select(cfg, key, default=missing)
        if value is not missing and value not in known:
            raise UnknownNameError(kind, str(value), known)
    for name, ends in (cfg.get("limits") or {}).items():
        accept, rule = _pair("[low, high], such as [-3, -1]")
        if not accept(ends):
            raise ContactLearnError(f"limits.{name} must be {rule}, got {ends!r}")
    device(cfg)
    fit_options(cfg)
    if "law" in cfg:
        drawn = [cfg.figures[part] for part in ("surface", "parameters")] if "figures" in cfg else []
        named_laws(cfg, [*cfg.get("laws", PAPER_LAWS), *drawn])
    recipes(cfg)
    if effects(cfg) and cfg.get("transfer") is not None:
        raise ContactLearnError("transfer is studied without effects; use effect=[]")
    if cfg.get("transfer") is not None and not (recipes(cfg) and cfg.transfer.get("bodies")):
        raise ContactLearnError("transfer needs a learned model and a body; see configs/experiment/transfer.yaml")
    for one, entry in (cfg.get("reference") or {}).items():
        for name in ("mu", "eps"):
            pair = entry.get(name) if isinstance(entry, DictConfig) else None
            if not isinstance(pair, ListConfig) or len(pair) != 2:
                raise ContactLearnError(f"reference.{one} must hold mu: [mean, std] and eps: [mean, std], got {entry}")


def _check_parts(cfg: DictConfig) -> None:
    """Refuse a value where there are settings by name, and names that could not be those of files."""
    for part in sorted(_PARTS):  # transfer before what is in it
        entries = OmegaConf.select(cfg, part, default={})
        if not isinstance(entries, DictConfig | dict) and not (entries is None and part in _NULL):
            raise ContactLearnError(f"{part} must hold settings by name, such as {part}.NAME=…, got {entries!r}")
        for name in (entries or ()) if part in _NAMING else ():
            if not _NAME.fullmatch(str(name)):
                raise ContactLearnError(f"a name in {part} has 1 to 60 letters, digits, blanks, _ and -, got {name!r}")


def device(cfg: DictConfig) -> torch.device:
    """Return the device to compute on; the CPU for commands that know no other.

    Raises:
        UnknownNameError: no such device.
        ContactLearnError: a GPU that is not there, or processes side by side on one.
    """
    found = devices.find(str(cfg.get("device", "cpu")))
    if found.type != "cpu" and (cfg.get("workers") or 1) > 1:
        raise ContactLearnError(f"workers={cfg.workers} is for the CPU; with device={cfg.device} use workers=1")
    return found


def box(cfg: DictConfig) -> Box:
    """Return the limits of μ and ε.

    Raises:
        DataError: limits in the wrong order, or an ε above 1.
    """
    return Box(tuple(cfg.train.mu), tuple(cfg.train.eps)) if "train" in cfg else Box()


def stated_noise(cfg: DictConfig) -> tuple[float, float, float] | None:
    """Return the standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), where they are known."""
    sigma = cfg.fit.noise
    if sigma is None:
        return None
    return tuple(sigma if isinstance(sigma, ListConfig) else [sigma])  # `FitOptions` checks that they are three


def reference(cfg: DictConfig) -> dict[str, dict[str, tuple[float, ...]]]:
    """Return published parameters by law, (mean, standard deviation) each; none where the configuration has none."""
    given = cfg.get("reference") or {}
    return {str(law): {name: tuple(entry[name]) for name in ("mu", "eps")} for law, entry in given.items()}


def fit_options(cfg: DictConfig) -> FitOptions:
    """Return the options of joint fits; those that the configuration lacks have their defaults.

    Raises:
        DataError: limits in the wrong order, or noise that is not three positive numbers.
        UnknownNameError: no such target.
    """
    given = {name: cfg.fit[name] for name in ("target", "starts") if name in cfg.fit}
    return FitOptions(box=box(cfg), noise=stated_noise(cfg), **given)


def recipes(cfg: DictConfig) -> dict[str, Recipe]:
    """The learned models of `model`, by name; a law alone is none of them.

    Raises:
        ContactLearnError: an entry that is no model, or parameters to learn without a law.
        UnknownNameError: a feature space, target or law that does not exist.
    """
    found = {}
    for name, entry in (cfg.get("model") or {}).items():
        settings = plain_values(entry) if isinstance(entry, DictConfig) else {}
        unknown = settings.keys() - {"features", "target", "law"}
        if not settings or unknown:
            wrong = f"unknown {', '.join(sorted(unknown))}" if unknown else repr(entry)
            raise ContactLearnError(f"model.{name} must hold features, target and law; got {wrong}")
        if settings.keys() == {"law"}:
            continue
        missing = {"features", "target"} - settings.keys()
        if missing:
            raise ContactLearnError(f"model.{name} lacks {', '.join(sorted(missing))}; see configs/model")
        base = settings.get("law")
        law = None if base is None else law_of(base, str(cfg.variant))
        found[name] = Recipe(settings["features"], settings["target"], law)
    return found


def recipes_around(cfg: DictConfig) -> dict[str, Recipe]:
    """The learned models that can be learnt around a law with effects, or all of them where there are none."""
    found = recipes(cfg)
    if not cfg.get("effect"):
        return found
    return {name: recipe for name, recipe in found.items() if recipe.target != "parameters_identified"}


def one_recipe(cfg: DictConfig) -> tuple[str, Recipe | None]:
    """Name and recipe of the one model to train; None for a law alone.

    Raises:
        ContactLearnError: no model, or several.
    """
    names = list(cfg.get("model") or {})
    if len(names) != 1:
        raise ContactLearnError(f"one model is trained at a time, got {names}; sweep over several with -m model=a,b")
    return names[0], recipes(cfg).get(names[0])


def effects(cfg: DictConfig, part: str = "effect") -> dict[str, Effect]:
    """The effects of a part of the configuration, `effect` or `candidate`, by name.

    Raises:
        ContactLearnError: an entry that is no effect, or a setting that it does not have.
    """
    found = {}
    for name, entry in (cfg.get(part) or {}).items():
        settings = plain_values(entry) if isinstance(entry, DictConfig) else None
        if not settings:
            raise ContactLearnError(
                f"{part}.{name} must hold _target_, a class, or a line of mathematics such as tau: '-c*rx*Pn'; "
                f"got {entry!r}"
            )
        try:
            found[name] = _effect(settings)
        except ContactLearnError as error:
            raise ContactLearnError(f"{part}.{name}: {error}") from error
    return found


def _effect(settings: dict[str, Any]) -> Effect:
    """The effect of a class or of lines of mathematics; that of a foreign class is tried on a few drops."""
    target = settings.pop("_target_", None)
    if target is None:
        return formula(**settings)
    kind = subclass(target, Effect)
    with in_one_line(target, kind):
        effect = from_settings(kind, settings)
        if not isinstance(getattr(effect, "formula", None), str):
            raise ContactLearnError(f'{target} must say what it does, such as formula = "v_x⁺ ← v_x⁺ + u"')
        if not str(target).startswith("contactlearn."):
            try_effect(effect, target)
    return effect
