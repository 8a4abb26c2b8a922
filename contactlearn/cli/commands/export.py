"""A model of a run as a file for use elsewhere."""

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import torch

from contactlearn.cli.checkpoints import TrainedModel, load_model
from contactlearn.cli.commands.trained import is_one_value
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.core.numerics import atomic_write, number
from contactlearn.diagnosis.record import Record
from contactlearn.effects import State
from contactlearn.mechanics.bodies import contact_points, make_shapes
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel, actual_coefficients, actual_state
from contactlearn.models.export import mujoco, onnx, source
from contactlearn.report.text.names import label
from contactlearn.simulation import mujoco as mujoco_drops, synthetic

TARGETS = {"numpy": ".py", "jax": ".py", "torch": ".py", "c": ".c", "onnx": ".onnx", "mujoco": ".xml", "json": ".json"}
"""Suffix of the file by what it is for."""

_ROWS = 10  # of the self-test
_JUDGED = 300  # impacts at most by which a scene is judged


def export_model(
    run: str, to: str, out: str | None, data: Impacts | None, *, without_residual: bool, force: bool
) -> str:
    """Write a model; return what was written, in a line or two.

    Args:
        run: a run folder or a checkpoint.
        to: one of `TARGETS`.
        out: the file; impact.c or the like in this folder if None.
        data: impacts of the body, for its shape and for the self-test; those of the run if None.
        without_residual: whether processes are left out.
        force: whether files that are there are replaced.

    Raises:
        ContactLearnError: the model has no such form, or the file cannot be written.
    """
    if to not in TARGETS:
        raise UnknownNameError("target of --to", to, TARGETS)
    trained = load_model(run)
    model = source.without_residual(trained.model) if without_residual else trained.model
    path = Path(out or f"impact{TARGETS[to]}")
    if path.suffix != TARGETS[to]:
        raise ContactLearnError(f"--to {to} writes a {TARGETS[to]} file, got {path}")
    known = data or impacts_of_run(run)
    said = ["without the Gaussian processes that correct it"] if model is not trained.model else []
    texts = dict[Path, str | bytes]()
    if model.scatter and to == "onnx":
        said.append("without the scatter of the contact, which a graph cannot draw")
    if to == "json":
        texts[path] = json.dumps(model.constants(), indent=2, ensure_ascii=False) + "\n"
    elif to == "onnx":
        texts[path] = onnx.graph(model, known or _made_up(trained))
    elif to == "mujoco":
        texts, notes = _scene(path, model, (known or _made_up(trained, measured=True))[:_JUDGED])
        said += notes
    else:
        texts[path] = source.source_code(model, to, (known or _made_up(trained))[:_ROWS])
    refuse_existing(texts, force)
    for file, text in texts.items():
        try:
            with atomic_write(file) as part:
                part.write_bytes(text if isinstance(text, bytes) else text.encode())
        except OSError as error:
            raise DataError(f"{file}: cannot be written: {error.strerror}") from None
    return "\n".join([str(model), *said, f"written to {' and '.join(map(str, texts))}"])


def _scene(path: Path, model: ContactModel, judged: Impacts) -> tuple[dict[Path, str | bytes], list[str]]:
    """The files of a MuJoCo scene, and what there is to say about it."""
    scene, hook = mujoco.export(model, judged)
    texts: dict[Path, str | bytes] = {path: scene.xml()}
    said = list[str]()
    if hook is not None:
        texts[path.with_name(f"{path.stem}_hook.py")] = hook
        why = "the contact scatters" if model.scatter else "coefficients depend on the state"
        said.append(f"{why}: call set_contact(model, data) of the hook before each step")
    if model.scatter:
        table = mujoco.ranges(model.physical, judged)
        texts[path.with_name(f"{path.stem}_ranges.json")] = json.dumps(table, indent=2, ensure_ascii=False) + "\n"
        spans = []
        for name, one in table["quantities"].items():
            unit = "" if one["unit"] == "–" else f" {one['unit']}"
            spans.append(f"{label(name)} {number(one['low'], 3)} to {number(one['high'], 3)}{unit}")
        said.append(f"ranges of 90 % for randomisation: {', '.join(spans)}")
    if model.recorded:
        recorded, physical = (one.predict(judged).v_post for one in (model, model.physical))
        said.append(
            f"without {' and '.join(model.recorded)}: of the recording, which no simulator has (recorded outcomes "
            f"change by {mujoco.difference(recorded, physical, judged):.1%})"
        )
    said.append(_differs(model.physical, scene, judged))
    return texts, said


def refuse_existing(files: Iterable[str | os.PathLike[str]], force: bool) -> None:
    """Raise for a file that would be replaced without a word.

    Raises:
        ContactLearnError: it is there, and `force` is not given.
    """
    for file in () if force else files:
        if Path(file).exists() and not Path(file).is_file():
            raise ContactLearnError(f"{file} is no regular file; give the name of one, with its suffix")
        if Path(file).exists():
            raise ContactLearnError(f"{file} is there already and is not replaced; choose another name, or add --force")


def _differs(model: ContactModel, scene: mujoco.Scene, impacts: Impacts) -> str:
    """By how much MuJoCo's outcomes differ from the model's, if the engine is here."""
    state = actual_state(model.effects, State.of(impacts))
    try:
        outcomes = mujoco_drops.outcomes(
            scene, impacts, actual_coefficients(model.effects, state, *model.law.coefficients)
        )
    except ContactLearnError as missing:
        return f"by how much a spring and a dashpot differ from {model.law.name} is not known: {missing}"
    ended = outcomes.isfinite().all(-1)
    share = mujoco.difference(model.predict(impacts).v_post[ended], outcomes[ended], impacts[ended])
    return (
        f"MuJoCo's contact is a spring and a dashpot; its outcomes differ from those of {model.law.name} by "
        f"{share:.1%} ({int(ended.sum())} impacts)"
    )


def impacts_of_run(run: str) -> Impacts | None:
    """Return the impacts that a run folder holds, those of a diagnosis; None if it holds none."""
    folder = Path(run) if Path(run).is_dir() else Path(run).parent
    return Record.load(folder).impacts if (folder / "record.npz").exists() else None


def _made_up(trained: TrainedModel, *, measured: bool = False) -> Impacts:
    """Simulated drops of the body of the training: of its shape, or of none, its mass and its moment of inertia.

    Raises:
        DataError: the body is in space; or is `measured`, and its mass or moment of inertia is not known, or several.
    """
    if trained.provenance is not None and trained.provenance.data.space != PLANE.name:
        raise DataError(f"the impacts that {trained.path} was fitted to are in space; give its data: data=…")
    data = {} if trained.provenance is None else trained.provenance.config.get("data")
    shape = make_shapes(data.get("shape")) if isinstance(data, dict) else None
    body = next(iter(shape)) if isinstance(shape, Mapping) else "body"
    drops = synthetic.load(_ROWS).replace(shape=shape, object=(body,) * _ROWS, validate=False)
    if shape is not None:
        drops = drops.replace(r=contact_points(shape, drops.body, drops.q[:, 2]))
    seen = None if trained.provenance is None else trained.provenance.data
    pairs = [pair for pair in (() if seen is None else (seen.mass, seen.inertia)) if pair and is_one_value(*pair)]
    if len(pairs) == 2:
        mass, inertia = (torch.full_like(drops.mass, sum(pair) / 2) for pair in pairs)
        return drops.replace(mass=mass, inertia=inertia)
    if measured:
        raise DataError(
            f"{trained.path}: the mass and the moment of inertia of one body are not known here; give its data: data=…"
        )
    return drops
