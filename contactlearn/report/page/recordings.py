"""The recordings behind some impacts as the data of a page: recordings.html.

A page shows at most `MOST` recordings: up to half of them are those with refused parts, and the others are spread
evenly over those with impacts.
"""

import json
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.result import REASONS, Found, Reason
from contactlearn.data.tracks import Tracked
from contactlearn.report.figures.tracks import standardised
from contactlearn.report.page.arrays import compressed
from contactlearn.report.page.page import render, save
from contactlearn.report.page.recording import of_recording
from contactlearn.report.page.sketches import sketch
from contactlearn.report.page.trials import digits
from contactlearn.report.text.numbers import number, percent
from contactlearn.report.text.tracks import refusals_by_reason, tracks_facts, tracks_headline

RECORDINGS = "recordings.html"
"""The page's name in a run folder."""
MOST = 200
"""Recordings on a page."""
SOURCES = tuple(
    f"contactlearn.{name}.load" for name in ("data.tracks", "simulation.recordings", "simulation.recordings_mujoco")
)
"""Of data: those that read recordings."""
_EDGE, _BINS, _FAR = 5, 50, 3  # of the histogram, in standard deviations


def write_recordings_page(path: Path, found: Tracked) -> Path:
    """Write the page of what was found in recordings, whole or not at all.

    Raises:
        DataError: the file cannot be written.
    """
    text = render(of_recordings(found), "recordings.html.j2", scripts=("recordings.js",))
    try:
        return save(path, text)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error}") from error


def has_recordings(config: Mapping[str, Any]) -> bool:
    """Whether a run with this configuration writes a page of its recordings."""
    data = config.get("data")
    return isinstance(data, Mapping) and data.get("_target_") in SOURCES


def of_recordings(found: Tracked) -> dict[str, Any]:
    """Return everything that the page of recordings says and draws; `block` holds the recordings."""
    contacts, refusals = defaultdict(list), defaultdict(list)
    for contact in found.survey.contacts:
        contacts[contact.recording].append(contact)
    for refusal in found.survey.refusals:
        refusals[refusal.recording].append(refusal)
    founds = _again(found, chosen(found))
    shown = [of_recording(one, contacts[name], refusals[name]) for name, one in founds.items()]
    scores = standardised([*founds.values()])
    return {
        "title": tracks_headline(found),
        "trials": None,
        "recordings": [
            {key: one[key] for key in ("name", "reasons")} | {"impacts": len(one["contacts"])} for one in shown
        ],
        "reasons": dict(REASONS),
        "outline": digits(found.shape.outline(91).T.tolist(), 5),
        "floor": _floor(found),
        "histogram": _histogram(scores),
        "block": compressed(_packed(shown)),
        "_facts": tracks_facts(found),
        "_limits": _limits(found, len(shown)),
        "_refusals": _reasons(found, shown),
        "_unread": [(r.recording, r.message) for r in found.survey.refusals if r.reason is Reason.NOT_READ],
        "_sketches": [
            sketch(one, refusals[name]) | {"recording": k}
            for k, (name, one) in enumerate(founds.items())
            if any(part.reason is not Reason.REST for part in refusals[name])
        ],
        "_residuals": _residuals(scores),
    }


def _packed(shown: Sequence[Mapping[str, Any]]) -> bytes:
    """JSON of the recordings; characters of a name that UTF-8 cannot hold become "?"."""
    return json.dumps(shown, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(errors="replace")


def chosen(found: Tracked, most: int = MOST) -> list[str]:
    """Name the recordings of a page: up to half have refused parts, the others are spread over those with impacts."""
    refusals = [one for one in found.survey.refusals if one.reason is not Reason.NOT_READ]
    first = [*dict.fromkeys(r.recording for r in refusals if r.reason is not Reason.REST)]
    first = _spread(first, most // 2)
    rest = [*dict.fromkeys(one.recording for one in (*found.survey.contacts, *refusals))]
    accepted = {one.recording for one in found.survey.contacts}.difference(first)
    second = _spread([name for name in rest if name in accepted], most - len(first))
    known = {*first, *second}
    third = [name for name in rest if name not in known]
    return [*first, *second, *third[: most - len(known)]]


def _spread(names: Sequence[str], most: int) -> list[str]:
    """At most so many names, evenly spread."""
    if len(names) <= most:
        return [*names]
    return [names[int(k)] for k in np.linspace(0, len(names) - 1, most).round()]


def _again(found: Tracked, names: Collection[str]) -> dict[str, Found]:
    """Tracks and flights by name, the first where two have one."""
    founds = dict[str, Found]()
    for one in found.again({*names}):
        founds.setdefault(one.track.name, one)
    return founds


def _floor(found: Tracked) -> dict[str, float]:
    """Height in m at x = 0, and slope in rad."""
    floor = found.floor
    return {"height": digits(floor.height.value, 6), "slope": digits(floor.slope.value if floor.slope else 0.0, 4)}


def _limits(found: Tracked, shown: int) -> str:
    """How many recordings are on the page, and which."""
    count = found.survey.recordings
    if shown >= count:
        return f"All {count} recordings are on this page."
    return (
        f"{shown} of {count} recordings are on this page: those with refused parts first, up to half of the page, "
        "and others with impacts, evenly spread."
    )


def _reasons(found: Tracked, shown: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Reasons of refusals: their key, words, number of parts, and number of recordings on the page."""
    return [
        {
            "key": str(reason),
            "words": REASONS[reason],
            "parts": count,
            "here": sum(reason in one["reasons"] for one in shown),
        }
        for reason, count in refusals_by_reason(found.survey.refusals)
    ]


def _histogram(scores: np.ndarray) -> list[list[float]]:
    """Densities of the standardised residuals of x, y and θ in bins from −5 to 5; what is beyond is in the last."""
    bins = np.linspace(-_EDGE, _EDGE, _BINS + 1)
    counts = [np.histogram(score.clip(-_EDGE, _EDGE), bins)[0] / max(len(score), 1) for score in scores.T]
    return [digits((count * _BINS / (2 * _EDGE)).tolist(), 4) for count in counts]


def _residuals(scores: np.ndarray) -> list[str]:
    """Standard deviation and share beyond three of them, of x, y and θ."""
    if not len(scores):
        return []
    return [
        f"{name}: standard deviation {number(float(score.std()), 3)}, {percent(float((abs(score) > _FAR).mean()), 2)} "
        f"beyond {_FAR}"
        for name, score in zip(("x", "y", "θ"), scores.T, strict=True)
    ]
