"""Fits that several commands make: laws alone and with effects, cost surfaces, and the models of an evaluation."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Int
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.cli.commands.loading import Split
from contactlearn.cli.resource_limits import FITTED
from contactlearn.cli.settings import EvaluateSettings, IdentificationSettings
from contactlearn.core.devices import moved
from contactlearn.core.events import track
from contactlearn.data.blocks import sampled
from contactlearn.diagnosis.events import OnEvent
from contactlearn.effects import Effect
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.identification import joint, shared
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.inference.identification.per_trial import TrialFit, fit_trials
from contactlearn.inference.identification.shared import SubsetFit
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures import laws as figures
from contactlearn.results.types import BEST_POST_HOC, IRB


def identify_law(
    law: Law,
    pool: Impacts,
    settings: IdentificationSettings,
    generator: torch.Generator,
    on_event: OnEvent,
    *,
    sizes: Sequence[int],
    repetitions: int | None = None,
    orders: Int[Tensor, "m n"] | None = None,
) -> SubsetFit:
    """Identify the shared (μ, ε) of a law on random subsets.

    Args:
        law: with any μ and ε.
        pool: the trials to draw subsets from.
        settings: compared impulse, limits and number of subsets.
        generator: source of the subsets.
        on_event: receives the progress.
        sizes: of the subsets.
        repetitions: number of subsets, if it is not that of the settings.
        orders: of the pool's trials, the subsets being the first of each; drawn if None.
    """
    step = "convergence of" if len(sizes) > 1 else "identifying"
    return shared.fit_subsets(
        pool,
        law,
        sizes=sizes,
        repetitions=settings.repetitions if repetitions is None else repetitions,
        orders=orders,
        generator=generator,
        target=settings.target,
        box=settings.box,
        progress=lambda blocks: track(blocks, f"{step} {law.label}", on_event),
    )


def fit_with_effects(
    law: Law,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    rows: Int[Tensor, "*subsets n"],
    options: FitOptions,
    on_event: OnEvent,
) -> dict[str, Fit]:
    """Fit the law alone and with its effects, by name, both to the same trials in the same way.

    Where flight limits a parameter, the fit has that to the impacts alone as `alone`.
    """
    fits = {}
    for chosen in track(({}, effects), f"fitting {law.label} and its effects", on_event):
        fit = joint.fit(impacts, law, chosen, rows=rows, options=options)
        if any(p.prior_from_flight for p in fit.parameters):
            alone = joint.fit(impacts.replace(apparatus=None), law, chosen, rows=rows, options=options)
            fit = replace(fit, alone=alone)
        fits[augmented_name(law.name, chosen)] = fit
    return fits


def augmented_name(law: str, effects: Iterable[str]) -> str:
    """Return the name of a law with effects in tables, such as `wang_mason + surface_tilt + spin_damping`."""
    return " + ".join((law, *effects))


def draw_cost_surface(law: Law, pool: Impacts, trials: int, settings: IdentificationSettings) -> Figure:
    """Draw the cost of a law over the whole box with its minimum, on random trials of the pool; Eq. (3.1), Fig. 3.3."""
    box, target = settings.box, settings.target
    mu, eps = box.axes()
    pool = pool[sampled(torch.ones(len(pool), dtype=torch.bool), trials)]
    least = shared.fit_subsets(pool, law, sizes=(trials,), repetitions=1, box=box, target=target)
    cost = shared.cost_surface(law, pool, mu, eps, target=target)
    return figures.cost_map(mu, eps, cost, least.mean(), law, trials)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Fits to the pool, trained models, (μ, ε) of each trial by law, norm of the bounds, and device."""

    fits: tuple[SubsetFit, ...]
    joint: Mapping[str, Fit]
    trained: Mapping[str, ContactModel]
    trials: Mapping[str, TrialFit]
    norm: metrics.Norm
    device: torch.device

    def predict(self, trials: Impacts) -> dict[str, Prediction]:
        """Predict impacts with every model and bound, by name; computed on the device, and taken back."""
        impacts = moved(trials, self.device)
        found = {fit.law.name: ContactModel(fit.to_law()).predict(impacts) for fit in self.fits}
        best, _ = bounds.best_post_hoc(impacts, found, self.norm)
        found |= {BEST_POST_HOC: best, IRB: bounds.irb(impacts, self.norm)}
        models = {name: fit.model for name, fit in self.joint.items()} | {**self.trained}
        return moved(found | {name: model.predict(impacts) for name, model in models.items()}, "cpu")


def compare_models(settings: EvaluateSettings, data: Split, on_event: OnEvent) -> Comparison:
    """Fit the laws to the pool, and `law` with the effects if there are any; and every law to every trial."""
    device, how, laws = settings.device, settings.train, settings.laws
    pool, impacts = moved(data.pool, device), moved(data.impacts, device)
    sizes = (min(data.train_size, FITTED),)
    fits = tuple(identify_law(law, pool, how, data.generator, on_event, sizes=sizes) for law in laws.values())
    joint: dict[str, Fit] = {}
    if settings.effects:
        rows = torch.arange(len(pool))
        found = fit_with_effects(settings.law, settings.effects, pool, rows, settings.fit_options, on_event)
        joint = {f"{name} (joint)" if name in laws else name: fit for name, fit in found.items()}
    shown = settings.figures.parameters
    every = laws if shown is None else {**laws, shown.name: shown}
    trials = {
        name: fit_trials(impacts, law, target=how.target, box=how.box)
        for name, law in track(every.items(), "every trial", on_event)
    }
    trained = {name: moved(one.model, device) for name, one in settings.trained.items()}
    return Comparison(fits=fits, joint=joint, trained=trained, trials=trials, norm=settings.bounds.norm, device=device)
