"""Checks of a composed configuration, before any data is read: a wrong setting costs seconds, not a run."""

import math
from collections.abc import Callable
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf

from contactlearn import bounds, laws
from contactlearn.errors import ContactLearnError, UnknownNameError
from contactlearn.fit import TARGETS
from contactlearn.learning import Recipe
from contactlearn.report.tables import FORMATS


def _whole(least: int) -> tuple[Callable[[Any], bool], str]:
    return lambda x: isinstance(x, int) and not isinstance(x, bool) and x >= least, f"a whole number, {least} or more"


def _number(accept: Callable[[float], bool], rule: str) -> tuple[Callable[[Any], bool], str]:
    return lambda x: isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) and accept(x), rule


def _range(high: float, rule: str) -> tuple[Callable[[Any], bool], str]:
    number, _ = _number(lambda x: 0 <= x <= high, rule)
    return lambda x: isinstance(x, ListConfig) and len(x) == 2 and all(map(number, x)) and x[0] < x[1], rule


def _sizes(least: int) -> tuple[Callable[[Any], bool], str]:
    whole, _ = _whole(least)

    def accept(x: Any) -> bool:
        return isinstance(x, ListConfig) and len(x) > 0 and all(map(whole, x)) and list(x) == sorted(set(x))

    return accept, f"an increasing list of whole numbers, {least} or more, such as [10, 20, 50]"


_RULES = {
    "test": _number(lambda x: 0 < x < 1, "a share in (0, 1)"),
    "seed": _whole(0),
    "threads": _whole(1),
    "train.size": _whole(1),
    "train.repetitions": _whole(1),
    "train.mu": _range(math.inf, "bounds [low, high] with 0 ≤ low < high"),
    "train.eps": _range(1, "bounds [low, high] with 0 ≤ low < high ≤ 1"),
    "bounds.patch": _number(lambda x: x > 0, "a positive half-width in m"),
    "bootstrap": _whole(10),
    "curves.sizes": _sizes(2),
    "curves.seeds": _whole(1),
    "transfer.sizes": _sizes(2),
    "transfer.seeds": _whole(1),
    "workers": (lambda x: x is None or _whole(1)[0](x), "a whole number, 1 or more, or null for one a core"),
    "figures.repetitions": _whole(1),
    "laws": (lambda x: isinstance(x, ListConfig) and len(x) > 0, "a list of at least one law, such as [whittaker]"),
}
_NAMES = {
    "train.target": ("impulse target", TARGETS),
    "bounds.norm": ("norm", bounds.NORMS),
    "tables": ("table format", FORMATS),
}


def check(cfg: DictConfig) -> None:
    """Raise for a setting that breaks its rule.

    Raises:
        ContactLearnError: naming the setting, the rule and the value.
        UnknownNameError: a law, variant, target, norm or format that does not exist.
    """
    missing = object()
    for key, (accept, rule) in _RULES.items():
        value = OmegaConf.select(cfg, key, default=missing)
        if value is not missing and not accept(value):
            raise ContactLearnError(f"{key} must be {rule}, got {value!r}")
    for key, (kind, known) in _NAMES.items():
        value = OmegaConf.select(cfg, key, default=missing)
        if value is not missing and value not in known:
            raise UnknownNameError(kind, str(value), known)
    recipes(cfg)
    if cfg.get("transfer") is not None and not (recipes(cfg) and cfg.transfer.get("bodies")):
        raise ContactLearnError("transfer needs a learned model and a body; see configs/experiment/transfer.yaml")
    named = ([cfg.law] if "law" in cfg else []) + list(cfg.get("laws", []))
    for law in named + [cfg.figures[part] for part in ("surface", "parameters") if "figures" in cfg]:
        laws.check(str(law), str(cfg.variant))
    for law, entry in (cfg.get("reference") or {}).items():
        for name in ("mu", "eps"):
            pair = entry.get(name) if isinstance(entry, DictConfig) else None
            if not isinstance(pair, ListConfig) or len(pair) != 2:
                raise ContactLearnError(f"reference.{law} must hold mu: [mean, std] and eps: [mean, std], got {entry}")


def recipes(cfg: DictConfig) -> dict[str, Recipe]:
    """The learned models of `model`, by name; a law alone is none of them.

    Raises:
        ContactLearnError: an entry that is no model, or parameters to learn without a law.
        UnknownNameError: a feature space, target or law that does not exist.
    """
    found = {}
    for name, entry in (cfg.get("model") or {}).items():
        settings = {} if not isinstance(entry, DictConfig) else OmegaConf.to_container(entry, resolve=True)
        unknown = settings.keys() - {"features", "target", "law"}
        if not settings or unknown:
            wrong = f"unknown {', '.join(sorted(unknown))}" if unknown else repr(entry)
            raise ContactLearnError(f"model.{name} must hold features, target and law; got {wrong}")
        if settings.keys() == {"law"}:
            continue
        missing = {"features", "target"} - settings.keys()
        if missing:
            raise ContactLearnError(f"model.{name} lacks {', '.join(sorted(missing))}; see configs/model")
        found[name] = Recipe(**settings, variant=cfg.variant)
    return found


def one_recipe(cfg: DictConfig) -> tuple[str, Recipe | None]:
    """Name and recipe of the one model to train; None for a law alone.

    Raises:
        ContactLearnError: no model, or several.
    """
    names = list(cfg.get("model") or {})
    if len(names) != 1:
        raise ContactLearnError(f"one model is trained at a time, got {names}; sweep over several with -m model=a,b")
    return names[0], recipes(cfg).get(names[0])
