"""One recording as data of a page: its frames, flights with their residuals, contacts, and refused parts.

Positions are in m, residuals in mm, angles in degrees; frames that the tracker lost are left out.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from contactlearn.core.numerics import measured
from contactlearn.data.recordings.flights import Flight, Indices
from contactlearn.data.recordings.result import REASONS, Found, Hit, Reason, Refusal
from contactlearn.data.recordings.track import Array, Track, turn
from contactlearn.report.page.trials import digits
from contactlearn.report.text.numbers import number, percent
from contactlearn.report.text.tracks import refusal_number

FRAMES = 1500
"""Frames of a recording on a page, at most."""
_LINE = 25  # points of a flight's line
_DEGREES = 180 / math.pi
_SHOWN = np.array((1.0, 1.0, _DEGREES))  # m, m and degrees
_FINE = np.array((1e3, 1e3, _DEGREES))  # mm, mm and degrees


def of_recording(found: Found, contacts: Sequence[Hit], refusals: Sequence[Refusal]) -> dict[str, Any]:
    """Return all that a page says and draws of one recording.

    Args:
        found: its track and flights.
        contacts: accepted ones.
        refusals: of its parts.
    """
    track, kept = found.track, _kept(found)
    pose = _nearest(found)
    return {
        "name": track.name,
        "said": _said(found, len(contacts), len(kept)),
        "reasons": [*dict.fromkeys(refusal.reason.value for refusal in refusals)],
        "step": digits(track.step),
        "time": digits(track.time[kept].tolist(), 7),
        "pose": digits((_SHOWN * pose[kept]).T.round(6).tolist(), 6),
        "flights": [_flight(track, flight, pose, kept) for flight in found.flights],
        "contacts": [*map(_contact, contacts)],
        "refused": [_refused(refusal) for refusal in refusals],
    }


def _kept(found: Found) -> Int[Indices, " k"]:
    """Frames that are shown: those about the flights, and only every n-th where these are too many."""
    track, flights = found.track, found.flights
    first, last = (flights[0].first, flights[-1].last) if flights else (0, len(track) - 1)
    room = max(0, FRAMES - (last - first + 1)) // 2
    frames = np.arange(max(0, first - room), min(len(track), last + 1 + room))
    frames = frames[track.seen[frames]]
    return frames[:: max(1, math.ceil(len(frames) / FRAMES))]


def _nearest(found: Found) -> Float[Array, "t 3"]:
    """Poses of the frames; those of a flight are within half a turn of its line."""
    pose = found.track.pose.copy()
    for flight in found.flights:
        line = _line(found.track, flight, found.track.time[flight.frames])
        pose[flight.frames, 2] = line[:, 2] + turn(flight.residual[:, 2])
    return pose


def _line(track: Track, flight: Flight, time: Float[Array, " n"]) -> Float[Array, "n 3"]:
    """Poses of a flight, moved by whole turns to where the track has it."""
    there = track.pose[flight.frames, 2] - flight.poses(track.time[flight.frames])[:, 2]
    turns = round(float(np.median(there)) / (2 * math.pi))
    return flight.poses(time) + np.array((0.0, 0.0, 2 * math.pi * turns))


def _flight(track: Track, flight: Flight, pose: Float[Array, "t 3"], kept: Int[Indices, " k"]) -> dict[str, Any]:
    """The line of a flight, and the residuals `residual` of the shown frames with the places `at`."""
    time = np.linspace(track.time[flight.first], track.time[flight.last], _LINE)
    both, at, own = np.intersect1d(kept, flight.frames, return_indices=True)
    residual = pose[both] - _line(track, flight, track.time[both])
    residual[:, :2] = flight.residual[own, :2]
    return {
        "time": digits(time.tolist(), 7),
        "line": digits((_SHOWN * _line(track, flight, time)).T.round(6).tolist(), 6),
        "at": at.tolist(),
        "residual": digits((_FINE * residual).T.round(4).tolist(), 3),
    }


def _contact(contact: Hit) -> dict[str, Any]:
    """A row of the table of contacts, the pose (m, m, rad), and the place of the flight before it."""
    errors = np.sqrt(contact.covariance.diagonal()).tolist()
    velocities = [*contact.v_pre.tolist(), *contact.v_post.tolist()]
    return {
        "name": contact.name,
        "time": digits(contact.time, 7),
        "pose": digits(contact.pose.tolist(), 7),
        "before": contact.flight,
        "cells": [
            measured(contact.time, errors[9]),
            *map(measured, velocities, errors),
            f"{contact.missing} ({percent(contact.certainty, 1)})",
            str(contact.lost),
            number(contact.apart, 2),
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


def _said(found: Found, contacts: int, shown: int) -> str:
    """How much a recording holds, and the noise of its frames."""
    track, frames = found.track, len(found.track)
    lost = frames - int(track.seen.sum())
    words = [
        f"{contacts} impacts" if contacts != 1 else "1 impact",
        f"{frames} frames in {number(float(track.time[-1] - track.time[0]), 3)} s"
        + (f", {lost} of them lost" if lost else "")
        + (f", {shown} of them shown" if shown < frames - lost else ""),
    ]
    if found.flights:
        x, y, angle = (_FINE * found.sigma).tolist()
        words.append(f"noise of a frame {number(x, 2)} and {number(y, 2)} mm, {number(angle, 2)}°")
    return "; ".join(words) + "."
