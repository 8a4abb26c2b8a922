"""From tracks to impacts on simulated recordings with known truth: found, false, errors, coverage, conventions, time.

    python benchmarks/accuracy/recordings.py [--size 300] [--seed 1000]
        [--what contacts rigs conventions files diagnosis]

Rigs have every fault at once (`rigs.py`): scale, frame rate, zero and sense of angles, dimensions, round corners, mass
centre, inertia, plates, lasting contacts and skipped frames; a fifth of their scenes are no drops.

A contact is clean if the flights before and after it have one frame more than the search requires, and if it lasts no
longer than the search allows.  An accepted one is false if one of its flights has three frames fewer, if no true
contact is within half a frame, or if it is not one contact with the floor.  Shares have Wilson's 95 % intervals.
"""

import argparse
import math
import sys
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import torch

from accuracy.rigs import Film, Rig, draw, film
from blind.report import wilson
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.flights import Air, FlightOptions, find_flights
from contactlearn.data.recordings.poses import turn
from contactlearn.data.recordings.result import RecordedContact
from contactlearn.data.tracks import Tracked, find_impacts, track_options
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.effects import find_effect
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Ellipse, contact_point
from contactlearn.simulation.camera import Camera, TrueContacts
from contactlearn.simulation.recordings import AXES, MASS, SEMI_AXES, simulate, write_recordings
from sensitivity.studies.flights import flat, nearest
from sensitivity.studies.frames import spatial
from speed.harness import header, row as printed

CHI_3 = 7.815
PLAIN = Camera()
GRID = {
    "250/s, 0.05 mm, 0.1°": PLAIN,
    "100/s": replace(PLAIN, rate=100.0, frames=200),
    "500/s": replace(PLAIN, rate=500.0, frames=1000),
    "1000/s": replace(PLAIN, rate=1000.0, frames=2000),
    "0.02 mm, 0.04°": replace(PLAIN, noise=2e-5, angle_noise=math.radians(0.04)),
    "0.2 mm, 0.4°": replace(PLAIN, noise=2e-4, angle_noise=math.radians(0.4)),
    "0.5 mm, 1°": replace(PLAIN, noise=5e-4, angle_noise=math.radians(1)),
    "blur of 2 ms": replace(PLAIN, exposure=0.002),
    "2 % lost, 1 % bad": replace(PLAIN, lost=0.02, bad=0.01),
    "half skip 1 or 2 frames": replace(PLAIN, skipped=0.5),
    "held by a hand": replace(PLAIN, held=0.2),
    "1000/s, contacts of 3 ms": replace(PLAIN, rate=1000.0, frames=2000, lasting=3e-3),
}

RIGS = [(rate, noise) for rate in (250.0, 500.0) for noise in (2e-5, 5e-5, 2e-4)]
"""Frames a second, and noise in m."""


@dataclass(kw_only=True)
class Tally:
    """What is found in recordings with known truth."""

    clean: int = 0
    found: int = 0
    accepted: int = 0
    false: int = 0
    errors: list[np.ndarray] = field(default_factory=list)
    inside: list[list[bool]] = field(default_factory=list)
    instants: list[float] = field(default_factory=list)
    missing: int = 0
    card: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, hit: RecordedContact, v: np.ndarray, late: float, skipped: int) -> None:
        """Count an accepted contact with its true velocities [2, 3], and the error of its instant in frames."""
        error, covariance = np.concatenate((hit.v_pre, hit.v_post)) - v.ravel(), hit.covariance
        self.errors.append(error / np.sqrt(covariance.diagonal()[:6]))
        parts = (slice(3), slice(3, 6))
        self.inside.append(
            [error[part] @ np.linalg.solve(covariance[part, part], error[part]) < CHI_3 for part in parts]
        )
        self.instants.append(late)
        self.missing += hit.missing == skipped

    def row(self) -> tuple[str, ...]:
        held, errors, instants = np.array(self.inside), np.array(self.errors), np.array(self.instants)
        return (
            share(self.found, self.clean), share(self.false, self.accepted),
            *(share(int(part.sum()), len(held)) for part in held.T),
            f"{np.abs(errors.mean(0)).max():.2f} ± {1 / math.sqrt(len(errors)):.2f}",
            f"{math.sqrt((instants**2).mean()):.3f}, at most {np.abs(instants).max():.2f}",
            share(int(self.missing), len(errors)),
        )  # fmt: skip


def share(good: int, of: int) -> str:
    """Share with its 95 % interval."""
    return "{:.1f} [{:.1f}, {:.1f}]".format(*(100 * x for x in (good / of, *wilson(good, of)))) if of else "–"


COLUMNS = (
    "found, %", "false, %", "v_pre in its region, %", "v_post, %", "largest bias, σ", "instant, frames",
    "missing right, %", "ms",
)  # fmt: skip


def contacts(size: int, seed: int) -> None:
    """A row of the table for every camera."""
    header("tracks", *COLUMNS)
    for number, (name, camera) in enumerate(GRID.items()):
        recordings, truth = simulate(size, camera, seed=seed + number)
        tally, spent = Tally(), 0.0
        for k, recording in enumerate(recordings):
            start = time.process_time()
            track = flat(recording)
            result = find_contacts(track)
            spent += time.process_time() - start
            width, found = find_flights(track).width, set[int]()
            for contact in result.contacts:
                tally.accepted += 1
                j = nearest(truth, k, contact.time)
                if j < 0 or abs(truth.time[j] - contact.time) > 0.5 / camera.rate or truth.frames[j].min() < width - 2:
                    tally.false += 1
                    continue
                found.add(j)
                v, late = np.stack((truth.v_pre[j], truth.v_post[j])), (contact.time - truth.time[j]) * camera.rate
                tally.add(contact, v, late, truth.skipped[j])
            clean = {int(j) for j in np.flatnonzero(truth.recording == k) if truth.frames[j].min() >= width + 1}
            tally.clean, tally.found = tally.clean + len(clean), tally.found + len(found & clean)
        printed(name, *tally.row(), f"{1e3 * spent / size:.0f}")


def rigs(size: int, seed: int, count: int = 30) -> None:
    """A row for every frame rate and noise, of squares and ellipses on `size` / `count` rigs with all faults.

    Then one for every property on their cards.
    """
    card: dict[str, list[float]] = defaultdict(list)
    header("rigs", *COLUMNS)
    for number, (rate, noise) in enumerate(RIGS):
        tally, spent = Tally(), 0.0
        for body in ("square", "ellipse"):
            drawn = [draw(body, rate, noise, seed + 1000 * number + k) for k in range(max(1, size // count // 2))]
            for rig, seen in zip(drawn, film(drawn, count, seed + number), strict=True):
                spent += judged(rig, seen, tally)
        printed(f"{rate:g}/s, {1e3 * noise:g} mm", *tally.row(), f"{1e3 * spent / size:.0f}")
        for name, scores in tally.card.items():
            card[name] += scores
    header("property", "in its interval, %", "median error, σ")
    for name, scores in [*card.items(), ("all", [*chain(*card.values())])]:
        off = np.abs(scores)
        printed(name, share(int((off < 1.96).sum()), len(off)), f"{np.median(off):.2f}")


def judged(rig: Rig, seen: Film, tally: Tally) -> float:
    """Count the contacts that are found on a rig; return the seconds of the search."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rig.parquet"
        seen.table.to_parquet(file)
        start = time.process_time()
        try:
            found = find_impacts(file, mass=1.0, shape=rig.shape)
            spent = time.process_time() - start
            survey, turn_of = found.survey, math.pi / 2 if rig.body == "square" else math.pi
            few = found.reload({"001", "002", "003"})
            width = max(find_flights(one.track, survey.model.air).width for one in few)
            for name, truth in rig.card().items():
                one, whole = getattr(found.impacts.apparatus, name), turn_of if name == "orientation" else math.inf
                if one is not None:
                    off = one.value + one.applied - truth
                    tally.card[name].append((off - whole * round(off / whole) if whole < math.inf else off) / one.error)
        except DataError as error:
            print(f"<!-- {error} -->")
            survey, width, spent = None, FlightOptions().narrowest(Air()), time.process_time() - start
    hit = set[int]()
    for contact in survey.contacts if survey else ():
        tally.accepted += 1
        mine = [j for j, one in enumerate(seen.contacts) if one.recording == int(contact.recording)]
        j = min(mine, key=lambda j: abs(seen.contacts[j].stated - contact.time), default=-1)
        true, late = seen.contacts[j], (contact.time - seen.contacts[j].stated) * rig.pace
        since = true.time.mean() + late - true.time
        if j < 0 or not true.single or abs(late) > np.ptp(true.time) / 2 + 0.5 / rig.rate:
            tally.false += 1
            continue
        hit.add(j)
        v = (true.v + true.a * since[:, None] / rig.pace) * (1, 1, survey.frame.sense)
        tally.add(contact, v, late * rig.rate, true.skipped)
    clean = {
        j for j, one in enumerate(seen.contacts)
        if one.single and np.ptp(one.time) <= FlightOptions().contact_time and min(one.frames) > width
    }  # fmt: skip
    tally.clean, tally.found = tally.clean + len(clean), tally.found + len(hit & clean)
    return spent


QUATERNION = {"columns": {"quaternion": ["q1", "q2", "q3", "q4"]}}
MIRRORED = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
CONVENTIONS = {
    "mm, y down, degrees": (replace(PLAIN, axes=AXES["image"], length=1e3, degrees=True), {}),
    "cm stated as m": (replace(PLAIN, length=100.0), {"unit": "m"}),
    "240/s for 250/s": (replace(PLAIN, stated_rate=240.0), {}),
    "240/s for 250/s, unit stated": (replace(PLAIN, stated_rate=240.0), {"unit": "m"}),
    "30/s for 250/s": (replace(PLAIN, stated_rate=30.0), {}),
    "y down stated as up": (replace(PLAIN, axes=AXES["image"]), {"up": "y"}),
    "space, y up, wxyz": (replace(PLAIN, axes=spatial(math.radians(20), AXES["y_up"])), QUATERNION),
    "space, z up, xyzw": (
        replace(PLAIN, axes=spatial(-math.radians(35), AXES["z_up"]), order="xyzw", length=1e3),
        QUATERNION,
    ),
    "xyzw stated as wxyz": (
        replace(PLAIN, axes=spatial(math.radians(20), AXES["y_up"]), order="xyzw"),
        QUATERNION | {"order": "wxyz"},
    ),
    "left-handed axes": (replace(PLAIN, axes=MIRRORED), QUATERNION),
    "degrees stated as radians": (replace(PLAIN, degrees=True), {"angle": "rad"}),
    "mirrored angles": (replace(PLAIN, axes=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))), {"sense": "mirrored"}),
}


def conventions(size: int, seed: int, sets: int = 10) -> None:
    """Outcomes of sets of recordings with wrong or unstated conventions: right, caught or requested, wrong."""
    header("recordings", "found and right", "caught or requested", "wrong")
    for number, (name, (camera, settings)) in enumerate(CONVENTIONS.items()):
        outcomes = Counter(outcome(size, camera, settings, seed + 100 * number + k) for k in range(sets))
        printed(name, *(outcomes[how] for how in ("right", "caught", "wrong")))


def outcome(size: int, camera: Camera, settings: dict, seed: int) -> str:
    """Whether velocities are right, or an error names the problem."""
    recordings, truth = simulate(size, camera, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        write_recordings(recordings, Path(folder))
        try:
            found = find_impacts(folder, mass=MASS, shape=Ellipse(SEMI_AXES), options=track_options(**settings))
        except ContactLearnError:
            return "caught"
    scores = []
    for contact in found.survey.contacts:
        j = nearest(truth, int(contact.recording) - 1, contact.time)
        scores.append(np.abs(contact.v_pre - truth.v_pre[j]) / np.sqrt(contact.covariance.diagonal()[:3]))
        off = abs(turn(2 * (contact.pose[2] - truth.q[j, 2])))  # of an ellipse, up to half a turn
        scores.append(off / 0.02 * np.ones(3))
    return "right" if np.median(scores) < 2 else "wrong"


PLANTED = {
    "spin_damping": {"c": 0.2},
    "tangential_restitution": {"beta": 0.2},
    "velocity_dependent_restitution": {"v_ref": 1.5, "p": -0.15},
    "directional_friction": {"a": 0.3},
    "contact_patch": {"k": 0.05},
    "inertia_error": {"kappa": 0.1},
}


def diagnosis(size: int, seed: int, sets: int = 2) -> None:
    """Names found from recordings, and from true states of the same impacts with noise of the stated covariances."""
    header("planted", "impacts", "from recordings", "from a table")
    for number, (name, values) in enumerate([("nothing", {}), *PLANTED.items()]):
        effects = {name: find_effect(name)(**values)} if values else {}
        for k in range(sets):
            recordings, truth = simulate(size, PLAIN, effects=effects, seed=seed + 100 * number + k)
            with tempfile.TemporaryDirectory() as folder:
                write_recordings(recordings, Path(folder))
                found = find_impacts(folder, mass=MASS, shape=Ellipse(SEMI_AXES))
            printed(name, len(found.impacts), named(found.impacts), named(tabled(found, truth, seed + k)))


def tabled(found: Tracked, truth: TrueContacts, seed: int) -> Impacts:
    """The true states of the impacts that were found, with noise of their covariances."""
    impacts = found.impacts
    rows = [nearest(truth, int(contact.recording) - 1, contact.time) for contact in found.survey.contacts]
    generator = torch.Generator().manual_seed(seed)
    noisy = {}
    for when in ("v_pre", "v_post"):
        factor = torch.linalg.cholesky(getattr(impacts, f"{when}_cov"))
        normal = torch.randn(len(impacts), 3, 1, generator=generator, dtype=torch.float64)
        noisy[when] = torch.from_numpy(getattr(truth, when)[rows]) + (factor @ normal)[..., 0]
    q = torch.from_numpy(truth.q[rows])
    return impacts.replace(q=q, r=contact_point(found.shape, q[:, 2]), apparatus=None, **noisy)


def named(impacts: Impacts) -> str:
    """The names that a diagnosis gives, with their confidence, or its verdict."""
    answer = diagnose(impacts)
    names = ", ".join(f"{one.effect} {one.confidence:.2f}" for one in answer.missing) or "no name"
    return f"{names}; {answer.verdict}"


def files(size: int, seed: int) -> None:
    """Time of the whole way from CSV files to impacts."""
    recordings, _ = simulate(size, PLAIN, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        write_recordings(recordings, Path(folder))
        start, cpu = time.perf_counter(), time.process_time()
        found = find_impacts(folder, mass=MASS, shape=Ellipse(SEMI_AXES))
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
        print(f"{size} files of {PLAIN.frames} frames: {len(found.impacts)} impacts in {wall:.1f} s, {cpu:.1f} s CPU")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=300, help="recordings of a row")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--what", nargs="+", default=["contacts", "rigs", "conventions", "files", "diagnosis"])
    options = parser.parse_args()
    if "contacts" in options.what:
        contacts(options.size, options.seed)
    if "rigs" in options.what:
        rigs(options.size, options.seed)
    if "conventions" in options.what:
        conventions(max(8, options.size // 25), options.seed)
    if "files" in options.what:
        files(options.size, options.seed)
    if "diagnosis" in options.what:
        diagnosis(max(8, options.size // 5), options.seed)


if __name__ == "__main__":
    main()
