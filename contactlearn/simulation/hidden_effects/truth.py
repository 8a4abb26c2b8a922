"""Drops with hidden effects in a folder: `drops.csv` for the analysis, and `truth.json`, which nothing in it opens."""

import json
import os
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import atomic_write
from contactlearn.core.serialisation import parsed
from contactlearn.data import table
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation.hidden_effects.drops import draw

DROPS, TRUTH = "drops.csv", "truth.json"
_SEALED = "sealed.bin"  # the account that versions before truth.json wrote


def load(seed: int, size: int = 500, folder: str | None = None, scatter: float = 0.0) -> Impacts:
    """Drops with one to three hidden effects, all drawn from the seed; see `drops.draw`.

    The folder gets drops.csv, for `data=table`, and truth.json, for `reveal`.

    Args:
        seed: an integer in [0, 2⁶³).
        size: number of drops.
        folder: where to write; None is outputs/mystery/seed_SEED.
        scatter: standard deviation of μ and ε from drop to drop, as a share of each.

    Raises:
        DataError: a value out of its range, or a folder that cannot be written.
    """
    impacts, truth = draw(seed, size=size, scatter=scatter)
    place = Path("outputs") / "mystery" / f"seed_{seed}" if folder is None else Path(folder)
    table.save(impacts, place / DROPS)
    try:
        with atomic_write(place / TRUTH) as part:
            part.write_text(json.dumps(truth, allow_nan=False, ensure_ascii=False), encoding="utf-8", newline="\n")
    except OSError as error:
        raise DataError(f"{place / TRUTH}: cannot be written: {error}") from error
    return impacts


def reveal(folder: str | os.PathLike[str]) -> str:
    """Return in words what is hidden in a folder that `load` wrote: law, parameters, noise and effects.

    Raises:
        DataError: no such folder, no truth in it, or a truth that is damaged.
    """
    folder = Path(folder)
    path = folder / TRUTH
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; give one that data=mystery wrote, such as outputs/mystery/seed_7")
    if not path.is_file():
        rule = "only a folder that data=mystery wrote can be revealed"
        if (folder / _SEALED).is_file():
            rule = f"its {_SEALED} is of an older version; make the drops again with data=mystery and the same seed"
        raise DataError(f"{folder}: holds no {TRUTH}; {rule}")
    try:
        return _described(parsed(path.read_bytes()))
    except (OSError, ContactLearnError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{path}: is damaged ({error!r}); make it again with data=mystery and the same seed") from None


def _described(truth: Mapping[str, Any]) -> str:
    """The truth of `drops.draw` in words."""
    noise, effects = truth["noise"], truth["effects"]
    lines = [
        f"Mystery drops, seed {truth['seed']}, {truth['size']} drops",
        f"law    {truth['law']} with μ = {truth['mu']:.4f}, ε = {truth['eps']:.4f}",
        f"noise  σ = {noise['v']:.4f} m/s on v_x and v_y, {noise['omega']:.3f} rad/s on ω, before and after contact",
        f"hidden {', '.join(effect['name'] for effect in effects) or 'nothing'}",
    ]
    if scatter := truth.get("scatter", 0.0):
        lines.append(f"scatter of μ and ε from drop to drop: {scatter:.0%} of each")
    for effect in effects:
        values = effect["parameters"].items()
        parameters = ", ".join(f"{symbol} = {value:.4g} {effect['units'][symbol]}".rstrip() for symbol, value in values)
        lines += [
            "",
            effect["name"],
            textwrap.fill(effect["form"], 80, initial_indent="  ", subsequent_indent="  "),
            f"  {parameters}",
            f"  changes the outcome by {100 * effect['relative_change']:.2f} % (rms, mass norm)",
        ]
    return "\n".join(lines)
