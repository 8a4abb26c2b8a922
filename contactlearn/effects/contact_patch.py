"""The contact is a patch, and its centre of pressure moves."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import Effect, parameter, require_positive
from contactlearn.effects.functions import ARM, Argument, Spline
from contactlearn.effects.impulse_path import perturbed_path, perturbed_path_in_space
from contactlearn.effects.state import State, altered, columns
from contactlearn.mechanics.space import SPACE


class ContactPatch(Effect):
    """The normal impulse acts at an arm to the right of the contact point: τ → τ + arm P_n.

        linear    c − k r_x
        curve     c + s(r_x), see `functions.Spline`
        after     c − k r_x, of the impulse that the law gives
        slip      −d sign(v_t), behind the contact point as the slip sees it
        point     c − k r_x, and the law acts at that point, with its velocity
        path      −k r_t in space
        lever     −k r_t in space, of the impulse that the law gives

    In all but `after`, `point` and `lever` the contact responds while it lasts, so that v_n⁺ stays (`perturbed_path`).
    It is not a resistance to rolling, which follows the spin (`rolling_resistance`).
    """

    place = "wrench"
    usual_range = ARM
    source = "finite contact area"
    mirror_symmetric = False
    adds_energy = True
    needs_lever = True
    like_shape = True


class _LinearArm(Frozen):
    """An arm c − k r_x."""

    in_words = "the normal impulse acts at an arm of {c} plus {k:-%} of r_x"
    k: Tensor | float = parameter("k", "–", -1.0, 1.0)
    c: Tensor | float = parameter("c", "m", -0.01, 0.01)

    def arm(self, state: State) -> Float[Tensor, "... n"]:
        """Return the arm in m."""
        return self.c - self.k * state.r[..., 0]


class LinearContactPatch(_LinearArm, ContactPatch):
    """The arm is c − k r_x.  It does not end at the edge of the patch (`ContactPatchCurve`)."""

    form = "linear"
    formula = "τ ← τ − k r_x P_n + c P_n while the contact lasts, P_t and P_n responding"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return perturbed_path(state, wrench, arm=self.arm(state))


class ContactPatchCurve(Spline, ContactPatch):
    """The arm is c + s(r_x).  It is not proportional to r_x (`LinearContactPatch`)."""

    formula = "τ ← τ + (c + s(r_x)) P_n while the contact lasts, a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    in_words = "is {c}, and changes by {c1}, {c2} and {c3} from knot to knot"
    argument = Argument("r_x", "m", lambda state: state.r[..., 0])
    c: Tensor | float = parameter("c", "m", -0.01, 0.01)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return perturbed_path(state, wrench, arm=self.c + self.change(state.r[..., 0]))


class ContactPatchAfter(_LinearArm, ContactPatch):
    """The arm is c − k r_x, and its moment is added to what the law gives.

    The contact does not respond to it (`LinearContactPatch`).
    """

    form = "after"
    formula = "τ ← τ − k r_x P_n + c P_n"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return altered(wrench, 2, self.arm(state) * wrench[..., 1])


class ContactPatchAtPoint(_LinearArm, ContactPatch):
    """r_x → r_x + c − k r_x: the law of contact acts at the centre of pressure, with the velocity of that point.

    The edge of the patch does not keep its own restitution (`LinearContactPatch`).
    """

    place = "state"
    form = "point"
    formula = "r_x ← r_x + c − k r_x, where the law acts"
    in_words = "the law acts at an arm of {c} plus {k:-%} of r_x"

    def state(self, state: State) -> State:
        r_x, r_y = state.r.unbind(-1)
        return state.replace(r=columns(r_x + self.c - self.k * r_x, r_y))


class ContactPatchBySlip(ContactPatch):
    """The arm is −d v_t/√(v_t² + v_s²): the pressure is higher at the trailing edge, or at the leading one for d < 0.

    It goes by the slip before contact and does not turn with it.  It does not follow the lever (`LinearContactPatch`).
    Source: Cross 2002.
    """

    form = "slip"
    formula = "τ ← τ − d sign(v_t) P_n while the contact lasts, smoothed, v_t the slip before contact"
    in_words = "the normal impulse acts at an arm of {d} against the slip"
    source = "Cross 2002"
    citations = ("cross2002",)
    mirror_symmetric = True
    needs_lever = False
    like_shape = False
    d: Tensor | float = parameter("d", "m", -0.01, 0.01)
    v_s: float = 0.1

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        smoothed = (state.v_t.square() + require_positive(self.v_s) ** 2).sqrt()
        return perturbed_path(state, wrench, arm=-self.d * state.v_t / smoothed)


class _AlongLever(Frozen):
    """An arm −k r_t along the floor, towards the mass centre for k > 0."""

    spaces = (SPACE,)
    mirror_symmetric = True
    in_words = "the normal impulse acts {k:%} of the lever along the floor nearer to the mass centre"

    k: Tensor | float = parameter("k", "–", -1.0, 1.0)

    def per_push(self, state: State) -> Float[Tensor, "... n 3"]:
        """dτ/dP_n in m: −k r_t × n."""
        r_x, r_y, _ = state.r.unbind(-1)
        return columns(-self.k * r_y, self.k * r_x, torch.zeros_like(r_x))


class ContactPatchInSpace(_AlongLever, ContactPatch):
    """The arm is −k r_t, and the contact responds.  It does not follow the spin (`rolling_resistance`)."""

    form = "path"
    formula = "τ ← τ − k r_t × n P_n while the contact lasts, P responding"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        per_push = self.per_push(state)

        def moment(spin: Float[Tensor, "3 ..."]) -> Float[Tensor, "3 ..."]:
            return per_push.expand(*spin.shape[1:], 3).movedim(-1, 0)

        return perturbed_path_in_space(state, wrench, self.values, moment=moment)


class ContactPatchAfterInSpace(_AlongLever, ContactPatch):
    """The arm is −k r_t, of the impulse that the law gives.  The contact does not respond (`ContactPatchInSpace`)."""

    form = "lever"
    formula = "τ ← τ − k r_t × n P_n"

    def wrench(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        return torch.cat((wrench[..., :3], wrench[..., 3:] + wrench[..., 2:3] * self.per_push(state)), -1)
