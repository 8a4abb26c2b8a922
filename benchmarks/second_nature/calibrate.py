"""Fit the confidence in a named effect to the half "learn", and show how often it is right on the half "report".

    python benchmarks/second_nature/calibrate.py learn.jsonl [poorer.jsonl …] [--report report.jsonl]

The files are those that `run.py --keep` made, also with a poorer catalogue.  Printed are the coefficients for
`contactlearn.diagnosis.search.calibration` and a table of stated against observed.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from scipy.optimize import minimize

from contactlearn.diagnosis.search.calibration import COEFFICIENTS, regressors
from second_nature import tables
from second_nature.judge import Said, score
from second_nature.run import read

PRIOR = np.array([1.0, 1.0, 1.0, 4.0])
"""Standard deviations of the coefficients, about the share itself: odds of the share and nothing else."""
MEAN = np.array([0.0, 0.5, 0.0, -4.0])


def names(said: list[Said]) -> tuple[np.ndarray, np.ndarray]:
    """Regressors of every named effect, and whether it is right."""
    rows = [(regressors(one.shares[k], one.gains[k], one.left), right) for one in said for k, right in score(one).named]
    return np.array([x for x, _ in rows]), np.array([y for _, y in rows], dtype=float)


def fitted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The coefficients that are most probable, with a Gaussian prior."""

    def loss(b: np.ndarray) -> float:
        z = x @ b
        return float(np.sum(np.logaddexp(0, z) - y * z) + 0.5 * np.sum(((b - MEAN) / PRIOR) ** 2))

    return minimize(loss, MEAN).x


def main() -> None:
    """Fit and show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("learn", type=Path, nargs="+")
    parser.add_argument("--report", type=Path)
    arguments = parser.parse_args()
    x, y = names([one for path in arguments.learn for one in read(path).values()])
    b = fitted(x, y)
    found = tuple(round(float(one), 2) for one in b)
    print(f"{len(y)} names, {int(y.sum())} right; coefficients {found}, in use {COEFFICIENTS}")
    for path in filter(None, (*arguments.learn, arguments.report)):
        x, y = names(list(read(path).values()))
        stated = 1 / (1 + np.exp(-x @ np.array(COEFFICIENTS)))
        print(
            f"\n{path.name}\n" + tables.reliability_of(list(zip(stated.tolist(), y.astype(bool).tolist(), strict=True)))
        )


if __name__ == "__main__":
    main()
