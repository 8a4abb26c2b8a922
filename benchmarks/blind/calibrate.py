"""Fit the stated probability of a named effect to some answers, and show how often it is right on others.

    python benchmarks/blind/calibrate.py learn.jsonl [author_a.jsonl …] [--report report.jsonl]

The files are answers of `run.py --every-name`, which makes a name of every candidate.  Printed are the coefficients for
`contactlearn.diagnosis.search.ladder`, and tables of stated against observed.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from scipy.optimize import minimize

from blind.judge import Answer
from blind.report import judged, reliability_of
from blind.run import read
from contactlearn.diagnosis.search.ladder import COEFFICIENTS, SUREST, regressors

PRIOR = np.array([3.0, 2.0, 2.0])
"""Standard deviations of the coefficients about 0."""


def design(answers: Iterable[Answer]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the regressors [n, 3] of every judged name, its share [n] and whether it is right [n]."""
    rows, shares, right = [], [], []
    for one in judged(answers):
        known = one.answer
        for k, y in one.score.named:
            rows.append(regressors(known.removed[k], known.reducible, known.trials, known.unexplained))
            shares.append(known.shares[k])
            right.append(float(y))
    return np.array(rows), np.array(shares), np.array(right)


def probabilities(x: np.ndarray, share: np.ndarray, coefficients: Sequence[float] | np.ndarray) -> np.ndarray:
    """Compute the probabilities [n] of names as `ladder.name_probability` does."""
    return share * SUREST / (1 + np.exp(-x @ np.asarray(coefficients)))


def fit(x: np.ndarray, share: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Fit the most probable coefficients [3] of a logistic regression with a Gaussian prior."""

    def loss(b: np.ndarray) -> float:
        p = probabilities(x, share, b).clip(1e-9, 1 - 1e-9)
        return -float(np.sum(np.log(np.where(y == 1, p, 1 - p)))) + 0.5 * float(np.sum((b / PRIOR) ** 2))

    return minimize(loss, np.zeros(len(PRIOR))).x


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("learn", type=Path, nargs="+")
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    x, share, y = map(np.concatenate, zip(*(design(read(path).values()) for path in options.learn), strict=True))
    fitted = tuple(round(float(b), 2) for b in fit(x, share, y))
    print(f"{len(y)} names, {int(y.sum())} right; coefficients {fitted}, in use {COEFFICIENTS}")
    for path in filter(None, (*options.learn, options.report)):
        x, share, y = design(read(path).values())
        stated = probabilities(x, share, COEFFICIENTS)
        pairs = list(zip(stated.tolist(), y.astype(bool).tolist(), strict=True))
        print(f"\n{path.name}\n{reliability_of({'names': pairs})}")


if __name__ == "__main__":
    main()
