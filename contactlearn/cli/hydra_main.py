"""The commands train, evaluate and diagnose as Hydra starts them: composed configurations, help, errors in one line.

Nothing heavy is imported before a configuration is complete, so `--help` is fast.
"""

import functools
import gc
import json
import logging
import os
import sys
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from importlib.metadata import distribution
from pathlib import Path
from string import Template
from textwrap import fill
from types import ModuleType
from typing import NoReturn

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from contactlearn.cli.command_line import CommandLine, one_of_each, parse_command_line, quoted, quoted_path
from contactlearn.cli.config_files import (
    CONFIGS,
    check_choices,
    choices,
    experiments,
    groups,
    summaries,
    user_folders,
    with_diagnosed_model,
    with_forms,
    with_globs,
    with_pluses,
    without_hydra,
)
from contactlearn.cli.config_security import check_targets
from contactlearn.cli.reasons import reason
from contactlearn.cli.sweeps.resolvers import jobs_that_fit, register_resolvers
from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError, suggest, terminal_safe
from contactlearn.core.signals import defer_interrupts, graceful_exit, is_interruption, prepare_process, write_output

# Our configurations of launchers have the names of those that their packages bring, whose types they are checked by.
warnings.filterwarnings("ignore", message=r"\s*'hydra/launcher/\w+' is validated against ConfigStore schema")

logging.raiseExceptions = False  # a message of Hydra's that nobody reads any more
logging.getLogger("contactlearn").propagate = False  # to Hydra's log of a sweep: it is printed already

register_resolvers()  # also in a launcher's process

_WIDTH = 80  # columns of help
_FULL = "HYDRA_FULL_ERROR"


def _run(command: str, cfg: DictConfig) -> float | None:
    """Run a command in its folder; an error that the user can fix is one message and exit status 2.

    Returns:
        What a sweeper minimises: the held-out error.
    """
    import torch
    from threadpoolctl import threadpool_limits

    from contactlearn.cli.job import run_job

    prepare_process()  # also in a launcher's process
    # The tensors here are small: threads cost more than they give, and sweeps run jobs side by side.
    if isinstance(cfg.threads, int) and cfg.threads > 0:  # anything else is refused with the other settings
        torch.set_num_threads(cfg.threads)
        threadpool_limits(cfg.threads)  # the BLAS of NumPy and SciPy
    logging.getLogger("fontTools").setLevel(logging.WARNING)  # it reports every glyph that a PDF embeds
    sweeping = HydraConfig.get().mode == RunMode.MULTIRUN
    try:
        return run_job(command, _load_commands().COMMANDS[command], cfg)
    except ContactLearnError as error:
        if sweeping:
            raise
        _end(f"error: {error}", 2)
    finally:
        if sweeping:
            _freeze_loaded()


# Collections of garbage, of which joblib makes many, pass over what the first job of a sweep has loaded.  None is made
# here: Ctrl-C in the midst of one can be lost.
_freeze_loaded = functools.cache(gc.freeze)


@functools.cache
def _load_commands() -> ModuleType:
    """Load the commands without collections of garbage, each of which would pass over all that is loaded so far."""
    gc.disable()
    try:
        from contactlearn.cli import commands
    finally:
        gc.enable()
    return commands


_EXAMPLE = (
    "no data=… is given, so an example is diagnosed, simulated drops; `contactlearn init FILE --name mydata` makes "
    "data=mydata of your file\n"
)


def _command(name: str) -> Callable[[], None]:
    """Return a command, which takes the configuration of its name from the command line."""

    def job(cfg: DictConfig) -> float | None:
        return _run(name, cfg)

    run: Callable[[], None] = hydra.main(version_base="1.3", config_path=CONFIGS, config_name=name)(job)

    def run_command() -> None:
        with graceful_exit(), _one_message():
            line = parse_command_line(sys.argv[1:])
            if line.flags == ("--version",):
                write_output(f"contactlearn {__version__}\n")
                return
            with user_folders(*line.folders):
                words = list(line.words)
                if "--shell-completion" not in line.flags:
                    words = completed(words, name, several=line.several or bool(line.flags))
                if line.flags == ("--help",):
                    write_output(_help(name, words) + "\n")
                    return
                if line.flags == ("--settings",):
                    settings = without_hydra(compose(name, words, return_hydra_config=True))
                    write_output(OmegaConf.to_yaml(settings) + "\n")
                    return
                if name != "diagnose":
                    _refuse_default_data(words, line)
                sys.argv[1:] = [*line.flags, *words]
                if {"--help", "--hydra-help", "--shell-completion"} & {*line.flags}:
                    run()
                elif line.several:
                    _sweep(run, name, words, line)
                else:
                    _composed(line.config_name or name, words, check=name)
                    if name == "diagnose" and _has_default_data(words, line):
                        write_output(_EXAMPLE)
                    run()

    return run_command


def _sweep(run: Callable[[], None], command: str, words: list[str], line: CommandLine) -> None:
    """Run the jobs of a sweep, unless a word is wrong in any of them."""
    from contactlearn.cli.settings import SETTINGS  # which loads torch
    from contactlearn.cli.sweeps.sweep import sweep

    swept, jobs = one_of_each(words)
    composed = [_composed(line.config_name or command, job, check=command) for job in jobs]
    for cfg in composed:
        SETTINGS[command].from_config(cfg)
    (cfg, *_) = composed
    params = OmegaConf.select(cfg, "hydra.sweeper.params") or {}
    keys = [*swept, *map(str, params)]
    with sweep(cfg.hydra, keys) as folder:
        sys.argv += [f"hydra.sweep.dir={quoted_path(str(folder))}"]
        if "contactlearn.job" in str(OmegaConf.to_container(cfg.hydra.sweep, resolve=False)):
            named = ",".join(json.dumps(key) for key in keys)
            sys.argv += [f"hydra.sweep.subdir='${{contactlearn.job:{named}}}'"]
        if str(cfg.hydra.launcher._target_).endswith("LocalLauncher") and "max_batch_size" in cfg.hydra.sweeper:
            sys.argv += [f"hydra.sweeper.max_batch_size={jobs_that_fit(cfg.hydra.launcher.mem_gb)}"]  # it starts all
        run()


def _has_default_data(words: list[str], line: CommandLine) -> bool:
    """Whether no word names the data, so that simulated drops stand in for them."""
    return not (_given(words) & {"data", "experiment"} or any(line.folders) or line.config_name)


def _refuse_default_data(words: list[str], line: CommandLine) -> None:
    """Refuse a checkpoint without words for the data, which are not those of its training by default."""
    if "checkpoint" in _given(words) and _has_default_data(words, line):
        raise ContactLearnError(
            "a checkpoint needs data=…: those to judge it on or to go on with, which may be those of its training; "
            "else they would be simulated drops (data=synthetic)"
        )


def completed(words: Sequence[str], command: str, *, several: bool = False) -> list[str]:
    """Return the words of a command as Hydra takes them: with those of a run for model=RUN, and paths in quotes.

    With a checkpoint no model of the configuration is trained, unless words name one.

    Raises:
        ContactLearnError: a word that cannot be read, or a choice that its group lacks.
    """
    words = with_forms(with_diagnosed_model(with_globs([_nothing_of(word) for word in words], command), command))
    keys = _given(words)
    trains = command in ("train", "evaluate") and "model" not in keys
    words = quoted([*words, "model=[]"] if "checkpoint" in keys and trains else words, several=several)
    check_choices(words, command)
    return with_pluses(words, command)


def _nothing_of(word: str) -> str:
    """`effect=[]` for `~effect`, by which Hydra would take out a choice, and finds none in a list of choices.

    Raises:
        ContactLearnError: a part that no command can be without.
    """
    group = word.removeprefix("~").partition("=")[0]
    if not word.startswith("~") or group not in ("effect", "model", "law", "data"):
        return word
    if group in ("law", "data"):
        raise ContactLearnError(f"{word}: every command needs {group}; choose another with {group}=…")
    return f"{group}=[]"


def _given(words: Sequence[str]) -> set[str]:
    """Names of the settings that words give, but for those that they set to null."""
    return {word.lstrip("+").partition("=")[0] for word in words if not word.endswith("=null")}


@contextmanager
def _one_message() -> Generator[None]:
    """End with one message and status 2 for an error that the user can fix."""
    before = os.environ.get(_FULL)
    os.environ[_FULL] = "1"  # Hydra raises exceptions, and prints none itself
    try:
        yield
    except BrokenPipeError:
        raise
    except Exception as error:
        if is_interruption(error):  # OmegaConf answers an interruption with an error of its own
            raise KeyboardInterrupt from error
        if before == "1" or not isinstance(
            error, ContactLearnError | HydraException | OmegaConfBaseException | OSError
        ):
            raise
        _end(f"error: {reason(error)}", 2)
    finally:
        os.environ.pop(_FULL) if before is None else os.environ.update({_FULL: before})


def _end(message: str, status: int) -> NoReturn:
    print(terminal_safe(message), file=sys.stderr)
    sys.exit(status)


def _help(config_name: str, overrides: list[str]) -> str:
    """Hydra's `--help` with choices in groups, without its search for every group, which takes half of the time."""
    cfg = compose(config_name, overrides, return_hydra_config=True)
    known = {group: choices(group) for group in groups(config_name)} | {"experiment": experiments(config_name)}
    parts = list[str]()
    for group, names in known.items():
        if not (told := summaries(group)):
            parts.append(fill(f"{group}: {', '.join(names)}", _WIDTH - 1, subsequent_indent="  "))
            continue
        several = ", [a,b] for several" if group == "effect" else ""
        parts.append(f"{group} ({group}=…{several})")
        for name in names:
            line = f"  {name}: {told[name]}" if name in told else f"  {name}"
            parts.append(fill(line, _WIDTH - 1, subsequent_indent=" " * 6))
    text = Template(cfg.hydra.help.template).substitute(APP_CONFIG_GROUPS="\n".join(parts))
    places = {"the folder configs": _near(Path(CONFIGS)), "the folder docs": _documentation()}  # Hydra's own names none
    for words, place in places.items():
        text = text.replace(words, place)
    return text


def _near(folder: Path) -> str:
    """A folder from the working directory if it is below it."""
    return str(folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder)


def _documentation() -> str:
    """Where the documentation is: in a checkout, else at the address that the package states."""
    if (folder := Path(CONFIGS).parent / "docs").is_dir():
        return _near(folder)
    urls = distribution("contactlearn").metadata.get_all("Project-URL") or []
    return next((one.partition(", ")[2] for one in urls if one.startswith("Documentation")), "the documentation")


train, evaluate, diagnose = map(_command, ("train", "evaluate", "diagnose"))


def compose(config_name: str, overrides: Sequence[str], *, return_hydra_config: bool = False) -> DictConfig:
    """A configuration composed as the commands compose theirs.

    Raises:
        ContactLearnError: a choice that its group lacks, a setting that the command does not have, or a class that a
            file brought.
    """
    words = completed(overrides, config_name)
    return _composed(config_name, words, check=config_name, return_hydra_config=return_hydra_config)


@contextmanager
def readable_errors() -> Generator[None]:
    """Put into words what Hydra has no error of its own for while it composes, such as law=null.

    Raises:
        ContactLearnError: for an error of Python's.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException, ContactLearnError):
        raise
    except RecursionError as error:
        raise ContactLearnError("configuration files refer to each other without an end") from error
    except (TypeError, ValueError, AttributeError, AssertionError) as error:
        seen = " ".join(str(error).split())
        raise ContactLearnError(f"a word of the command line cannot be read: {seen}; --settings lists all") from error


def _composed(config_name: str, words: Sequence[str], *, check: str, return_hydra_config: bool = True) -> DictConfig:
    """A checked configuration, before Hydra makes anything of it.

    Raises:
        ContactLearnError: see `compose`.
    """
    folder = os.path.abspath(CONFIGS)
    with (
        defer_interrupts(),
        hydra.initialize_config_dir(version_base="1.3", config_dir=folder, job_name=check),
        readable_errors(),
    ):
        for word in words:
            _require_plugin(word)
            if word.startswith("~") and "/" not in word and config_name == check:
                from contactlearn.cli.settings import require_setting  # which loads torch

                key = word[1:].partition("=")[0]
                if require_setting(key.split("."), check):
                    raise ContactLearnError(f"{key} cannot be taken out; {key}=null where it may have no value")
        cfg = hydra.compose(config_name, [*words], return_hydra_config=return_hydra_config)
    check_targets(cfg, words)
    if words:
        from contactlearn.cli.settings import check_names

        check_names(cfg, config_name, words)
    OmegaConf.to_container(without_hydra(cfg), resolve=True)
    return cfg


def _require_plugin(word: str) -> None:
    """Refuse a launcher or a sweeper that is not installed."""
    group, _, name = word.lstrip("+").partition("=")
    kind = group.removeprefix("hydra/")
    if kind in ("launcher", "sweeper") and name.isidentifier():
        installed = GlobalHydra.instance().config_loader().get_group_options(group)
        if name not in installed:
            raise ContactLearnError(
                f"no {group} {name!r} is installed{suggest(name, installed)}; there are {', '.join(installed)}; "
                f"others are plugins of Hydra's, such as pip install hydra-{name}-{kind}"
            )
