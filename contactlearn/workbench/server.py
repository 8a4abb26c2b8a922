"""The server: one process, bound to this machine, with a token in the address that it prints."""

import contextlib
import logging
import secrets
import socket
import sys
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from importlib.metadata import version
from pathlib import Path

import torch
from dash import Dash
from flask import Response
from threadpoolctl import threadpool_limits
from werkzeug.serving import ThreadedWSGIServer

from contactlearn.core.errors import ContactLearnError
from contactlearn.workbench.background import BackgroundRuns
from contactlearn.workbench.background_callbacks import BackgroundCallbacks
from contactlearn.workbench.commands import session_of
from contactlearn.workbench.files import FileCallbacks, SavedRuns
from contactlearn.workbench.layout import page_layout
from contactlearn.workbench.models import Models
from contactlearn.workbench.security import ServerAddress, protect
from contactlearn.workbench.session_callbacks import SessionCallbacks

OUTPUTS = Path("outputs")
_PORTS = range(8765, 8785)
_LAST = 65535  # largest port
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


def make_app(address: ServerAddress, models: Models, outputs: Path = OUTPUTS) -> Dash:
    """Return the app for a server at an address; run folders are below `outputs`."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # it logs each request with the token
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
    app.layout = lambda: page_layout(_LARGEST_FILE)
    saved = SavedRuns(outputs)
    SessionCallbacks(models).register(app)
    BackgroundCallbacks(models, BackgroundRuns(outputs), saved).register(app)
    FileCallbacks(models, saved).register(app)
    _serve_scripts(app)
    saved.serve(app.server)
    scripts = " ".join(["'self'", *app.csp_hashes()])
    policy = (  # which allows only the page's own scripts
        f"default-src 'none'; script-src {scripts}; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
        "font-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    protect(app.server, address, policy)
    return app


def _serve_scripts(app: Dash) -> None:
    """Serve the scripts and styles of the report and of the workbench."""
    report = resources.files("contactlearn.report.page") / "templates"
    own = resources.files("contactlearn.workbench") / "static"
    scripts = (own / name for name in ("sliders.js", "box.js", "page.js"))
    parts = (own / "data.js", report / "figures.js", *scripts)
    script = "\n".join(part.read_text(encoding="utf-8") for part in parts)
    style = (report / "style.css").read_text(encoding="utf-8") + (own / "page.css").read_text(encoding="utf-8")
    library = (resources.files("plotly") / "package_data" / "plotly.min.js").read_bytes()

    def add(path: str, content: str | bytes, kind: str, headers: Mapping[str, str] | None = None) -> None:
        app.server.add_url_rule(path, path, lambda: Response(content, mimetype=kind, headers=headers))

    add("/workbench.js", script, "text/javascript")
    add("/style.css", style, "text/css")
    add("/plotly.js", library, "text/javascript", {"Cache-Control": _FOREVER})


def listen(host: str, port: int | None, models: Models) -> tuple[ThreadedWSGIServer, ServerAddress]:
    """Return a server that listens, and its address with a new token.

    Args:
        host: to bind to.
        port: to bind to; 0 is any free port, None the first free one of a range.
        models: of all sessions.

    Raises:
        ContactLearnError: the port cannot be bound.
    """
    if port is not None and not 0 <= port <= _LAST:
        raise ContactLearnError(f"a port is a number from 0 to {_LAST}, got {port}")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for candidate in _PORTS if port is None else [port]:
        with contextlib.suppress(OSError), socket.create_server((host, candidate), family=family) as free:
            found = free.getsockname()[1]
            break
    else:
        ports = f"port {port}" if port is not None else f"ports {_PORTS[0]} to {_PORTS[-1]}"
        raise ContactLearnError(f"cannot listen on {host}, {ports}: taken, or not this machine's; try --port 0")
    address = ServerAddress(host=host, port=found, token=secrets.token_urlsafe(24))
    server = ThreadedWSGIServer(host, found, make_app(address, models).server)
    server.daemon_threads = False  # torch does not survive threads that end with the process: closing waits for them
    return server, address


def serve(words: Sequence[str], host: str, port: int | None, browser: bool) -> None:
    """Serve the workbench until it is interrupted; without a law or an effect it opens on the best law alone.

    Args:
        words: words of a command line with the first session.
        host: to bind to.
        port: to bind to; a free port if None.
        browser: open one at the address.
    """
    torch.set_num_threads(1)
    threadpool_limits(1)
    session, models = session_of(words), Models()
    print("fitting the laws …", file=sys.stderr, flush=True)
    models.fitted(session)  # the first fit of a process is slow, and data that cannot be read are an error here
    if not any(word.lstrip("+").startswith(("law", "effect")) for word in words):
        session = replace(session, law=models.best_law(session).law.name)
    server, bound = listen(host, port, models)
    address = bound.url + session.address.replace("?", "&", 1)
    print(f"open: {address}", flush=True)
    if browser:
        webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt):
        server.serve_forever()
    server.server_close()
