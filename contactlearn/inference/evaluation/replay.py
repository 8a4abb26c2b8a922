"""Replays: the trajectories of recordings as models predict them from the state of a first flight.

    for replay in replays({"law": model}, tracked, ["rig"]):
        replay.errors("law")

A prediction starts with the flight before the first accepted contact of a recording, or with its first frames, and
knows nothing of what comes later.  Recorded poses are corrected as the impacts are.  Heights are above the floor that
the accepted contacts show, by the contact points that each model has.  Errors are those of Acosta, Yang & Posa, RA-L
2022: the mean over frames of the distance over the body's width, and of the angle.

A model whose contact scatters is also followed `FAN` times, its deviations drawn anew at every bounce, until the
contact after bounce `BOUNCES`.  Starts are drawn with the errors of the first flight, and for each trajectory the
floor's height with the scatter of heights of contacts and an acceleration in flight as flights of these recordings have
of their own.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import wrapped
from contactlearn.data.audit.corrections import correct
from contactlearn.data.recordings.flights import FlightModel
from contactlearn.data.recordings.poses import Array, away
from contactlearn.data.recordings.result import Reason, RecordedContact, SearchedTrack
from contactlearn.data.tracks import Tracked
from contactlearn.effects import find_effect
from contactlearn.mechanics.apparatus import REACH, Apparatus
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import displaced_pose, in_world, swept
from contactlearn.mechanics.shapes import Shape, Solid, contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.roll_out import Until

_BOUNCES = 1000  # after which a prediction ends
_MIN_CLEARANCE = 0.02  # widths above the floor from which on a flight is predicted
FAR = 0.1
"""Distance over the body's width from which on a prediction is lost."""
STARTS = ("flight", "frames")
"""Starts of predictions, see `replays`."""
_DIFFERENCES = 3  # of first frames
FAN = 59
"""Trajectories of a fan.  Between the third lowest and the third highest lie 90 % of others of its distribution."""
BOUNCES = 3
"""Bounces that fans follow."""
_AT_ONCE = 40  # recordings whose fans are followed together


@dataclass(frozen=True, kw_only=True, eq=False)
class Replay:
    """One recording and its predictions.

    Args:
        recording: its name.
        time: of the frames [T] in s, from the state that predictions start with.
        recorded: poses (x, y, θ) [T, 3], in space [T, 7], corrected, above the floor.
        predicted: poses by model.
        bounces: recorded contacts before each frame [T].
        shape: of the body.
        fans: poses by model whose contact scatters, of the first F frames, to the end of the last flight at most.
        noise: standard deviations of a frame's position in m.
    """

    recording: str
    time: Float[Tensor, "t"]
    recorded: Float[Tensor, "t pose"]
    predicted: dict[str, Float[Tensor, "t pose"]]
    bounces: Int[Tensor, "t"]
    shape: Shape
    fans: dict[str, Float[Tensor, "s f pose"]]
    noise: Float[Tensor, "d"]

    def band(self, model: str) -> Float[Tensor, "2 f d"]:
        """Return the lower and upper ends of the 90 % bands of recorded positions, noise of the frames included."""
        fan, generator = self.fans[model][..., : len(self.noise)], torch.Generator().manual_seed(0)
        seen = fan + self.noise * torch.randn(fan.shape, dtype=torch.float64, generator=generator)
        ends = (FAN + 1) // 20
        return seen.sort(0).values[[ends - 1, -ends]]

    def inside(self, model: str) -> Bool[Tensor, "f d"]:
        """Return which recorded positions lie within the bands."""
        low, high = self.band(model)
        recorded = self.recorded[: low.shape[0], : low.shape[1]]
        return (low <= recorded) & (recorded <= high)

    def errors(self, model: str) -> Float[Tensor, "t 2"]:
        """Return the distance over the body's width, and the angle in rad, of each frame."""
        predicted, recorded, d = self.predicted[model], self.recorded, 2 if self.recorded.shape[1] == 3 else 3
        distance = (predicted - recorded)[:, :d].norm(dim=-1) / width(self.shape)
        turn, true = predicted[:, d:], recorded[:, d:]
        if d == 2:
            return torch.stack((distance, wrapped(turn - true).abs()[:, 0]), -1)
        chord = torch.minimum((turn - true).norm(dim=-1), (turn + true).norm(dim=-1))  # of quaternions: 2 sin(angle/4)
        return torch.stack((distance, 4 * (chord / 2).arcsin()), -1)

    def lost_after(self, model: str) -> float:
        """Return the time in s until the distance first exceeds `FAR`; infinite if it never does."""
        far = (self.errors(model)[:, 0] > FAR).nonzero()
        return self.time[far[0, 0]].item() if len(far) else math.inf


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Mean, standard deviation and median over recordings."""

    mean: float
    deviation: float
    median: float


@dataclass(frozen=True, kw_only=True)
class ReplayErrors:
    """Errors of a model.

    Args:
        distance: over the body's width, mean over the frames of a recording.
        angle: in rad, likewise.
        lost_after: median time in s until the distance exceeds `FAR`; None where most predictions last to the end.
        coverage: shares of recorded positions within the 90 % bands of the fans after one bounce, after two and three;
            None of a model without scatter.
    """

    distance: Spread
    angle: Spread
    lost_after: float | None
    coverage: tuple[float, ...] | None = None

    @classmethod
    def of(cls, replays: Sequence[Replay], model: str) -> Self:
        """Return the errors of one model."""
        means = torch.stack([replay.errors(model).mean(0) for replay in replays])
        distance, angle = (
            Spread(mean=x.mean().item(), deviation=x.std(correction=0).item(), median=x.quantile(0.5).item())
            for x in means.unbind(-1)
        )
        lost = float(np.median([replay.lost_after(model) for replay in replays]))
        return cls(
            distance=distance,
            angle=angle,
            lost_after=lost if math.isfinite(lost) else None,
            coverage=tuple(coverage(replays, model).tolist()) if model in replays[0].fans else None,
        )


def coverage(replays: Sequence[Replay], model: str) -> Float[Tensor, "{BOUNCES}"]:
    """Return the share of recorded positions within the bands of a model after each bounce; NaN where there is none."""
    inside = torch.cat([replay.inside(model).double().mean(-1) for replay in replays])
    bounces = torch.cat([replay.bounces[: replay.fans[model].shape[1]] for replay in replays])
    return torch.stack([inside[bounces == k + 1].mean() for k in range(BOUNCES)])


def width(shape: Shape) -> float:
    """Return the width in m of a body along its x axis."""
    ahead = torch.eye(3 if isinstance(shape, Solid) else 2, dtype=torch.float64)[0]
    return (shape.support(ahead) - shape.support(-ahead))[0].item()


def replays(
    models: Mapping[str, ContactModel],
    tracked: Tracked,
    corrections: Sequence[str] = (),
    without: Collection[str] = (),
    *,
    start: str = STARTS[0],
) -> list[Replay]:
    """Predict the recordings that have an accepted contact after a flight from above the floor.

    Args:
        models: by name.
        tracked: recordings as they were searched.
        corrections: of the impacts, by name; they correct recorded poses as well.
        without: names of recordings to leave out.
        start: of the predictions: the fitted "flight" before the first accepted contact, or the first "frames" of the
            recording, with the median of three differences as velocity.

    Raises:
        DataError: no recording is left.
    """
    contacts = _contacts_by_recording(tracked, without)
    raw = tracked.impacts.replace(validate=False)
    impacts = correct(raw, corrections)
    shape = impacts.shape
    assert shape is not None
    assert not isinstance(shape, Mapping)  # recordings are of one body
    up = impacts.space.d - 1
    floor = (impacts.q[:, up] + impacts.r[:, up]).median()
    generator = np.random.default_rng(0)
    takes = [
        _Take.of(recording, contacts[recording.track.name], tracked.survey.model, start, generator)
        for recording in tracked.reload({*contacts})
    ]
    seen = correct(_as_impacts(raw, takes), corrections)
    poses = seen.q.clone()
    poses[:, up] -= floor
    starts = torch.tensor([0, *(len(take.pose) for take in takes)]).cumsum(0)[:-1]
    orientation = poses[starts, 2] if up == 1 else poses[starts, 3:]
    above = poses[starts, up] + contact_point(shape, orientation)[:, up] > _MIN_CLEARANCE * width(shape)
    kept, starts = [take for take, high in zip(takes, above, strict=True) if high], starts[above]
    if not kept:
        raise DataError(f"{tracked.path}: no recording has a flight from above the floor to an accepted contact")
    state = BodyState(
        pose=poses[starts],
        velocity=seen.v_pre[starts],
        mass=seen.mass[starts],
        inertia=seen.inertia[starts],
        shape=shape,
        object=impacts.object[0],
    )
    floors = {name: model.contact_heights(impacts).median() - floor for name, model in models.items()}
    models = _about_the_centre(models, impacts)
    predicted = _predicted(models, state, floors, [take.time for take in kept], tracked.rig)
    rows = starts[:, None] + torch.tensor([len(take.time) for take in kept])[:, None] + 1 + torch.arange(FAN)
    drawn = replace(state.repeated(FAN), pose=poses[rows].movedim(0, 1), velocity=seen.v_pre[rows].movedim(0, 1))
    fans = _fans(models, drawn, floors, [take.time[: take.followed] for take in kept], tracked, generator)
    return [
        Replay(
            recording=take.recording,
            time=torch.from_numpy(take.time),
            recorded=poses[start + 1 : start + 1 + len(take.time)],
            predicted={name: all_poses[k, : len(take.time)] for name, all_poses in predicted.items()},
            bounces=torch.from_numpy(take.bounces),
            shape=shape,
            fans={name: all_poses[k] for name, all_poses in fans.items()},
            noise=torch.from_numpy(take.sigma[: impacts.space.d]),
        )
        for k, (take, start) in enumerate(zip(kept, starts.tolist(), strict=True))
    ]


def _contacts_by_recording(
    tracked: Tracked, without: Collection[str]
) -> Mapping[str, list[tuple[int, RecordedContact]]]:
    """Accepted contacts and their rows by recording."""
    contacts = defaultdict[str, list[tuple[int, RecordedContact]]](list)
    for row, contact in enumerate(tracked.survey.contacts):
        if contact.recording not in without:
            contacts[contact.recording].append((row, contact))
    if not contacts:
        raise DataError(f"{tracked.path}: no recording is left that the model was not fitted to")
    return contacts


def _about_the_centre(models: Mapping[str, ContactModel], impacts: Impacts) -> Mapping[str, ContactModel]:
    """The models of a body whose mass centre the rig card has moved away from the middle of its shape."""
    offset = () if impacts.apparatus is None else impacts.apparatus.beside[: impacts.space.d]
    if not any(offset):
        return models
    rig = {"rig": find_effect("com_offset", "contact")().at([*map(torch.tensor, offset)])}

    def moved(model: ContactModel) -> ContactModel:
        if isinstance(model.base, ContactModel):
            return replace(model, base=moved(model.base))
        return replace(model, effects=rig | dict(model.effects), parameter_covariance=None)

    return {name: moved(model) for name, model in models.items()}


def _as_impacts(impacts: Impacts, takes: Sequence["_Take"]) -> Impacts:
    """Poses and velocities of recordings as impacts of the same body, which corrections take."""
    return impacts[torch.tensor([take.row for take in takes for _ in take.pose])].replace(
        q=torch.from_numpy(np.concatenate([take.pose for take in takes])),
        v_pre=torch.from_numpy(np.concatenate([take.velocity for take in takes])),
    )


def _predicted(
    models: Mapping[str, ContactModel],
    state: BodyState,
    floors: Mapping[str, Tensor],
    times: Sequence[Array],
    rig: Apparatus,
    accelerations: Float[Tensor, "s n d"] | None = None,
) -> dict[str, Float[Tensor, "... n t pose"]]:
    """Poses of bodies at times of their own, padded, by model above its floor; a body at rest stays there.

    With `accelerations` the contact scatters, and poses have a first axis of one.
    """
    time = pad_sequence([torch.from_numpy(one) for one in times], batch_first=True, padding_value=math.nan)
    friction = None if rig.friction is None else rig.friction.value
    drag = 0.0 if rig.drag is None or rig.drag.value < REACH * rig.drag.error else rig.drag.value
    predicted = {}
    for name, model in models.items():
        until = Until(bounces=_BOUNCES, time=time.nan_to_num(0).max().item())
        raised = torch.zeros(state.pose.shape[-1], dtype=torch.float64)
        raised[state.space.d - 1] = floors[name]
        above = replace(state, pose=state.pose - raised)
        random: dict[str, Any] = {}
        if accelerations is not None:
            generator = torch.Generator().manual_seed(0)
            random = {"acceleration": accelerations[None], "samples": 1, "generator": generator}
        path = model.roll_out(above, until=until, gravity=rig.gravity.value, drag=drag, friction=friction, **random)
        predicted[name] = path.at(torch.minimum(time, path.end[..., None])) + raised
    return predicted


def _fans(
    models: Mapping[str, ContactModel],
    drawn: BodyState,
    floors: Mapping[str, Tensor],
    times: Sequence[Array],
    tracked: Tracked,
    generator: np.random.Generator,
) -> dict[str, list[Float[Tensor, "s f pose"]]]:
    """Fans of each recording by model whose contact scatters, from drawn starts [FAN, N].

    The floor's height and an acceleration in flight are drawn for each trajectory; parameters are known well beside the
    scatter.
    """
    d = drawn.space.d
    raised = torch.zeros_like(drawn.pose)
    raised[..., d - 1] = torch.from_numpy(generator.normal(0.0, tracked.floor.scatter, (FAN, len(times))))
    sizes = np.array(tracked.survey.model.prior[0][:d])
    accelerations = torch.from_numpy(sizes * generator.standard_normal((FAN, len(times), d)))
    drawn = replace(drawn, pose=drawn.pose - raised)
    models = {
        name: replace(model, parameter_covariance=None) for name, model in models.items() if model.law_model.scatter
    }
    fans: dict[str, list[Tensor]] = {name: [] for name in models}
    for begin in range(0, len(times), _AT_ONCE) if models else ():
        rows = slice(begin, begin + _AT_ONCE)
        fields = ("pose", "velocity", "mass", "inertia", "order")
        starts = replace(drawn, **{name: getattr(drawn, name)[:, rows] for name in fields})
        for name, poses in _predicted(
            models, starts, floors, times[rows], tracked.rig, accelerations=accelerations[:, rows]
        ).items():
            poses = poses[0] + raised[:, rows, None]
            fans[name] += [poses[:, k, : len(time)] for k, time in enumerate(times[rows])]
    return fans


@dataclass(frozen=True, kw_only=True, eq=False)
class _Take:
    """A recording from a start on: row of its impact, T frames, and poses [1 + T + FAN, …].

    These are of the state, of the frames, and of states that are drawn with the errors of the first flight; `sigma` are
    the standard deviations of a frame.  The first frames, as many as `followed`, are those of a fan.
    """

    recording: str
    row: int
    time: Float[Array, "t"]
    pose: Float[Array, "n pose"]
    velocity: Float[Array, "n D"]
    bounces: Int[np.ndarray, "t"]
    sigma: Float[Array, "k"]
    followed: int

    @classmethod
    def of(
        cls,
        searched: SearchedTrack,
        contacts: Sequence[tuple[int, RecordedContact]],
        model: FlightModel,
        start: str,
        generator: np.random.Generator,
    ) -> Self:
        """Return the frames from the start until the body rests."""
        (row, first), track = contacts[0], searched.track
        flight = searched.flights[first.flight]
        seen = np.flatnonzero(track.seen)
        begin = float(track.time[flight.first if start == "flight" else seen[0]])
        rest = min(
            (part.time[0] for part in searched.refusals if part.reason is Reason.REST and part.time[0] > begin),
            default=math.inf,
        )
        frames = seen[(track.time[seen] >= begin) & (track.time[seen] <= rest)]
        time = track.time[frames]
        skipped = sum((hit.missing * track.step * (time > hit.time) for _, hit in contacts), np.zeros(len(time)))
        if start == "flight":
            first_pose, first_velocity, errors = flight.at(begin)
        else:
            first_pose, first_velocity = _differences(time, track.pose[frames], flight.air.gravity)
            errors = np.zeros(2 * [2 * len(first_velocity)])
        moved, faster = np.split(generator.multivariate_normal(np.zeros(len(errors)), errors, FAN), 2, 1)
        fan = displaced_pose(torch.from_numpy(first_pose), torch.from_numpy(moved))
        pose = torch.cat((torch.from_numpy(np.vstack((first_pose, track.pose[frames]))), fan))
        velocity = torch.zeros(len(pose), len(first_velocity), dtype=torch.float64)
        velocity[0], velocity[-FAN:] = torch.from_numpy(first_velocity), torch.from_numpy(first_velocity + faster)
        arm = in_world(torch.tensor(model.centre, dtype=torch.float64).expand(len(pose), -1), pose)
        d = arm.shape[1]  # flights and tracks are of the centre of mass, impacts of the tracked point
        pose[:, :d] -= arm
        velocity[:, :d] -= swept(arm, velocity[:, d:])
        ends = [later.last for later in searched.flights[first.flight :]]
        bounces = np.searchsorted(ends, frames)
        return cls(
            recording=track.name,
            row=row,
            time=time - begin + skipped,
            pose=pose.numpy(),
            velocity=velocity.numpy(),
            bounces=bounces,
            sigma=searched.sigma,
            followed=int((bounces <= min(BOUNCES, len(ends) - 1)).sum()),
        )


def _differences(time: Array, pose: Array, gravity: Sequence[float]) -> tuple[Float[Array, "pose"], Float[Array, "D"]]:
    """Pose of a first frame, and its velocity as the median of differences of the frames from there on."""
    first, d = slice(0, _DIFFERENCES + 1), len(gravity)
    step, middle = np.diff(time[first])[:, None], (time[first][1:, None] + time[first][:-1, None]) / 2 - time[0]
    moved = away(pose[first][1:], pose[first][:-1]) / step
    moved[:, :d] -= middle * gravity
    return pose[0], np.median(moved, 0)
