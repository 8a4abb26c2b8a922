"""Does the diagnosis find hidden effects?  The physics of the data is an independent simulator's, or MuJoCo's.

    python benchmarks/accuracy/hidden_effects.py [--workers 2] [--scale 1.0] [--only single] [--keep entries.jsonl]

`data=mystery` hides effects whose size is two to five times the noise in the outcome.  Each data set is diagnosed with
law=best and the whole catalogue; the ground truth is read afterwards.

    single      one effect, named first (or found at all)
    pair        two effects, both found
    none        nothing hidden: any name is a false alarm
    unknown     effects that no catalogue entry describes: called unknown, with the right component
    confounded  two effects with nearly the same trace, both found or reported as rivals
    corrupted   wrong columns, axes and units of clean drops: corrected, without any effect
    mujoco      tilt, offset centre of mass, wrong inertia, late sample, by another engine

    gain        share of the error reduction from the law alone to the true prediction that the named effects reach
    precision   share of the named effects that were hidden;  recall: share of the hidden effects that were named
    coverage    of the 95 % intervals of parameters that simulator and catalogue share

Finished sets are lines of the file --keep, and an interrupted run resumes from there.
"""

import argparse
import json
import random
import sys
import time
from collections import defaultdict
from itertools import combinations
from pathlib import Path
from statistics import mean, median

import torch
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from contactlearn.core.numerics import Z_95
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.learning.curves import run
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.simulation import hidden_effects, mujoco
from contactlearn.simulation.hidden_effects.effects import CONFOUNDED
from sensitivity.studies.cases import spoilt

COMPONENTS = {"magnetic_pull": "tau", "elastic_strap": "t", "spin_lift": "n"}
MUJOCO = {
    "surface_tilt": ({"tilt": 0.03}, {"phi": 0.03}),
    "com_offset": ({"com_offset": (1e-3, -5e-4)}, {"delta_a": 1e-3, "delta_b": -5e-4}),
    "inertia_error": ({"inertia_error": 0.2}, {"kappa": 0.2}),
    "gravity_impulse": ({"delay": 0.008}, {"dt": 0.008}),
}
CORRUPTIONS = ("mirrored_x", "mirrored_theta", "contact_point_sign", "swapped_pre_post", "degrees", "millimetres")


def tasks(scale: float) -> list[tuple]:
    """(group, names, seed, size, noise) of every data set."""
    rng, found = random.Random(0), []
    kinds = ((150, 1.0), (500, 1.0), (500, 2.0), (1500, 1.0))

    def add(group: str, names: tuple, seed: int, count: int, among: tuple = kinds) -> None:
        for k in range(max(1, round(count * scale))):
            found.append((group, names, seed + k, *among[k % len(among)]))

    for name in hidden_effects.EFFECTS:
        add("single", (name,), 100, 4)
    pairs = [
        pair for pair in combinations(hidden_effects.EFFECTS, 2) if not any(set(pair) <= group for group in CONFOUNDED)
    ]
    for k, pair in enumerate(rng.sample(pairs, max(1, round(60 * scale)))):
        found.append(("pair", pair, 200 + k, 500, (1.0, 2.0)[k % 2]))
    add("none", (), 300, 60)
    for name in hidden_effects.UNKNOWN:
        add("unknown", (name,), 400, 10, kinds[1:])
    for group in CONFOUNDED:
        add("confounded", tuple(sorted(group)), 500, 2, kinds[1:3])
    for name in CORRUPTIONS:
        add("corrupted", (name,), 700, 6)
    for name in MUJOCO:
        add("mujoco", (name,), 600, 4, ((150, 1.0), (500, 1.0)))
    return found


def one(group: str, names: tuple, seed: int, size: int, noise: float) -> dict:
    """Diagnose one data set, then look at the truth."""
    truth, expected = None, {}
    if group == "mujoco":
        options, expected = MUJOCO[names[0]]
        impacts, expected = mujoco.load(size=size, seed=seed, **options), {names[0]: expected}
    elif group == "corrupted":
        impacts, _ = hidden_effects.draw(seed, effects=[], size=size, noise=noise)
        impacts = spoilt(impacts, *names)
    else:
        impacts, truth = hidden_effects.draw(seed, effects=list(names), size=size, noise=noise)
        expected = {
            effect["name"]: hidden_effects.comparable_parameters(effect["name"], effect["parameters"])
            for effect in truth["effects"]
        }
    began = time.perf_counter()
    found = diagnose(impacts)
    seconds = time.perf_counter() - began
    entry = {
        "group": group, "names": names, "size": size, "noise": noise, "seed": seed, "found": list(found.effects),
        "seconds": seconds, "verdict": found.verdict, "law": found.law,
        "repairs": list(found.corrections),
        "components": [str(name) for name in found.remainder.components] if found.remainder else [],
        "rivals": {one.effect.name: [rival.effect.name for rival in one.rivals] for one in found.missing},
        "sigmas": _sigmas(found, expected),
    }  # fmt: skip
    if truth is not None and found.budget is not None:
        best = _error(impacts, truth["v_post_from_measured"])
        base, named = found.budget.base.mean, found.budget.named.mean
        entry["gain"] = (base - named) / (base - best) if base > 1.05 * best else None
        entry["hidden_share"] = 1 - best / base
        entry["floor"] = found.budget.noise.mean / best
    return entry


def _sigmas(found: Diagnosis, expected: dict[str, dict[str, float]]) -> list[float]:
    """How many standard errors the parameters of effects that were rightly named are off."""
    return [
        (one.value - expected[str(missing.effect)][one.name]) / one.standard_error
        for missing in found.missing
        for one in missing.parameters
        if one.name in expected.get(str(missing.effect), {})
    ]


def _error(impacts: Impacts, v_post: list) -> float:
    return mass_error(impacts, Prediction(torch.tensor(v_post, dtype=torch.float64), impacts.wrench)).mean().item()


def named(entry: dict, name: str) -> bool:
    """Whether an effect was named, or one that the diagnosis reports as its rival here."""
    return name in entry["found"] or any(
        name in others for effect, others in entry["rivals"].items() if effect in entry["found"]
    )


def report(entries: list[dict]) -> None:
    groups = defaultdict(list)
    for entry in entries:
        key = entry["group"]
        if key in ("single", "none", "pair"):
            key += f", {entry['size']} trials, noise × {entry['noise']:g}"
        groups[key].append(entry)
    print("| group | sets | right | precision | recall | gain, median | coverage | seconds, median (max) |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for key, group in groups.items():
        right = [_is_right(entry) for entry in group]
        hits = sum(name in entry["names"] for entry in group for name in entry["found"])
        claims = sum(len(entry["found"]) for entry in group)
        hidden = sum(len(entry["names"]) for entry in group if entry["group"] != "corrupted")
        recall = sum(named(entry, name) for entry in group for name in entry["names"])
        gains = [entry["gain"] for entry in group if entry.get("gain") is not None]
        times = [entry["seconds"] for entry in group]
        inside = [abs(sigma) < Z_95 for entry in group for sigma in entry["sigmas"]]
        print(
            f"| {key} | {len(group)} | {mean(right):.0%} | {hits / claims if claims else 1:.0%} | "
            f"{recall / hidden if hidden else 1:.0%} | {f'{median(gains):.0%}' if gains else ''} | "
            f"{f'{mean(inside):.0%} of {len(inside)}' if inside else ''} | {median(times):.1f} ({max(times):.1f}) |"
        )


def _is_right(entry: dict) -> bool:
    """Whether the answer is right: named first, both named, nothing named, corrected, or unknown."""
    found, names = entry["found"], entry["names"]
    if entry["group"] == "none":
        return not found and not entry["repairs"]
    if entry["group"] == "corrupted":
        return names[0] in entry["repairs"] and not found
    if entry["group"] == "unknown":
        return entry["verdict"] == "unknown" and COMPONENTS[names[0]] in entry["components"]
    if entry["group"] in ("single", "mujoco"):
        return bool(found) and (found[0] == names[0] or names[0] in entry["rivals"].get(found[0], []))
    return all(named(entry, name) for name in names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scale", type=float, default=1.0, help="of the number of data sets")
    parser.add_argument("--only", help="one group")
    parser.add_argument("--keep", type=Path, help="file of finished sets, one JSON line each")
    options = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1)
    done = [json.loads(line) for line in options.keep.open()] if options.keep and options.keep.exists() else []
    known = {(e["group"], tuple(e["names"]), e["seed"], e["size"], e["noise"]) for e in done}
    chosen = [task for task in tasks(options.scale) if options.only in (None, task[0])]
    entries = [e for e in done if options.only in (None, e["group"])]
    for entry in run(one, [task for task in chosen if task not in known], options.workers):
        entries.append(entry)
        if options.keep:
            with options.keep.open("a") as file:
                file.write(json.dumps(entry) + "\n")
        if not _is_right(entry):
            answer = entry["found"] or entry["repairs"] or entry["verdict"]
            print(f"  missed: {entry['group']} {entry['names']} n = {entry['size']}: {answer}", flush=True)
    report(entries)


if __name__ == "__main__":
    main()
