"""The centre of mass is not where it was thought to be."""

from abc import abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State, columns, perpendicular
from contactlearn.mechanics.rigid_body import rotate


@dataclass(frozen=True, eq=False)
class ComOffset(Effect):
    """The centre of mass lies (δ_a, δ_b) from the assumed one, along the body's axes: d = R(θ) (δ_a, δ_b).

        tracked    r → r − d,  v → v + ω ẑ × d, and back after contact: the tracked point was taken for the centre
        contact    r → r − d: velocities are those of the centre, and the contact point was computed from another

    The moment of inertia is taken to be about the centre of mass already.
    """

    source = "calibration"
    mirror_symmetric = False
    last = True
    delta_a: Tensor | float = parameter("δ_a", "m", -0.02, 0.02)
    delta_b: Tensor | float = parameter("δ_b", "m", -0.02, 0.02)

    @abstractmethod
    def state(self, state: State) -> State:
        """Return the state about the centre of mass."""

    def shift(self, state: State) -> Tensor:
        """Return d [..., N, 2] in m, in world axes."""
        return rotate(columns(torch.as_tensor(self.delta_a), torch.as_tensor(self.delta_b)), state.theta)


@dataclass(frozen=True, eq=False)
class ComOffsetTracked(ComOffset):
    """The tracked velocity is that of another point, too.  It is no shift of the contact alone (`ComOffsetContact`)."""

    form = "tracked"
    formula = "d = R(θ) (δ_a, δ_b); (r, v) ← (r − d, v + ω ẑ × d)"
    in_words = "the centre of mass lies {delta_a} from the tracked point along the body's x and {delta_b} along its y"
    adds_energy = True

    def state(self, state: State) -> State:
        d = self.shift(state)
        velocity = state.v_pre[..., :2] + state.omega[..., None] * perpendicular(d)
        return state.replace(
            r=state.r - d,
            v_pre=columns(*velocity.unbind(-1), state.omega),
            offset=d if state.offset is None else state.offset + d,
        )


@dataclass(frozen=True, eq=False)
class ComOffsetContact(ComOffset):
    """Only the lever arm is another one.  The velocities are those of the centre of mass (`ComOffsetTracked`)."""

    form = "contact"
    formula = "d = R(θ) (δ_a, δ_b); r ← r − d"
    in_words = "the centre of mass lies {delta_a} from the assumed one along the body's x and {delta_b} along its y"

    def state(self, state: State) -> State:
        return state.replace(r=state.r - self.shift(state))
