"""`python -m contactlearn COMMAND`, or `contactlearn COMMAND`; --help lists the commands.

train, evaluate and diagnose are those of train.py, evaluate.py and diagnose.py in a checkout: Hydra parses their
settings.  The arguments of all others are argparse's, see `contactlearn.cli.tools`.
"""

import argparse
import re
import sys
from textwrap import fill
from typing import Any

from contactlearn.cli.tools import add_tools
from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError, UnknownLayoutError, install_hint, suggest, terminal_safe
from contactlearn.core.signals import graceful_exit, write_output

_CONFIGURED = {
    "train": "train one contact model",
    "evaluate": "compare laws and learned models with the bounds",
    "diagnose": "find out which physical effect is missing",
}
"""Commands whose arguments Hydra parses."""
_GROUPS = {
    "Which physics is missing": ("diagnose", "workbench"),
    "Bring and check data": ("init", "audit", "impacts"),
    "Compare laws and learned models": ("evaluate", "train"),
    "Plan the next impacts": ("plan", "measure"),
    "Use and compare results": ("export", "replay", "report", "results", "reveal"),
}
"""Commands as --help lists them."""


def main(arguments: list[str] | None = None) -> int:
    """Run the `contactlearn` command; return the exit status."""
    words = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if words and words[0] in _CONFIGURED:
        from contactlearn.cli import hydra_main

        sys.argv = [f"contactlearn {words[0]}", *words[1:]]  # from which Hydra reads its overrides
        getattr(hydra_main, words[0])()
        return 0
    with graceful_exit():
        options = _parsed(words)
        from hydra.errors import HydraException
        from omegaconf.errors import OmegaConfBaseException

        from contactlearn.cli.reasons import reason

        try:
            said = options.run(options)
            text, status = said if isinstance(said, tuple) else (said, 0)
            write_output(terminal_safe(text) + "\n")
            return status
        except BrokenPipeError:  # of a reader that has gone
            raise
        except (ContactLearnError, HydraException, OmegaConfBaseException, OSError) as error:
            lines = reason(error).splitlines()
            shown = lines if isinstance(error, UnknownLayoutError) else lines[:1]
            print(f"error: {terminal_safe(chr(10).join(shown))}", file=sys.stderr)
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


class _Help(argparse.HelpFormatter):
    """Wraps what argparse wraps, but leaves each example on a line of its own, to be copied."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        head, colon, examples = text.partition(": contactlearn ")
        if not colon:
            return super()._fill_text(text, width, indent)
        return "\n".join((f"{head}:", *(f"  contactlearn {one}" for one in examples.split("; contactlearn "))))


class _Parser(argparse.ArgumentParser):
    def _print_message(self, message: str, file: Any = None) -> None:  # argparse's own passes over a full disk
        if file is sys.stdout:
            write_output(message)
        else:
            super()._print_message(message, file)


def _parser() -> tuple[_Parser, dict[str, _Parser]]:
    """The parser of all commands, and that of each by name."""
    parser = _Parser(
        prog="contactlearn",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="COMMAND --help explains each; diagnose, evaluate and train also have --settings.",
    )
    parser.add_argument("--version", action="version", version=f"contactlearn {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", help=argparse.SUPPRESS)
    summaries = dict[str, str]()

    def add(command: str, *, help: str, description: str | None = None, epilog: str | None = None) -> _Parser:
        summaries[command] = help  # argparse's own list has no groups
        return commands.add_parser(command, description=description, epilog=epilog, formatter_class=_Help)

    for command, summary in _CONFIGURED.items():
        add(command, help=summary)
    add_tools(add)
    bench = add(
        "workbench",
        help="do all of this in a browser",
        description="Serve the workbench on this machine: tick an effect, and the model is fitted again.",
        epilog="example: contactlearn workbench data=mystery data.seed=7",
    )
    bench.add_argument(
        "overrides", nargs="*", metavar="key=value", help="data=…, data.KEY=…, law=…, effect=[…], effect.NAME.form=…"
    )
    bench.add_argument("--host", default="127.0.0.1", help="to bind to; the token is required everywhere")
    bench.add_argument("--port", type=int, help="to bind to (default: the first free one from 8765; 0: any free one)")
    bench.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    bench.set_defaults(run=_run_workbench)
    lines = ["Learn rigid-body contact from measurements.  First try: contactlearn diagnose data=mystery data.seed=7"]
    for group, names in _GROUPS.items():
        lines += ["", f"{group}:"]
        lines += [fill(summaries[one], 79, initial_indent=f"    {one:11}", subsequent_indent=15 * " ") for one in names]
    parser.usage, parser.description = "contactlearn [-h] [--version] COMMAND ...", "\n".join(lines)
    return parser, commands.choices


def _run_workbench(options: argparse.Namespace) -> str:
    """Serve the workbench until it is stopped."""
    try:
        from contactlearn.workbench.server import serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("dash", "flask"):
            raise
        raise ContactLearnError(f"the workbench needs Dash: {install_hint('workbench')}") from None
    serve(options.overrides, host=options.host, port=options.port, browser=not options.no_browser)
    return "closed; every address works again after the next start, and the runs are in outputs"


if __name__ == "__main__":
    sys.exit(main())
