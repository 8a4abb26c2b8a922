"""Every choice of the effects in play, each fitted jointly with the law, its errors over all trials and not held out.

With E effects these are 2^E models; choice k has effect j if bit j of k is set.  Those of two and more effects
start at the values of the choice with one more.  Each is fitted to 600 trials at most, in even steps through the
sequence: these errors compare the choices with each other, and are a little below the ladder's.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result.effects import Choices
from contactlearn.effects import EffectId, columns
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel

MOST = 6
"""Effects in play, at most: 64 models."""
_FITTED = 600  # trials, at most
_RESAMPLES = 1000
_TOLERANCE = 3e-5  # nats a trial


@dataclass(frozen=True, kw_only=True)
class FittedChoices:
    """The choices, and v_post in (m/s, m/s, rad/s) of each."""

    choices: Choices
    outcomes: Float[Tensor, "choices n D"]

    def reduction(self, impacts: Impacts, effect: EffectId, generator: torch.Generator) -> Interval | None:
        """Compute the mean mass error without an effect less that with it, all others on; None if it is not in play."""
        if effect not in self.choices.effects:
            return None
        full = len(self.outcomes) - 1
        without = full - 2 ** self.choices.effects.index(effect)
        errors = [mass_error(impacts, Prediction(self.outcomes[k], impacts.wrench)) for k in (without, full)]
        return bootstrap(errors[0] - errors[1], generator, _RESAMPLES)


def fit_choices(
    impacts: Impacts,
    model: ContactModel,
    effects: Sequence[EffectId],
    *,
    generator: torch.Generator,
    options: FitOptions = FitOptions(),
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> FittedChoices:
    """Fit every choice of some effects of a fitted model, its other effects always on.

    Args:
        impacts: measurements.
        model: a law with effects, fitted to these impacts.
        effects: of the model, the most important first; those after the first `MOST` stay on.
        generator: of the bootstrap.
        options: of the fits.
        progress: wraps the choices.
    """
    effects = tuple(effects)[:MOST]
    law, full = model.law, 2 ** len(effects) - 1
    options = replace(options, tolerance=_TOLERANCE, standard_errors=False)
    sample = impacts[:: -(-len(impacts) // _FITTED)]
    start = {full: columns(*model.values)}
    outcomes, errors = {}, {}
    for choice in progress(range(full, -1, -1)):
        left_out = {effect.name for j, effect in enumerate(effects) if not choice >> j & 1}
        kept = {name: effect for name, effect in model.effects.items() if name not in left_out}
        fit = joint.fit(sample, law, kept, options=options, start=start[choice])
        owners = [p.name.rpartition(".")[0] for p in fit.parameters]
        for j, effect in enumerate(effects):
            if effect.name in kept:
                others = torch.tensor([owner != effect.name for owner in owners])
                start.setdefault(choice - 2**j, fit.values[others])
        prediction = fit.model.predict(impacts)
        outcomes[choice] = prediction.v_post
        errors[choice] = bootstrap(mass_error(impacts, prediction), generator, _RESAMPLES)
    choices = Choices(effects=effects, errors=tuple(errors[k] for k in range(full + 1)))
    return FittedChoices(choices=choices, outcomes=torch.stack([outcomes[k] for k in range(full + 1)]))
