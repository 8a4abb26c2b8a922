"""Learning studies, which take longer than a tick: learning curves, and the learned models of `configs/model`.

Each study yields an event for every model that it has trained, with all held-out errors so far.  As a program,

    python -m contactlearn.workbench.studies KIND ADDRESS FILE

appends the events of a study of the session at an address to a file.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import torch
from threadpoolctl import threadpool_limits

from contactlearn.cli.config_files import CONFIGS, choices
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.events import LearningProgress, append_event
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.inference.learning.curves import nested_orders
from contactlearn.inference.learning.recipe import learn
from contactlearn.workbench.commands import words_of
from contactlearn.workbench.models import STARTS, Models, mean_error
from contactlearn.workbench.session import Session

ALONE, MODEL = "alone", "model"
"""The law alone and the model, in a learning curve."""
_SUBSETS, _SIZES = 6, (10, 20, 50, 100, 200, 500, 1000)  # of a learning curve
_Points = tuple[tuple[int, Interval], ...]


def curve_steps(models: Models, session: Session) -> Iterator[LearningProgress]:
    """Fit the law alone and the model to several random subsets of each size, nested in each other."""
    data, fitted = models.split(session), models.fitted(session)
    orders = nested_orders(len(data.pool), _SUBSETS, torch.Generator().manual_seed(session.seed))
    least = 2 * len(fitted.fit.parameters) + 8
    sizes = [size for size in (*_SIZES, len(data.pool)) if least <= size <= len(data.pool)]
    errors: dict[str, _Points] = {ALONE: (), MODEL: ()}
    for done, size in enumerate(sizes):
        yield LearningProgress(done=done, total=len(sizes), errors=dict(errors))
        rows = orders[:, :size] if size < len(data.pool) else orders[:1]
        for name, one in ((ALONE, models.law_alone(session)), (MODEL, fitted)):
            fit = identify_jointly(one.law, one.effects, data.pool, rows, options=FitOptions(starts=STARTS))
            errors[name] += ((size, mean_error(data.test, fit.model.predict(data.test))),)
    yield LearningProgress(done=len(sizes), total=len(sizes), errors=errors)


def learned_steps(models: Models, session: Session) -> Iterator[LearningProgress]:
    """Train every learned model on the training part, those with a law around the model of the session."""
    data, fitted = models.split(session), models.fitted(session)
    names = ",".join(choices(Path(CONFIGS, "model")))
    recipes = EvaluateSettings.from_config(compose("evaluate", [*words_of(session), f"model=[{names}]"])).learnable
    errors: dict[str, _Points] = {}
    for done, (name, recipe) in enumerate(recipes.items()):
        yield LearningProgress(done=done, total=len(recipes), errors=dict(errors))
        model = learn(recipe, data.pool, torch.arange(len(data.pool)), fitted.model if recipe.law else None)
        errors[name] = ((len(data.pool), mean_error(data.test, model.predict(data.test))),)
    yield LearningProgress(done=len(recipes), total=len(recipes), errors=errors)


STUDIES: Mapping[str, Callable[[Models, Session], Iterator[LearningProgress]]] = {
    "curve": curve_steps,
    "learned": learned_steps,
}
"""The studies by kind."""


def run_study(kind: str, address: str, file: str) -> int:
    """Write the events of a study; return the exit status."""
    torch.set_num_threads(1)
    threadpool_limits(1)
    try:
        for step in STUDIES[kind](Models(), Session.read(address)):
            append_event(Path(file), step)
    except ContactLearnError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(run_study(*sys.argv[1:]))
