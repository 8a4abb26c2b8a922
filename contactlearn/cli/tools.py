"""The commands that argparse parses: the arguments of each, and the function that runs it and returns the output.

Each command imports the modules that it needs when it runs.

Raises:
    ContactLearnError: errors that a user can fix.
"""

import argparse
import re
import shlex
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from contactlearn.core.errors import ContactLearnError

if TYPE_CHECKING:
    from contactlearn.cli.settings import SourceSettings

_REPORT = """For one run of evaluate or diagnose, write its report.html again from the run folder, without the data
source and without a fit.  For several runs, or a folder above some, write one self-contained page that opens
offline, with the settings in which the runs differ, their held-out errors, verdicts and missing effects in a table to
sort and filter, learning curves where train.size differs, and the ladders of diagnoses.  Runs that cannot be read are
named on it, with the reason."""


def add_tools(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add a parser for each command."""
    _add_data_tools(add)
    _add_export(add)
    _add_replay(add)
    _add_planning(add)
    _add_result_tools(add)


def _add_data_tools(add: Callable[..., argparse.ArgumentParser]) -> None:
    init = add(
        "init",
        help="write the settings of your measurements to a file, for data=NAME on every command",
        description="Look at the names of columns and their units, and write NAME.yaml in this folder: what they say, "
        "and an explanation of the rest. Every command takes it as data=NAME. Where names do not tell the columns, "
        "print what each probably is, and one command that names them.",
        epilog="example: contactlearn init drops.csv --name mydata",
    )
    init.add_argument("path", metavar="FILE", help="a table of impacts, a recording, or a folder with recordings")
    init.add_argument("--name", help="NAME (default: that of the file)")
    init.add_argument(
        "overrides", nargs="*", metavar="data.KEY=value", help="settings that are known already, data.columns={…}"
    )
    init.set_defaults(run=run_init)
    audit = add(
        "audit",
        help="list mistakes in measurements, and the setting that corrects them",
        description="Look for mistakes in a table, or in any data source: columns, units, axes, repeated and "
        "impossible trials. Nothing is fitted, and no file is changed. The exit status is 1 if the data are wrong.",
        epilog="examples: contactlearn audit drops.csv data.units.length=mm; contactlearn audit data=ellipse_drops",
    )
    audit.add_argument(
        "overrides",
        nargs="+",
        metavar="FILE|key=value",
        help="a .csv or .parquet table, or data=NAME for another source, and their settings, data.KEY=…",
    )
    audit.set_defaults(run=run_audit)
    impacts = add(
        "impacts",
        help="find the impacts in recordings of tracked poses",
        description="Find the impacts between free flights in recordings, with covariances, as a table for data=table; "
        "a second table holds everything that was refused, with reason and number.",
        epilog="examples: contactlearn impacts data=mydata -o impacts.parquet; "
        "contactlearn impacts drops/ -o impacts.parquet data.mass=0.05 'data.shape={kind: disc, radius: 0.02}'",
    )
    impacts.add_argument(
        "overrides",
        nargs="+",
        metavar="FOLDER|key=value",
        help="a recording, or a folder with recordings, or data=NAME; and settings of configs/data/tracks.yaml: "
        "data.mass=0.05, data.unit=mm, …",
    )
    impacts.add_argument("-o", "--out", metavar="FILE", required=True, help="a .csv or .parquet file for the impacts")
    _add_force(impacts)
    impacts.set_defaults(run=run_impacts)


def _add_export(add: Callable[..., argparse.ArgumentParser]) -> None:
    export = add(
        "export",
        help="write a model as C, NumPy, JAX, PyTorch, ONNX or MuJoCo scene, or any data source as a table",
        description="With --to, write the law and the effects of a run's model as one file: a function of the impact, "
        "its parameters as constants, and a self-test. Without it, write any data source to a table that data=table "
        "reads back exactly; or a feature space of it, what learned models see, with units in the header.",
        epilog="examples: contactlearn export outputs/diagnose/2026-01-31_12-00-00 --to c -o impact.c; "
        "contactlearn export drops.csv data=ellipse_drops data.inertia=uniform_disc; "
        "contactlearn export x1.csv data=ellipse_drops --features x1",
    )
    export.add_argument("file", metavar="RUN|FILE", help="a run folder or model.pt; without --to the table to write")
    export.add_argument(
        "--to", metavar="TARGET", help="numpy, jax, torch, c, onnx, mujoco; json: all constants in full"
    )
    export.add_argument(
        "-o", "--out", metavar="FILE", help="with --to: the file to write (default: impact.c or the like)"
    )
    export.add_argument("--without-residual", action="store_true", help="leave out the model's Gaussian processes")
    export.add_argument(
        "overrides", nargs="*", metavar="key=value", help="data=synthetic|ellipse_drops|mystery|table, data.KEY=…"
    )
    export.add_argument("--features", metavar="SPACE", help="without --to: state (10-D), x1, x2 or x2_polar")
    _add_force(export)
    export.set_defaults(run=run_export)


def _add_replay(add: Callable[..., argparse.ArgumentParser]) -> None:
    replay = add(
        "replay",
        help="predict recorded trajectories with a model, and see both side by side",
        description="Follow the models of a run from the first flight of each recording, bounce after bounce: errors "
        "over time and over bounces, and an animation. Recordings to which a diagnosis was fitted are left out.",
        epilog="example: contactlearn replay outputs/diagnose/2026-01-31_12-00-00 data=mydata data.path=others/",
    )
    replay.add_argument("model", metavar="RUN", help="a run folder or model.pt")
    replay.add_argument("overrides", nargs="+", metavar="key=value", help="recordings: data=NAME, data.KEY=…")
    replay.add_argument("-o", "--out", metavar="DIR", help="folder for page, figures and numbers; that of the run")
    replay.add_argument(
        "--start", choices=("flight", "frames"), default="flight",
        help="predict from the fitted first flight, or from the first frames alone",
    )  # fmt: skip
    replay.set_defaults(run=run_replay)


def _add_planning(add: Callable[..., argparse.ArgumentParser]) -> None:
    plan = add(
        "plan",
        help="say which impacts to measure next, and when to stop",
        description="Choose a batch of drops within the limits of a rig: before anything is measured for a body, then "
        "from a diagnosis of all drops so far. FOLDER gets plan.csv to drop from, plan.html, plan.json and a picture.",
        epilog="examples: contactlearn plan data=mystery data.seed=7 'rig.height=[0.05,0.5]' 'rig.theta=[-3.14,3.14]' "
        "'rig.omega={low: -30, high: 30, share: 0.1}' -o plans/1; "
        "contactlearn plan outputs/diagnose/2026-01-31_12-00-00 after=plans/1 -o plans/2",
    )
    plan.add_argument(
        "overrides",
        nargs="*",
        metavar="RUN|key=value",
        help="the folder of a diagnosis, and settings of configs/plan.yaml: rig.NAME=…, goal=names, count=20, …",
    )
    plan.add_argument("-o", "--out", metavar="FOLDER", default="plan", help="for the files of the plan (default: plan)")
    _add_force(plan)
    plan.set_defaults(run=run_plan)
    measure = add(
        "measure",
        help="make the drops of a plan in a simulated laboratory, as a robot would",
        description="Make planned drops in the laboratory of data=mystery or data=mujoco: settings are reached as the "
        "rig does it, what it does not set comes by chance, impacts have noise. They are added to FILE.",
        epilog="example: contactlearn measure plans/1 data=mystery data.seed=7 -o drops.csv",
    )
    measure.add_argument("plan", metavar="PLAN", help="the folder of a plan, whose plan.csv may have been changed")
    measure.add_argument("overrides", nargs="+", metavar="key=value", help="data=mystery data.seed=…, data.scatter=…")
    measure.add_argument(
        "-o", "--out", metavar="FILE", required=True, help="a .csv or .parquet file, new or to go on with"
    )
    measure.add_argument("--again", action="store_true", help="add the drops of a plan that FILE holds already")
    measure.set_defaults(run=run_measure)


def _add_result_tools(add: Callable[..., argparse.ArgumentParser]) -> None:
    reveal = add(
        "reveal",
        help="print the hidden effects of the drops of data=mystery",
        description="Print the ground truth of mystery drops: law, parameters, noise and hidden effects.",
        epilog="example: contactlearn reveal outputs/mystery/seed_7",
    )
    reveal.add_argument("folder", metavar="DIR", help="the folder that data=mystery wrote")
    reveal.set_defaults(run=run_reveal)
    report = add(
        "report",
        help="redraw the page of one run, or make one page over several runs or a whole sweep",
        description=_REPORT,
        epilog="examples: contactlearn report outputs/diagnose/2026-01-31_12-00-00; "
        "contactlearn report multirun/2026-01-31/12-00-00; "
        "contactlearn report outputs/diagnose outputs/evaluate --out all.html",
    )
    above = "a run, a sweep, or any folder above some"
    report.add_argument(
        "folders", nargs="+", metavar="DIR", help=f"{above}: every diagnosis.json and results.json in it is a run"
    )
    report.add_argument(
        "--out",
        metavar="FILE",
        help="the page over runs, an .html file, also of a single one (default: report.html in DIR if it is one folder "
        "and no run itself, else ./report.html); it never replaces the page of a run",
    )
    report.set_defaults(run=run_report)
    results = add(
        "results",
        help="write all runs below some folders as one table",
        description="Write one tidy table of all finished runs, a row for each run and model: errors with intervals, "
        "the settings in which runs differ, data, versions and hashes.",
        epilog="example: contactlearn results outputs -o results.parquet",
    )
    results.add_argument("folders", nargs="+", metavar="DIR", help=above)
    results.add_argument("-o", "--out", metavar="FILE", required=True, help="a .parquet or .csv file")
    _add_force(results)
    results.set_defaults(run=run_results)


def _add_force(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--force", action="store_true", help="replace a file that is there")


def _source(command: str, words: Sequence[str], path: str | None = None) -> "SourceSettings":
    """The source that words choose, with another path if one is given; a setting of anything else is refused."""
    from contactlearn.cli.hydra_main import compose
    from contactlearn.cli.settings import SourceSettings

    for word in words:
        if word.lstrip("+~").partition("=")[0].partition(".")[0] != "data":
            raise ContactLearnError(f"{command} only takes data=… and data.KEY=…, got {word}{_in_data(word)}")
    cfg = compose("evaluate", list(words))
    if path is not None:
        cfg.data.path = path.replace("${", "\\${")  # a name in a file system, and no reference
    return SourceSettings.from_config(cfg)


def _in_data(word: str) -> str:
    """The setting of the data that a word without `data.` means, if there is one."""
    from contactlearn.cli.config_files import shipped_settings

    key = re.split(r"[.=]", word.lstrip("+~"))[0]
    known = any(key in settings for settings in shipped_settings("data").values())
    return f": data.{word.lstrip('+~')}?" if known else ""


def _path_and_words(command: str, options: argparse.Namespace) -> tuple[str | None, list[str]]:
    """The file or folder among the words of a command, if there is one, and the settings."""
    from pathlib import Path

    paths = [word for word in options.overrides if "=" not in word or Path(word).exists()]
    if len(paths) > 1:
        raise ContactLearnError(f"{command} takes one file or folder at a time, got {', '.join(paths)}")
    return next(iter(paths), None), [word for word in options.overrides if word not in paths]


def run_init(options: argparse.Namespace) -> str:
    """Write the settings of measurements to a file; return a summary."""
    from pathlib import Path

    from contactlearn.cli.command_line import parse_override, quoted
    from contactlearn.cli.commands.init import write_settings

    stated = dict[str, Any]()
    for word in quoted(options.overrides):
        override = parse_override(word)
        group, _, key = str(override.key_or_group).partition(".")
        if group != "data" or not key or "." in key:
            raise ContactLearnError(
                f"init only takes data.KEY=…, such as data.columns={{…}} or data.mass=…, got {word}"
            )
        stated[key] = override.value()
    return write_settings(Path(options.path), options.name, stated)


def run_audit(options: argparse.Namespace) -> tuple[str, int]:
    """Return the findings of the audit of a table or of any data source, and the setting that corrects them.

    The exit status is 1 where the data are wrong.
    """
    from contactlearn.cli.commands.loading import load_data
    from contactlearn.data.audit.findings import CLOSING, audit
    from contactlearn.report.text.names import sentence
    from contactlearn.report.text.sentences import correct_setting

    path, words = _path_and_words("audit", options)
    words = words if path is None else ["data=table", *words]
    source = _source("audit", words, path)
    impacts = load_data(source, validate=False).impacts
    findings = audit(impacts)
    lines = [f"{impacts.source}: {len(impacts)} impacts"]
    closing = [one for one in findings if one.name in CLOSING and not one.mistake]
    for finding in (*(one for one in findings if one not in closing), *closing):
        lines.append(f"{'wrong' if finding.mistake else 'note'}: {sentence(finding.sentence)}")
        lines += [f"evidence: {sentence(finding.grounds)}"] if finding.grounds else []
    setting = correct_setting(source.corrections, findings)
    lines += [f"to correct it: {setting} on any command"] if setting else []
    if not findings.mistakes:
        chosen = [f"data.path={path}"] if path else []
        lines.append(f"next: {shlex.join(['contactlearn', 'diagnose', *words, *chosen])}")
    if findings.mistakes and not setting:
        lines.append("no setting corrects this: change the table, or what data.columns, data.units and data.shape say")
    return "\n".join(lines).replace("\u00a0", " "), int(bool(findings.mistakes))


def run_export(options: argparse.Namespace) -> str:
    """Write a model of a run for use elsewhere, or a data source as a table; return a line with the path."""
    from contactlearn.cli.commands.export import export_model, refuse_existing
    from contactlearn.cli.commands.loading import load_data
    from contactlearn.data import table
    from contactlearn.mechanics.features import Features

    if options.to is not None:
        data = load_data(_source("export", options.overrides)).impacts if options.overrides else None
        return export_model(
            options.file, options.to, options.out, data, without_residual=options.without_residual, force=options.force
        )
    refuse_existing([options.file], options.force)
    impacts = load_data(_source("export", options.overrides)).impacts
    if options.features is None:
        path = table.save(impacts, options.file)
    else:
        path = table.write_frames([Features.of(impacts, options.features).table()], options.file)
    return f"{len(impacts)} impacts from {impacts.source} written to {path}"


def run_replay(options: argparse.Namespace) -> str:
    """Predict recorded trajectories with the models of a run; return a summary."""
    from pathlib import Path

    from contactlearn.cli.commands.replay import write_replay

    run = Path(options.model)
    out = Path(options.out) if options.out else run if run.is_dir() else run.parent
    return write_replay(options.model, _source("replay", options.overrides), out, options.start)


def run_plan(options: argparse.Namespace) -> str:
    """Plan the next drops and write the plan; return a summary."""
    from pathlib import Path

    from contactlearn.cli.commands.plan import write_plan
    from contactlearn.cli.hydra_main import compose
    from contactlearn.cli.settings import PlanSettings

    run, words = _path_and_words("plan", options)
    settings = PlanSettings.from_config(compose("plan", words))
    data = [word for word in words if word.startswith(("data=", "data."))]
    return write_plan(settings, None if run is None else Path(run), Path(options.out), force=options.force, data=data)


def run_measure(options: argparse.Namespace) -> str:
    """Measure planned drops in a simulated laboratory; return a summary."""
    from pathlib import Path

    from contactlearn.cli.commands.plan import write_measured

    source = _source("measure", options.overrides)
    return write_measured(Path(options.plan), source, Path(options.out), again=options.again)


def run_impacts(options: argparse.Namespace) -> str:
    """Find the impacts in recordings and write them; return a summary."""
    from pathlib import Path

    from contactlearn.cli.commands.export import refuse_existing
    from contactlearn.cli.commands.impacts import write_impacts

    path, words = _path_and_words("impacts", options)
    chosen = [word for word in words if word.startswith("data=")]
    source = _source("impacts", [*([] if chosen else ["data=tracks"]), *words], path)
    if source.target != "contactlearn.data.tracks.load":
        raise ContactLearnError(f"impacts are found in recordings, and {chosen[-1]} is another source of data")
    refuse_existing([options.out], options.force)
    return write_impacts(source, Path(options.out))


def run_reveal(options: argparse.Namespace) -> str:
    """Return the truth about drops with hidden effects."""
    from contactlearn.simulation.hidden_effects import reveal

    return reveal(options.folder)


def run_report(options: argparse.Namespace) -> str:
    """Write the page of one run again, or one over several; return a line with its path."""
    from pathlib import Path

    from contactlearn.report.events import progress
    from contactlearn.report.page.runs import has_page, redraw, write_runs
    from contactlearn.results.runs import printable, repeated_jobs

    if options.out is None and len(options.folders) == 1 and has_page(Path(options.folders[0])):
        return f"report: {printable(str(redraw(Path(options.folders[0]))))}"
    with progress() as on_event:
        page, runs, skipped = write_runs(options.folders, options.out, on_event)
    lines = [f"left out {name}: {reason}" for name, reason in skipped]
    lines += filter(None, [repeated_jobs(run.path.parent for run in runs)])
    counted = f"{len(runs)} {'run' if len(runs) == 1 else 'runs'}"
    counted += f", {len(skipped)} left out" if skipped else ""
    return "\n".join([*lines, counted, f"report: {printable(str(page))}"])


def run_results(options: argparse.Namespace) -> str:
    """Write the table of all runs in some folders; return their number in a line."""
    from pathlib import Path

    from contactlearn.cli.commands.export import refuse_existing
    from contactlearn.report.events import progress
    from contactlearn.results.runs import repeated_jobs, write_table

    refuse_existing([options.out], options.force)
    with progress() as on_event:
        frame, skipped = write_table(options.folders, options.out, on_event)
    lines = [f"left out {name}: {reason}" for name, reason in skipped]
    lines += filter(None, [repeated_jobs(Path(path).parent for path in frame["path"])])
    return "\n".join([*lines, f"{frame['run'].nunique()} runs, {len(frame)} rows written to {options.out}"])
