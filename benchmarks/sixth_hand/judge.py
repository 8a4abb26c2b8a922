"""What a diagnosis said of a set, and its score."""

from typing import Any

from fifth_hand.judge import Truth, ask_of
from sixth_hand import sets
from sixth_hand.meanings import UNKNOWN
from third_hand.judge import Said

TRUTH = Truth({name: [one.what for one in scene.hidden] for name, scene in sets.SETS.items()}, UNKNOWN)


def ask(name: str, seconds: float) -> dict[str, Any]:
    """Read the file of a set and write down what the diagnosis says of it, within so many seconds."""
    bodies = sets.SETS[name].bodies.items()
    return ask_of(sets, name, {who: body.shape if name in sets.TOLD else None for who, body in bodies}, seconds)


def left_out(said: Said) -> list[str]:
    """Names that would only have stood for something unknown, and that the diagnosis does without."""
    told = (said.remainder or {}).get("modulation") or {}
    return [one["name"] for one in told.get("instead_of", ())]
