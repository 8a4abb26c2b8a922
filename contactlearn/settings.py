"""Checks of a composed configuration, before any data is read: a wrong setting costs seconds, not a run."""

import math
from collections.abc import Callable
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf

from contactlearn import bounds, laws
from contactlearn.errors import ContactLearnError, UnknownNameError
from contactlearn.fit import TARGETS
from contactlearn.report.tables import FORMATS


def _whole(least: int) -> tuple[Callable[[Any], bool], str]:
    return lambda x: isinstance(x, int) and not isinstance(x, bool) and x >= least, f"a whole number, {least} or more"


def _number(accept: Callable[[float], bool], rule: str) -> tuple[Callable[[Any], bool], str]:
    return lambda x: isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) and accept(x), rule


def _range(high: float, rule: str) -> tuple[Callable[[Any], bool], str]:
    number, _ = _number(lambda x: 0 <= x <= high, rule)
    return lambda x: isinstance(x, ListConfig) and len(x) == 2 and all(map(number, x)) and x[0] < x[1], rule


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
    named = ([cfg.law] if "law" in cfg else []) + list(cfg.get("laws", []))
    for law in named + [cfg.figures[part] for part in ("surface", "parameters") if "figures" in cfg]:
        laws.check(str(law), str(cfg.variant))
    for law, entry in (cfg.get("reference") or {}).items():
        for name in ("mu", "eps"):
            pair = entry.get(name) if isinstance(entry, DictConfig) else None
            if not isinstance(pair, ListConfig) or len(pair) != 2:
                raise ContactLearnError(f"reference.{law} must hold mu: [mean, std] and eps: [mean, std], got {entry}")
