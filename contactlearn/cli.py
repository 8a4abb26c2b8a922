"""The doors: commands that parse a Hydra configuration and hand it to `contactlearn.app`.

Nothing heavy is imported before a configuration is complete, so `--help` is fast.
"""

import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

import hydra
from omegaconf import DictConfig

_PACKAGE = Path(__file__).parent
# Beside the package in a checkout, inside it where it is installed.
CONFIGS = next(str(path) for path in (_PACKAGE / "configs", _PACKAGE.parent / "configs") if path.is_dir())


def _run(job: Callable[[DictConfig], None], cfg: DictConfig) -> None:
    """Run a job; an error that the user can mend is one message and exit status 2."""
    import torch
    from threadpoolctl import threadpool_limits

    from contactlearn.errors import ContactLearnError

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


@hydra.main(version_base="1.3", config_path=CONFIGS, config_name="train")
def train(cfg: DictConfig) -> None:
    """Train one model."""
    from contactlearn import app

    _run(app.train, cfg)


@hydra.main(version_base="1.3", config_path=CONFIGS, config_name="evaluate")
def evaluate(cfg: DictConfig) -> None:
    """Compare laws and learned models with the bounds."""
    from contactlearn import app

    _run(app.evaluate, cfg)


@hydra.main(version_base="1.3", config_path=CONFIGS, config_name="diagnose")
def diagnose(cfg: DictConfig) -> None:
    """Find out which physical effect is missing."""
    from contactlearn import app

    _run(app.diagnose, cfg)


def compose(config_name: str, overrides: list[str]) -> DictConfig:
    """A configuration composed as the commands compose theirs."""
    with hydra.initialize_config_dir(version_base="1.3", config_dir=os.path.abspath(CONFIGS)):
        return hydra.compose(config_name, overrides)
