"""Shared parts of the speed benchmarks: options, threads, interleaved rounds, medians, published drops, Markdown rows.

All methods run once a round, one after the other, because the pace of a machine drifts; medians are over the rounds.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

import torch
from threadpoolctl import threadpool_limits

from contactlearn.core.errors import DataError
from contactlearn.data import ellipse_drops
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation import synthetic

Key = TypeVar("Key")


def parser(doc: str, rounds: int) -> argparse.ArgumentParser:
    """Make a parser with --rounds and --quick."""
    found = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    found.add_argument("--rounds", type=int, default=rounds, help="interleaved rounds, each of all methods")
    found.add_argument("--quick", action="store_true", help="a small size and one round: does it run?")
    return found


def parsed(options: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse the command line: one round under --quick, and PyTorch and BLAS get one thread, or --threads."""
    found = options.parse_args()
    found.rounds = 1 if found.quick else found.rounds
    threads = getattr(found, "threads", 1)
    torch.set_num_threads(threads)
    threadpool_limits(threads)
    return found


def timed(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Return the result of a call and its seconds."""
    start = time.perf_counter()
    result = function(*arguments)
    return result, time.perf_counter() - start


def seconds(function: Callable[..., Any], *arguments: Any) -> float:
    """Return the seconds of a call."""
    return timed(function, *arguments)[1]


def interleaved(clocks: Mapping[Key, Callable[[], float]], rounds: int) -> dict[Key, list[float]]:
    """Run every clock once a round; return the seconds of each in all rounds."""
    times: dict[Key, list[float]] = {name: [] for name in clocks}
    for _ in range(rounds):
        for name, clock in clocks.items():
            times[name].append(clock())
    return times


def medians(times: Mapping[Key, list[float]]) -> dict[Key, float]:
    """Return the median of each method's seconds."""
    return {name: statistics.median(values) for name, values in times.items()}


def compared(methods: Mapping[Key, Callable[[], Any]], rounds: int) -> tuple[dict[Key, Any], dict[Key, float]]:
    """Run every method once a round; return their last results and their median seconds."""
    results: dict[Key, Any] = {}

    def clock(name: Key) -> float:
        results[name], taken = timed(methods[name])
        return taken

    return results, medians(interleaved({name: partial(clock, name) for name in methods}, rounds))


def repeated(function: Callable[[], Any], count: int) -> Callable[[], float]:
    """Return a clock: the median seconds of so many calls."""
    return lambda: statistics.median(seconds(function) for _ in range(count))


def row(*cells: object) -> None:
    """Print a row of a Markdown table."""
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def header(*titles: object) -> None:
    """Print the head of a Markdown table."""
    print()
    row(*titles)
    row(*["---"] * len(titles))


def drops(kind: str = "published") -> Impacts:
    """Load the published drops, the same with x mirrored (docs/log.md has the reason), or as many synthetic ones.

    Args:
        kind: "published", "mirrored" or "synthetic".  Synthetic drops replace published ones that cannot be loaded.
    """
    if kind != "synthetic":
        try:
            impacts = ellipse_drops.load()
        except DataError as error:
            print(f"synthetic drops, because {error}")
        else:
            mirror = torch.tensor((-1.0 if kind == "mirrored" else 1.0, 1.0, 1.0), dtype=torch.float64)
            return impacts.replace(q=impacts.q * mirror, v_pre=impacts.v_pre * mirror, v_post=impacts.v_post * mirror)
    return synthetic.load(size=1718)
