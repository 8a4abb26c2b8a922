"""The page of recordings: its numbers, its names, where it is written, and what it does in headless Chromium."""

import base64
import gzip
import html
import json
import re
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import nothing_sticks_out
from commands import run
from evaluations import provenance
from test_report_page import HOSTILE, data_of, draw_everything, into_view, opened, silent, until

from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.commands.record import save_recordings_page
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import tracks
from contactlearn.data.recordings.result import Reason
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.report.figures.tracks import standardised
from contactlearn.report.page.page import render, reproduced
from contactlearn.report.page.recordings import (
    FRAMES,
    MAX_RECORDINGS,
    of_recording,
    of_recordings,
    shown_recordings,
    write_recordings_page,
)
from contactlearn.report.text.tracks import tracks_facts, tracks_summary
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import MASS, SEMI_AXES, simulate, write_recordings

SHAPE = Ellipse(SEMI_AXES)
NAME = "<img src=x onerror=window.hacked=1>&amp;'{{ 7*7 }}"  # that a file may have
FIGURES = ("track", "body", "residuals")


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    """Recordings with lost frames, one that a hand holds at first, names that try to be markup, and a broken file."""
    folder = tmp_path_factory.mktemp("takes")
    write_recordings(simulate(5, Camera(frames=220, lost=0.02), seed=3)[0], folder)
    held, *_ = simulate(1, Camera(frames=300, held=0.5), seed=6)[0]
    write_recordings([replace(held, name=NAME)], folder)
    (folder / "9_broken<b>.csv").write_text("time,x\n1,2\n")
    return folder


@pytest.fixture(scope="module")
def found(takes):
    return tracks.find_impacts(takes, mass=MASS, shape=SHAPE)


@pytest.fixture(scope="module")
def searched(found):
    return [*found.reload({*shown_recordings(found)})]


@pytest.fixture(scope="module")
def page(found, searched, tmp_path_factory):
    return write_recordings_page(tmp_path_factory.mktemp("page") / "recordings.html", found, searched)


def recordings_of(content):
    return json.loads(gzip.decompress(base64.b64decode(content["block"])))


def test_the_page_has_what_was_found(found, page, searched):
    text, survey = html.unescape(page.read_text()), found.survey
    content = of_recordings(found, searched)
    recordings = recordings_of(content)
    title = f"{len(found.impacts)} impacts from 6 recordings, normal velocities before contact ±"
    assert content["title"].startswith(title)
    assert sum(one["impacts"] for one in content["recordings"]) == len(found.impacts)
    assert [contact["name"] for one in recordings for contact in one["contacts"]] == list(found.impacts.trial)
    assert sum(len(one["refused"]) for one in recordings) == len(survey.refusals) - 1
    for reason, count in Counter(refusal.reason for refusal in survey.refusals).items():
        assert {(one["key"], one["parts"]) for one in content["_refusals"]} >= {(str(reason), count)}
    terminal = "\n".join(tracks_summary(found, Path("a.csv"), Path("b.csv")))
    for name, words in tracks_facts(found):
        assert f'<th scope="row">{name}</th><td>{words}</td>' in text
        assert f"{name:<8} {words}" in terminal
    assert "All 6 recordings are on this page." in text
    assert "has no column 'y'" in text


def test_a_recording_has_its_frames_flights_and_contacts(found, searched):
    (one,) = found.reload({"0001"})
    contacts = [contact for contact in found.survey.contacts if contact.recording == "0001"]
    recording = of_recording(one, contacts, one.refusals)
    assert len(recording["time"]) == len(recording["pose"][2]) == one.track.seen.sum() < len(one.track)
    for flight, shown in zip(one.flights, recording["flights"], strict=True):
        residual = np.array(shown["residual"]).T / (1e3, 1e3, np.degrees(1))
        np.testing.assert_allclose(residual, flight.residual, rtol=0.01, atol=1e-6)
        np.testing.assert_allclose(np.array(recording["time"])[shown["at"]], one.track.time[flight.frames], atol=1e-6)
    first, shown = contacts[0], recording["contacts"][0]
    instant, _, falling, *_ = (float(cell.split()[0].replace("−", "-")) for cell in shown["cells"])
    assert instant == pytest.approx(first.time, abs=1e-4)
    assert falling == pytest.approx(first.v_pre[1], abs=1e-3)
    assert shown["before"] == 0


def test_long_recordings_are_thinned(found, tmp_path, searched):
    (one,) = found.reload({"0001"})
    frames = 40 * len(one.track)
    time = np.arange(frames) * one.track.step
    pose = np.resize(one.track.pose, (frames, 3))
    long = replace(one.track, time=time, pose=pose)
    about = of_recording(replace(one, track=long), (), ())
    assert len(about["time"]) <= FRAMES
    assert all(len(flight["at"]) == len(own.frames) for flight, own in zip(about["flights"], one.flights, strict=True))
    assert "of them shown" in about["summary"]
    whole = of_recording(replace(one, track=long, flights=()), (), ())
    assert FRAMES / 2 < len(whole["time"]) <= FRAMES
    # Half of the page at most has refused parts, the rest is spread over those with impacts.
    hit, survey = found.survey.contacts[0], found.survey
    rest = replace(survey.refusals[0], reason=Reason.REST)
    contacts = [replace(hit, recording=f"{k:04d}") for k in range(1000)]
    refusals = [replace(rest, recording=f"{k:04d}", reason=Reason.SLIDING) for k in range(0, 1000, 2)]
    refusals += [replace(rest, recording=f"{k:04d}") for k in range(1000)]
    many = replace(survey, contacts=tuple(contacts), refusals=tuple(refusals), recordings=1000)
    names = shown_recordings(replace(found, survey=many))
    assert len(names) == len(set(names)) == MAX_RECORDINGS
    even = [int(name) for name in names if int(name) % 2 == 0]
    assert len(even) >= MAX_RECORDINGS // 2
    assert min(even) < 20
    assert max(even) > 980
    assert (
        "6 of 1000 recordings are on this page"
        in of_recordings(replace(found, survey=replace(survey, recordings=1000)), searched)["_limits"]
    )
    content = of_recordings(found, searched)
    scores = standardised([*found.reload(set(shown_recordings(found)))])
    shown = [trace["y"] for trace in content["figures"]["residuals"]["data"] if trace["type"] == "bar"]
    for bars, score in zip(shown, scores.T, strict=True):
        assert sum(bars) * 0.2 == pytest.approx(1, abs=1e-3)
        assert max(bars) == pytest.approx(0.4, abs=0.15)
        assert score.std() == pytest.approx(1, abs=0.1)
    assert f"x: standard deviation {scores[:, 0].std():.3g}, " in content["_residuals"][0]
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match=r"recordings\.html: cannot be written"):
        write_recordings_page(tmp_path / "file" / "recordings.html", found, searched)


def test_names_are_text(found, page, searched):
    text = page.read_text()
    assert "<img" not in text
    assert "<b>" not in text.partition("<script")[0]
    assert html.escape(NAME).replace("&#x27;", "&#39;") in text
    assert NAME in [one["name"] for one in data_of(page)["recordings"]]
    refusals = tuple(replace(one, recording=HOSTILE, message=HOSTILE) for one in found.survey.refusals)
    hostile = replace(found, survey=replace(found.survey, refusals=refusals))
    assert "<script>window" not in render(
        of_recordings(hostile, searched), "recordings.html.j2", scripts=("recordings.js",)
    )
    visible = re.sub(r'<script type="(application/json|text/plain)".*?</script>', "", text, flags=re.S)
    loads = re.findall(r"(?:src|href|action|data)\s*=\s*[\"']([^\"']*)", visible)
    assert all(target.startswith(("#", "data:")) for target in loads)


def test_the_command_and_a_run_write_the_page(takes, tmp_path, found, searched):
    shape = f"data.shape={{kind: ellipse, semi_axes: {list(SEMI_AXES)}}}"
    folder = tmp_path / "takes"
    shutil.copytree(takes, folder, ignore=shutil.ignore_patterns("9_*"))
    told = run("contactlearn", "impacts", str(folder), "-o", str(tmp_path / "out.csv"), f"data.mass={MASS}", shape)
    assert f"page     {tmp_path / 'out.recordings.html'}" in told
    assert "next: contactlearn diagnose data=table data.path=" in told
    assert data_of(tmp_path / "out.recordings.html")["title"] in told
    loaded = load_data(settings(takes))
    assert loaded.impacts.fingerprint() == found.impacts.fingerprint()
    assert loaded.tracked is not None
    save_recordings_page(tmp_path, loaded.tracked)
    assert data_of(tmp_path / "recordings.html")["title"].startswith(f"{len(loaded.impacts)} impacts from 6 recordings")
    with pytest.raises(ContactLearnError, match="colour"):
        load_data(settings(takes, "+data.colour=red"))


def settings(takes, *more):
    """The settings of a source."""
    shape = f"data.shape={{kind:ellipse,semi_axes:[{SEMI_AXES[0]},{SEMI_AXES[1]}]}}"
    words = ["data=tracks", f"data.path={takes}", f"data.mass={MASS}", shape, *more]
    return SourceSettings.from_config(compose("evaluate", words))


@pytest.mark.parametrize("source", ["data.tracks", "simulation.recordings", "simulation.synthetic"])
def test_the_report_links_to_the_page(source):
    content = reproduced(provenance({"data": {"_target_": f"contactlearn.{source}.load"}}))
    assert content["recordings"] == ("" if source == "simulation.synthetic" else "recordings.html")
    assert not reproduced(provenance({"data": None}))["recordings"]


@pytest.fixture
def shown(browser, page):
    return opened(browser, page)


def summary(browser):
    return browser.execute_script("return document.getElementById('summary').textContent")


def test_everything_is_drawn_in_silence(browser, page):
    shown = opened(browser, page)
    draw_everything(shown)
    for figure in FIGURES:
        text = shown.execute_script(f"return document.querySelector('#{figure}').textContent")
        assert "undefined" not in text
        assert "NaN" not in text
    assert nothing_sticks_out(shown)
    assert silent(shown)


def test_a_choice_changes_figure_tables_and_address(shown):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    draw_everything(shown)
    first, height = summary(shown), "document.getElementById('track').data.find(one => one.yaxis === 'y2').y[1]"
    before = shown.execute_script(f"return {height}")
    shown.find_element(By.ID, "later").send_keys(Keys.ENTER)
    until(shown, f"{height} !== {before}")
    assert summary(shown) != first
    assert shown.current_url.endswith("#recording=0002")
    shown.find_element(By.ID, "choice").send_keys(Keys.ARROW_DOWN)
    until(shown, "document.getElementById('summary').textContent.startsWith('0003')")
    into_view(shown, "body")
    last = "[...document.querySelectorAll('#contacts button')].at(-1)"
    shown.execute_script(f"{last}.click()")
    name = shown.execute_script(f"return {last}.textContent")
    until(shown, f"document.getElementById('body').getAttribute('aria-label').includes('{name}')")
    again = shown.current_url
    shown.get("about:blank")
    shown.get(again)
    until(shown, "document.documentElement.dataset.ready")
    assert summary(shown).startswith("0003")
