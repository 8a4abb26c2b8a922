"""The server: one process, bound to this machine, with a token in the address that it prints."""

import contextlib
import logging
import secrets
import socket
import webbrowser
from collections.abc import Sequence
from importlib import resources
from importlib.metadata import version
from pathlib import Path

import torch
from dash import Dash
from flask import Response
from threadpoolctl import threadpool_limits
from werkzeug.serving import ThreadedWSGIServer

from contactlearn.core.errors import ContactLearnError
from contactlearn.workbench.actions import actions_of
from contactlearn.workbench.background import Background
from contactlearn.workbench.commands import session_of
from contactlearn.workbench.jobs import Jobs
from contactlearn.workbench.keeping import Keeping
from contactlearn.workbench.models import Models
from contactlearn.workbench.page import Page
from contactlearn.workbench.panes import frame
from contactlearn.workbench.previews import Previews
from contactlearn.workbench.promises import Promises
from contactlearn.workbench.saved import Saved
from contactlearn.workbench.security import Door, protect
from contactlearn.workbench.studying import Studying
from contactlearn.workbench.tasks import StudyRuns

OUTPUTS = Path("outputs")
_PORTS = range(8765, 8785)
_LAST = 65535  # port that there is
_LARGEST_FILE = 40 << 20  # bytes; base64 makes a third more of it
_FOREVER = "private, max-age=31536000, immutable"
_INDEX = """<!DOCTYPE html>
<html lang="en">
<head>
{%metas%}
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{%title%}</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="/style.css">
<script src="/workbench.js" defer></script>
<script src="/plotly.js?v=PLOTLY" async id="plotly"></script>
{%css%}
</head>
<body>
{%app_entry%}
<footer>{%config%}{%scripts%}{%renderer%}</footer>
</body>
</html>"""


def make_app(door: Door, models: Models, outputs: Path = OUTPUTS) -> Dash:
    """Return the app, ready to be served behind a door; runs are written and looked for below `outputs`."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # it writes a line a request, with the token
    app = Dash(
        "contactlearn",
        title="contactlearn workbench",
        update_title="",
        include_assets_files=False,
        index_string=_INDEX.replace("PLOTLY", version("plotly")),
        suppress_callback_exceptions=True,
        serve_locally=True,
        add_log_handler=False,
    )
    app.enable_dev_tools(debug=False)
    app.layout = lambda: frame.page_layout(_LARGEST_FILE)
    promises = Promises(models)
    actions = actions_of(models, promises)
    saved = Saved(outputs)
    Page(models, promises, actions).register(app)
    Background(Jobs(outputs), saved).register(app)
    Studying(models, StudyRuns(models)).register(app)
    Keeping(models, saved, outputs).register(app)
    _serve_scripts(app)
    Previews(models, actions).serve(app.server)
    saved.serve(app.server)
    protect(app.server, door, _policy(app))
    return app


def _policy(app: Dash) -> str:
    """The content-security policy: scripts of the page's own alone."""
    scripts = " ".join(["'self'", *app.csp_hashes()])
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
        "font-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def _serve_scripts(app: Dash) -> None:
    """Serve the scripts and styles: those of the report, and the page's own."""
    report, own = (
        resources.files("contactlearn.report.page") / "templates",
        resources.files("contactlearn.workbench") / "static",
    )
    scripts = (own / name for name in ("sliders.js", "box.js", "page.js"))
    parts = (own / "data.js", report / "numbers.js", report / "figures.js", *scripts)
    script = "\n".join(part.read_text(encoding="utf-8") for part in parts)
    style = (report / "style.css").read_text(encoding="utf-8") + (own / "page.css").read_text(encoding="utf-8")
    library = (resources.files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    app.server.add_url_rule("/workbench.js", "workbench", lambda: Response(script, mimetype="text/javascript"))
    app.server.add_url_rule("/style.css", "style", lambda: Response(style, mimetype="text/css"))
    app.server.add_url_rule(
        "/plotly.js",
        "plotly",
        lambda: Response(library, mimetype="text/javascript", headers={"Cache-Control": _FOREVER}),
    )


def listen(host: str, port: int | None, models: Models) -> tuple[ThreadedWSGIServer, Door]:
    """Return a server that listens, and its door with a new token.

    Args:
        host: to bind to.
        port: to bind to; 0 is any free one, None the first free one of a few.
        models: of all sessions.

    Raises:
        ContactLearnError: it cannot be bound.
    """
    if port is not None and not 0 <= port <= _LAST:
        raise ContactLearnError(f"a port is a number from 0 to {_LAST}, got {port}")
    for tried in _PORTS if port is None else [port]:
        with contextlib.suppress(OSError), socket.create_server((host, tried), family=_family(host)) as free:
            found = free.getsockname()[1]
            break
    else:
        ports = f"port {port}" if port is not None else f"ports {_PORTS[0]} to {_PORTS[-1]}"
        raise ContactLearnError(f"cannot listen on {host}, {ports}: taken, or not this machine's; try --port 0")
    door = Door(host=host, port=found, token=secrets.token_urlsafe(24))
    server = ThreadedWSGIServer(host, found, make_app(door, models).server)
    server.daemon_threads = False  # torch does not survive threads that end with the process: closing waits for them
    return server, door


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def serve(words: Sequence[str], host: str, port: int | None, browser: bool) -> None:
    """Serve the workbench until it is interrupted.

    Args:
        words: of the session to begin with.
        host: to bind to.
        port: to bind to; a free one if None.
        browser: whether to open one.
    """
    torch.set_num_threads(1)
    threadpool_limits(1)
    session, models = session_of(words), Models()
    models.fitted(session)  # the first fit of a process is slow, and data that cannot be read are said here
    server, door = listen(host, port, models)
    address = door.address + session.address.replace("?", "&", 1)
    print(f"open     {address}", flush=True)
    if browser:
        webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt):
        server.serve_forever()
    server.server_close()
