"""Events of a run: reported by long tasks, written to the run folder, and read there by another process."""

import msgspec
import pytest
from commands import SMALL, TRAIN, run
from diagnoses import few
from observers import RecordingObserver

from contactlearn.diagnosis import events
from contactlearn.diagnosis.events import EffectsFound, RemainderLearned, TaskProgress, append_event, read_events, track
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.report.events import event_lines
from contactlearn.simulation import hidden_effects


def test_a_long_task_reports_its_first_and_last_step_and_some_between(monkeypatch):
    quick, every = RecordingObserver(), RecordingObserver()
    assert list(track(iter("abc"), "letters", quick)) == ["a", "b", "c"]
    assert [(one.done, one.total) for one in quick] == [(0, None), (3, 3)]
    monkeypatch.setattr(events, "_INTERVAL", -1.0)
    assert list(track("abc", "letters", every)) == ["a", "b", "c"]
    assert [(one.done, one.total) for one in every] == [(0, 3), (1, 3), (2, 3), (3, 3), (3, 3)]


def test_a_file_of_events_is_read_as_the_same_events_while_it_is_written(tmp_path):
    impacts, truth = hidden_effects.draw(7, effects=["magnetic_pull"], size=60)
    recorded, path = RecordingObserver(), tmp_path / events.FILE

    def on_event(event):
        recorded(event)
        append_event(path, event)

    diagnose(impacts, truth["law"], candidates=few("surface_tilt"), laws=[], on_event=on_event)
    assert read_events(path) == recorded
    assert [type(one).__name__ for one in recorded if not isinstance(one, TaskProgress)] == [
        "AuditFindings", "LawsCompared", "LimitsEstimated", "RegionsFound", "EffectsFound", "RemainderLearned",
    ]  # fmt: skip
    assert [line.partition(":")[0] for line in event_lines(recorded[0])] == ["audit"]
    assert recorded.of(EffectsFound)
    assert recorded.of(RemainderLearned)
    with path.open("ab") as file:
        file.write(b'{"event": "Task')
    assert read_events(path) == recorded
    path.write_bytes(b'{"event": "Unknown"}\n')
    with pytest.raises(msgspec.ValidationError, match="Unknown"):
        read_events(path)
    assert read_events(tmp_path / "none") == []


@pytest.mark.parametrize(
    ("command", "words", "task"), [("train.py", TRAIN, "held-out trials"), ("evaluate.py", SMALL, "every trial")]
)
def test_a_run_folder_holds_the_progress_of_its_run(command, words, task, tmp_path):
    run(command, *words, f"hydra.run.dir={tmp_path / 'run'}")
    tasks = [one for one in read_events(tmp_path / "run" / events.FILE) if one.task == task]
    assert (tasks[0].done, tasks[-1].done) == (0, tasks[-1].total)
