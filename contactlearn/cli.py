"""The doors: commands that parse a Hydra configuration and hand it to `contactlearn.app`.

Nothing heavy is imported before a configuration is complete, so `--help` is fast.
"""

import functools
import logging
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from string import Template

import hydra
from omegaconf import DictConfig, OmegaConf

from contactlearn.errors import ContactLearnError, UnknownNameError

_PACKAGE = Path(__file__).parent
# Beside the package in a checkout, inside it where it is installed.
CONFIGS = next(str(path) for path in (_PACKAGE / "configs", _PACKAGE.parent / "configs") if path.is_dir())


def _run(job: Callable[[DictConfig], None], cfg: DictConfig) -> None:
    """Run a job; an error that the user can mend is one message and exit status 2."""
    import torch
    from threadpoolctl import threadpool_limits

    # The tensors here are small: threads cost more than they give, and sweeps run jobs side by side.
    if isinstance(cfg.threads, int) and cfg.threads > 0:  # settings.check refuses anything else
        torch.set_num_threads(cfg.threads)
        threadpool_limits(cfg.threads)  # the BLAS of NumPy and SciPy
    logging.getLogger("fontTools").setLevel(logging.WARNING)  # it tells of every glyph that a PDF embeds
    try:
        job(cfg)
    except ContactLearnError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def _command(job: Callable[[DictConfig], None]) -> Callable[[], None]:
    """The door of a job: the configuration of its name, from the command line."""
    run: Callable[[], None] = hydra.main(version_base="1.3", config_path=CONFIGS, config_name=job.__name__)(job)

    @functools.wraps(job)
    def door() -> None:
        words = sys.argv[1:]
        flags = {word for word in words if word.startswith("-")}
        try:
            if not flags & {"--config-dir", "-cd"}:
                _check_choices(words)
        except ContactLearnError as error:
            print(f"error: {error}", file=sys.stderr)
            sys.exit(2)
        if flags and flags <= {"--help", "-h"}:
            print(_help(job.__name__, [word for word in words if word not in flags]))
        else:
            run()

    return door


def _help(config_name: str, overrides: list[str]) -> str:
    """What Hydra prints for `--help`, without its search for every group, which takes half of the time."""
    cfg = compose(config_name, overrides, return_hydra_config=True)
    ours = OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key != "hydra"])
    folders = (path for path in sorted(Path(CONFIGS).iterdir()) if path.is_dir() and path.name != "hydra")
    groups = "".join(f"{folder.name}: {', '.join(_choices(folder))}\n" for folder in folders)
    return Template(cfg.hydra.help.template).substitute(CONFIG=OmegaConf.to_yaml(ours), APP_CONFIG_GROUPS=groups)


def _choices(group: Path) -> list[str]:
    return sorted(path.stem for path in group.glob("*.yaml"))


def _check_choices(overrides: list[str]) -> None:
    """Raise for a choice that its group lacks, such as law=mirtisch; Hydra suggests nothing.

    Raises:
        UnknownNameError: with the nearest name.
    """
    for word in overrides:
        group, _, choice = word.partition("=")
        folder = Path(CONFIGS, group)
        if not group.isidentifier() or not folder.is_dir() or "(" in choice:  # not a group, or a function of Hydra's
            continue
        known = _choices(folder)
        for name in re.findall(r"\w+", choice):
            if name not in known and name != "null":
                raise UnknownNameError(group, name, known)


@_command
def train(cfg: DictConfig) -> None:
    """Train one model."""
    from contactlearn import app

    _run(app.train, cfg)


@_command
def evaluate(cfg: DictConfig) -> None:
    """Compare laws and learned models with the bounds."""
    from contactlearn import app

    _run(app.evaluate, cfg)


@_command
def diagnose(cfg: DictConfig) -> None:
    """Find out which physical effect is missing."""
    from contactlearn import app

    _run(app.diagnose, cfg)


def compose(config_name: str, overrides: list[str], *, return_hydra_config: bool = False) -> DictConfig:
    """A configuration composed as the commands compose theirs.

    Raises:
        UnknownNameError: a choice that its group lacks.
    """
    _check_choices(overrides)
    with hydra.initialize_config_dir(version_base="1.3", config_dir=os.path.abspath(CONFIGS)):
        return hydra.compose(config_name, overrides, return_hydra_config=return_hydra_config)
