"""Fit the stated probability of a named effect to some answers, and show how often it is right on others.

    python benchmarks/blind/calibrate.py learn.jsonl [author_a.jsonl …] [--report report.jsonl]

The files are answers of `run.py --every-name`, which makes a name of every candidate.  Printed are the coefficients for
`contactlearn.diagnosis.search.ladder`, and tables of stated against observed.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from scipy.optimize import minimize

from blind.judge import Answer
from blind.report import judged, reliability_of
from blind.run import read
from contactlearn.diagnosis.search.ladder import COEFFICIENTS, regressors

MEAN = np.array([-0.32, 0.37, 2.15, -9.75, 0.0, 0.0])
"""Coefficients of an earlier fit to some 500 names, of the whole catalogue and of a poorer one."""
PRIOR = np.array([1.0, 0.2, 0.4, 2.0, 1.5, 0.7])
"""Standard deviations of the coefficients about MEAN."""


def design(answers: Iterable[Answer]) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors [n, 6] of every judged name, and whether it is right [n]."""
    rows = [
        (regressors(known.shares[k], known.gains[k], known.left, known.physics == "unknown", len(known.shares) - 1), y)
        for one in judged(answers)
        for known in [one.answer]
        for k, y in one.score.named
    ]
    return np.array([x for x, _ in rows]), np.array([y for _, y in rows], dtype=float)


def fit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Fit the most probable coefficients [4] of a logistic regression with a Gaussian prior."""

    def loss(b: np.ndarray) -> float:
        z = x @ b
        return float(np.sum(np.logaddexp(0, z) - y * z) + 0.5 * np.sum(((b - MEAN) / PRIOR) ** 2))

    return minimize(loss, MEAN).x


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("learn", type=Path, nargs="+")
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    x, y = map(np.concatenate, zip(*(design(read(path).values()) for path in options.learn), strict=True))
    fitted = tuple(round(float(b), 2) for b in fit(x, y))
    print(f"{len(y)} names, {int(y.sum())} right; coefficients {fitted}, in use {COEFFICIENTS}")
    for path in filter(None, (*options.learn, options.report)):
        x, y = design(read(path).values())
        stated = 1 / (1 + np.exp(-x @ np.array(COEFFICIENTS)))
        pairs = list(zip(stated.tolist(), y.astype(bool).tolist(), strict=True))
        print(f"\n{path.name}\n{reliability_of({'names': pairs})}")


if __name__ == "__main__":
    main()
