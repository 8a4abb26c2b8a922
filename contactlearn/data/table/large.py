"""Tables of any length: a small one is read into memory, a large one again and again, in blocks of rows."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from contactlearn.core.errors import DataError
from contactlearn.data import table
from contactlearn.data.blocks import BLOCK, LARGE, Blocks
from contactlearn.data.table import Table
from contactlearn.mechanics.bodies import AnyShape
from contactlearn.mechanics.impacts import Impacts


def table_blocks(path: Path, shape: AnyShape | None) -> Blocks:
    """Return the impacts of a table file as `table.save` writes it.

    Raises:
        DataError: see `table.read`.
    """
    if not is_large(path):
        return Blocks.of(table.load(path, shape))
    return Blocks.survey(lambda: blocks_of(table.read_blocks(path, BLOCK, shape=shape), lambda one: one.impacts))


def blocks_of(tables: Iterator[Table], impacts_of: Callable[[Table], Impacts]) -> Iterator[Impacts]:
    """Yield the impacts of a table that is read in blocks; errors name the row of the whole table.

    Args:
        tables: the blocks, for which rows are right already.
        impacts_of: corrects the impacts of a block.

    Raises:
        DataError: impacts that break a rule once corrected.
    """
    trials = 0
    for one in tables:
        try:
            impacts = impacts_of(one)
        except DataError as error:
            raise error.below(trials) from None
        trials += len(impacts)
        yield impacts


def is_large(path: Path) -> bool:
    """Whether a table file has more than `LARGE` rows; what cannot be read is not large."""
    try:
        if path.suffix.lower() == ".parquet":
            from pyarrow import parquet

            with parquet.ParquetFile(path) as file:
                return file.metadata.num_rows > LARGE
        with path.open("rb") as file:
            return sum(1 for _ in islice(file, LARGE + 2)) > LARGE + 1
    except (OSError, ValueError):  # pyarrow's errors are these
        return False
