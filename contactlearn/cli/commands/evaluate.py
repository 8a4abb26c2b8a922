"""Compare laws and learned models with the bounds on held-out trials, and compute their learning curves."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace

from contactlearn.cli.commands import curves, evaluation_record, fitting, loading, record
from contactlearn.cli.commands.fitting import Comparison
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.commands.transfer import transfer
from contactlearn.cli.job import Run
from contactlearn.cli.resource_limits import fits_on_disk
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.diagnosis.events import OnEvent
from contactlearn.inference.evaluation.metrics import ErrorSums
from contactlearn.inference.learning.curves import Curve
from contactlearn.mechanics.bodies import shapes_entries
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.report import terminal
from contactlearn.report.events import progress
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import write
from contactlearn.results import estimates, folder
from contactlearn.results.tables import HeldOut, save_curves, save_held_out, save_trial_parameters
from contactlearn.results.types import Evaluation


def evaluate(settings: EvaluateSettings, run: Run) -> None:
    """Compare laws with both bounds, then learned models against the number of trials; or transfer to other bodies."""
    if settings.transfer is not None:
        transfer(settings, settings.transfer, run)
        return
    data = loading.split(settings.split, run.folder)
    loading.show_split(data, str(run.config["device"]), settings.device)
    row = _drawn_row(settings, data)
    with progress(run.folder) as on_event:
        compared = fitting.compare_models(settings, data, on_event)
        held_out = HeldOut(impacts=data.test, predictions=compared.predict(data.test))
        sums = _save_predictions(settings, data, compared, held_out, run, on_event)
    compared = moved(compared, "cpu")
    result = _result(settings, run, data, compared, sums)
    path = run.folder / f"trial_parameters.{settings.tables}"
    save_trial_parameters(data.impacts, list(compared.trials.values()), path)
    folder.write_result(run.folder, result)
    terminal.show_models(result.fits, result.errors, result.norm, result.joint)
    if result.joint:
        terminal.show_joint(*list(result.joint.items())[-1])
    if settings.reference:
        terminal.show_reference(result.fits, settings.reference)
    learned: dict[str, Curve] = {}
    if settings.recipes:
        result, learned = _with_curves(settings, run, data, held_out, result)
    with progress(run.folder) as on_event:
        shown = evaluation_record.evaluation_record(settings, data, compared, held_out, result, learned, row, on_event)
    record.write_record(run, result.provenance, shown)
    write(run.folder, of_evaluation(result, held_out))
    terminal.show_folder(run.folder)


def _save_predictions(
    settings: EvaluateSettings, data: Split, compared: Comparison, held_out: HeldOut, run: Run, on_event: OnEvent
) -> ErrorSums:
    """Predict all held-out trials, block by block, write them to tables, and add up their errors."""
    sums, count = ErrorSums(held_out.predictions), data.held_out_trials

    def predicted() -> Iterator[tuple[Impacts, Mapping[str, Prediction]]]:
        for impacts in loading.track_blocks(on_event, data.held_out_impacts(), count, "held-out trials"):
            predictions = held_out.predictions if impacts is data.test else compared.predict(impacts)
            sums.add(impacts, predictions)
            yield impacts, predictions

    if fits_on_disk(run.folder, count * len(sums.models)):
        save_held_out(run.folder, settings.tables, data.held_out_impacts(), predicted())
    else:
        deque(predicted(), maxlen=0)
        save_held_out(run.folder, settings.tables, [data.test], [(data.test, held_out.predictions)])
    return sums


def _result(settings: EvaluateSettings, run: Run, data: Split, compared: Comparison, sums: ErrorSums) -> Evaluation:
    """The result without learning curves.

    Runs are compared by the law with its effects, else by the law, or by the best one if that is not among them.
    """
    errors = estimates.error_table(sums, settings.bootstrap, data.generator)
    joint = {name: estimates.joint_estimate(fit) for name, fit in compared.joint.items()}
    best, differences = estimates.ranked(sums)
    law, laws = settings.law.name, [fit.law.name for fit in compared.fits]
    law = law if joint or law in laws else min(laws, key=lambda name: errors[name].headline)
    return Evaluation(
        provenance=run.provenance(data.blocks, settings.device, data.train_size),
        model=list(joint)[-1] if joint else law,
        law=law,
        effects=estimates.effect_ids(settings.effects),
        norm=settings.norm,
        fits=tuple(map(estimates.law_estimate, compared.fits)),
        joint=joint,
        errors=errors,
        best=best,
        differences=differences,
        tables=settings.tables,
        shape=shapes_entries(data.test.shape),
    )


def _with_curves(
    settings: EvaluateSettings, run: Run, data: Split, held_out: HeldOut, result: Evaluation
) -> tuple[Evaluation, dict[str, Curve]]:
    """Add learning curves to the result, write it again and print them; with the curves that are no law's."""
    found = curves.learning_study(settings, data, run)
    levels = curves.mean_errors(data.test, held_out.bounds)
    entries = {
        name: curves.curve_entry(curve, levels, data.generator, settings.bootstrap) for name, curve in found.items()
    }
    result = replace(result, learning_curves=entries)
    save_curves(found, run.folder / f"learning_curves.{settings.tables}")
    folder.write_result(run.folder, result)
    learned = {name: curve for name, curve in found.items() if name not in settings.laws}
    terminal.show_curves({name: entries[name] for name in learned})
    run.remove_partial_results()
    return result, learned


def _drawn_row(settings: EvaluateSettings, data: Split) -> int | None:
    """Row of the held-out trial to draw, if it is given by name."""
    name, test = settings.figures.trial, data.test
    if name is None:
        return None
    if name not in test.trial:
        raise DataError(
            f"figures.trial={name} is not among the {len(test)} held-out trials of {test.source}; "
            f"they begin with {', '.join(test.trial[:5])}"
        )
    return test.trial.index(name)
