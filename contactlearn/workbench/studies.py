"""What takes longer than a tick: learning curves, and the learned models of `configs/model`, model by model.

Each study yields a step for every model that it has trained, with all errors so far: held out, by the number of
training trials.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch

from contactlearn.cli.config_files import CONFIGS, choices
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.inference.learning.curves import nested_orders
from contactlearn.inference.learning.recipe import learn
from contactlearn.workbench.commands import words_of
from contactlearn.workbench.models import STARTS, Models, held_out
from contactlearn.workbench.session import Session

ALONE, MODEL = "alone", "model"
"""The law alone and the model, in a learning curve."""
_SUBSETS, _SIZES = 6, (10, 20, 50, 100, 200, 500, 1000)  # of a learning curve
Points = tuple[tuple[int, Interval], ...]
"""Numbers of training trials with held-out errors."""


@dataclass(frozen=True, kw_only=True)
class StudyStep:
    """How far a study is: models trained, of how many, and their errors by name."""

    done: int
    total: int
    errors: Mapping[str, Points]


def curve_steps(models: Models, session: Session) -> Iterator[StudyStep]:
    """Fit the law alone and the model to several random subsets of each size, nested in each other."""
    data, fitted = models.split(session), models.fitted(session)
    orders = nested_orders(len(data.pool), _SUBSETS, torch.Generator().manual_seed(session.seed))
    least = 2 * len(fitted.fit.parameters) + 8
    sizes = [size for size in (*_SIZES, len(data.pool)) if least <= size <= len(data.pool)]
    found: dict[str, Points] = {ALONE: (), MODEL: ()}
    for done, size in enumerate(sizes):
        yield StudyStep(done=done, total=len(sizes), errors=dict(found))
        rows = orders[:, :size] if size < len(data.pool) else orders[:1]
        for name, one in ((ALONE, models.alone(session)), (MODEL, fitted)):
            fit = identify_jointly(one.law, one.effects, data.pool, rows, options=FitOptions(starts=STARTS))
            found[name] += ((size, held_out(data.test, fit.model.predict(data.test))),)
    yield StudyStep(done=len(sizes), total=len(sizes), errors=found)


def learned_steps(models: Models, session: Session) -> Iterator[StudyStep]:
    """Train every learned model on the training part, those with a law around the model of the session."""
    data, fitted = models.split(session), models.fitted(session)
    names = ",".join(choices(Path(CONFIGS, "model")))
    recipes = EvaluateSettings.from_config(compose("evaluate", [*words_of(session), f"model=[{names}]"])).learnable
    found: dict[str, Points] = {}
    for done, (name, recipe) in enumerate(recipes.items()):
        yield StudyStep(done=done, total=len(recipes), errors=dict(found))
        model = learn(recipe, data.pool, torch.arange(len(data.pool)), fitted.model if recipe.law else None)
        found[name] = ((len(data.pool), held_out(data.test, model.predict(data.test))),)
    yield StudyStep(done=len(recipes), total=len(recipes), errors=found)


STUDIES: Mapping[str, Callable[[Models, Session], Iterator[StudyStep]]] = {
    "curve": curve_steps,
    "learned": learned_steps,
}
"""By the name of their controls."""
