"""Every choice of the effects in play, each fitted jointly with the law: what a reader can tick on and off.

With E effects these are 2^E models; choice k has effect j if bit j of k is set.  Those of two and more effects
start at the values of the choice with one more.  The errors are those of fits to all trials: not held out, so a
little below the ladder's.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.effects import columns
from contactlearn.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.identification.joint import FitOptions, identify_jointly
from contactlearn.impacts import Impacts
from contactlearn.model import ContactModel

MOST = 6
"""Effects in play, at most."""
_RESAMPLES = 1000


@dataclass(frozen=True)
class Subsets:
    """The effects in play, and of each choice v_post [2^E, N, 3] in (m/s, m/s, rad/s) and the mean mass error."""

    names: tuple[str, ...]
    v_post: Tensor
    errors: tuple[Interval, ...]


def subsets(
    impacts: Impacts,
    model: ContactModel,
    names: Iterable[str],
    *,
    generator: torch.Generator,
    progress: Callable[[Iterable], Iterable] = iter,
    options: FitOptions = FitOptions(),
) -> Subsets:
    """Fit every choice of some effects of a fitted model, its other effects always on.

    Args:
        model: a law with effects, fitted to these impacts.
        names: of its effects, the most important first; those after the first `MOST` stay on.
        generator: of the bootstrap.
        options: of the fits.
    """
    names = tuple(names)[:MOST]
    law, full = model.base, 2 ** len(names) - 1
    start = {full: torch.cat((columns(law.mu, law.eps), *(columns(*e.values) for e in model.effects.values())))}
    predictions, errors = {}, {}
    for choice in progress(range(full, -1, -1)):
        left_out = {name for j, name in enumerate(names) if not choice >> j & 1}
        effects = {name: effect for name, effect in model.effects.items() if name not in left_out}
        fit = identify_jointly(law, effects, impacts, options=options, start=start[choice])
        owner = [p.name.rpartition(".")[0] for p in fit.parameters]
        for j, name in enumerate(names):
            if name in effects:
                kept = torch.tensor([one != name for one in owner])
                start.setdefault(choice - 2**j, fit.values[kept])
        prediction = fit.model.predict(impacts)
        predictions[choice] = prediction.v_post
        errors[choice] = bootstrap(mass_error(impacts, prediction), generator, _RESAMPLES)
    choices = range(full + 1)
    return Subsets(names, torch.stack([predictions[k] for k in choices]), tuple(errors[k] for k in choices))
