"""`python -m contactlearn COMMAND`: train, evaluate and diagnose as in a checkout, and the tools beside them.

train key=value…      train one contact model
evaluate key=value…   compare laws and learned models with the bounds
diagnose key=value…   find out which physical effect is missing
audit FILE            say what is wrong with a table, or with any data=…
export FILE data=…    write any data source to a table file
impacts FOLDER -o F   find the impacts in recordings of tracked poses
reveal DIR            print the hidden effects of the drops of data=mystery
report DIR…           redraw the page of one run, or make one page over several
results DIR… -o FILE  write all runs as one table, a row for each run and model
workbench data=…      the whole loop, live in a browser
"""

import argparse
import re
import sys
from collections.abc import Callable

from contactlearn import __version__
from contactlearn.cli import tools
from contactlearn.core.errors import ContactLearnError, harmless, installing, suggest
from contactlearn.core.signals import graceful_exit

_REPORT = """Of one run of evaluate or diagnose: write its report.html again, from the run folder alone, without the
data source and without a fit.  Of several runs, or of a folder above some: write one self-contained page that opens
offline, with the settings in which the runs differ, their held-out errors, verdicts and missing effects in a table to
sort and filter, learning curves where train.size differs, and the ladders of diagnoses.  Runs that cannot be read are
named on it, with the reason."""


_CONFIGURED = {
    "train": "train one contact model",
    "evaluate": "compare laws and learned models with the bounds",
    "diagnose": "find out which physical effect is missing",
}
"""Commands whose arguments Hydra parses."""


def main(arguments: list[str] | None = None) -> int:
    """Run the `contactlearn` command; return the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in _CONFIGURED:
        return _configured(*words)
    with graceful_exit():
        return _run_tool(words)


def _run_tool(words: list[str]) -> int:
    """Run a command whose arguments argparse parses; return the exit status."""
    options = _parsed(words)
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from contactlearn.cli.config_files import explained

    try:
        print(harmless(options.run(options)))
    except ContactLearnError as error:
        said = str(error).splitlines()[0]
    except (HydraException, OmegaConfBaseException) as error:
        said = explained(error, "evaluate", vars(options).get("overrides", ()))  # by which the tools compose their data
    else:
        return 0
    print(f"error: {harmless(said)}", file=sys.stderr)
    return 2


def _parsed(words: list[str]) -> argparse.Namespace:
    """Parse the command line; settings may also follow an option, for which argparse has no word."""
    parser, commands = _parser()
    if words and not words[0].startswith("-") and words[0] not in commands:
        parser.error(f"no command is called {words[0]!r}{suggest(words[0], commands)}; --help lists all")
    options, settings = parser.parse_known_args(words)
    wrong = [word for word in settings if word.startswith("-") or "=" not in word or "overrides" not in options]
    if wrong:
        command = commands[next(word for word in words if word in commands)]
        known = re.findall(r"(?<!\S)--?[a-z][\w-]*", command.format_help())
        command.error(f"unknown argument {wrong[0]!r}{suggest(wrong[0], known)}")
    if settings:
        options.overrides = [*options.overrides, *settings]
    return options


def _configured(command: str, *overrides: str) -> int:
    """Run a command whose configuration Hydra composes; Hydra reads its overrides from `sys.argv`."""
    from contactlearn.cli import hydra_main

    sys.argv = [f"contactlearn {command}", *overrides]
    getattr(hydra_main, command)()
    return 0


def _parser() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """The parser of all commands, and that of each by name."""
    parser = argparse.ArgumentParser(prog="contactlearn", description="Learn rigid-body contact from measurements.")
    parser.add_argument("--version", action="version", version=f"contactlearn {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND ARGUMENT")
    add = commands.add_parser
    for command, summary in _CONFIGURED.items():
        add(command, help=f"{summary}; {command} --help lists its settings")
    _add_audit(add)
    _add_export(add)
    _add_impacts(add)
    _add_reveal(add)
    _add_report(add)
    _add_results(add)
    _add_workbench(add)
    return parser, commands.choices


def workbench() -> int:
    """Run `contactlearn workbench`; return the exit status."""
    return main(["workbench", *sys.argv[1:]])


def _add_audit(add: Callable[..., argparse.ArgumentParser]) -> None:
    audit = add(
        "audit",
        help="say what is wrong with measurements, and which setting corrects it",
        description="Look for mistakes in a table, or in any data source: columns, units, axes, repeated and "
        "impossible trials. Nothing is fitted, and no file is changed.",
        epilog="examples: contactlearn audit drops.csv data.units.length=mm; contactlearn audit data=ellipse_drops",
    )
    audit.add_argument(
        "words",
        nargs="+",
        metavar="FILE|key=value",
        help="a .csv or .parquet table, or data=NAME for another source, and their settings, data.KEY=…",
    )
    audit.set_defaults(run=tools.run_audit)


def _add_export(add: Callable[..., argparse.ArgumentParser]) -> None:
    export = add(
        "export",
        help="write any data source to a CSV or Parquet table",
        description="Write any data source to a table that data=table reads back exactly.",
        epilog="example: contactlearn export drops.csv data=ellipse_drops data.inertia=uniform_disc",
    )
    export.add_argument("file", help="where to write: a .csv or .parquet file")
    export.add_argument(
        "overrides", nargs="*", metavar="key=value", help="data=synthetic|ellipse_drops|mystery|table, data.KEY=…"
    )
    export.set_defaults(run=tools.run_export)


def _add_impacts(add: Callable[..., argparse.ArgumentParser]) -> None:
    impacts = add(
        "impacts",
        help="find the impacts in recordings of tracked poses",
        description="Find the impacts between free flights in recordings, with covariances, as a table for data=table; "
        "everything that was refused goes, with reason and number, into a table beside it.",
        epilog="example: contactlearn impacts drops/ -o impacts.parquet mass=0.05 'shape={kind: disc, radius: 0.02}'",
    )
    impacts.add_argument("path", metavar="FOLDER", help="a recording, or a folder with recordings")
    impacts.add_argument("-o", "--out", metavar="FILE", required=True, help="a .csv or .parquet file for the impacts")
    impacts.add_argument(
        "overrides", nargs="*", metavar="key=value", help="settings of configs/data/tracks.yaml: mass=0.05, unit=mm, …"
    )
    impacts.set_defaults(run=tools.run_impacts)


def _add_reveal(add: Callable[..., argparse.ArgumentParser]) -> None:
    reveal = add(
        "reveal",
        help="print the hidden effects of the drops of data=mystery",
        description="Open the truth beside mystery drops: law, parameters, noise and hidden effects.",
        epilog="example: contactlearn reveal outputs/mystery/seed_7",
    )
    reveal.add_argument("folder", metavar="DIR", help="the folder that data=mystery wrote")
    reveal.set_defaults(run=tools.run_reveal)


def _add_report(add: Callable[..., argparse.ArgumentParser]) -> None:
    report = add(
        "report",
        help="redraw the page of one run, or make one page over several runs or a whole sweep",
        description=_REPORT,
        epilog="examples: contactlearn report outputs/diagnose/2026-01-31_12-00-00; "
        "contactlearn report outputs/train/sweep; "
        "contactlearn report outputs/diagnose outputs/evaluate --out all.html",
    )
    report.add_argument(
        "folders",
        nargs="+",
        metavar="DIR",
        help="a run, a sweep, or any folder above some: every diagnosis.json and results.json in it is a run",
    )
    report.add_argument(
        "--out",
        metavar="FILE",
        help="the page over runs, an .html file, also of a single one (default: report.html in DIR if it is one folder "
        "and no run itself, else ./report.html); it never replaces the page of a run",
    )
    report.set_defaults(run=tools.run_report)


def _add_results(add: Callable[..., argparse.ArgumentParser]) -> None:
    results = add(
        "results",
        help="write all runs below some folders as one table",
        description="Write one tidy table of all finished runs, a row for each run and model: errors with intervals, "
        "the settings in which runs differ, data, versions and hashes.",
        epilog="example: contactlearn results outputs -o results.parquet",
    )
    results.add_argument("folders", nargs="+", metavar="DIR", help="a run, a sweep, or any folder above some")
    results.add_argument("-o", "--out", metavar="FILE", required=True, help="a .parquet or .csv file")
    results.set_defaults(run=tools.run_results)


def _add_workbench(add: Callable[..., argparse.ArgumentParser]) -> None:
    bench = add(
        "workbench",
        help="compare, see, learn, add and watch the error fall, live in a browser",
        description="Serve the workbench on this machine: tick an effect, and the model is fitted again.",
        epilog="example: contactlearn workbench data=mystery data.seed=7",
    )
    bench.add_argument(
        "overrides", nargs="*", metavar="key=value", help="data=…, data.KEY=…, law=…, effect=[…], effect.NAME.form=…"
    )
    bench.add_argument("--host", default="127.0.0.1", help="to bind to; the token is asked for everywhere")
    bench.add_argument("--port", type=int, help="to bind to (default: the first free one from 8765; 0: any free one)")
    bench.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    bench.set_defaults(run=_run_workbench)


def _run_workbench(options: argparse.Namespace) -> str:
    """Serve the workbench until it is stopped."""
    try:
        from contactlearn.workbench.server import serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("dash", "flask"):
            raise
        raise ContactLearnError(f"the workbench needs Dash: {installing('workbench')}") from None
    serve(options.overrides, host=options.host, port=options.port, browser=not options.no_browser)
    return "closed; every address works again after the next start, and the runs are in outputs"


if __name__ == "__main__":
    sys.exit(main())
