"""What a diagnosis said of a set, and its score."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from fourth_hand import sets
from fourth_hand.laboratory import Scene
from fourth_hand.meanings import KNOWN, SEQUENCE
from third_hand.judge import Said, hear


def ask(name: str, seconds: float) -> dict:
    """Read the file of a set and write down what the diagnosis says of it, within so many seconds."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.csv")
        sets.write(sets.draw(name), path)
        columns = {column.removesuffix("_pre"): column for column in sets.BEFORE}
        outlines = {f"body{k}": body.shape for k, body in enumerate(sets.SETS[name].bodies, 1)}
        return hear(path, outlines, seconds, columns)


@dataclass(frozen=True, kw_only=True)
class Score:
    """Answers to the questions of a set; None where a question is not asked of it.

    `unknown`: the verdict is that something is unknown, where something is; `false_unknown`: it is, where nothing is.
    `sentence`: what is said of the sequence has the right coefficient and what it follows, where it follows something.
    `first`: the first name is the known effect.  `silent`: no name is given.
    """

    unknown: bool | None = None
    sentence: bool | None = None
    first: bool | None = None
    silent: bool | None = None
    false_unknown: bool | None = None


def score(said: Said) -> Score:
    """Compare an answer with what is hidden."""
    scene, unknown = sets.SETS[said.name], said.verdict == "unknown"
    return Score(
        unknown=unknown if scene.unknown else None,
        sentence=_sentence(scene, said) if along(scene) else None,
        first=said.effects[:1] != [] and said.effects[0] in KNOWN[scene.known.what] if scene.known else None,
        silent=None if scene.effects else not said.effects,
        false_unknown=None if scene.unknown else unknown,
    )


def along(scene: Scene) -> bool:
    """Whether something unknown follows the sequence of the trials."""
    return scene.unknown is not None and scene.unknown.what in SEQUENCE


def _sentence(scene: Scene, said: Said) -> bool:
    right, told = SEQUENCE[scene.unknown.what], said.succession
    if told is None or told["coefficient"] != right.coefficient or told["follows"] not in right.follows:
        return False
    return told["follows"] != "period" or abs(told["trials"] / right.period - 1) < 0.05
