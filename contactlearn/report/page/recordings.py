"""The recordings behind some impacts as the data of a page: recordings.html.

    write_recordings_page   the page
    of_recordings           its data; `of_recording` has one recording, `sketch` a small picture of it

Positions are in m, residuals in mm, angles in degrees; frames that the tracker lost are left out.  Of a body in space
the angle is that from its first frame, of at most half a turn.
A page shows at most `MAX_RECORDINGS` recordings: up to half of them are those with refused parts, and the others are
spread evenly over those with impacts.
"""

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Int

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import measured
from contactlearn.data.recordings.flights import Flight, Indices
from contactlearn.data.recordings.poses import Array, away, turn
from contactlearn.data.recordings.result import REASONS, Reason, RecordedContact, Refusal, SearchedTrack
from contactlearn.data.recordings.track import Track
from contactlearn.data.tracks import Tracked
from contactlearn.mechanics.space import PLANE
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.tracks import residual_names, residuals_figure, standardised
from contactlearn.report.page.page import compressed, render, save
from contactlearn.report.page.trials import digits
from contactlearn.report.text.numbers import number, percent
from contactlearn.report.text.tracks import refusal_number, refusals_by_reason, tracks_facts, tracks_headline

Item = TypeVar("Item")
MAX_RECORDINGS = 200
"""Recordings on a page."""
FRAMES = 1500
"""Frames of a recording on a page, at most."""
_LINE = 25  # points of a flight's line
_DEGREES = 180 / math.pi
_PLANE = (("x", "m", "mm"), ("y", "m", "mm"), ("θ", "°", "°"))
_SPACE = (("x", "m", "mm"), ("y", "m", "mm"), ("z", "m", "mm"), ("angle", "°", "°"))
WIDTH, HEIGHT = 200, 70
"""Of a picture."""
_POINTS = 60  # frames of a picture, at most
_SKETCH_LINE = 8  # points of a flight's line
_MIN_WIDTH = 2.0  # width of a refused part
_FAR_SIGMAS = 3  # standard deviations of a residual


def write_recordings_page(path: Path, tracked: Tracked, searched: Iterable[SearchedTrack]) -> Path:
    """Write the page of what was found in recordings, whole or not at all.

    Args:
        path: of the page.
        tracked: what was found in all recordings.
        searched: the `shown_recordings` with their flights, from `Tracked.reload`.

    Raises:
        DataError: the file cannot be written.
    """
    text = render(of_recordings(tracked, searched), "recordings.html.j2", scripts=("recordings.js",))
    try:
        return save(path, text)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error.strerror}") from error


def of_recordings(tracked: Tracked, searched: Iterable[SearchedTrack]) -> dict[str, Any]:
    """Return everything that the page of recordings says and draws; `block` holds the recordings.

    The arguments are those of `write_recordings_page`.
    """
    contacts, refusals = defaultdict(list), defaultdict(list)
    for contact in tracked.survey.contacts:
        contacts[contact.recording].append(contact)
    for refusal in tracked.survey.refusals:
        refusals[refusal.recording].append(refusal)
    tracks = dict[str, SearchedTrack]()
    for one in searched:  # the first where two have one name
        tracks.setdefault(one.track.name, one)
    shown = [of_recording(one, contacts[name], refusals[name]) for name, one in tracks.items()]
    scores, floor, space = standardised([*tracks.values()]), tracked.floor, tracked.impacts.space
    outline = tracked.shape.outline(91).T.tolist()
    packed = json.dumps(shown, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return {
        "title": tracks_headline(tracked),
        "trials": None,
        "recordings": [
            {key: one[key] for key in ("name", "reasons")} | {"impacts": len(one["contacts"])} for one in shown
        ],
        "reasons": dict(REASONS),
        "coordinates": _PLANE if space is PLANE else _SPACE,
        "outline": digits([[None if math.isnan(x) else x for x in row] for row in outline], 5),
        "floor": {
            "height": digits(floor.height.value, 6),
            "slope": digits(floor.slope.value if floor.slope else 0.0, 4),
        },
        "figures": {"residuals": digits(as_plotly(residuals_figure([*tracks.values()])))},
        "block": compressed(packed.encode(errors="replace")),
        "_symbols": [f"{symbol}{when} ({unit})" for when in ("", "⁺") for symbol, unit in space.symbols.items()],
        "_freedom": space.D - 1,
        "_facts": tracks_facts(tracked),
        "_rig": tracked.rig.rows(),
        "_limits": _limits(tracked, len(shown)),
        "_refusals": _reasons(tracked, shown),
        "_unread": [(r.recording, r.message) for r in tracked.survey.refusals if r.reason is Reason.NOT_READ],
        "_sketches": [
            sketch(one, refusals[name]) | {"recording": k}
            for k, (name, one) in enumerate(tracks.items())
            if any(part.reason is not Reason.REST for part in refusals[name])
        ],
        "_residuals": _residuals(scores),
    }


def shown_recordings(tracked: Tracked) -> list[str]:
    """Name the recordings of a page: up to half have refused parts, the others are spread over those with impacts."""
    refusals = [refusal for refusal in tracked.survey.refusals if refusal.reason is not Reason.NOT_READ]
    first = [*dict.fromkeys(r.recording for r in refusals if r.reason is not Reason.REST)]
    first = spread(first, MAX_RECORDINGS // 2)
    rest = [*dict.fromkeys(one.recording for one in (*tracked.survey.contacts, *refusals))]
    accepted = {contact.recording for contact in tracked.survey.contacts}.difference(first)
    second = spread([name for name in rest if name in accepted], MAX_RECORDINGS - len(first))
    known = {*first, *second}
    third = [name for name in rest if name not in known]
    return [*first, *second, *third[: MAX_RECORDINGS - len(known)]]


def spread(items: Sequence[Item], most: int) -> list[Item]:
    """Return at most so many items, evenly spread."""
    if len(items) <= most:
        return [*items]
    return [items[int(k)] for k in np.linspace(0, len(items) - 1, most).round()]


def _limits(tracked: Tracked, shown: int) -> str:
    """How many recordings are on the page, and which."""
    count = tracked.survey.recordings
    if shown >= count:
        return f"All {count} recordings are on this page."
    return (
        f"{shown} of {count} recordings are on this page: those with refused parts first, up to half of the page, "
        "and others with impacts, evenly spread."
    )


def _reasons(tracked: Tracked, shown: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Reasons of refusals: their key, words, number of parts, and number of recordings on the page."""
    return [
        {
            "key": str(reason),
            "words": REASONS[reason],
            "parts": count,
            "here": sum(reason in one["reasons"] for one in shown),
        }
        for reason, count in refusals_by_reason(tracked.survey.refusals)
    ]


def _residuals(scores: np.ndarray) -> list[str]:
    """Standard deviation and share beyond three of them, of x, y and θ."""
    if not len(scores):
        return []
    return [
        f"{name}: standard deviation {number(float(score.std()), 3)}, "
        f"{percent(float((abs(score) > _FAR_SIGMAS).mean()), 2)} beyond {_FAR_SIGMAS}"
        for name, score in zip(residual_names(scores.shape[1]), scores.T, strict=True)
    ]


def of_recording(
    searched: SearchedTrack, contacts: Sequence[RecordedContact], refusals: Sequence[Refusal]
) -> dict[str, Any]:
    """Return all that a page says and draws of one recording.

    Args:
        searched: its track and flights.
        contacts: accepted ones.
        refusals: of its parts.
    """
    track, kept = searched.track, _kept(searched)
    pose = _nearest(searched)
    return {
        "name": track.name,
        "summary": _summary(searched, len(contacts), len(kept)),
        "reasons": [*dict.fromkeys(refusal.reason.value for refusal in refusals)],
        "step": digits(track.step),
        "time": digits(track.time[kept].tolist(), 7),
        "pose": digits(_shown(track, pose[kept]).T.round(6).tolist(), 6),
        "flights": [_flight(track, flight, pose, kept) for flight in searched.flights],
        "contacts": [*map(_contact, contacts)],
        "refused": [_refused(refusal) for refusal in refusals],
    }


def _kept(searched: SearchedTrack) -> Int[Indices, " k"]:
    """Frames that are shown: those about the flights, and only every n-th where these are too many."""
    track, flights = searched.track, searched.flights
    first, last = (flights[0].first, flights[-1].last) if flights else (0, len(track) - 1)
    room = max(0, FRAMES - (last - first + 1)) // 2
    frames = np.arange(max(0, first - room), min(len(track), last + 1 + room))
    frames = frames[track.seen[frames]]
    return frames[:: max(1, math.ceil(len(frames) / FRAMES))]


def _shown(track: Track, pose: Float[Array, "n m"]) -> Float[Array, "n c"]:
    """Coordinates of poses as they are drawn, in m and degrees."""
    if track.d == 2:
        return pose * (1.0, 1.0, _DEGREES)
    angle = np.linalg.norm(away(pose, track.pose[track.seen][:1])[:, 3:], axis=1)
    return np.column_stack((pose[:, :3], _DEGREES * angle))


def _nearest(searched: SearchedTrack) -> Float[Array, "t m"]:
    """Poses of the frames; those of a flight are within half a turn of its line."""
    pose = searched.track.pose.copy()
    if searched.track.d == 3:
        return pose
    for flight in searched.flights:
        line = _line(searched.track, flight, searched.track.time[flight.frames])
        pose[flight.frames, 2] = line[:, 2] + turn(flight.residual[:, 2])
    return pose


def _line(track: Track, flight: Flight, time: Float[Array, " n"]) -> Float[Array, "n m"]:
    """Poses of a flight, moved by whole turns to where the track has it."""
    if track.d == 3:
        return flight.poses(time)
    there = track.pose[flight.frames, 2] - flight.poses(track.time[flight.frames])[:, 2]
    turns = round(float(np.median(there)) / (2 * math.pi))
    return flight.poses(time) + np.array((0.0, 0.0, 2 * math.pi * turns))


def _flight(track: Track, flight: Flight, pose: Float[Array, "t m"], kept: Int[Indices, " k"]) -> dict[str, Any]:
    """The line of a flight, and the residuals `residual` of the shown frames with the places `at`."""
    time = np.linspace(track.time[flight.first], track.time[flight.last], _LINE)
    both, at, own = np.intersect1d(kept, flight.frames, return_indices=True)
    residual = _shown(track, pose[both]) - _shown(track, _line(track, flight, track.time[both]))
    residual[:, : track.d] = 1e3 * flight.residual[own, : track.d]
    return {
        "time": digits(time.tolist(), 7),
        "line": digits(_shown(track, _line(track, flight, time)).T.round(6).tolist(), 6),
        "at": at.tolist(),
        "residual": digits(residual.T.round(4).tolist(), 3),
    }


def _contact(contact: RecordedContact) -> dict[str, Any]:
    """A row of the table of contacts, the pose (m, m, rad), and the place of the flight before it."""
    errors = np.sqrt(contact.covariance.diagonal()).tolist()
    velocities = [*contact.v_pre.tolist(), *contact.v_post.tolist()]
    return {
        "name": contact.name,
        "time": digits(contact.time, 7),
        "pose": digits(contact.pose.tolist(), 7),
        "before": contact.flight,
        "cells": [
            measured(contact.time, errors[-1]),
            *map(measured, velocities, errors),
            f"{contact.missing} ({percent(contact.certainty, 1)})",
            str(contact.lost),
            number(contact.chi_square, 2),
        ],
    }


def _refused(refusal: Refusal) -> dict[str, Any]:
    start, end = refusal.time
    return {
        "time": digits([start, end], 7),
        "reason": REASONS[refusal.reason],
        "number": refusal_number(refusal),
        "rest": refusal.reason is Reason.REST,
    }


def _summary(searched: SearchedTrack, contacts: int, shown: int) -> str:
    """How much a recording holds, and the noise of its frames."""
    track, frames = searched.track, len(searched.track)
    lost = frames - int(track.seen.sum())
    words = [
        f"{contacts} impacts" if contacts != 1 else "1 impact",
        f"{frames} frames in {number(float(track.time[-1] - track.time[0]), 3)} s"
        + (f", {lost} of them lost" if lost else "")
        + (f", {shown} of them shown" if shown < frames - lost else ""),
    ]
    if searched.flights:
        *across, up = (number(1e3 * one, 2) for one in searched.sigma[: track.d])
        angle = number(_DEGREES * float(searched.sigma[-1]), 2)
        words.append(f"noise of a frame {', '.join(across)} and {up} mm, {angle}°")
    return "; ".join(words) + "."


def sketch(searched: SearchedTrack, refusals: Sequence[Refusal]) -> dict[str, Any]:
    """Return the frames and flights as paths, the refused parts as bands, and the words of a small picture."""
    track, seen = searched.track, np.flatnonzero(searched.track.seen)
    frames = seen[np.linspace(0, len(seen) - 1, min(_POINTS, len(seen))).astype(int)]
    height = track.height[seen]
    left, span = float(track.time[0]), float(np.ptp(track.time))
    low, range_ = (float(height.min()), float(np.ptp(height)) or 1.0) if len(seen) else (0.0, 1.0)

    def placed(time: Float[Array, " n"], height: Float[Array, " n"]) -> list[str]:
        x, y = WIDTH * (time - left) / span, 3 + (HEIGHT - 6) * (1 - (height - low) / range_)
        return [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]

    axes, lines = "no frame was seen", []
    if len(seen):
        lowest, highest = (number(1e3 * float(end), 3) for end in (height.min(), height.max()))
        axes = f"time 0–{number(span, 2)} s, height {lowest} to {highest} mm"
    for flight in searched.flights:
        when = np.linspace(track.time[flight.first], track.time[flight.last], _SKETCH_LINE)
        lines.append("M" + "L".join(placed(when, flight.poses(when)[:, track.d - 1])))
    return {
        "name": track.name,
        "dots": "".join(f"M{point}h0" for point in placed(track.time[frames], track.height[frames])),
        "flights": "".join(lines),
        "bands": [_band(refusal, left, span) for refusal in refusals],
        "reasons": _counted_reasons(refusals),
        "axes": axes,
    }


def _band(refusal: Refusal, left: float, span: float) -> dict[str, Any]:
    start, end = (WIDTH * (time - left) / span for time in refusal.time)
    width, text = max(end - start, _MIN_WIDTH), f"{REASONS[refusal.reason]}: {refusal_number(refusal)}"
    place = {"x": round((start + end - width) / 2, 1), "width": round(width, 1)}
    return place | {"text": text, "rest": refusal.reason is Reason.REST}


def _counted_reasons(refusals: Sequence[Refusal]) -> list[str]:
    """Each reason once, with the number of its first part, and how many parts there are."""
    counts = dict[str, list[Refusal]]()
    for refusal in refusals:
        counts.setdefault(REASONS[refusal.reason], []).append(refusal)
    return [
        f"{reason}{f' ({len(ones)} times)' if len(ones) > 1 else ''}: {refusal_number(ones[0])}"
        for reason, ones in counts.items()
    ]
