"""Fits that several commands ask for, with the options of a configuration."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from omegaconf import DictConfig
from torch import Tensor

from contactlearn.cli.commands import settings
from contactlearn.cli.commands.means import FITTED
from contactlearn.data.blocks import sampled
from contactlearn.diagnosis.events import OnEvent, track
from contactlearn.effects import Effect
from contactlearn.inference.identification import shared
from contactlearn.inference.identification.joint import JointFit, identify_jointly
from contactlearn.inference.identification.shared import SharedFit
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts

_DRAWN = 5_000  # trials of a cost surface


@dataclass(frozen=True, kw_only=True)
class CostSurface:
    """Cost of a law in N s over a grid of (μ, ε) on a whole pool, and its minimum; Eq. (3.1)."""

    law: Law
    mu: Float[Tensor, " a"]
    eps: Float[Tensor, " b"]
    cost: Float[Tensor, "a b"]
    minimum: tuple[float, float]


def identify_law(
    cfg: DictConfig,
    law: Law,
    pool: Impacts,
    generator: torch.Generator,
    on_event: OnEvent,
    *,
    sizes: Sequence[int] | None = None,
    repetitions: int | None = None,
    orders: Int[Tensor, "m n"] | None = None,
) -> SharedFit:
    """Identify the shared (μ, ε) of a law.

    Args:
        cfg: the configuration.
        law: with any μ and ε.
        pool: the trials to draw subsets from.
        generator: source of the subsets.
        on_event: receives the progress.
        sizes: of the subsets; `train.size` if None, but at most `FITTED`.
        repetitions: number of subsets; `train.repetitions` if None.
        orders: of the pool's trials, the subsets being the first of each; drawn if None.
    """
    sizes = (min(cfg.train.size, FITTED),) if sizes is None else sizes
    verb = "converging" if len(sizes) > 1 else "identifying"
    return shared.identify(
        law,
        pool,
        sizes=sizes,
        repetitions=cfg.train.repetitions if repetitions is None else repetitions,
        orders=orders,
        generator=generator,
        target=cfg.train.target,
        box=settings.box(cfg),
        progress=lambda blocks: track(blocks, f"{verb} {law.name}", on_event),
    )


def fit_with_effects(
    cfg: DictConfig,
    law: Law,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    rows: Int[Tensor, "*subsets n"],
    on_event: OnEvent,
) -> dict[str, JointFit]:
    """Fit the law alone and with its effects, by name, both to the same trials in the same way.

    Where flight limits a parameter the fit to the impacts alone stands beside.
    """
    fits, options = {}, settings.fit_options(cfg)
    for chosen in track(({}, effects), f"fitting {law.name} and its effects", on_event):
        fit = identify_jointly(law, chosen, impacts, rows, options=options)
        if any(p.prior_from_flight for p in fit.parameters):
            alone = identify_jointly(law, chosen, impacts.replace(apparatus=None), rows, options=options)
            fit = replace(fit, alone=alone)
        fits[augmented_name(law.name, chosen)] = fit
    return fits


def augmented_name(law: str, effects: Iterable[str]) -> str:
    """Return the name of a law with effects in tables, such as `wang_mason + surface_tilt + spin_damping`."""
    return " + ".join((law, *effects))


def law_surface(cfg: DictConfig, law: Law, pool: Impacts) -> CostSurface:
    """Evaluate the cost of a law over the whole box, and find its minimum, on the pool or a random sample of it."""
    mu, eps = settings.box(cfg).axes()
    pool = pool[sampled(torch.ones(len(pool), dtype=torch.bool), _DRAWN)]
    least = shared.identify(
        law, pool, sizes=(len(pool),), repetitions=1, box=settings.box(cfg), target=cfg.train.target
    )
    cost = shared.cost_surface(law, pool, mu, eps, target=cfg.train.target)
    return CostSurface(law=law, mu=mu, eps=eps, cost=cost, minimum=least.mean())


def workers(cfg: DictConfig) -> int:
    """Return the number of processes to train in: as asked for, or one for each core that this process may use.

    On a GPU it is one, this process itself.
    """
    if cfg.workers is not None or settings.device(cfg).type != "cpu":
        return cfg.workers or 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
