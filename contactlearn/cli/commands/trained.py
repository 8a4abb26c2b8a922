"""Whether models from checkpoints may be judged on the data of a run, and what limits the comparison."""

from collections.abc import Iterator, Mapping

from contactlearn.cli.checkpoints import TrainedModel
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.settings import SplitSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.mechanics.features import SPACES
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.regressor import Regressor
from contactlearn.report import terminal


def check_models(models: Mapping[str, TrainedModel], data: Split, settings: SplitSettings) -> None:
    """Print where trained models come from; refuse those that do not fit the data, or have seen held-out trials.

    Raises:
        ContactLearnError: naming the file, the rule and the fix.
    """
    for name, one in models.items():
        _refuse_unfit(one, data.pool)
        _refuse_seen(one, data, settings)
        terminal.print_line(f"{name}: {one.path}")
        for doubt in _doubts(one.processes, data.test) if one.processes is not None else ():
            terminal.print_line(f"note: {name} {doubt}")


def _refuse_unfit(one: TrainedModel, pool: Impacts) -> None:
    try:
        for effect in one.effects.values():
            effect.prepare(pool)
        found = one.model.predict(pool[:1]).v_post
    except ContactLearnError as error:
        raise ContactLearnError(f"{one.path}: does not fit these data: {error}") from error
    except RuntimeError as error:  # parts whose shapes do not fit each other
        raise ContactLearnError(
            f"{one.path}: predicts nothing; train it again ({str(error).splitlines()[0]})"
        ) from error
    if found.shape != (1, 3) or not found.isfinite().all():
        raise ContactLearnError(
            f"{one.path}: must predict one finite (v_x, v_y, ω) of each impact, got shape {tuple(found.shape)}; "
            "a model of several subsets is judged in Python"
        )


def _refuse_seen(one: TrainedModel, data: Split, settings: SplitSettings) -> None:
    """Refuse a model of these very data, unless its training held the same trials out."""
    if one.provenance is None or one.provenance.data.sha256 != data.blocks.sha256:
        return
    config = one.provenance.config
    if "test" not in config:
        raise ContactLearnError(f"{one.path}: was fitted to all trials of these data; judge it on others")
    seed = config.get("split_seed", config.get("seed"))  # one seed did both in earlier versions
    if (config["test"], seed) != (settings.test, settings.split_seed):
        split = f"test={config['test']} split_seed={seed}"
        raise ContactLearnError(
            f"{one.path}: was trained on these data with {split}, and has seen trials that test={settings.test} "
            f"split_seed={settings.split_seed} holds out; use {split}"
        )


def _doubts(processes: Regressor, test: Impacts) -> Iterator[str]:
    """What makes the errors of a learned model look better than they are, or worse than they need be."""
    if seen := int(processes.trained_with(test).sum()):
        yield f"was trained on impacts that equal {seen} of the {len(test)} held-out ones: its errors are too small"
    x = test.features(processes.space).values
    fixed = processes.inputs.scale.isinf() & ((x - processes.inputs.mean).abs() > 1e-6 * x.abs()).any(0)
    names = [name for name, lost in zip(SPACES[processes.space].columns, fixed.flatten().tolist(), strict=True) if lost]
    if names:
        yield f"has seen a single value of {', '.join(names)}, and ignores that these data have others"
