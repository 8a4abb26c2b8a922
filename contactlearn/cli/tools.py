"""The commands that argparse parses, from their options to what they print; what each needs is imported in it alone.

Raises:
    ContactLearnError: what a user can mend.
"""

import argparse
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from contactlearn.core.errors import ContactLearnError, UnknownNameError

if TYPE_CHECKING:
    from contactlearn.cli.settings import SourceSettings


def _source(command: str, words: Sequence[str], path: str | None = None) -> "SourceSettings":
    """The source that words choose, and its file; a setting of anything else would do nothing."""
    from contactlearn.cli.hydra_main import compose
    from contactlearn.cli.settings import SourceSettings

    cfg = compose("evaluate", list(words))
    for word in words:
        if word.lstrip("+~").partition("=")[0].partition(".")[0] != "data":
            raise ContactLearnError(f"{command} takes data=… and data.KEY=… alone, got {word}")
    if path is not None:
        cfg.data.path = path
    return SourceSettings.from_config(cfg)


def run_audit(options: argparse.Namespace) -> str:
    """Return the findings of the audit of a table or of any data source, and the setting that corrects them."""
    from pathlib import Path

    from contactlearn.cli.commands.loading import load_data
    from contactlearn.data.audit.findings import audit
    from contactlearn.report.text import correct_setting, phrase, sentence

    files = [word for word in options.words if "=" not in word or Path(word).is_file()]
    if len(files) > 1:
        raise ContactLearnError(f"one table is audited at a time, got {', '.join(files)}")
    words = [word for word in options.words if word not in files]
    source = _source("audit", ["data=table", *words], path=files[0]) if files else _source("audit", words)
    impacts = load_data(source, validate=False)
    findings = audit(impacts)
    lines = [f"{impacts.source}: {len(impacts)} impacts"]
    lines += [f"{'wrong' if finding.mistake else 'note'}: {sentence(finding.sentence)}" for finding in findings]
    lines += [] if findings else [f"note: {phrase('consistent')}"]
    setting = correct_setting(source.corrections, findings)
    lines += [f"to correct it: {setting} on any command"] if setting else []
    return "\n".join(lines).replace("\u00a0", " ")


def run_export(options: argparse.Namespace) -> str:
    """Write a data source to a table; say so."""
    from contactlearn.cli.commands.loading import load_data
    from contactlearn.data import table

    impacts = load_data(_source("export", options.overrides))
    path = table.save(impacts, options.file)
    return f"{len(impacts)} impacts from {impacts.source} written to {path}"


def run_impacts(options: argparse.Namespace) -> str:
    """Find the impacts in recordings and write them; return what was found."""
    from pathlib import Path

    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from contactlearn.cli.commands.impacts import own_names, write_impacts
    from contactlearn.cli.config_files import explained
    from contactlearn.cli.hydra_main import compose
    from contactlearn.cli.settings import SourceSettings

    every = [*map(str, compose("evaluate", ["data=tracks"]).data)]
    known = [name for name in every if name not in ("_target_", "path", "correct")]  # which come otherwise, or later
    words = [re.sub(r"^([+~]*)(data\.)?", r"\1data.", word) for word in options.overrides]
    for word in words:
        name = re.split(r"[.=]", word)[1]
        if name not in known:
            raise UnknownNameError("setting of impacts", name, known)
    try:
        cfg = compose("evaluate", ["data=tracks", *words])
    except (HydraException, OmegaConfBaseException) as error:
        raise ContactLearnError(own_names(explained(error, "evaluate", words), every)) from None
    cfg.data.path = options.path
    return write_impacts(SourceSettings.from_config(cfg), Path(options.out))


def run_reveal(options: argparse.Namespace) -> str:
    """Return the truth about drops with hidden effects."""
    from contactlearn.simulation.hidden_effects import reveal

    return reveal(options.folder)


def run_report(options: argparse.Namespace) -> str:
    """Write the page of one run again, or one over several; say where it is."""
    from pathlib import Path

    from contactlearn.diagnosis.events import track
    from contactlearn.report.events import progress
    from contactlearn.report.page.redraw import has_page, redraw
    from contactlearn.report.page.runs.page import write_runs
    from contactlearn.report.page.runs.rows import printable

    if options.out is None and len(options.folders) == 1 and has_page(Path(options.folders[0])):
        return f"open     {printable(str(redraw(Path(options.folders[0]))))}"
    with progress() as on_event:
        page, runs, skipped = write_runs(options.folders, options.out, lambda items, task: track(items, task, on_event))
    lines = [f"left out {name}: {reason}" for name, reason in skipped]
    counted = f"{len(runs)} {'run' if len(runs) == 1 else 'runs'}"
    counted += f", {len(skipped)} left out" if skipped else ""
    return "\n".join([*lines, counted, f"open     {printable(str(page))}"])


def run_results(options: argparse.Namespace) -> str:
    """Write the table of all runs in some folders; say how many there are."""
    from contactlearn.diagnosis.events import track
    from contactlearn.report.events import progress
    from contactlearn.report.results_table import write_table

    with progress() as on_event:
        frame, skipped = write_table(options.folders, options.out, lambda items, task: track(items, task, on_event))
    lines = [f"left out {name}: {reason}" for name, reason in skipped]
    return "\n".join([*lines, f"{frame['run'].nunique()} runs, {len(frame)} rows written to {options.out}"])
