"""Dilution: what errors of the measured velocities before impact make of a residual, told by these velocities.

Where the trials begin alike, a measured v_pre that is large is large by its error for a part.  A model that takes it
for true then errs by −∂v_post/∂v_pre E[u | v_pre], which is linear in v_pre as measured.  So does physics that the
model lacks; where the errors could be as large as matters, the two cannot be told apart.
Source: Fuller 1987, "Measurement error models".
"""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects import State
from contactlearn.inference.identification.joint import FitOptions, JointFit
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import derivative, resolve

_TOLD = 1.0  # standard errors of a sum over all trials that dilution may amount to


def diluted(impacts: Impacts, fit: JointFit, options: FitOptions) -> Float[Tensor, "n 3 k"]:
    """Compute whitened changes of v_post by errors that v_pre tells; none where its noise is known to the fit.

    Components of v_pre count whose errors, if as large as the residual, could be seen over so many trials.
    """
    none = torch.zeros(len(impacts), 3, 0, dtype=torch.float64)
    if options.known(impacts).noise is not None or options.target != "velocity":
        return none
    centred = impacts.v_pre - impacts.v_pre.mean(0)
    told = len(impacts) * fit.scatter.diagonal() > _TOLD**2 * centred.square().mean(0)
    if not told.any():
        return none
    model, own = fit.model, [part.clone().requires_grad_() for part in impacts.v_pre.unbind(-1)]
    with torch.enable_grad():
        state = State.of(impacts).replace(v_pre=torch.stack(own, -1))
        slope = derivative(resolve(model.law, model.effects, state, *model.law.coefficients).v_post, own)
    columns = (slope[:, :, told, None] * (centred / centred.std(0).clamp_min(1e-300))[:, None, None]).flatten(2)
    return torch.linalg.solve_triangular(torch.linalg.cholesky(fit.scatter), columns, upper=False)
