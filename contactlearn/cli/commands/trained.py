"""Checks of models from checkpoints against the data that they are judged on."""

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
    """Print the origin of trained models; refuse those that do not fit the data, or have seen held-out trials.

    Raises:
        ContactLearnError: naming the file, the rule and the fix.
    """
    for name, trained in models.items():
        _refuse_unfit(trained, data.pool)
        _refuse_seen(trained, data, settings)
        terminal.print_line(f"{name}: {trained.path}")
        for doubt in _doubts(trained.model.regressor, data.test) if trained.model.regressor is not None else ():
            terminal.print_line(f"note: {name} {doubt}")


def _refuse_unfit(trained: TrainedModel, pool: Impacts) -> None:
    """Refuse a model that cannot predict an impact of the data."""
    try:
        for effect in trained.effects.values():
            effect.prepare(pool)
        v_post = trained.model.predict(pool[:1]).v_post
    except ContactLearnError as error:
        raise ContactLearnError(f"{trained.path}: does not fit these data: {error}") from error
    except RuntimeError as error:  # parts whose shapes do not fit each other
        raise ContactLearnError(
            f"{trained.path}: predicts nothing; train it again ({str(error).splitlines()[0]})"
        ) from error
    if v_post.shape != (1, 3) or not v_post.isfinite().all():
        raise ContactLearnError(
            f"{trained.path}: must predict one finite (v_x, v_y, ω) of each impact, got shape {tuple(v_post.shape)}; "
            "a model of several subsets is judged in Python"
        )


def _refuse_seen(trained: TrainedModel, data: Split, settings: SplitSettings) -> None:
    """Refuse a model of these very data, unless its training held the same trials out."""
    if trained.provenance is None or trained.provenance.data.sha256 != data.blocks.sha256:
        return
    config = trained.provenance.config
    if "test" not in config:
        raise ContactLearnError(f"{trained.path}: was fitted to all trials of these data; judge it on others")
    seed = config.get("split_seed", config.get("seed"))  # one seed did both in earlier versions
    if (config["test"], seed) != (settings.test, settings.split_seed):
        split = f"test={config['test']} split_seed={seed}"
        raise ContactLearnError(
            f"{trained.path}: was trained on these data with {split}, and has seen trials that test={settings.test} "
            f"split_seed={settings.split_seed} holds out; use {split}"
        )


def _doubts(regressor: Regressor, test: Impacts) -> Iterator[str]:
    """Yield reasons for which the errors of a learned model are smaller than on new data, or larger than needed."""
    if seen := int(regressor.trained_with(test).sum()):
        yield f"was trained on impacts that equal {seen} of the {len(test)} held-out ones: its errors are too small"
    x = test.features(regressor.space).values
    fixed = regressor.inputs.scale.isinf() & ((x - regressor.inputs.mean).abs() > 1e-6 * x.abs()).any(0)
    names = [name for name, lost in zip(SPACES[regressor.space].columns, fixed.flatten().tolist(), strict=True) if lost]
    if names:
        yield f"has seen a single value of {', '.join(names)}, and ignores that these data have others"
