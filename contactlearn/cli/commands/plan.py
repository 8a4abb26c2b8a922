"""The commands plan and measure: a plan to files, and planned drops in a simulated laboratory.

plan.csv     a row a drop, in shown units, in the order in which to make them
plan.json    everything: the rig, the drops, the forecast, the diagnoses so far
plan.png     the drops over what the rig sets
plan.html    the page
"""

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import pandas as pd
import torch

from contactlearn.cli.commands.export import refuse_existing
from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.commands.trained import is_one_value
from contactlearn.cli.settings import PlanSettings, SourceSettings
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.core.numerics import atomic_write, wrapped
from contactlearn.core.serialisation import from_json, to_json
from contactlearn.data import table
from contactlearn.data.blocks import joined
from contactlearn.diagnosis.record import Record
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.mechanics.bodies import shapes_entries
from contactlearn.mechanics.impacts import Impacts
from contactlearn.planning.design import plan
from contactlearn.planning.measurement import Measures, carry_out
from contactlearn.planning.result import Plan, PlannedDrop, Purpose
from contactlearn.planning.rig import ANGLES, Rig, Specimen, settings_of
from contactlearn.report.figures import style
from contactlearn.report.figures.plan import plan_figure
from contactlearn.report.page.plan import PLAN, write_plan_page
from contactlearn.report.terminal import relative
from contactlearn.report.text.plan import plan_summary, setting
from contactlearn.results.folder import read_result
from contactlearn.results.types import DiagnosisRun
from contactlearn.simulation import hidden_effects
from contactlearn.simulation.hidden_effects.drops import Laboratory
from contactlearn.simulation.mujoco import Bench, EngineLaboratory, Hidden

_JSON, _CSV = "plan.json", "plan.csv"
_MYSTERY, _MUJOCO = "contactlearn.simulation.hidden_effects.load", "contactlearn.simulation.mujoco.load"
_DROP, _FOR, _BODY = "drop", "for", "body"
_REACHED, _NEAR = 5.0, 0.02  # standard deviations of a setting, and share of its limits, within which a drop has it
_SAME_DROPS = 0.9  # share of the drops of a plan in a row of trials from which on they are these


def write_plan(settings: PlanSettings, run: Path | None, out: Path, *, force: bool, data: Sequence[str] = ()) -> str:
    """Plan the next drops and write the plan; return a summary, line by line.

    Args:
        settings: of the command.
        run: folder of a diagnosis.
        out: folder for the files.
        force: whether a plan that is there is replaced.
        data: words of the command line that name the data, for the command that comes next; a run has its own.

    Raises:
        ContactLearnError: nothing to plan for, or several; see also `contactlearn.planning.design.plan`.
        DataError: a file that cannot be read or written.
    """
    refuse_existing([out / _JSON], force)
    before = None if settings.after is None else read_plan(Path(settings.after))
    given = {"a run": run, "body": settings.body, "data": settings.data}
    named = [name for name, one in given.items() if one is not None]
    if len(named) != 1:
        seen = " and ".join(named) or "none of them"
        raise ContactLearnError(f"a plan is for a run of diagnose, for body={{…}}, or for data=NAME; got {seen}")
    if run is None:
        known, source = settings.body or _known(settings.data), settings.data and settings.data.target
    else:
        diagnosed = _diagnosed(run)
        known = replace(diagnosed.diagnosis, record=Record.load(run))
        data = [word for word in shlex.split(diagnosed.use) if word.startswith(("data=", "data."))]
        source = diagnosed.provenance.config.get("data", {}).get("_target_")
    chosen = plan(
        known,
        _rig(settings, before),
        goal=settings.goal,
        count=settings.count,
        budget=settings.budget,
        looks=() if before is None else before.looks,
        seed=settings.seed,
    )
    impacts = known.record and known.record.impacts if isinstance(known, Diagnosis) else known
    measured = settings_of(impacts) if isinstance(impacts, Impacts) else {}
    try:
        out.mkdir(parents=True, exist_ok=True)
        with atomic_write(out / _CSV) as part:
            _frame(chosen).to_csv(part, index=False)
        style.save(plan_figure(chosen, measured), out, "plan")
        page = write_plan_page(out / PLAN, chosen, measured)
        with atomic_write(out / _JSON) as part:
            part.write_text(to_json(chosen), encoding="utf-8")
    except OSError as error:
        raise DataError(f"{out}: cannot be written: {error.strerror}") from None
    drops = f"drops: {relative(out / _CSV)}" + (", if you want to go on all the same" if chosen.stop else "")
    lines = [*plan_summary(chosen), drops, f"report: {relative(page)}"]
    if chosen.stop is None:
        lines.append(f"next: {_next_command(source, relative(out), data)}")
    return "\n".join(lines)


def _next_command(source: str | None, out: Path, data: Sequence[str]) -> str:
    """The command that goes on from a plan: it measures the drops, or reads what was measured of them.

    The source of a body is None.
    """
    if source is None:
        words = ["init", "drops.csv", "--name", "mydata"]
    elif source in (_MYSTERY, _MUJOCO):
        words = ["measure", str(out), *data, "-o", "drops.csv"]
    else:
        words = ["diagnose", *(word for word in map(_for_more, data) if word)]
    return shlex.join(["contactlearn", *words])


def _for_more(word: str) -> str:
    """A setting of a diagnosis for its data with more impacts, in which what it averaged may vary."""
    key, _, names = word.partition("=")
    if key != "data.correct":
        return word
    kept = [name for name in names.strip("[]").split(",") if not name.strip().startswith("averaged_")]
    return f"{key}=[{','.join(kept)}]" if kept else ""


def write_measured(path: Path, source: SourceSettings, out: Path, *, again: bool = False) -> str:
    """Measure planned drops in a laboratory, `data=mystery` or `data=mujoco`, and add them to a table.

    Args:
        path: folder of a plan, or a file in it.
        source: `data` of a configuration.
        out: a .csv or .parquet file, whose impacts go on if it is there.
        again: whether drops that are there already are made and added once more.

    Returns:
        A summary, line by line.

    Raises:
        ContactLearnError: another source of data, no seed, or drops that are there already.
        DataError: a plan or a table that cannot be read, or a plan in space.
    """
    table.check_suffix(out)
    if source.target not in (_MYSTERY, _MUJOCO):
        raise ContactLearnError(
            "planned drops are measured in the laboratory of data=mystery or data=mujoco; other data are measured"
            " already"
        )
    body, laboratory = _laboratory(source)
    folder = path.parent if path.is_file() else path
    planned = read_plan(folder)
    drops, rig = _drops(folder / _CSV, planned), Rig(limits=planned.rig)
    before = table.load(out, body.shape) if out.exists() else None
    if before is not None and not again and (trials := _measured_already(drops, planned, before)):
        raise ContactLearnError(
            f"{out} holds the drops of {folder} already, as trials {trials[0]} to {trials[1]}; plan the next ones with "
            f"contactlearn plan RUN after={folder}, or add these once more with --again"
        )
    first = 1 if before is None else len(before) + 1
    generator = torch.Generator().manual_seed(int(source.options["seed"]) + first)
    named = [PlannedDrop(settings=drop.settings, purpose=drop.purpose, body=body.name) for drop in drops]
    measured = carry_out(rig, named, [body], laboratory, generator=generator, first=first)
    if before is not None:
        _require_same_fields(before, measured, out)
    every = measured if before is None else joined([before, measured])
    table.save(every, out)
    if source.target == _MYSTERY:
        hidden_effects.load(**{key: source.options[key] for key in ("seed", "size", "folder", "scatter")})
    shape = json.dumps(shapes_entries(body.shape)).replace('"', "")
    command = f"contactlearn diagnose data=table data.path={out} 'data.shape={shape}'"
    lines = [f"{len(measured)} drops measured, {len(every)} impacts in {out}"]
    known = {"the plan": next(iter(planned.bodies.values()), None)}
    known |= {} if before is None else {str(out): Specimen.of(before)[0].moments}
    lines += [f"note: {one}" for one in _other_body(known, body)]
    return "\n".join([*lines, f"next: {command}"])


def _require_same_fields(before: Impacts, measured: Impacts, out: Path) -> None:
    """Refuse drops that have what a table has not, such as a pose after contact, or lack what it has."""
    fields = (*before.space.components, *before.space.covariances)
    other = [name for name in fields if (getattr(before, name) is None) != (getattr(measured, name) is None)]
    if other:
        raise ContactLearnError(
            f"{out} is of another laboratory: only one of the two has {', '.join(other)}; choose another file"
        )


def _measured_already(drops: list[PlannedDrop], planned: Plan, before: Impacts) -> tuple[str, str] | None:
    """First and last of the trials in a row that had the settings of the drops, nearly all of them; None if none."""
    count, values = len(drops), settings_of(before)
    if len(before) < count:
        return None
    close = torch.ones(len(before) - count + 1, count, dtype=torch.bool)
    for name, one in planned.rig.items():
        if one.settable and name in values:
            wanted = torch.tensor([drop.settings[name] for drop in drops], dtype=torch.float64)
            off = values[name].unfold(0, count, 1) - wanted
            off = wrapped(off) if name in ANGLES else off
            reach = _REACHED * (one.precision + one.share * wanted.abs()) + _NEAR * (one.high - one.low)
            close &= off.abs() <= reach
    share, first = close.double().mean(1).max(0)
    return (before.trial[first], before.trial[first + count - 1]) if share >= _SAME_DROPS else None


def _other_body(known: Mapping[str, tuple[float, ...] | None], body: Specimen) -> Iterator[str]:
    """Yield that the body of the plan, or of the table, is not the laboratory's."""
    for what, moments in known.items():
        if moments and not all(is_one_value(*sorted(pair)) for pair in zip(moments, body.moments, strict=True)):
            there, here = (
                f"{mass:.3g} kg, {', '.join(f'{x:.3g}' for x in rest)} kg m²" for mass, *rest in (moments, body.moments)
            )
            yield f"{what} is for another body, of {there}: the laboratory's has {here}"


def read_plan(folder: Path) -> Plan:
    """Read the plan of a folder.

    Raises:
        DataError: no plan is there, or it is damaged.
    """
    try:
        return from_json(Plan, (folder / _JSON).read_bytes())
    except OSError:
        raise DataError(f"{folder}: holds no {_JSON}; give a folder that contactlearn plan wrote") from None
    except ContactLearnError as error:
        raise DataError(f"{folder / _JSON}: is damaged: {error}") from None


def _rig(settings: PlanSettings, before: Plan | None) -> Rig:
    """The rig of the settings, on top of that of the plan before."""
    known = {} if before is None else before.rig
    noise = settings.noise or (() if before is None else before.noise)
    return Rig(limits=known | dict(settings.rig), noise=noise)


def _diagnosed(run: Path) -> DiagnosisRun:
    result = read_result(run / "diagnosis.json") if (run / "diagnosis.json").exists() else None
    if not isinstance(result, DiagnosisRun):
        raise ContactLearnError(f"{run}: holds no diagnosis; give the folder of a run of diagnose")
    return result


def _known(source: SourceSettings | None) -> Impacts | Specimen:
    """Measured impacts, or the body of a laboratory."""
    assert source is not None  # one of the three is given
    return _laboratory(source)[0] if source.target in (_MYSTERY, _MUJOCO) else load_data(source).impacts


def _laboratory(source: SourceSettings) -> tuple[Specimen, Measures]:
    """A simulated laboratory, and the body in it as it is reported."""
    source.refuse_missing()
    given = source.options
    if source.target == _MYSTERY:
        own = Laboratory.of(given["seed"], scatter=given["scatter"])
        return Specimen(mass=own.mass, inertia=own.inertia, shape=own.shape, name="ellipse"), own
    hidden = Hidden(**{one.name: given[one.name] for one in fields(Hidden)})
    named = {one.name: given[one.name] for one in fields(Bench) if one.name != "hidden"}
    bench = Bench(**named, hidden=hidden)
    sigma = torch.tensor([given[f"{what}_noise"] for what in ("velocity", "velocity", "spin")], dtype=torch.float64)
    body = Specimen(mass=bench.mass, inertia=bench.nominal_inertia, shape=bench.body, name=bench.kind)
    return body, EngineLaboratory(bench=bench, sigma=sigma)


# --- The table of drops ---------------------------------------------------------------------------


def _header(name: str) -> str:
    _, unit, _ = setting(name)
    return f"{name} [{unit}]"


def _frame(chosen: Plan) -> pd.DataFrame:
    """The drops in shown units."""
    names = [name for name, one in chosen.rig.items() if one.settable]
    rows = [
        {_DROP: number, _BODY: drop.body}
        | {_header(name): round(drop.settings[name] * setting(name)[2], 6) for name in names}
        | {_FOR: drop.purpose.value}
        for number, drop in enumerate(chosen.drops, 1)
    ]
    return pd.DataFrame(rows)


def _drops(path: Path, planned: Plan) -> list[PlannedDrop]:
    """The drops of a table that `_frame` made, and that a person may have changed."""
    try:
        frame = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    names = [name for name, one in planned.rig.items() if one.settable]
    for column in map(_header, names):
        if column not in frame:
            raise UnknownNameError(f"column of {path}:", column, list(frame.columns))
        if bad := next((row for row, x in enumerate(pd.to_numeric(frame[column], errors="coerce"), 1) if x != x), None):
            raise DataError(f"{path}: row {bad}, column {column}: must be a number", row=bad, column=column)
    return [
        PlannedDrop(
            settings={name: float(row[_header(name)]) / setting(name)[2] for name in names},
            purpose=Purpose(row[_FOR]) if row.get(_FOR) in [*Purpose] else Purpose.SPACE,
            body=str(row.get(_BODY, "body")),
        )
        for _, row in frame.iterrows()
    ]
