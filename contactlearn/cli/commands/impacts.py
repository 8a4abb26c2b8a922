"""The impacts command: recordings to a table of impacts, a table of refusals, figures, and a page."""

import re
import shlex
from pathlib import Path

import pandas as pd
import yaml

from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.events import track
from contactlearn.core.numerics import atomic_write
from contactlearn.core.serialisation import to_json
from contactlearn.data import table, tracks
from contactlearn.report.events import progress
from contactlearn.report.figures import style
from contactlearn.report.figures.tracks import contact_figure, residuals_figure
from contactlearn.report.page.recordings import shown_recordings, write_recordings_page
from contactlearn.report.text.tracks import tracks_summary

_CONTACTS, _MOST = 3, 24  # recordings whose contacts, and whose residuals, are drawn
_LONGEST = 60  # characters of a recording's name in the name of a file


def write_impacts(source: SourceSettings, out: Path) -> str:
    """Find the impacts of recordings and write them; return a summary, line by line.

    Args:
        source: `data` of a configuration with data=tracks.
        out: a .csv or .parquet file; NAME.refused.csv next to it holds the refusals, NAME.json conventions and rig
            card, NAME.recordings.html shows all.

    Raises:
        ContactLearnError: a setting is missing.
        DataError: see `contactlearn.data.tracks.find_impacts`; or a file cannot be written.
    """
    table.check_suffix(out)
    tracked = find_recorded(source)
    table.save(tracked.impacts, out)
    refused = out.with_name(f"{out.stem}.refused.csv")
    columns = ["recording", "reason", "quantity", "value", "unit", "from", "to", "message"]
    rows = [
        (r.recording, r.reason.value, r.quantity, r.value, r.unit, *r.time, r.message) for r in tracked.survey.refusals
    ]
    try:
        with atomic_write(refused) as part:
            pd.DataFrame(rows, columns=columns).to_csv(part, index=False)
        with atomic_write(out.with_suffix(".json")) as part:
            part.write_text(to_json({"conventions": tracked.survey.frame.clues, "rig": tracked.rig.rows()}))
    except OSError as error:
        raise DataError(f"{refused}: cannot be written: {error.strerror}") from error
    figures = draw_recordings(tracked, out.with_name(f"{out.stem}_figures"))
    shown = tracked.reload({*shown_recordings(tracked)})
    page = write_recordings_page(out.with_name(f"{out.stem}.recordings.html"), tracked, shown)
    lines = [*tracks_summary(tracked, out, refused), f"figures  {figures}", f"page     {page}"]
    words = ["contactlearn", "diagnose", "data=table", f"data.path={out}"]
    if shape := source.options.get("shape"):  # which the table does not have
        words.append(f"data.shape={yaml.safe_dump(shape, default_flow_style=True, width=10**9).strip()}")
    words += ["data.correct=[rig]"] if tracked.rig.differing else []  # the table has the velocities as measured
    return "\n".join([*lines, f"next: {shlex.join(words)}"])


def find_recorded(source: SourceSettings) -> tracks.Tracked:
    """Find the impacts of recordings, and show the progress.

    Raises:
        ContactLearnError: a setting that the source does not have.
        DataError: see `contactlearn.data.tracks.find_impacts`.
    """
    source.refuse_missing()
    with progress() as on_event:
        try:
            return tracks.find(**source.options, progress=lambda parts: track(parts, "searching recordings", on_event))
        except TypeError as error:
            raise ContactLearnError(f"data: {error}") from None


def draw_recordings(tracked: tracks.Tracked, folder: Path) -> Path:
    """Draw a few contacts, and the residuals of some recordings, into a folder."""
    contacts = {contact.recording: contact for contact in reversed(tracked.survey.contacts)}
    founds = {one.track.name: one for one in tracked.reload([*contacts][-_MOST:])}
    for name in [*contacts][-_CONTACTS:]:
        stem = "contact_" + re.sub(r"[^\w.-]", "_", name)[:_LONGEST]
        style.save(contact_figure(founds[name], contacts[name], tracked.shape), folder, stem)
    style.save(residuals_figure([*founds.values()]), folder, "residuals")
    return folder
