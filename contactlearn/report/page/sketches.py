"""Small pictures of recordings, as the numbers of an SVG: height over time, with flights and refused parts."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from contactlearn.data.recordings.result import REASONS, Found, Reason, Refusal
from contactlearn.data.recordings.track import Array
from contactlearn.report.text.numbers import number
from contactlearn.report.text.tracks import refusal_number

WIDTH, HEIGHT = 200, 70
"""Of a picture."""
_POINTS = 60  # frames of a picture, at most
_LINE = 8  # points of a flight's line
_LEAST = 2.0  # width of a refused part


def sketch(found: Found, refusals: Sequence[Refusal]) -> dict[str, Any]:
    """Return the frames and flights as paths, the refused parts as bands, and the words of a small picture."""
    track, seen = found.track, np.flatnonzero(found.track.seen)
    frames = seen[np.linspace(0, len(seen) - 1, min(_POINTS, len(seen))).astype(int)]
    time, height = track.time[seen], track.pose[seen, 1]
    left, span = float(track.time[0]), float(np.ptp(track.time))
    low, range_ = (float(height.min()), float(np.ptp(height)) or 1.0) if len(seen) else (0.0, 1.0)

    def placed(time: Float[Array, " n"], height: Float[Array, " n"]) -> list[str]:
        x, y = WIDTH * (time - left) / span, 3 + (HEIGHT - 6) * (1 - (height - low) / range_)
        return [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]

    lines = []
    for flight in found.flights:
        when = np.linspace(track.time[flight.first], track.time[flight.last], _LINE)
        lines.append("M" + "L".join(placed(when, flight.poses(when)[:, 1])))
    return {
        "name": track.name,
        "dots": "".join(f"M{point}h0" for point in placed(track.time[frames], track.pose[frames, 1])),
        "flights": "".join(lines),
        "bands": [_band(refusal, left, span) for refusal in refusals],
        "reasons": _reasons(refusals),
        "axes": f"time 0–{number(span, 2)} s, height {_ends(height)} mm" if len(time) else "no frame was seen",
    }


def _band(refusal: Refusal, left: float, span: float) -> dict[str, Any]:
    start, end = (WIDTH * (time - left) / span for time in refusal.time)
    width = max(end - start, _LEAST)
    said = f"{REASONS[refusal.reason]}: {refusal_number(refusal)}"
    return {
        "x": round((start + end - width) / 2, 1),
        "width": round(width, 1),
        "said": said,
        "rest": refusal.reason is Reason.REST,
    }


def _reasons(refusals: Sequence[Refusal]) -> list[str]:
    """Each reason once, with the number of its first part, and how many parts there are."""
    counts = dict[str, list[Refusal]]()
    for refusal in refusals:
        counts.setdefault(REASONS[refusal.reason], []).append(refusal)
    return [
        f"{reason}{f' ({len(ones)} times)' if len(ones) > 1 else ''}: {refusal_number(ones[0])}"
        for reason, ones in counts.items()
    ]


def _ends(height: Float[Array, " n"]) -> str:
    low, high = (number(1e3 * float(end), 3) for end in (height.min(), height.max()))
    return f"{low} to {high}"
