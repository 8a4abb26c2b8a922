"""Checks of models from checkpoints against the data that they are judged on, or that their training goes on with."""

from collections.abc import Iterator, Mapping

from contactlearn.cli.checkpoints import TrainedModel
from contactlearn.cli.commands.loading import Split
from contactlearn.cli.settings import SplitSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.mechanics.features import Features, feature_units
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.regressor import Regressor
from contactlearn.report import terminal
from contactlearn.report.text.sentences import phrase
from contactlearn.results.types import DataSource, Pair

_SAME_BODY = 0.01  # relative difference of masses, or of moments of inertia, up to which bodies count as one
_MENTIONED_SHARE = 0.05  # share of impacts with rare features, up to which they go without mention


def check_models(models: Mapping[str, TrainedModel], data: Split, settings: SplitSettings) -> None:
    """Print the origin of trained models; refuse those that do not fit the data, or have seen held-out trials.

    Raises:
        ContactLearnError: naming the file, the rule and the fix.
    """
    for name, trained in models.items():
        _refuse_unfit(trained, data.pool)
        _refuse_seen(trained, data, settings)
        terminal.print_line(f"{name}: {trained.path}")
        regressor, held_out = trained.model.regressor, len(data.test)
        if regressor is not None and (seen := int(regressor.trained_with(data.test).sum())):
            overlap = f"was trained on impacts that equal {seen} of the {held_out} held-out ones"
            terminal.print_line(f"note: {name} {overlap}: its errors are too small")
        _show_news(name, trained, data.test)


def check_start(trained: TrainedModel, data: Split) -> None:
    """Print the origin of the model that a training goes on from; refuse one that does not fit the data.

    Raises:
        ContactLearnError: naming the file, the rule and the fix.
    """
    _refuse_unfit(trained, data.pool)
    source = None if trained.provenance is None else trained.provenance.data
    terminal.print_line(f"goes on from {trained.path}, {phrase('trained_on', trained.trained_on, source)}")
    _show_news(trained.learned, trained, data.pool)


def body_ranges(impacts: Impacts) -> dict[str, Pair]:
    """Return the least and the largest mass in kg, and moment of inertia in kg m², by field of a `DataSource`."""
    ranges = {"mass": impacts.mass.aminmax(), "inertia": impacts.inertia.aminmax()}
    return {name: (low.item(), high.item()) for name, (low, high) in ranges.items()}


def is_one_value(low: float, high: float) -> bool:
    """Whether masses, or moments of inertia, from one to another are those of one body."""
    return high <= (1 + _SAME_BODY) * low


def _show_news(name: str, trained: TrainedModel, impacts: Impacts) -> None:
    """Print what is new to a model: the body, features beyond its training's, features that it cannot use."""
    news = [] if trained.provenance is None else [*_other_body(trained.provenance.data, impacts)]
    if trained.model.regressor is not None:
        news += _other_features(trained.model.regressor, impacts)
    for one in news:
        terminal.print_line(f"note: {name} {one}")


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
    if v_post.shape != pool.v_post[:1].shape or not v_post.isfinite().all():
        raise ContactLearnError(
            f"{trained.path}: must predict one finite velocity of each impact, got shape {tuple(v_post.shape)}; "
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


def _other_body(seen: DataSource, impacts: Impacts) -> Iterator[str]:
    """Yield that the body is another one than the training's, by mass and moment of inertia."""
    if seen.mass is None or seen.inertia is None:
        return
    here = body_ranges(impacts)
    both = ((seen.mass, here["mass"]), (seen.inertia, here["inertia"]))
    if any(new[0] < (1 - _SAME_BODY) * old[0] or new[1] > (1 + _SAME_BODY) * old[1] for old, new in both):
        mass, inertia = (["–".join(dict.fromkeys(f"{x:.3g}" for x in pair)) for pair in pairs] for pairs in both)
        yield (
            f"was trained on a body of {mass[0]} kg, {inertia[0]} kg m²; these data have {mass[1]} kg, "
            f"{inertia[1]} kg m²: experiment=transfer compares bodies"
        )


def _other_features(regressor: Regressor, impacts: Impacts) -> Iterator[str]:
    """Yield the features that lie beyond the training's, and those of which the training had one value."""
    columns, x = feature_units(regressor.space, impacts.space), Features.of(impacts, regressor.space).values
    known, new = regressor.gps.train_inputs[0][..., 0, :, :], regressor.inputs.apply(x)
    far = (new < known.amin(-2, keepdim=True) - 1) | (new > known.amax(-2, keepdim=True) + 1)
    if (share := far.any(-1).double().mean().item()) > _MENTIONED_SHARE:
        names = [name for name, beyond in zip(columns, far.any(0).tolist(), strict=True) if beyond]
        yield (
            f"extrapolates to {100 * share:.0f} % of these impacts: their {', '.join(names)} lie more than a standard "
            "deviation beyond those of its training"
        )
    fixed = regressor.inputs.scale.isinf() & ((x - regressor.inputs.mean).abs() > 1e-6 * x.abs()).any(0)
    names = [name for name, lost in zip(columns, fixed.flatten().tolist(), strict=True) if lost]
    if names:
        yield f"has seen a single value of {', '.join(names)}, and ignores that these data have others"
