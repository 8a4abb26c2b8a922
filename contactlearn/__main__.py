"""`python -m contactlearn export FILE data=…`: write any data source to a table file."""

import argparse
import sys

from contactlearn.errors import ContactLearnError


def main(arguments: list[str] | None = None) -> int:
    """Entry point of the `contactlearn` command; returns the exit status."""
    parser = argparse.ArgumentParser(prog="contactlearn", description="Tools beside contactlearn's train and evaluate.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    export = commands.add_parser(
        "export",
        help="write any data source to a CSV or Parquet table",
        description="Write any data source to a table that data=table reads back exactly.",
        epilog="example: contactlearn export drops.csv data=ellipse_drops data.inertia=uniform_disc",
    )
    export.add_argument("file", help="where to write: a .csv or .parquet file")
    export.add_argument(
        "overrides", nargs="*", metavar="key=value", help="data=synthetic|ellipse_drops|table, data.KEY=…"
    )
    options = parser.parse_args(arguments)
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from contactlearn.app import load_data
    from contactlearn.cli import compose
    from contactlearn.data import table

    try:
        impacts = load_data(compose("evaluate", options.overrides).data)
        path = table.save(impacts, options.file)
    except (ContactLearnError, HydraException, OmegaConfBaseException) as error:
        print(f"error: {str(error).splitlines()[0]}", file=sys.stderr)
        return 2
    print(f"{len(impacts)} impacts from {impacts.source} written to {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
