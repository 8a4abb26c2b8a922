"""Does the diagnosis find what is hidden?  On data whose physics is nature's own, not the catalogue's.

    python benchmarks/hidden_effects.py [--workers 2] [--scale 1.0]

`data=mystery` hides effects whose size is two to five times the noise in the outcome.  Each data set is diagnosed with
law=best and the whole catalogue, knowing nothing; only then is the truth looked at.

    single      one effect, named first (or found at all)
    pair        two effects, both found
    none        nothing hidden: anything named is a false alarm
    unknown     effects that no catalogue entry describes: said to be unknown, with the right component
    corrupted   columns, axes and units of clean drops spoilt: caught, and clean data not accused
    mujoco      tilt, offset centre of mass, wrong inertia, late sample, by another engine

    way         share of the way from the law alone to nature's own prediction that the named effects bring
    precision   share of the effects named that were hidden;  recall: share of those hidden that were named
"""

import argparse
import random
import time
from collections import defaultdict
from itertools import combinations
from statistics import mean, median

import torch
from threadpoolctl import threadpool_limits

from contactlearn.data import mujoco, mystery
from contactlearn.data.corrections import correct
from contactlearn.data.mystery.hidden import RIVALS
from contactlearn.diagnosis.diagnosis import diagnose
from contactlearn.impacts import Impacts, Prediction
from contactlearn.metrics import mass_error
from contactlearn.study import run

COMPONENTS = {"magnetic_pull": "tau", "elastic_strap": "t", "spin_lift": "n"}
MUJOCO = {
    "surface_tilt": {"tilt": 0.03},
    "com_offset": {"com_offset": (1e-3, -5e-4)},
    "inertia_error": {"inertia_error": 0.2},
    "gravity_impulse": {"delay": 0.008},
}
CORRUPTIONS = ("mirrored_x", "mirrored_theta", "contact_point_sign", "swapped_pre_post")
"""Corrections that undo themselves, and so spoil what is right."""


def tasks(scale: float) -> list[tuple]:
    """(group, names, seed, size, noise) of every data set."""
    rng, found = random.Random(0), []
    count = lambda n: max(1, round(n * scale))  # noqa: E731
    for name in mystery.EFFECTS:
        for k in range(count(4)):
            size, noise = ((150, 1.0), (500, 1.0), (500, 2.0), (1500, 1.0))[k % 4]
            found.append(("single", (name,), 100 + k, size, noise))
    pairs = [p for p in combinations(mystery.EFFECTS, 2) if not any(set(p) <= group for group in RIVALS)]
    for k, pair in enumerate(rng.sample(pairs, count(60))):
        found.append(("pair", pair, 200 + k, 500, 1.0))
    for k in range(count(60)):
        found.append(("none", (), 300 + k, (150, 500)[k % 2], (1.0, 2.0)[k // 2 % 2]))
    for name in mystery.UNKNOWN:
        for k in range(count(8)):
            found.append(("unknown", (name,), 400 + k, 500, 1.0))
    for group in RIVALS:
        for k in range(count(2)):
            found.append(("confounded", tuple(sorted(group)), 500 + k, 500, 1.0))
    for name in CORRUPTIONS:
        for k in range(count(6)):
            found.append(("corrupted", (name,), 700 + k, (150, 500)[k % 2], 1.0))
    for name in MUJOCO:
        for k in range(count(3)):
            found.append(("mujoco", (name,), 600 + k, 500, 1.0))
    return found


def one(group: str, names: tuple, seed: int, size: int, noise: float) -> dict:
    """Diagnose one data set, then look at the truth."""
    if group == "mujoco":
        impacts, truth = mujoco.load(size=size, seed=seed, **MUJOCO[names[0]]), None
    elif group == "corrupted":
        impacts, truth = mystery.draw(seed, effects=[], size=size)[0].replace(suspect=True), None
        impacts = correct(impacts, names)
    else:
        impacts, truth = mystery.draw(seed, effects=list(names), size=size, noise=noise)
    began = time.perf_counter()
    found = diagnose(impacts, "best")
    seconds = time.perf_counter() - began
    entry = {
        "group": group, "names": names, "size": size, "noise": noise, "found": found.effects, "seconds": seconds,
        "verdict": found.verdict, "law": found.law,
        "repairs": [finding.correction for finding in found.findings],
        "components": list(found.remainder.components) if found.remainder else [],
        "equivalents": {k: [e["name"] for e in v] for k, v in found.to_dict()["equivalents"].items()},
    }  # fmt: skip
    if truth is not None and found.ladder:
        best = _error(impacts, truth["v_post_from_measured"])
        base, named = found.budget["base"]["mean"], found.budget["named"]["mean"]
        entry["way"] = (base - named) / (base - best) if base > 1.05 * best else None
        entry["hidden_share"] = 1 - best / base
    return entry


def _error(impacts: Impacts, v_post: list) -> float:
    return mass_error(impacts, Prediction(torch.tensor(v_post, dtype=torch.float64), impacts.wrench)).mean().item()


def named(entry: dict, name: str) -> bool:
    """Whether an effect was named, or one that the diagnosis says is equivalent to it here."""
    return name in entry["found"] or any(
        name in others for effect, others in entry["equivalents"].items() if effect in entry["found"]
    )


def report(entries: list[dict]) -> None:
    groups = defaultdict(list)
    for entry in entries:
        key = (
            entry["group"]
            if entry["group"] != "single"
            else f"single, {entry['size']} trials, noise × {entry['noise']:g}"
        )
        groups[key].append(entry)
    print("| group | sets | as asked | precision | recall | way, median | seconds, median (max) |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for key, group in groups.items():
        asked = [_as_asked(entry) for entry in group]
        hits = sum(name in entry["names"] for entry in group for name in entry["found"])
        claims = sum(len(entry["found"]) for entry in group)
        hidden = sum(len(entry["names"]) for entry in group if key != "corrupted")
        recall = sum(named(entry, name) for entry in group for name in entry["names"])
        ways = [entry["way"] for entry in group if entry.get("way") is not None]
        times = [entry["seconds"] for entry in group]
        print(
            f"| {key} | {len(group)} | {mean(asked):.0%} | {hits / claims if claims else 1:.0%} | "
            f"{recall / hidden if hidden else 1:.0%} | {f'{median(ways):.0%}' if ways else ''} | "
            f"{median(times):.1f} ({max(times):.1f}) |"
        )


def _as_asked(entry: dict) -> bool:
    """Named first, or both named, or nothing named, or said to be unknown."""
    found, names = entry["found"], entry["names"]
    if entry["group"] == "none":
        return not found and not entry["repairs"]
    if entry["group"] == "corrupted":
        return entry["repairs"] == list(names) and not found
    if entry["group"] == "unknown":
        return entry["verdict"] == "unknown" and COMPONENTS[names[0]] in entry["components"]
    if entry["group"] in ("single", "mujoco"):
        return bool(found) and (found[0] == names[0] or names[0] in entry["equivalents"].get(found[0], []))
    return all(named(entry, name) for name in names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scale", type=float, default=1.0, help="of the number of data sets")
    parser.add_argument("--only", help="one group")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    chosen = [task for task in tasks(options.scale) if options.only in (None, task[0])]
    entries = []
    for entry in run(one, chosen, options.workers):
        entries.append(entry)
        if not _as_asked(entry):
            print(f"  missed: {entry['group']} {entry['names']} n = {entry['size']}: {entry['found']}", flush=True)
    report(entries)


if __name__ == "__main__":
    main()
