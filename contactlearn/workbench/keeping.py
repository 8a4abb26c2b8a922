"""Callbacks of what is kept and brought: uploads, other data, experiment files, saved runs, and the hints."""

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
from contactlearn.workbench.commands import experiment
from contactlearn.workbench.models import Models
from contactlearn.workbench.panes import frame
from contactlearn.workbench.panes import saved as pane
from contactlearn.workbench.panes.hints import HINTS
from contactlearn.workbench.saved import COMPARED, Saved
from contactlearn.workbench.session import Session
from contactlearn.workbench.tasks import studied


class Keeping:
    """The callbacks of what is kept.

    Args:
        models: of all sessions.
        saved: runs.
        outputs: folder of runs and uploads.
    """

    def __init__(self, models: Models, saved: Saved, outputs: Path) -> None:
        self.models, self.saved, self.outputs = models, saved, outputs

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        app.callback(
            Output("address", "search", allow_duplicate=True), Output("trouble", "children", allow_duplicate=True),
            Output("mistakes", "children", allow_duplicate=True),
            Input("upload", "contents"), Input("load", "n_clicks"), Input("words", "n_submit"),
            State("upload", "filename"), State("words", "value"), State("address", "search"), prevent_initial_call=True,
        )(self.load)  # fmt: skip
        app.callback(
            Output("download", "data"),
            Input("experiment", "n_clicks"),
            State("address", "search"),
            prevent_initial_call=True,
        )(self.experiment)
        app.callback(
            Output("runs", "children"), Output("runs-said", "children"),
            Input("list-runs", "n_clicks"), Input("compare-runs", "n_clicks"), prevent_initial_call=True,
        )(self.runs)  # fmt: skip
        app.callback(
            Output("hints", "hidden"), Output("hint-title", "children"), Output("hint-text", "children"),
            Output("hint-next", "hidden"), Output("reveal", "hidden"),
            Input("hint-next", "n_clicks"), Input("hint-end", "n_clicks"), Input("settled", "data"),
        )(self.hint)  # fmt: skip
        app.callback(
            Output("truth", "children"),
            Output("truth", "hidden"),
            Input("reveal", "n_clicks"),
            State("address", "search"),
            prevent_initial_call=True,
        )(self.reveal)

    def load(self, contents: str | None, *values: Any) -> tuple[Any, str, Any]:
        """Go to other data: a file that was dropped, or words as on a command line; the model stays.

        Data that break a rule of impacts are audited, so that they can be loaded corrected.
        """
        *_, name, words, address = values
        try:
            session = Session.read(address or "")
            if ctx.triggered_id == "upload":
                if contents is None or name is None:
                    return no_update, "", no_update
                data = ("data=table", f"data.path={self.kept(name, contents)}")
            else:
                data = _words(words or "")
            other = replace(studied(session), data=data)
        except ContactLearnError as error:
            return no_update, str(error), no_update
        try:
            self.models.split(other)
        except ContactLearnError as error:
            return no_update, str(error), self.offered(other)
        return other.address or "?", "", no_update

    def offered(self, session: Session) -> Any:
        """What is wrong with data that could not be loaded, if that is all."""
        try:
            return frame.mistakes(audit(self.models.suspected(session)), session, loaded=False)
        except ContactLearnError:
            return no_update

    def kept(self, name: str, contents: str) -> Path:
        """Write a file that was dropped under the hash of its content, once it can be read.

        Raises:
            DataError: it is no table, or breaks a rule of tables.
        """
        table.check_suffix(Path(name))
        try:
            content = base64.b64decode(contents.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise DataError(f"{name}: did not arrive whole: {error}; drop it again") from None
        path = self.outputs / "uploads" / f"{hashlib.sha256(content).hexdigest()[:16]}{Path(name).suffix.lower()}"
        if not path.exists():
            with written_whole(path) as part:
                part.write_bytes(content)
        try:
            table.load(path, validate=False)  # what breaks a rule of impacts may be corrected
        except ContactLearnError as error:
            path.unlink()
            raise DataError(str(error).replace(str(path), name)) from None
        return path

    def experiment(self, _: int, address: str | None) -> Any:
        """The experiment file of the session."""
        return dcc.send_string(experiment(Session.read(address or "")), "session.yaml")

    def runs(self, _: int, __: int) -> tuple[Any, Any]:
        """The saved runs; if asked for, one page over all of them."""
        runs = self.saved.listed()
        if ctx.triggered_id == "list-runs":
            return pane.run_list(runs), ""
        try:
            self.saved.compare([one.name for one in runs if one.kind != "unreadable"])
        except ContactLearnError as error:
            return no_update, str(error)
        return pane.run_list(runs), html.A("open the comparison", href=f"/runs/{COMPARED}", target="_blank")

    def hint(self, clicks: int, ended: int, address: str | None) -> tuple[Any, ...]:
        """The next hint, for data that hide something."""
        if not address or ended or "data=mystery" not in Session.read(address).data:
            return True, "", "", True, True
        at = min(clicks, len(HINTS) - 1)
        title, text = HINTS[at]
        return False, f"{at + 1} of {len(HINTS)}. {title}.", text, at == len(HINTS) - 1, at < len(HINTS) - 1

    def reveal(self, _: int, address: str | None) -> tuple[Any, Any]:
        """Return the truth about the data."""
        words = dict(word.split("=", 1) for word in Session.read(address or "").data)
        folder = words.get("data.folder", f"outputs/mystery/seed_{words.get('data.seed')}")
        try:
            return reveal(folder), False
        except ContactLearnError as error:
            return str(error), False


def _words(text: str) -> tuple[str, ...]:
    """Words of a command line that name data."""
    try:
        return tuple(shlex.split(text)) or Session().data
    except ValueError as error:
        raise ContactLearnError(f"{text!r} cannot be read as words: {error}") from None
