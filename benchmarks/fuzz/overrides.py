"""Words of a command line, one in a line of the text; the first is the command.

Composed as Hydra composes them, but without Hydra's own part and with the files of each choice read once, and checked
as the commands check them.
"""

from functools import lru_cache

import hydra
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from contactlearn.cli.command_line import quoted
from contactlearn.cli.config_files import CONFIGS, check_choices, with_pluses
from contactlearn.cli.config_security import check_targets
from contactlearn.cli.hydra_main import readable_errors
from contactlearn.cli.reasons import reason
from contactlearn.cli.settings import SETTINGS, check_names
from contactlearn.core.errors import ContactLearnError
from fuzz.target import Target

COMMANDS = tuple(SETTINGS)
WORDS = (
    "evaluate\ntrain.size=50\nmodel=[x1_wrench]",
    "train\neffect=[surface_tilt,spin_damping]\neffect.spin_damping.form=during",
    "diagnose\ndata=table\ndata.path=drops.csv\ndata.shape={kind: disc, radius: 0.02}\nlaw=best",
    "evaluate\ndata=table\ndata.path=drops.csv\ndata.shape={body: {kind: disc, radius: 0.02}}",
    'evaluate\n+effect.mine.tau="-c*rx*Pn"\n+effect.mine.parameters.c=[-1,1]\ntest=0.3\nseed=7',
    "train\nlaw=chatterjee_ruina\nlaw.e_t=0.2\ntrain.mu=[0,1]\n+limits.mu=[-3,-1]",
    "evaluate\nexperiment=fazeli2017\ncurves.sizes=[10,20]\n~transfer.bodies.rod",
    "evaluate\n+model.mine={features: x1, target: wrench, law: null}\nfit.noise=[0.1,0.1,1]\nbounds.norm=euclidean",
    "train\ndata.path=${oc.env:HOME}\ndata.units.length=${data.path}\n++train.sise=3",
)


def read(content: bytes) -> None:
    """Compose and check a configuration; what Hydra refuses is one line."""
    first, *words = content.decode("utf-8", "replace").split("\n")
    command = COMMANDS[len(first) % len(COMMANDS)] if first not in COMMANDS else first
    try:
        words = quoted(words)
        check_choices(words, command)
        words = with_pluses(words, command)
        with readable_errors():
            cfg = composed(command, words)
        check_names(cfg, command, words)
        check_targets(cfg, words)
        SETTINGS[command].from_config(cfg)
    except (HydraException, OmegaConfBaseException) as error:
        line = reason(error)
        if not line or "\n" in line:
            raise AssertionError(f"is no line: {line!r}") from error
        raise ContactLearnError(line) from error


def composed(command: str, words: list[str]) -> DictConfig:
    """The configuration of a command with its words."""
    parsed = OverridesParser.create().parse_overrides(words)
    chosen = tuple(word for word, one in zip(words, parsed, strict=True) if _is_choice(one.key_or_group))
    cfg = _base(command, chosen).copy()
    OmegaConf.set_struct(cfg, True)
    others = [one for one in parsed if not _is_choice(one.key_or_group)]
    ConfigLoaderImpl._apply_overrides_to_config(others, cfg)
    return cfg


def _is_choice(name: str) -> bool:
    """Whether a word is about a group, whose files Hydra has to read."""
    return name.split("@")[0] in ("law", "model", "effect", "data", "experiment", "candidate") or "/" in name


@lru_cache(maxsize=64)
def _base(command: str, chosen: tuple[str, ...]) -> DictConfig:
    with hydra.initialize_config_dir(version_base="1.3", config_dir=CONFIGS):
        return hydra.compose(command, list(chosen))


KEYS = [
    "train.size", "data.path", "effect", "law._target_", "candidate", "limits", "hydra.run.dir", "reference", "laws",
]  # fmt: skip
TARGET = Target(
    read, lambda: [words.encode() for words in WORDS],
    words=[
        *KEYS, "${", "}", "[", "]", "{", "null", "nan", "inf", "1e999", "glob(*)", "range(1,9)", "++", "~", "@",
        "\\,",
    ],
    watched=["hydra.core.override_parser", "hydra._internal.grammar"],
)  # fmt: skip
