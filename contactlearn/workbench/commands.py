"""Sessions as command line and experiment file, and command lines as sessions.

`evaluate` with the words of a session makes the same split and the same joint fit, so its held-out error is the same.
Parameters that are set by hand, the selected trial and the windows of the map are in the address alone.
"""

import shlex
from collections.abc import Sequence
from typing import Any

from omegaconf import OmegaConf

from contactlearn.cli.config_files import groups
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import is_number
from contactlearn.effects import EffectId, find_effect
from contactlearn.workbench.lines import line_name, overrides
from contactlearn.workbench.models import STARTS
from contactlearn.workbench.session import Option, Session


def session_of(words: Sequence[str]) -> Session:
    """Return the session with data, law, effects and seed of a command line.

    Raises:
        ContactLearnError: a word that the workbench does not take, or a choice that does not exist.
    """
    for word in words:
        key = word.lstrip("+~").partition("=")[0]
        if key.split(".")[0] not in ("data", "law", "effect", "seed") or (key.startswith("law.")):
            raise ContactLearnError(
                f"the workbench takes data=…, law=…, effect=…, effect.NAME.form=… and seed=…; got {word}"
            )
    settings = EvaluateSettings.from_config(compose("evaluate", list(words)))
    effects: list[EffectId] = []
    options: list[Option] = []
    for name, effect in settings.effects.items():
        kind = find_effect(name, effect.form)
        effects.append(kind.id)
        for key, value in effect.options.items():
            if value != kind().options[key]:
                numbers = value if isinstance(value, tuple) else (value,)
                if not all(map(is_number, numbers)):
                    raise ContactLearnError(f"the workbench takes numbers as options of effects; got {key}={value}")
                options.append(Option(effect=name, name=key, value=tuple(map(float, numbers))))
    return Session(
        data=tuple(word for word in words if word.startswith("data")) or Session().data,
        law=settings.law.name,
        effects=tuple(effects),
        options=tuple(sorted(options, key=lambda one: (one.effect, one.name))),
        seed=settings.seed,
    )


def words_of(session: Session) -> list[str]:
    """Write data, law, effects and lines as the words of a command."""
    words = [*session.data, f"law={session.law}", f"effect=[{','.join(one.name for one in session.effects)}]"]
    words += [f"effect.{effect.name}.form={effect.form}" for effect in session.effects if effect.form is not None]
    words += [f"effect.{one.effect}.{one.name}={str(one.setting).replace(' ', '')}" for one in session.options]
    for place, line in enumerate(session.lines):
        words += overrides(line, line_name(place))
    return [*words, f"seed={session.seed}"]


def command(session: Session) -> str:
    """Write the command that evaluates the model of a session on the same data in the same way."""
    return shlex.join(["contactlearn", "evaluate", *_evaluated(session)])


def _evaluated(session: Session) -> list[str]:
    return [*words_of(session), f"split_seed={session.seed}", "model=[]", f"fit.starts={STARTS}"]


def experiment(session: Session) -> str:
    """Write the experiment file of a session, for configs/experiment or a folder named by --config-dir."""
    defaults: list[dict[str, Any]] = [
        {"override /data": next((word[5:] for word in session.data if word.startswith("data=")), "synthetic")},
        {"override /law": session.law},
        {"override /model": []},
        {"override /effect": [effect.name for effect in session.effects]},
    ]
    entries, words = OmegaConf.create({"defaults": defaults}), _evaluated(session)
    cfg = compose("evaluate", words)
    for key in (word.lstrip("+").partition("=")[0] for word in words):
        if key not in groups("evaluate"):
            OmegaConf.update(entries, key, OmegaConf.select(cfg, key))
    head = ["# @package _global_", f"# {command(session)}"]
    if session.manual:
        head.append(f"# set by hand, which no command can do: {', '.join(f'{k} = {x:g}' for k, x in session.manual)}")
    return "\n".join([*head, OmegaConf.to_yaml(entries)])
