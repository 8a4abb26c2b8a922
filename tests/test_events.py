"""Events of a run: reported by long tasks, written to the run folder, and read there by another process."""

import msgspec
import pytest
from observers import RecordingObserver

from contactlearn.core.events import TaskProgress, track
from contactlearn.diagnosis import events
from contactlearn.diagnosis.events import append_event, read_events
from contactlearn.inference.learning.events import RoundScored


def test_a_long_task_reports_its_first_and_last_step_and_some_between(monkeypatch):
    quick, every = RecordingObserver(), RecordingObserver()
    assert list(track(iter("abc"), "letters", quick)) == ["a", "b", "c"]
    assert [(one.done, one.total) for one in quick] == [(0, None), (3, 3)]
    monkeypatch.setattr("contactlearn.core.events._INTERVAL", -1.0)
    assert list(track("abc", "letters", every)) == ["a", "b", "c"]
    assert [(one.done, one.total) for one in every] == [(0, 3), (1, 3), (2, 3), (3, 3), (3, 3)]


def test_a_file_of_events_is_read_while_it_is_written(tmp_path):
    path, recorded = tmp_path / events.FILE, [TaskProgress(task="letters", done=1, total=3)]
    append_event(path, recorded[0])
    assert read_events(path) == recorded
    with path.open("ab") as file:
        file.write(b'{"event": "Task')
    assert read_events(path) == recorded
    path.write_bytes(b'{"event": "Unknown"}\n')
    with pytest.raises(msgspec.ValidationError, match="Unknown"):
        read_events(path)
    assert read_events(tmp_path / "none") == []


def test_rounds_of_older_runs_are_read(tmp_path):
    """They name their model as well."""
    path = tmp_path / events.FILE
    event = RoundScored(trained_on=9, round=1, errors={"mass_error": 0.5}, negative_log_density=1.0)
    append_event(path, event)
    path.write_bytes(path.read_bytes().replace(b'"trained_on"', b'"model":"x1_wrench","trained_on"'))
    assert b"x1_wrench" in path.read_bytes()
    assert read_events(path) == [event]
