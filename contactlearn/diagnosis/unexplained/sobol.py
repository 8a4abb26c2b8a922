"""Total Sobol indices of a prediction: the part of its variance that goes if a variable is another trial's.

Everything else stays the trial's own.  Source: Jansen 1999.
"""

from collections.abc import Callable, Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result.remainder import VariableShare

_PERMUTATIONS = 2


def total_indices(
    predict: Callable[[Float[Tensor, "b m d"]], Float[Tensor, "b m o"]],
    x: Float[Tensor, "b m d"],
    groups: Mapping[str, Sequence[int]],
    generator: torch.Generator,
) -> Float[Tensor, "g o"]:
    """Compute the mean square change of each output by each variable, in the outputs' units squared.

    Args:
        predict: the outputs at inputs.
        x: inputs of the trials of each fold.
        groups: columns of each variable, which move together.
        generator: of the other trials.
    """
    here, found = predict(x), []
    for _ in range(_PERMUTATIONS):
        other = x[:, torch.randperm(x.shape[1], generator=generator)]
        for columns in groups.values():
            changed = x.clone()
            changed[..., columns] = other[..., columns]
            found.append((predict(changed) - here).square().mean((0, 1)))
    return torch.stack(found).unflatten(0, (_PERMUTATIONS, len(groups))).mean(0)


def variable_shares(
    groups: Mapping[str, Sequence[int]], total: Float[Tensor, " g"], least: float
) -> tuple[VariableShare, ...]:
    """Return the shares of the variables in their sum, the largest first, without those below the least."""
    each = zip(groups, (total / total.sum().clamp_min(1e-300)).tolist(), strict=True)
    ordered = sorted(each, key=lambda item: -item[1])
    return tuple(VariableShare(symbol=name, share=x) for name, x in ordered if x >= least)
