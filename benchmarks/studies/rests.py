"""Studies of bodies at rest: whether the zero of θ that they tell is called off."""

import math
from dataclasses import dataclass, replace

import numpy as np

from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.floor import find_floor, find_rests
from contactlearn.data.recordings.result import Found, Hit, Reason
from contactlearn.simulation.recordings import simulate
from studies.cases import between
from studies.flights import BODY, CAMERAS, flat
from studies.study import AllThresholds, Row, Study, each

_CONTACTS = 12  # too few to tell the zero without bodies at rest


@dataclass(frozen=True, eq=False, kw_only=True)
class Lain:
    """A few contacts, and tracks that end at rest."""

    contacts: tuple[Hit, ...]
    found: tuple[Found, ...]


def _lain(kind: str, seed: int) -> Lain:
    """Nine recordings: all lie flat, the zero of θ is off in all, or some lean against something or lie on a book."""
    recordings, _ = simulate(9, CAMERAS["noisy" if seed % 2 else "plain"], seed=seed)
    turned, found = math.radians(between(1, 4, seed)) * (kind == "turned"), list[Found]()
    for k, recording in enumerate(recordings):
        one = find_contacts(flat(recording))
        off = np.array((0.0, 0.0, turned))
        if kind == "propped" and k < 4:
            off += (0.0, between(1e-4, 0.02, seed + k), math.radians(between(2, 40, seed + k)))
        track = replace(one.track, pose=one.track.pose + off)
        contacts = tuple(replace(hit, pose=hit.pose + np.array((0.0, 0.0, turned))) for hit in one.contacts)
        found.append(replace(one, track=track, contacts=contacts))
    return Lain(contacts=tuple(hit for one in found for hit in one.contacts)[:_CONTACTS], found=tuple(found))


def _called(lain: Lain, thresholds: AllThresholds) -> bool:
    """Whether the zero of θ is said to be off."""
    rests = [
        rest
        for one in lain.found
        for rest in find_rests(
            one.track, [r.time for r in one.refusals if r.reason is Reason.REST], one.sigma, thresholds.tracks.rest
        )
    ]
    zero = find_floor(lain.contacts, BODY, rests, limits=thresholds.tracks.floor).orientation
    return zero is not None and abs(zero.value) > 3 * zero.error


RESTS = Study(
    name="bodies at rest", null=each(12, "flat", "propped"), planted=each(24, "turned"), prepare=_lain, alarm=_called
)

ROWS = (
    Row(field="tracks.rest.moves", values=(0.2, 0.5, 1.5, 4.0, 15.0), study=RESTS),
    Row(field="tracks.rest.lasts", values=(0.1, 0.2, 0.3, 0.8, 1.3), study=RESTS),
    Row(field="tracks.floor.rests_of_a_zero", values=(2, 4, 6, 8, 12), study=RESTS),
    Row(field="tracks.floor.leaning", values=tuple(math.radians(x) for x in (1, 3, 10, 30, 90)), study=RESTS),
)
