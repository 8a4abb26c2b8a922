"""What laws give at one impact, and all that they can give: the numbers of Fig. 2.3, and of its counterpart in space.

    ImpulseSpace   one impact in the plane: admissible impulses, measurement, bound, impulse and reach of each law
    SlipDiagram    one impact in space: the slip before and after contact by each law, and Routh's path between them
    LawImpulses    many impacts: impulses and reach of each law, or paths and ends of the slip
    ScatterCloud   many similar impacts in one impulse space: measured, and as a model draws them

Slips are in the axes of the slip before contact: along it, and across.  The figure number is that of Fazeli et al.
(2017); source of the path: Keller (1986).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.inference.evaluation.bounds import irb
from contactlearn.inference.evaluation.reach import Cells, reached_cells, reached_nodes
from contactlearn.inference.identification.result import Box
from contactlearn.laws import Law
from contactlearn.laws.contact import SpatialContact
from contactlearn.laws.hodograph import Hodograph, after_impulse
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts, Prediction, measured_impulse
from contactlearn.mechanics.space import SPACE
from contactlearn.models.contact_model import ContactModel

_CLOUDS, _SIMILAR, _CLOUD = 3, 30, 30  # incidences, impacts of a cloud, and draws of each
_STEPS, _PAGE_STEPS = 24, 12  # of a path of the slip, in a figure and for every trial of a page


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulseSpace:
    """One impact in impulse space; impulses in N s.

    Args:
        trial: the impact, in the plane.
        laws: at their identified parameters.
        ellipse: boundary of the energy ellipse.
        measured: the measured impulse.
        bound: the impulse of the IRB bound (norm `mass`) of a measurement that is not admissible, else None.
        reaches: cells of the impulses that laws can give, see `reach.reached_cells`: of all laws, or of the first few.
        predicted: impulse of each law.
    """

    trial: Impacts
    laws: tuple[Law, ...]
    ellipse: Float[Tensor, "n 2"]
    measured: Float[Tensor, "2"]
    bound: Float[Tensor, "2"] | None
    reaches: tuple[Cells, ...]
    predicted: Float[Tensor, "laws 2"]

    @classmethod
    def of(
        cls,
        trial: Impacts,
        laws: Mapping[str, Law],
        box: Box | None = None,
        *,
        target: str = "momentum",
        reached: int | None = None,
    ) -> "ImpulseSpace":
        """Compute what laws give one impact, and can give it with any (μ, ε) in a box.

        Args:
            trial: one impact.
            laws: at their identified parameters, by name.
            box: the parameters that a law may take; μ and ε in [0, 1] if left out.
            target: the measured impulse, see `impacts.measured_impulse`.
            reached: number of laws whose reach is computed; all if left out.

        Raises:
            ContactLearnError: no laws.
        """
        if not laws:
            raise ContactLearnError("an impulse space needs at least one law, got none")
        W, v_c, measured = trial.W[0], trial.v_c[0], measured_impulse(trial, target)[0]
        inside = bool(rigid_body.admissible(W, v_c, measured))
        every = tuple(laws.values())
        return cls(
            trial=trial,
            laws=every,
            ellipse=rigid_body.energy_ellipse(W, v_c),
            measured=measured,
            bound=None if inside else irb(trial).wrench[0, :2],
            reaches=tuple(reached_cells(law, W, v_c, box or Box()) for law in every[:reached]),
            predicted=torch.stack([law.impulse(W, v_c) for law in every]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipDiagram:
    """The slip of one impact in space before and after contact; all in m/s.

    Args:
        laws: at their identified parameters.
        before: slip before contact.
        path: Routh's path of the slip at the friction of the first law.
        ends: slip after contact by each law.
        measured: slip after contact.
        bound, predicted: by the IRB bound and by a further model; None without that model.
    """

    laws: tuple[Law, ...]
    before: Float[Tensor, "2"]
    path: Float[Tensor, "steps 2"]
    ends: Float[Tensor, "laws 2"]
    measured: Float[Tensor, "2"]
    bound: Float[Tensor, "2"] | None
    predicted: Float[Tensor, "2"] | None

    @classmethod
    def of(cls, trial: Impacts, laws: Mapping[str, Law], prediction: Prediction | None = None) -> "SlipDiagram":
        """Compute the slip of one impact by laws at their identified parameters, and by a further model."""
        every = tuple(laws.values())

        def after(v_post: Tensor) -> Tensor:
            return slip_after(trial, v_post)[..., 0, :]

        return cls(
            laws=every,
            before=after(trial.v_pre),
            path=slip_paths(trial, every[0])[0],
            ends=after(torch.stack([ContactModel(law).predict(trial).v_post for law in every])),
            measured=after(trial.v_post),
            bound=None if prediction is None else after(irb(trial).v_post),
            predicted=None if prediction is None else after(prediction.v_post),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LawImpulses:
    """What laws give at N impacts, and can give.

    Args:
        laws: at their fitted parameters, by name.
        arrays: in the plane `impulse` [L, N, 2] in N s, `ellipse` [N, 4, 2], the vectors of
            `rigid_body.ellipse_vectors`, and of `reach.reached_nodes` `reach` [L, N, A, B, 2] and `torn`
            [L, N, A − 1, B − 1]; in space the `path` of the slip at each law's friction and its `end` in m/s.
        first: the first impact.
    """

    laws: Mapping[str, Law]
    arrays: Mapping[str, Tensor]
    first: ImpulseSpace | SlipDiagram

    @classmethod
    def of(cls, impacts: Impacts, laws: Mapping[str, Law]) -> "LawImpulses":
        """Compute all arrays of laws at their fitted parameters."""
        first = impacts[[0]]
        if impacts.space is SPACE:
            v_post = torch.stack([ContactModel(law).predict(impacts).v_post for law in laws.values()])
            paths = torch.stack([slip_paths(impacts, law, _PAGE_STEPS) for law in laws.values()])
            arrays = {"path": paths, "end": slip_after(impacts, v_post)}
            return cls(laws=laws, arrays=arrays, first=SlipDiagram.of(first, laws))
        W, v_c = impacts.W, impacts.v_c
        reach, torn = zip(*(reached_nodes(law, W, v_c) for law in laws.values()), strict=True)
        arrays = {
            "impulse": torch.stack([law.impulse(W, v_c).detach() for law in laws.values()]),
            "ellipse": rigid_body.ellipse_vectors(W, v_c),
            "reach": torch.stack(reach),
            "torn": torch.stack(torn),
        }
        return cls(laws=laws, arrays=arrays, first=ImpulseSpace.of(first, laws, reached=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatterCloud:
    """Impulses of K similar impacts in the plane of slip and normal, carried into the energy ellipse of one of them.

    An impulse keeps its place in the ellipse: ‖Lᵀ (P − centre)‖ over the radius, W = L Lᵀ.  The tangential impulse is
    along the slip.  In space the ellipse is the section of the ellipsoid without an impulse across the slip.  All in
    N s.

    Args:
        incidence: slip over approach of the one.
        ellipse: its boundary.
        vectors: centre and chords, see `rigid_body.ellipse_vectors`.
        measured: impulses [K, 2].
        expected: of the model without deviations [K, 2].
        drawn: with deviations of the contact and noise of the instrument [S, K, 2].
    """

    incidence: float
    ellipse: Float[Tensor, "points 2"]
    vectors: Float[Tensor, "4 2"]
    measured: Float[Tensor, "k 2"]
    expected: Float[Tensor, "k 2"]
    drawn: Float[Tensor, "s k 2"]

    @classmethod
    def along(cls, model: ContactModel, impacts: Impacts) -> list["ScatterCloud"]:
        """Return clouds of measured impacts at several incidences, from steep to shallow."""
        d, generator = impacts.space.d, torch.Generator().manual_seed(0)
        plane = [0, d - 1]
        turn = impacts.slip_axes[:, :d, :d].mT[:, plane]
        slip = rigid_body.matvec(turn, impacts.v_c)[:, :1]
        turn = torch.cat((torch.where(slip < 0, -1.0, 1.0)[..., None] * turn[:, :1], turn[:, 1:]), 1)
        W, v_c = turn @ impacts.W @ turn.mT, rigid_body.matvec(turn, impacts.v_c)
        features = torch.stack((-v_c[:, 0] / v_c[:, 1], W[:, 0, 1] / W[:, 1, 1], W[:, 0, 0] / W[:, 1, 1]), 1)
        places = (torch.arange(_CLOUDS, dtype=torch.float64) + 0.5) / _CLOUDS
        scale = features.quantile(0.75, 0) - features.quantile(0.25, 0)
        middle = features.median(0).values.repeat(_CLOUDS, 1)
        middle[:, 0] = features[:, 0].quantile(places)
        apart = ((features - middle[:, None]) / scale.clamp_min(1e-9)).norm(dim=-1)
        return [
            cls._about(model, impacts[rows], turn[rows], W[rows], v_c[rows], generator)
            for rows in apart.argsort(-1)[:, :_SIMILAR]
        ]

    @classmethod
    def _about(
        cls, model: ContactModel, some: Impacts, turn: Tensor, W: Tensor, v_c: Tensor, generator: torch.Generator
    ) -> "ScatterCloud":
        """The cloud in the ellipse of the first of some impacts."""
        drawn = model.scattered(some, generator, _CLOUD).v_post
        if model.noise is not None:
            unit = torch.randn(drawn.shape, dtype=torch.float64, generator=generator)
            variances, axes = torch.linalg.eigh(model.noise)  # 0 of what is the same in all trials, as in bounces
            root = axes * variances.clamp_min(0).sqrt()
            drawn = drawn + rigid_body.matvec(some.slip_axes @ root, unit)
        root, centre = torch.linalg.cholesky(W).mT, -rigid_body.matvec(rigid_body.effective_inertia(W), v_c)
        radius = (-(centre * v_c).sum(-1)).sqrt()
        carry = torch.linalg.inv(root[:1]) @ root * (radius[0] / radius)[:, None, None]

        def carried(v_post: Tensor) -> Tensor:
            P = rigid_body.matvec(turn, some.mass[:, None] * (v_post - some.v_pre)[..., : some.space.d])
            return centre[0] + rigid_body.matvec(carry, P - centre)

        return cls(
            incidence=(-v_c[0, 0] / v_c[0, 1]).item(),
            ellipse=rigid_body.energy_ellipse(W[0], v_c[0]),
            vectors=rigid_body.ellipse_vectors(W[0], v_c[0]),
            measured=carried(some.v_post),
            expected=carried(model.outcome(some).v_post),
            drawn=carried(drawn),
        )


def slip_after(impacts: Impacts, v_post: Float[Tensor, "*batch n 6"]) -> Float[Tensor, "*batch n 2"]:
    """Slip [..., N, 2] of the contact point with a velocity of the body, along the slip before contact and across."""
    v_c = rigid_body.contact_velocity(impacts.r, v_post)
    return rigid_body.matvec(impacts.slip_axes.mT[:, :2, :2], v_c[..., :2])


def slip_paths(impacts: Impacts, law: Law, steps: int = _STEPS) -> Float[Tensor, "n {steps}+1 2"]:
    """Routh's path of the slip [N, steps + 1, 2] in m/s at the friction of a law, up to its normal impulse."""
    contact, _ = SpatialContact.of(impacts.W, impacts.v_c)
    path, P_n = Hodograph(contact, law.coefficients[0].to(impacts.mass)), law.impulse(impacts.W, impacts.v_c)[:, 2]
    shares = torch.linspace(0, 1, steps + 1, dtype=torch.float64).to(P_n)
    points = [path.followed(path.start(), after_impulse(share * P_n)) for share in shares]
    return torch.stack([torch.stack((point.v_1, point.v_2), -1) for point in points], 1)
