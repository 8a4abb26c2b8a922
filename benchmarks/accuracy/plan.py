"""Do planned drops need less work than random ones?  Drop by drop, in worlds of `data=mystery`.

    python benchmarks/accuracy/plan.py [--worlds 8] [--nulls 3] [--budget 120] [--keep looks.jsonl]
    python benchmarks/accuracy/plan.py --table [--keep looks.jsonl]
    python benchmarks/accuracy/plan.py --parameters

Each world is measured in batches of 20 within the limits of one rig: heights 0.05–0.5 m to 2 mm, spins within 30 rad/s
set to 10 %, any angle to 2°; the place on the floor comes by chance.  `planned` drops are those of `plan` from the
diagnosis before them, `random` ones are drawn evenly within the same limits.  Both are diagnosed with the whole
catalogue after every batch, and follow the rule of `planning.stopping` for names; with random drops no forecast ends
them.  The ground truth is read only to judge.  Worlds are seeds from 9001 on, which nothing was tuned to.

    drops    until the names found at ≥ 0.9 are those that are hidden, and none beside them is probable
    settled  the names at the end, if the rule settled some: right, part (some of them, nothing false), or false
    null     worlds without effects, to the end of the budget: looks with a found name, sequences that settle one

    parameters    standard errors of a known law with a known effect from 20 random drops and 80 that are planned from
                  them (goal=parameters), over those from 100 random drops

Finished looks are lines of the file --keep, and an interrupted run resumes from there.
"""

import argparse
import json
from collections import defaultdict
from pathlib import Path
from statistics import median

import torch
from scipy.stats import beta
from threadpoolctl import threadpool_limits

from contactlearn import laws
from contactlearn.data.blocks import joined
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.effects import catalogue
from contactlearn.inference.identification.joint import fit
from contactlearn.planning.design import plan
from contactlearn.planning.measurement import carry_out
from contactlearn.planning.result import Goal, Look, PlannedDrop, Purpose, Stop
from contactlearn.planning.rig import Limits, Rig, Specimen
from contactlearn.planning.stopping import decide
from contactlearn.simulation.hidden_effects import draw
from contactlearn.simulation.hidden_effects.drops import Laboratory

RIG = Rig(
    limits={
        "height": Limits(low=0.05, high=0.5, precision=0.002),
        "theta": Limits(low=-torch.pi, high=torch.pi, precision=0.035),
        "omega": Limits(low=-30.0, high=30.0, share=0.1),
        "x": Limits(low=0.08, high=0.5, settable=False),
    }
)
FIRST, BATCH = 9001, 20
ARMS = ("planned", "random")
KNOWN = (
    "side_drag", "surface_tilt", "spin_damping", "com_offset", "velocity_dependent_restitution", "contact_patch",
    "directional_friction", "inertia_error",
)  # fmt: skip


def specimen(laboratory: Laboratory) -> Specimen:
    """The body as it is reported."""
    return Specimen(mass=laboratory.mass, inertia=laboratory.inertia, shape=laboratory.shape, name="ellipse")


def looks(seed: int, arm: str, effects: tuple[str, ...] | None, budget: int) -> list[dict]:
    """The looks at a world, one a batch, to the end of its sequence; a null world goes on to the end of the budget."""
    laboratory, generator = Laboratory.of(seed, effects=effects), torch.Generator().manual_seed(seed)
    body = specimen(laboratory)
    rig, chosen, drops, made, found = RIG.completed([body]), None, [], list[Look](), list[dict]()
    truth = {e["name"] for e in draw(seed, effects=effects)[1]["effects"]}
    while not found or not ended(found[-1], truth):
        if arm == "random":
            batch = evenly(rig, generator)
        else:
            chosen = plan(body, RIG, count=BATCH, budget=budget) if chosen is None else chosen
            batch = chosen.drops
        first = 1 + sum(map(len, drops))
        drops.append(carry_out(rig, batch, [body], laboratory, generator=generator, first=first))
        known = diagnose(joined(drops))
        if arm == "random":
            made.append(Look.of(known, gain=1.0))
            stop = decide(Goal.NAMES, made, budget, BATCH)
        else:
            chosen = plan(known, RIG, count=BATCH, budget=budget, looks=made, seed=len(made))
            made, stop = list(chosen.looks), chosen.stop
        look = made[-1]
        found.append(
            {
                "seed": seed,
                "arm": arm,
                "trials": look.trials,
                "found": look.found,
                "probable": look.probable,
                "gain": look.gain,
                "stop": stop,
                "verdict": known.verdict,
                "budget": budget,
                "truth": sorted(truth),
                "hidden": known.hidden,
                "confidence": {one.effect.name: one.confidence for one in known.missing},
            }
        )
    return found


def ended(look: dict, truth: set[str]) -> bool:
    """Whether a sequence ends: at the budget, or where the rule has settled the right names."""
    return look["trials"] + BATCH > look["budget"] or (
        bool(truth) and look["stop"] == Stop.SETTLED and {*look["found"]} == truth
    )


def evenly(rig: Rig, generator: torch.Generator) -> list[PlannedDrop]:
    """Drops at random within the limits."""
    unit = torch.rand(BATCH, len(rig.limits), generator=generator, dtype=torch.float64)
    return [
        PlannedDrop(
            settings={
                n: s.low + (s.high - s.low) * u for (n, s), u in zip(rig.limits.items(), row, strict=True) if s.settable
            },
            purpose=Purpose.SPACE,
            body="ellipse",
        )
        for row in unit.tolist()
    ]


def parameter_errors() -> str:
    """Ratios of standard errors, planned over random, geometric means over the parameters of each model."""
    said, ratios = [], []
    candidate = catalogue()["gravity_impulse"][0]
    options = DiagnoseOptions(candidates={candidate.id: candidate()}, laws=[laws.find("wang_mason")])
    for number, name in enumerate(KNOWN):
        laboratory, generator = (
            Laboratory.of(FIRST + 100 + number, effects=(name,)),
            torch.Generator().manual_seed(number),
        )
        body, made = specimen(laboratory), []
        rig = RIG.completed([body])
        for _ in range(5):
            first = 1 + sum(map(len, made))
            made.append(carry_out(rig, evenly(rig, generator), [body], laboratory, generator=generator, first=first))
        found = diagnose(made[0], "wang_mason", [name], options=options)
        drops = plan(found, RIG, goal=Goal.PARAMETERS, count=80).drops
        planned = joined([made[0], carry_out(rig, drops, [body], laboratory, generator=generator, first=21)])
        errors = [fit(some, "wang_mason", [name]).standard_errors for some in (planned, joined(made))]
        ratios.append((errors[0] / errors[1]).log().mean().exp().item())
        said.append(f"{name}: {ratios[-1]:.2f} of {', '.join(f'{x:.2f}' for x in (errors[0] / errors[1]).tolist())}")
        print(said[-1], flush=True)
    return f"standard errors, planned over random: median {median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}"


def interval(count: int, of: int) -> str:
    """A share with its exact 95 % interval."""
    low = 0.0 if count == 0 else beta.ppf(0.025, count, of - count + 1)
    high = 1.0 if count == of else beta.ppf(0.975, count + 1, of - count)
    return f"{count} of {of} ({low:.0%} to {high:.0%})"


def table(lines: list[dict]) -> str:
    """What was measured."""
    worlds = defaultdict(list)
    for one in lines:
        worlds[one["seed"], one["arm"]].append(one)
    said, drops, settled, null = [], defaultdict(dict), defaultdict(list), []
    for (seed, arm), sequence in sorted(worlds.items()):
        truth = {*sequence[0]["truth"]}
        names = " ".join(f"{x['trials']}:{'+'.join(x['found']) or '–'}{'?' * bool(x['probable'])}" for x in sequence)
        said.append(f"{seed} {arm} [{'+'.join(sorted(truth)) or 'nothing'}] {names}")
        end = next((x for x in sequence if x["stop"] == Stop.SETTLED), None)
        if not truth:
            null.append((sequence, end))
            continue
        right = (x["trials"] for x in sequence if {*x["found"]} == truth and not x["probable"])
        drops[seed][arm] = next(right, None)
        last = set() if end is None else {*end["found"]}
        settled[arm].append("open" if not last else "right" if last == truth else "part" if last < truth else "false")
    for arm in ARMS:
        found = [one[arm] for one in drops.values() if arm in one]
        reached = sorted(x for x in found if x is not None)
        said.append(f"{arm}: right names in {interval(len(reached), len(found))}, after {reached} drops")
        kinds = (f"{kind} {interval(settled[arm].count(kind), len(found))}" for kind in ("right", "part", "false"))
        said.append(f"    settled: {'; '.join(kinds)}")
    both = [(one["planned"], one["random"]) for one in drops.values() if len(one) == 2]
    if both:
        never = max(x["trials"] for x in lines) + BATCH
        ratios = sorted((a or never) / (b or never) for a, b in both)
        said.append(
            f"planned over random drops, {never} where never: median {median(ratios):.2f} of "
            f"{', '.join(f'{x:.2f}' for x in ratios)}"
        )
    if null:
        every = [x for sequence, _ in null for x in sequence]
        said.append(f"null: looks with a found name {interval(sum(bool(x['found']) for x in every), len(every))}")
        said.append(f"null: a name settled in {interval(sum(end is not None for _, end in null), len(null))} sequences")
    return "\n".join(said)


def main() -> None:
    """Run what the file does not have yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("worlds", 8), ("nulls", 3), ("budget", 120)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--keep", type=Path, default=Path("plan_looks.jsonl"))
    parser.add_argument("--table", action="store_true", help="of finished looks alone")
    parser.add_argument("--parameters", action="store_true", help="errors of parameters alone")
    options = parser.parse_args()
    if options.parameters:
        torch.set_num_threads(1)
        print(parameter_errors())
        return
    lines = [json.loads(line) for line in options.keep.read_text().splitlines()] if options.keep.exists() else []
    done = {(one["seed"], one["arm"]) for one in lines}
    tasks = [(FIRST + k, arm, None) for k in range(options.worlds) for arm in ARMS]
    nulls = [(FIRST + 1000 + k, "planned", ()) for k in range(options.nulls)]
    for k, one in enumerate(nulls):  # among the others, so that an interrupted run has some of each
        tasks.insert(min(3 * k + 2, len(tasks)), one)
    torch.set_num_threads(1)
    with threadpool_limits(1):
        for seed, arm, effects in () if options.table else tasks:
            if (seed, arm) not in done:
                found = looks(seed, arm, effects, options.budget)
                lines += found
                with options.keep.open("a") as file:
                    file.writelines(json.dumps(one) + "\n" for one in found)
                print(seed, arm, [(x["trials"], x["found"]) for x in found], found[-1]["stop"], flush=True)
    print(table(lines))


if __name__ == "__main__":
    main()
