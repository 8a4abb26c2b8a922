"""Callbacks of files: dropped tables, experiment files and saved runs; and of the hints to hidden effects."""

import base64
import binascii
import hashlib
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from dash import Dash, Input, Output, State, ctx, dcc, html, no_update

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import written_whole
from contactlearn.data import table
from contactlearn.data.audit.findings import audit
from contactlearn.simulation.hidden_effects import reveal
from contactlearn.workbench import content
from contactlearn.workbench.commands import experiment
from contactlearn.workbench.layout import HINTS
from contactlearn.workbench.models import Models
from contactlearn.workbench.saved_runs import COMPARED, SavedRuns
from contactlearn.workbench.session import Session


class FileCallbacks:
    """The callbacks of dropped tables, other data, experiment files, saved runs, and the hints."""

    def __init__(self, models: Models, saved: SavedRuns) -> None:
        self.models, self.saved = models, saved

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        address = State("address", "search")
        app.callback(
            Output("address", "search", allow_duplicate=True), Output("trouble", "children", allow_duplicate=True),
            Output("mistakes", "children", allow_duplicate=True),
            Input("upload", "contents"), Input("load", "n_clicks"), Input("words", "n_submit"),
            State("upload", "filename"), State("words", "value"), address, prevent_initial_call=True,
        )(self.load)  # fmt: skip
        app.callback(
            Output("download", "data"), Input("experiment", "n_clicks"), address, prevent_initial_call=True
        )(self.experiment)  # fmt: skip
        app.callback(
            Output("runs", "children"), Output("runs-status", "children"),
            Input("list-runs", "n_clicks"), Input("compare-runs", "n_clicks"), prevent_initial_call=True,
        )(self.runs)  # fmt: skip
        app.callback(
            Output("hints", "hidden"), Output("hint-title", "children"), Output("hint-text", "children"),
            Output("hint-next", "hidden"), Output("reveal", "hidden"),
            Input("hint-next", "n_clicks"), Input("hint-end", "n_clicks"), Input("settled", "data"),
        )(self.hint)  # fmt: skip
        app.callback(
            Output("truth", "children"), Output("truth", "hidden"), Input("reveal", "n_clicks"), address,
            prevent_initial_call=True,
        )(self.reveal)  # fmt: skip

    def load(self, contents: str | None, *values: Any) -> tuple[Any, str, Any]:
        """Go to other data, a dropped file or words as on a command line, with the same model.

        Data that break a rule of impacts are audited, so that they can be loaded corrected.
        """
        *_, name, words, address = values
        try:
            session = Session.read(address or "")
            if ctx.triggered_id == "upload":
                if contents is None or name is None:
                    return no_update, "", no_update
                data = ("data=table", f"data.path={self.store_table(name, contents)}")
            else:
                data = _data_words(words or "")
            other = replace(session.model_only, data=data)
        except ContactLearnError as error:
            return no_update, str(error), no_update
        try:
            self.models.split(other)
        except ContactLearnError as error:
            return no_update, str(error), self.corrections(other)
        return other.address or "?", "", no_update

    def corrections(self, session: Session) -> Any:
        """Return what the audit finds in data that could not be loaded, with a button that loads them corrected."""
        try:
            return content.mistakes(audit(self.models.unvalidated(session)), session, loaded=False)
        except ContactLearnError:
            return no_update

    def store_table(self, name: str, contents: str) -> Path:
        """Write a dropped file under the hash of its content, once it can be read.

        Raises:
            DataError: it is no table, or breaks a rule of tables.
        """
        table.check_suffix(Path(name))
        try:
            table_bytes = base64.b64decode(contents.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise DataError(f"{name}: did not arrive whole: {error}; drop it again") from None
        digest = hashlib.sha256(table_bytes).hexdigest()[:16]
        path = self.saved.outputs / "uploads" / f"{digest}{Path(name).suffix.lower()}"
        if not path.exists():
            with written_whole(path) as part:
                part.write_bytes(table_bytes)
        try:
            table.load(path, validate=False)  # data that break a rule of impacts may be corrected
        except ContactLearnError as error:
            path.unlink()
            raise DataError(str(error).replace(str(path), name)) from None
        return path

    def experiment(self, _: int, address: str | None) -> Any:
        """Return the experiment file of the session."""
        return dcc.send_string(experiment(Session.read(address or "")), "session.yaml")

    def runs(self, _: int, __: int) -> tuple[Any, Any]:
        """Show the saved runs, and write one page over all of them if its button was pressed."""
        runs = self.saved.latest()
        if ctx.triggered_id == "list-runs":
            return content.run_list(runs), ""
        try:
            self.saved.compare([one.name for one in runs if one.kind != "unreadable"])
        except ContactLearnError as error:
            return no_update, str(error)
        return content.run_list(runs), html.A("open the comparison", href=f"/runs/{COMPARED}", target="_blank")

    def hint(self, clicks: int, ended: int, address: str | None) -> tuple[Any, ...]:
        """Show the next hint, for data with hidden effects."""
        if not address or ended or "data=mystery" not in Session.read(address).data:
            return True, "", "", True, True
        at = min(clicks, len(HINTS) - 1)
        title, text = HINTS[at]
        return False, f"{at + 1} of {len(HINTS)}. {title}.", text, at == len(HINTS) - 1, at < len(HINTS) - 1

    def reveal(self, _: int, address: str | None) -> tuple[Any, Any]:
        """Show the ground truth of the data."""
        words = dict(word.split("=", 1) for word in Session.read(address or "").data)
        folder = words.get("data.folder", f"outputs/mystery/seed_{words.get('data.seed')}")
        try:
            return reveal(folder), False
        except ContactLearnError as error:
            return str(error), False


def _data_words(text: str) -> tuple[str, ...]:
    """Return the words of a command line that name data."""
    try:
        return tuple(shlex.split(text)) or Session().data
    except ValueError as error:
        raise ContactLearnError(f"{text!r} cannot be read as words: {error}") from None
