"""Fit the stated probability of a named effect to the half "learn", and show how often it is right on others.

    python benchmarks/blind/calibrate.py learn.jsonl [poorer.jsonl …] [--report report.jsonl]

The files are answers of `run.py` on the independent suite, also with a poorer catalogue.  Printed are the coefficients
for `contactlearn.diagnosis.search.ladder`, and tables of stated against observed.
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

PRIOR = np.array([1.0, 1.0, 1.0, 4.0])
"""Standard deviations of the coefficients about MEAN."""
MEAN = np.array([0.0, 0.5, 0.0, -4.0])


def design(answers: Iterable[Answer]) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors [n, 4] of every judged name, and whether it is right [n]."""
    rows = [
        (regressors(one.answer.shares[k], one.answer.gains[k], one.answer.left), right)
        for one in judged(answers)
        for k, right in one.score.named
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
