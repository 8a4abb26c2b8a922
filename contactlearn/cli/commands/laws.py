"""The laws of a configuration: `law`, the one under models and effects, and the names in `laws` and `figures`."""

import inspect
from collections.abc import Iterable
from typing import Any

from omegaconf import DictConfig

from contactlearn import laws
from contactlearn.cli.commands.own import in_one_line, try_law
from contactlearn.cli.commands.plain import plain_values
from contactlearn.cli.commands.targets import subclass
from contactlearn.core.errors import ContactLearnError
from contactlearn.laws import PAPER_LAWS, Law

BEST = "best"
"""As the law of a diagnosis: the one with the least held-out error."""


def given_law(cfg: DictConfig) -> Law:
    """Return the law `law` of the configuration.

    Raises:
        ContactLearnError: a `_target_` that is no law, or no law.
        UnknownNameError: no such law, variant or option.
    """
    law = law_of(cfg.law, str(cfg.variant))
    if law is None:
        raise ContactLearnError("law=best is a choice of diagnose.py alone; name a law, such as law=wang_mason")
    return law


def chosen_law(cfg: DictConfig) -> Law | None:
    """Return the law `law` of the configuration, see `given_law`; None where a diagnosis is to choose it."""
    return given_law(cfg) if "test" in cfg else law_of(cfg.law, str(cfg.variant))


def named_laws(cfg: DictConfig, names: Iterable[str]) -> dict[str, Law]:
    """Return laws by name in the variant of the configuration; that of `law` has the options given there.

    Raises:
        UnknownNameError: no such law or variant.
    """
    law = chosen_law(cfg)
    known = {} if law is None else {law.name: law}
    return {str(name): known.get(str(name)) or laws.find(str(name), str(cfg.variant)) for name in names}


def compared_laws(cfg: DictConfig) -> dict[str, Law]:
    """Return the laws of an evaluation: those of `laws`, and that of `law` if it is none of the paper's."""
    law = chosen_law(cfg)
    own = [] if law is None or law.name in PAPER_LAWS else [law.name]
    return named_laws(cfg, dict.fromkeys((*cfg.laws, *own)))


def law_of(entry: Any, variant: str) -> Law | None:
    """Return the law of a name, or of a mapping with `_target_` and options; None for `best` and for no `_target_`.

    A class of the variant `textbook` stands for its family, so that the variant can be chosen beside it.

    Raises:
        ContactLearnError: a `_target_` that is no law, or one with a slip.
        UnknownNameError: no such law, variant or option.
    """
    if isinstance(entry, DictConfig):
        entry = plain_values(entry)
    if not isinstance(entry, dict):
        return None if entry == BEST else laws.find(str(entry), variant)
    target = entry.get("_target_")
    if target is None:
        return None
    kind = subclass(target, Law)
    if inspect.isabstract(kind):
        raise ContactLearnError(f"_target_={target} has no closed form; a law must define solve(contact, mu, eps)")
    options = {key: tuple(x) if isinstance(x, list) else x for key, x in entry.items() if key != "_target_"}
    with in_one_line(target, kind):
        law = laws.find(kind.name, variant if kind.variant == "textbook" else kind.variant, **options)
        if not str(target).startswith("contactlearn."):
            try_law(law, target)
    return law
