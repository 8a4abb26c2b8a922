"""Do planned drops need less work than random ones?  Drop by drop, in worlds of `data=mystery`.

    python benchmarks/accuracy/plan.py [--worlds SEED …] [--nulls SEED …] [--strength 2 5] [--batches 20 10 10 20 20]
                                      [--keep looks.jsonl]
    python benchmarks/accuracy/plan.py --table [--keep looks.jsonl]
    python benchmarks/accuracy/plan.py --parameters
    python benchmarks/accuracy/plan.py --twins

Each world is measured within the limits of one rig: heights 0.05–0.5 m to 2 mm, spins within 30 rad/s set to 10 %, any
angle to 2°; the place on the floor comes by chance. The first look is at 20 drops, the least that is diagnosed, the
next at 30, 40, 60 and 80, or as `--batches` says. `planned` drops are those of `plan` from the diagnosis before them,
`random` ones are drawn evenly within the same limits. Both are diagnosed with the whole catalogue at every look, and
follow the rule of `planning.stopping` for names; with random drops no forecast ends them. The ground truth is read
only to judge. `--strength` is the range of the size of an effect in units of the noise: 2 to 5 is usual. Worlds are
seeds that nothing was tuned to.

    drops    until the names found at ≥ 0.9 are those that are hidden, and none beside them is probable
    settled  the names at the end, if the rule settled some: right, part (some of them, nothing false), or false
    null     worlds without effects, to the end of the budget: looks with a found name, sequences that settle one

    twins         drops that bring 3 nats of evidence, odds of 20, between two alike effects, of a size at which 1000
                  random drops bring no more: expected, and by fits to drops that are made
    parameters    standard errors of a known law with a known effect from 20 random drops and 80 that are planned from
                  them (goal=parameters), over those from 100 random drops

Finished looks are lines of the file --keep, and an interrupted run resumes from there.
"""

import argparse
import json
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median

import torch
from scipy.stats import beta
from threadpoolctl import threadpool_limits

from contactlearn import laws
from contactlearn.data.blocks import joined
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.effects import catalogue, find_effect
from contactlearn.inference.identification.joint import fit
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel
from contactlearn.planning.criteria import EffectSeparation
from contactlearn.planning.design import NOISE, plan
from contactlearn.planning.hypotheses import Candidates
from contactlearn.planning.measurement import carry_out
from contactlearn.planning.result import Goal, Look, PlannedDrop, Purpose, Stop
from contactlearn.planning.rig import Limits, Rig, Specimen, states
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
TWINS = (
    ("incidence_dependent_friction", "velocity_dependent_friction"),
    ("slip_dependent_restitution", "incidence_dependent_restitution"),
    ("inertia_error", "spin_damping"),
)
NATS = 3.0
ARMS = ("planned", "random")
KNOWN = (
    "side_drag", "surface_tilt", "spin_damping", "com_offset", "velocity_dependent_restitution", "contact_patch",
    "directional_friction", "inertia_error",
)  # fmt: skip


def specimen(laboratory: Laboratory) -> Specimen:
    """The body as it is reported."""
    return Specimen(mass=laboratory.mass, inertia=laboratory.inertia, shape=laboratory.shape, name="ellipse")


def looks(
    seed: int, arm: str, effects: tuple[str, ...] | None, strength: tuple[float, float], batches: list[int]
) -> list[dict]:
    """The looks at a world, one a batch, to the end of its sequence; a null world goes on to the last batch."""
    laboratory = Laboratory.of(seed, effects=effects, strength=strength)
    generator = torch.Generator().manual_seed(seed)
    body = specimen(laboratory)
    rig, chosen, drops, made, found = RIG.completed([body]), None, [], list[Look](), list[dict]()
    truth = {e["name"] for e in draw(seed, effects=effects)[1]["effects"]}
    budget = sum(batches)
    for count, following in pairwise((*batches, batches[-1])):
        if arm == "random":
            batch = evenly(rig, generator, count)
        else:
            chosen = plan(body, RIG, count=count, budget=budget) if chosen is None else chosen
            batch = chosen.drops
        first = 1 + sum(map(len, drops))
        drops.append(carry_out(rig, batch, [body], laboratory, generator=generator, first=first))
        known = diagnose(joined(drops))
        if arm == "random":
            made.append(Look.of(known, gain=1.0))
            stop = decide(Goal.NAMES, made, budget, following)
        else:
            chosen = plan(known, RIG, count=following, budget=budget, looks=made, seed=len(made))
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
                "truth": sorted(truth),
                "confidence": {one.effect.name: one.confidence for one in known.missing},
            }
        )
        if truth and stop is Stop.SETTLED and {*look.found} == truth:
            break
    return found


def evenly(rig: Rig, generator: torch.Generator, count: int) -> list[PlannedDrop]:
    """Drops at random within the limits."""
    unit = torch.rand(count, len(rig.limits), generator=generator, dtype=torch.float64)
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
            Laboratory.of(9101 + number, effects=(name,)),
            torch.Generator().manual_seed(number),
        )
        body, made = specimen(laboratory), []
        rig = RIG.completed([body])
        for _ in range(5):
            first = 1 + sum(map(len, made))
            made.append(
                carry_out(rig, evenly(rig, generator, 20), [body], laboratory, generator=generator, first=first)
            )
        found = diagnose(made[0], "wang_mason", [name], options=options)
        drops = plan(found, RIG, goal=Goal.PARAMETERS, count=80).drops
        planned = joined([made[0], carry_out(rig, drops, [body], laboratory, generator=generator, first=21)])
        errors = [fit(some, "wang_mason", [name]).standard_errors for some in (planned, joined(made))]
        ratios.append((errors[0] / errors[1]).log().mean().exp().item())
        said.append(f"{name}: {ratios[-1]:.2f} of {', '.join(f'{x:.2f}' for x in (errors[0] / errors[1]).tolist())}")
        print(said[-1], flush=True)
    return f"standard errors, planned over random: median {median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}"


def twins() -> str:
    """Drops that separate two alike effects, expected and in the evidence of fits to drops that were really made."""
    law, noise = laws.find("wang_mason").at(0.15, 0.55), torch.tensor(NOISE[PLANE], dtype=torch.float64)
    body = Specimen(mass=0.05, inertia=1.9e-5, shape=Ellipse((0.036, 0.024)), name="ellipse")
    rig, generator = RIG.completed([body]), torch.Generator().manual_seed(1)
    values, said = rig.draw(1600, 1, beyond=0.25), list[str]()
    settings, _ = states([body], torch.zeros(1600, dtype=torch.long), values, generator)
    unit = torch.rand(1600, len(rig.limits), generator=generator, dtype=torch.float64)
    values = {
        name: one.low + (one.high - one.low) * u for (name, one), u in zip(rig.limits.items(), unit.T, strict=True)
    }
    random, _ = states([body], torch.zeros(1600, dtype=torch.long), values, generator)
    assert settings is not None
    assert random is not None
    for pair in TWINS:
        effects = {name: find_effect(name)().prepare(settings) for name in pair}
        covariance = noise.square().diag()
        about = Candidates.about(
            ContactModel(law), effects, settings, covariance.expand(len(settings), -1, -1), random[:1000], covariance
        )
        one = EffectSeparation.of(about, repeats=1)
        value = one.size[0] * (2 * NATS / one.squared()[2, 0]).sqrt()  # of the first, against the second
        one = replace(
            one, size=value * torch.eye(len(one.size), dtype=torch.float64)[0], information=0 * one.information
        )
        picked = list[int]()
        while one.squared()[2, 0] < 2 * NATS:
            gain = one.gain()
            gain[picked] = -torch.inf
            picked.append(int(gain.argmax()))
            one = one.after(picked[-1])
        truth = ContactModel(law, effects={pair[0]: effects[pair[0]].at([value])})
        evidence = []
        for drops in (random[:1000], settings[picked]):
            nats = []
            for _ in range(8):
                v_post = truth.predict(drops).v_post
                v_post = v_post + noise * torch.randn(v_post.shape, generator=generator, dtype=torch.float64)
                made = drops.replace(v_post=v_post)
                fits = (fit(made, law, [effects[name]]).model.predict(made).v_post for name in pair)
                chi = [((v_post - v) / noise).square().sum().item() for v in fits]
                nats.append((chi[1] - chi[0]) / 2)
            evidence.append(sum(nats) / len(nats))
        said.append(
            f"{pair[0]} against {pair[1]}: {NATS} nats by 1000 random or {len(picked)} planned drops; fits to drops "
            f"that were made, 8 times: {evidence[0]:.1f} and {evidence[1]:.1f}"
        )
        print(said[-1], flush=True)
    return f"planned drops in the place of 1000: {len(said)} pairs"


def interval(count: int, of: int) -> str:
    """A share with its exact 95 % interval."""
    low = 0.0 if count == 0 else beta.ppf(0.025, count, of - count + 1)
    high = 1.0 if count == of else beta.ppf(0.975, count + 1, of - count)
    return f"{count} of {of} ({low:.0%} to {high:.0%})"


def table(lines: list[dict], batches: list[int]) -> str:
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
        never = sum(batches) + batches[-1]
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
    parser.add_argument("--worlds", type=int, nargs="*", default=[], help="seeds")
    parser.add_argument("--nulls", type=int, nargs="*", default=[], help="seeds of worlds without effects")
    parser.add_argument("--strength", type=float, nargs=2, default=(2.0, 5.0))
    parser.add_argument("--batches", type=int, nargs="+", default=[20, 10, 10, 20, 20], help="drops before each look")
    parser.add_argument("--keep", type=Path, default=Path("plan_looks.jsonl"))
    parser.add_argument("--table", action="store_true", help="of finished looks alone")
    parser.add_argument("--parameters", action="store_true", help="errors of parameters alone")
    parser.add_argument("--twins", action="store_true", help="two alike effects alone")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.parameters or options.twins:
        print(parameter_errors() if options.parameters else twins())
        return
    lines = [json.loads(line) for line in options.keep.read_text().splitlines()] if options.keep.exists() else []
    done = {(one["seed"], one["arm"]) for one in lines}
    tasks = [(seed, arm, None) for seed in options.worlds for arm in ARMS]
    tasks += [(seed, "planned", ()) for seed in options.nulls]
    with threadpool_limits(1):
        for seed, arm, effects in () if options.table else tasks:
            if (seed, arm) not in done:
                found = looks(seed, arm, effects, tuple(options.strength), options.batches)
                lines += found
                with options.keep.open("a") as file:
                    file.writelines(json.dumps(one) + "\n" for one in found)
                print(seed, arm, [(x["trials"], x["found"]) for x in found], found[-1]["stop"], flush=True)
    print(table(lines, options.batches))


if __name__ == "__main__":
    main()
