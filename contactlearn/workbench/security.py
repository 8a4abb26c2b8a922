"""Refusals: the workbench answers only its own page in its own browser.

    Host      any other than the address that was printed: 403, so that a foreign name that is led here (DNS
              rebinding) reads nothing
    Origin    any other than the page's own, and requests that a browser marks as from another site: 403
    token     none, or a wrong one: 403; the address that was printed has it, a cookie has it afterwards
    size      a body over the limit: 413, before it is read

Every answer forbids frames, foreign scripts and caches.  The token is new with every start.
"""

import hmac
import ipaddress
import socket
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlencode, urlsplit

from flask import Flask, Response, abort, redirect, request
from werkzeug.wrappers import Response as Answer

LARGEST_BODY = 64 << 20
"""Bytes of a request."""
_EVERYWHERE = ("0.0.0.0", "::")
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True, kw_only=True)
class ServerAddress:
    """Address and token of a server."""

    host: str
    port: int
    token: str

    @property
    def url(self) -> str:
        """The URL to print, with the token."""
        host = "127.0.0.1" if self.host in _EVERYWHERE else self.host
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/?token={self.token}"

    @property
    def cookie(self) -> str:
        """Name of the cookie; servers on other ports have others."""
        return f"contactlearn-{self.port}"

    def matches(self, netloc: str) -> bool:
        """Compare a host and port, as in a Host header or after the scheme of an origin, with this server's."""
        try:
            parts = urlsplit(f"//{netloc}")
            host, port = parts.hostname or "", parts.port or 80
        except ValueError:
            return False
        if port != self.port or parts.username is not None or parts.path:
            return False
        if host in ("127.0.0.1", "localhost", self.host):
            return True
        return self.host in _EVERYWHERE and (host == socket.gethostname().lower() or _is_ip(host))


def protect(server: Flask, address: ServerAddress, policy: str) -> None:
    """Refuse requests as the module describes, and send the policy and the other headers with every answer."""
    server.config["MAX_CONTENT_LENGTH"] = LARGEST_BODY

    def refuse() -> Answer | None:
        origin = request.headers.get("Origin")
        if not address.matches(request.headers.get("Host", "")):
            abort(403, "This host is not the workbench's: open the address that it printed.")
        if origin is not None and not (
            origin.startswith("http://") and address.matches(origin.removeprefix("http://"))
        ):
            abort(403, "Requests from other origins are refused.")
        if request.headers.get("Sec-Fetch-Site", "none") in ("cross-site", "same-site") and request.method != "GET":
            abort(403, "Requests from other sites are refused.")
        if request.content_length is None and "Transfer-Encoding" in request.headers:
            abort(411, "A request says how long it is.")
        if (request.content_length or 0) > LARGEST_BODY:
            abort(413, f"A request has up to {LARGEST_BODY >> 20} MiB.")
        return _identified(address)

    def finish(response: Response) -> Response:
        for name, value in (_HEADERS | {"Content-Security-Policy": policy}).items():
            response.headers.setdefault(name, value)
        return response

    server.before_request(refuse)
    server.after_request(finish)


def _identified(address: ServerAddress) -> Answer | None:
    """Accept a request with the cookie; redirect one with the token in its address, and set the cookie."""
    given = request.args.get("token")
    if given is not None and request.method == "GET" and request.path == "/" and _equal(given, address.token):
        rest = [
            (key, value) for key, value in parse_qsl(request.query_string.decode("utf-8", "replace")) if key != "token"
        ]
        answer = redirect("/" + (f"?{urlencode(rest)}" if rest else ""))
        answer.set_cookie(address.cookie, address.token, httponly=True, samesite="Strict", path="/")
        return answer
    if not _equal(request.cookies.get(address.cookie, ""), address.token):
        abort(403, "The token is missing or wrong: open the address that the workbench printed.")
    return None


def _equal(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


def _is_ip(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True
