"""The replay command: trajectories that the models of a run predict, beside those of recordings."""

from pathlib import Path

from contactlearn.cli.checkpoints import load_models
from contactlearn.cli.commands.export import impacts_of_run
from contactlearn.cli.commands.impacts import find_recorded
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import DataError
from contactlearn.core.numerics import atomic_write
from contactlearn.core.serialisation import to_json
from contactlearn.inference.evaluation.replay import STARTS, ReplayErrors, replays
from contactlearn.report.figures import style
from contactlearn.report.figures.replays import bodies_figure, fan_figure, replay_figure
from contactlearn.report.page.page import REPLAY
from contactlearn.report.page.replays import write_replay_page
from contactlearn.report.text.replays import replay_sentence


def write_replay(run: str, source: SourceSettings, out: Path, start: str = STARTS[0]) -> str:
    """Predict recordings with the models of a run; return a summary, line by line.

    Args:
        run: a run folder or a checkpoint.
        source: `data` of a configuration of recordings.
        out: folder for replay.html, replay.json and the figures.
        start: of the predictions, see `contactlearn.inference.evaluation.replay.replays`.

    Raises:
        ContactLearnError: no model, or a setting that is missing.
        DataError: see `contactlearn.data.tracks.find_impacts`; or a file cannot be written.
    """
    models = {name: one.model for name, one in load_models([run], ()).items()}
    tracked, fitted = find_recorded(source), impacts_of_run(run)
    names = {contact.recording for contact in tracked.survey.contacts}
    known = set[str]() if fitted is None else names & {name.rpartition("#")[0] for name in fitted.trial}
    some = known != names
    shown = replays(models, tracked, source.corrections, without=known if some else (), start=start)
    errors = {name: ReplayErrors.of(shown, name) for name in models}
    begin = "the flight before their first accepted contact" if start == STARTS[0] else "their first frames"
    said = f"{len(shown)} of {tracked.survey.recordings} recordings, from {begin}"
    if known:
        said += f"; {len(known)} to which the run was fitted are left out" if some else "; the run was fitted to them"
    elif fitted is None:
        said += "; the model may have been fitted to some of them"
    try:
        out.mkdir(parents=True, exist_ok=True)
        with atomic_write(out / "replay.json") as part:
            part.write_text(to_json(errors), encoding="utf-8")
        style.save(replay_figure(shown), out, "replay")
        last = [*models][-1]
        ordered = sorted(shown, key=lambda one: one.errors(last)[:, 0].mean().item())
        style.save(bodies_figure(ordered[len(ordered) // 2]), out, "bodies")
        for model in shown[0].fans:
            name = "fan" if len(shown[0].fans) == 1 else f"fan_{model}"
            style.save(fan_figure(shown, ordered[len(ordered) // 2], model), out, name)
        page = write_replay_page(out / REPLAY, shown, errors, said)
    except OSError as error:
        raise DataError(f"{out}: cannot be written: {error.strerror}") from None
    lines = [f"  {name}: {replay_sentence(one)}" for name, one in errors.items()]
    return "\n".join([said, *lines, f"report: {page}"])
