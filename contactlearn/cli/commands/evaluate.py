"""Compare laws and learned models with the bounds on held-out trials, and draw their learning curves."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from matplotlib.figure import Figure
from omegaconf import DictConfig

from contactlearn.cli.commands import curves, fitting, loading, record, results, settings
from contactlearn.cli.commands.fitting import CostSurface
from contactlearn.cli.commands.laws import compared_laws, given_law, named_laws
from contactlearn.cli.commands.loading import Split, show_split, watched
from contactlearn.cli.commands.means import FITTED, fits_on_disk, lower_train_size
from contactlearn.cli.commands.parts import forget, parts_folder
from contactlearn.cli.commands.transfer import transfer
from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.diagnosis.events import OnEvent, track
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.sums import ErrorSums
from contactlearn.inference.identification.joint import JointFit
from contactlearn.inference.identification.per_trial import TrialFit, identify_trials
from contactlearn.inference.identification.shared import SharedFit
from contactlearn.inference.learning.curves import Curve
from contactlearn.mechanics.bodies import shapes_entries
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.figures import laws as figures
from contactlearn.report.figures.impulse_space import reachable_impulses
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import write
from contactlearn.report.tensorboard import Tracker
from contactlearn.results import folder as run_folder
from contactlearn.results.evaluation import BEST_POST_HOC, IRB, Evaluation
from contactlearn.results.held_out import HeldOut, save_held_out
from contactlearn.results.tables import save_curves, save_trial_parameters


@dataclass(frozen=True, kw_only=True)
class _Compared:
    """Fits to the pool, (μ, ε) of single trials by law, the norm of the bounds, and the device that computes them."""

    fits: tuple[SharedFit, ...]
    joint: Mapping[str, JointFit]
    trials: Mapping[str, TrialFit]
    norm: str
    device: torch.device

    def predict(self, trials: Impacts) -> dict[str, Prediction]:
        """What every model and bound says of impacts, by name; computed on the device, and taken back."""
        impacts = moved(trials, self.device)
        found = {fit.law.name: ContactModel(fit.to_law()).predict(impacts) for fit in self.fits}
        best, _ = bounds.best_post_hoc(impacts, found, self.norm)
        found |= {BEST_POST_HOC: best, IRB: bounds.irb(impacts, self.norm)}
        return moved(found | {name: fit.model.predict(impacts) for name, fit in self.joint.items()}, "cpu")


@dataclass(frozen=True, kw_only=True)
class _Extras:
    """Computations for figures alone: convergence, cost surface, and the bound of patches of some half-widths (m)."""

    convergence: SharedFit
    surface: CostSurface
    widths: torch.Tensor
    patched: torch.Tensor  # mean error and its interval for each half-width, [W, 3]


def evaluate(cfg: DictConfig) -> None:
    """Compare laws with both bounds, then learned models against the number of trials; or transfer to other bodies."""
    settings.check(cfg)
    if cfg.transfer is not None:
        transfer(cfg)
        return
    folder = results.run_folder()
    lower_train_size(cfg)
    data = loading.split(cfg, folder)
    show_split(data, cfg.device, settings.device(cfg))
    row = _row(cfg, data)
    with progress(folder) as on_event:
        compared = _compared(cfg, data, on_event)
        held_out = HeldOut(impacts=data.test, predictions=compared.predict(data.test))
        sums = _saved(cfg, data, compared, held_out, folder, on_event)
    compared = moved(compared, "cpu")
    result = _result(cfg, data, compared, sums)
    save_trial_parameters(data.impacts, list(compared.trials.values()), folder / f"trial_parameters.{cfg.tables}")
    run_folder.write_result(folder, result)
    _show(cfg, result)
    learned = {}
    if settings.recipes(cfg):
        result, learned = _with_curves(cfg, data, held_out, result, folder)
    with progress(folder) as on_event:
        extras = _extras(cfg, data, on_event)
    drawn = _drawn(cfg, data, compared, held_out, result, extras, row)
    if learned:
        drawn |= curves.draw_curves(result, learned, data.test, held_out.bounds)
    _record(cfg, folder, data, result, drawn)
    write(folder, of_evaluation(result, held_out))
    terminal.show_folder(folder)


def _compared(cfg: DictConfig, data: Split, on_event: OnEvent) -> _Compared:
    """Fit the laws, and `law` with the effects if there are any."""
    device, effects = settings.device(cfg), settings.effects(cfg)
    pool, impacts = moved(data.pool, device), moved(data.impacts, device)
    laws = compared_laws(cfg)
    fits = tuple(fitting.identify_law(cfg, law, pool, data.generator, on_event) for law in laws.values())
    joint: dict[str, JointFit] = {}
    if effects:
        rows = torch.arange(len(pool))
        found = fitting.fit_with_effects(cfg, given_law(cfg), effects, pool, rows, on_event)
        joint = {f"{name} (joint)" if name in laws else name: fit for name, fit in found.items()}
    every = laws | named_laws(cfg, [cfg.figures.parameters])
    trials = {
        name: identify_trials(law, impacts, target=cfg.train.target, box=settings.box(cfg))
        for name, law in track(every.items(), "every trial", on_event)
    }
    return _Compared(fits=fits, joint=joint, trials=trials, norm=cfg.bounds.norm, device=device)


def _saved(
    cfg: DictConfig, data: Split, compared: _Compared, held_out: HeldOut, folder: Path, on_event: OnEvent
) -> ErrorSums:
    """Predict all held-out trials, block by block, write them to tables, and add up their errors."""
    shown = data.test, held_out.predictions
    sums, count = ErrorSums(held_out.predictions), data.unseen_trials

    def predicted() -> Iterator[tuple[Impacts, Mapping[str, Prediction]]]:
        for impacts in watched(on_event, data.unseen(), count, "held-out trials"):
            predictions = shown[1] if impacts is shown[0] else compared.predict(impacts)
            sums.add(impacts, predictions)
            yield impacts, predictions

    if fits_on_disk(folder, count * len(sums.models)):
        save_held_out(folder, cfg.tables, data.unseen(), predicted())
    else:
        deque(predicted(), maxlen=0)
        save_held_out(folder, cfg.tables, [data.test], [shown])
    return sums


def _result(cfg: DictConfig, data: Split, compared: _Compared, sums: ErrorSums) -> Evaluation:
    """The result without learning curves.

    Runs are compared by the law with its effects, else by the law, or by the best one if that is not among them.
    """
    errors = results.error_table(sums, cfg.bootstrap, data.generator)
    joint = {name: results.joint_estimate(fit) for name, fit in compared.joint.items()}
    best, differences = results.ranked(sums)
    law, laws = given_law(cfg).name, [fit.law.name for fit in compared.fits]
    law = law if joint or law in laws else min(laws, key=lambda name: errors[name].headline)
    return Evaluation(
        provenance=results.provenance(data.blocks, cfg),
        model=list(joint)[-1] if joint else law,
        law=law,
        effects=results.effect_ids(settings.effects(cfg)),
        norm=cfg.bounds.norm,
        fits=tuple(map(results.law_estimate, compared.fits)),
        joint=joint,
        errors=errors,
        best=best,
        differences=differences,
        tables=cfg.tables,
        shape=shapes_entries(data.test.shape),
    )


def _show(cfg: DictConfig, result: Evaluation) -> None:
    """Print the tables of a result."""
    terminal.show_models(result.fits, result.errors, result.norm, result.joint)
    if result.joint:
        terminal.show_joint(*list(result.joint.items())[-1])
    if cfg.reference is not None:
        terminal.show_reference(result.fits, settings.reference(cfg))


def _with_curves(
    cfg: DictConfig, data: Split, held_out: HeldOut, result: Evaluation, folder: Path
) -> tuple[Evaluation, dict[str, Curve]]:
    """Add learning curves to the result, write it again and print them; with the curves that are no law's."""
    parts = parts_folder(cfg)
    found, learned = curves.learning_study(cfg, data, parts)
    levels = curves.mean_errors(data.test, held_out.bounds)
    entries = {name: curves.curve_entry(curve, levels, data.generator, cfg.bootstrap) for name, curve in found.items()}
    result = replace(result, learning_curves=entries)
    save_curves(found, folder / f"learning_curves.{cfg.tables}")
    run_folder.write_result(folder, result)
    terminal.show_curves({name: entries[name] for name in learned})
    forget(parts)
    return result, {name: found[name] for name in learned}


def _extras(cfg: DictConfig, data: Split, on_event: OnEvent) -> _Extras:
    # Every k up to 120, and as many of a larger range.
    most = min(cfg.train.size, FITTED)
    sizes = torch.linspace(1, most, min(most, 120)).round().int().tolist()
    (law,) = named_laws(cfg, [cfg.figures.surface]).values()
    repetitions = cfg.figures.repetitions
    widths = cfg.bounds.patch * torch.linspace(0, 1, 25, dtype=torch.float64) ** 2  # dense where the bound falls
    headline = metrics.METRICS[metrics.HEADLINE]
    pool, test = moved(data.pool, settings.device(cfg)), moved(data.test, settings.device(cfg))
    patched = headline.error(test, bounds.irb(test, cfg.bounds.norm, patch=widths[:, None]))
    found = _Extras(
        convergence=fitting.identify_law(
            cfg, law, pool, data.generator, on_event, sizes=sizes, repetitions=repetitions
        ),
        surface=fitting.law_surface(cfg, law, pool),
        widths=widths,
        patched=torch.tensor([list(metrics.bootstrap(error, data.generator, cfg.bootstrap)) for error in patched]),
    )
    return moved(found, "cpu")


def _record(cfg: DictConfig, folder: Path, data: Split, result: Evaluation, drawn: Mapping[str, Figure]) -> None:
    """Log the result to TensorBoard, and save the figures; laws with effects are fitted to the whole pool."""
    plain = {name: entry for name, entry in result.errors.items() if name not in result.joint}
    size = len(data.pool) if result.joint else cfg.train.size
    errors = record.headline_errors(result.errors)
    with Tracker(folder, cfg.train.size) as tracker:
        tracker.scalars(record.scalars(result.fits, plain, {}))
        if result.joint:
            effects = {name: result.errors[name] for name in result.joint}
            tracker.scalars(record.scalars([], effects, result.joint), size)
        tracker.scalars({record.MODEL: errors[result.model]}, size)
        source = result.provenance.data.source
        record.log_hyperparameters(tracker, cfg, source, size, result.law, [effect.name for effect in result.effects])
        equations = (*map(record.law_equation, result.fits), *(fit.equation for fit in result.joint.values()))
        record.log_card(tracker, result.provenance, equations, errors)
        if result.learning_curves:
            yardsticks = {name: result.errors[name] for name in (BEST_POST_HOC, IRB)}
            curves.log_curves(tracker, result.learning_curves, yardsticks)
        charted = (*result.learning_curves, BEST_POST_HOC, IRB) if result.learning_curves else ()
        tracker.charts(record.charts(charted))
        record.save_figures(drawn, folder, tracker)


def _drawn(
    cfg: DictConfig,
    data: Split,
    compared: _Compared,
    held_out: HeldOut,
    result: Evaluation,
    extras: _Extras,
    row: int | None,
) -> dict[str, Figure]:
    """Draw the figures of an evaluation by file name, but for learning curves."""
    test, box, axis = data.test, settings.box(cfg), record.headline_axis(cfg)
    drawn = record.draw_effects(list(compared.joint.values())[-1].model, test) if compared.joint else {}
    laws = {fit.law.name: fit.to_law() for fit in compared.fits}
    headline = metrics.METRICS[metrics.HEADLINE]
    per_trial = {name: headline.error(test, prediction) for name, prediction in held_out.predictions.items()}
    headlines = record.headline_errors(result.errors)
    intervals = {name: (one.mean, one.low, one.high) for name, one in headlines.items()}
    best = min(laws, key=lambda name: intervals[name])
    row = int(per_trial[best].argsort()[len(test) // 2]) if row is None else row
    levels = {name: intervals[name][0] for name in (best, BEST_POST_HOC)}
    per_law = compared.trials[cfg.figures.parameters]
    return drawn | {
        "energy_ellipse": reachable_impulses(test, row, laws, box, target=cfg.train.target),
        "cost_surface": record.draw_cost_surface(extras.surface),
        "convergence": figures.convergence(extras.convergence),
        "error_comparison": figures.error_comparison(per_trial, intervals, axis),
        "patch_curve": figures.patch_curve((1e3 * extras.widths).tolist(), extras.patched, levels, axis),
        "trial_parameters": figures.trial_parameters(per_law, data.impacts, box=box),
    }


def _row(cfg: DictConfig, data: Split) -> int | None:
    """Row of the held-out trial to draw, if one is asked for by name."""
    if cfg.figures.trial is None:
        return None
    name, test = str(cfg.figures.trial), data.test
    if name not in test.trial:
        raise DataError(
            f"figures.trial={name} is not among the {len(test)} held-out trials of {test.source}; "
            f"they begin with {', '.join(test.trial[:5])}"
        )
    return test.trial.index(name)
