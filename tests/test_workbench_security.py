"""Refusals of the workbench: foreign hosts and origins, no token, large bodies; and what every answer forbids."""

import base64
import hashlib
import json
import re
import socket

import pytest
from commands import run_alone

pytest.importorskip("dash", reason="the workbench needs Dash: pip install 'contactlearn[workbench]'")

from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError
from contactlearn.workbench.models import Models
from contactlearn.workbench.security import LARGEST_BODY, ServerAddress
from contactlearn.workbench.server import listen, make_app

PORT, TOKEN = 8765, "secret-token"
HOME = f"http://127.0.0.1:{PORT}"
CALLBACK = "/_dash-update-component"


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    outputs = tmp_path_factory.mktemp("outputs")
    (outputs / "diagnose" / "run").mkdir(parents=True)
    (outputs / "diagnose" / "run" / "report.html").write_text("<p>report</p>")
    (outputs / "diagnose" / "run" / "model.pt").write_text("no page")
    return make_app(ServerAddress(host="127.0.0.1", port=PORT, token=TOKEN), Models(), outputs)


@pytest.fixture
def stranger(app):
    """A browser without the cookie."""
    return app.server.test_client()


@pytest.fixture
def client(stranger):
    stranger.get(f"/?token={TOKEN}", base_url=HOME)
    return stranger


def test_the_address_gives_the_cookie_and_leaves_no_token(stranger):
    # No other path takes it, so that none can lead elsewhere: //host is a path, too.
    for path in ("/_dash-layout", "//evil.example/"):
        there = {"PATH_INFO": path}
        assert stranger.get(f"/?token={TOKEN}", base_url=HOME, environ_overrides=there).status_code == 403
    answer = stranger.get(f"/?token={TOKEN}&data=mystery&data.seed=7", base_url=HOME)
    assert answer.status_code == 302
    assert answer.headers["Location"] == "/?data=mystery&data.seed=7"
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert stranger.get("/", base_url=HOME).status_code == 200


@pytest.mark.parametrize("path", ["/", "/_dash-layout", "/workbench.js", "/plotly.js", "/style.css", "/runs/runs.html"])
@pytest.mark.parametrize("query", ["", "?token=wrong", "?token="])
def test_nothing_is_read_without_the_token(stranger, path, query):
    assert stranger.get(path + query, base_url=HOME).status_code == 403


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", f"evil.example:{PORT}", "127.0.0.1:1", "127.0.0.1", f"127.0.0.1.evil.example:{PORT}",
        f"x@127.0.0.1:{PORT}", f"127.0.0.1:{PORT}x", "",
    ],
)  # fmt: skip
def test_foreign_hosts_are_refused(client, host):
    """A name of somebody else's that is led to this address (DNS rebinding) reads nothing, token or not."""
    for path in ("/", f"/?token={TOKEN}"):
        assert client.get(path, base_url=HOME, headers={"Host": host}).status_code in (400, 403)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", f"https://127.0.0.1:{PORT}", "http://127.0.0.1:1", "file://"]
)
def test_foreign_origins_are_refused(client, origin):
    assert client.post(CALLBACK, base_url=HOME, json={}, headers={"Origin": origin}).status_code == 403


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_the_page_itself_is_answered(client, name):
    client.get(f"/?token={TOKEN}", base_url=f"http://{name}:{PORT}")
    own = {"Host": f"{name}:{PORT}", "Origin": f"http://{name}:{PORT}", "Sec-Fetch-Site": "same-origin"}
    assert client.get("/_dash-layout", base_url=f"http://{name}:{PORT}", headers=own).status_code == 200


def test_large_bodies_are_refused_before_they_are_read(client):
    answer = client.post(CALLBACK, base_url=HOME, environ_overrides={"CONTENT_LENGTH": str(LARGEST_BODY + 1)})
    assert answer.status_code == 413
    chunked = client.post(CALLBACK, base_url=HOME, headers={"Transfer-Encoding": "chunked"})
    assert chunked.status_code in (411, 413)
    assert client.post(CALLBACK, base_url=HOME, json={}, headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403


def test_every_answer_forbids_foreign_scripts_and_frames(client, stranger, app):
    for answer in (
        client.get("/", base_url=HOME),
        stranger.get("/none", base_url=HOME),
        client.get("/none", base_url=HOME),
    ):
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        script = re.search(r"script-src ([^;]*)", policy)[1]
        assert "unsafe" not in script
        assert "http" not in script
        assert answer.headers["X-Frame-Options"] == "DENY"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Referrer-Policy"] == "no-referrer"
    page = client.get("/", base_url=HOME)
    policy = page.headers["Content-Security-Policy"]
    for attributes, text in re.findall(r"<script([^>]*)>(.*?)</script>", page.text, re.DOTALL):
        source = re.search(r'src="([^"]*)"', attributes)
        if source:
            assert source[1].startswith("/")
        elif "application/json" not in attributes:
            assert base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() in policy
    assert "http://" not in page.text
    assert "https://" not in page.text
    assert app.server.debug is False
    config = json.loads(
        re.search(r'<script id="_dash-config"[^>]*>(.*?)</script>', client.get("/", base_url=HOME).text)[1]
    )
    assert config["ui"] is False
    assert not config.get("hot_reload")
    assert client.get("/?__debugger__=yes&cmd=resource&f=debugger.js", base_url=HOME).mimetype == "text/html"
    assert client.get("/_alive_reload", base_url=HOME).status_code != 500
    assert client.get("/runs/diagnose/run/report.html", base_url=HOME).text == "<p>report</p>"
    for path in (
        "diagnose/run/model.pt",
        "../pyproject.toml",
        "%2e%2e/pyproject.toml",
        "diagnose/run/none/report.html",
        "/etc/passwd",
    ):
        answer = client.get(f"/runs/{path}", base_url=HOME)
        assert answer.status_code == 404 or "workbench" in answer.text  # a path that is no run's is the page


@pytest.mark.parametrize(
    ("headers", "status"),
    [({"Origin": "http://evil.example"}, 403), ({"Sec-Fetch-Site": "same-site"}, 403), ({"Host": "evil.example"}, 403)],
)
def test_a_dragged_slider_is_answered_to_the_page_alone(client, stranger, headers, status):
    question = {"address": "?data=synthetic&data.size=60", "of": "mu", "value": 0.3}
    assert client.post("/preview", base_url=HOME, json=question, headers=headers).status_code == status
    answer = client.post("/preview", base_url=HOME, json=question)
    assert answer.json["summary"][0] == "Held-out error "
    client.delete_cookie(f"contactlearn-{PORT}", domain="127.0.0.1")
    assert stranger.post("/preview", base_url=HOME, json=question).status_code == 403


@pytest.mark.parametrize(
    "body",
    [
        "x", "[]", "{}", '{"value": "much", "address": "", "of": "mu"}', '{"value": NaN, "address": "", "of": "mu"}',
        '{"value": 1, "address": "?seed=-1", "of": "mu"}',
        '{"value": 1, "address": 7, "of": "mu"}', '{"value": true, "address": "", "of": "mu"}',
        '{"value": 1e999, "address": "", "of": "mu"}', '{"value": 1' + 400 * "0" + ', "address": "", "of": "mu"}',
    ],
)  # fmt: skip
def test_what_is_no_slider_is_refused(client, body):
    answer = client.post("/preview", base_url=HOME, data=body, content_type="application/json")
    assert answer.status_code == 400


def test_other_addresses_of_this_machine_need_the_token_too(tmp_path):
    address = ServerAddress(host="0.0.0.0", port=PORT, token=TOKEN)
    client = make_app(address, Models(), tmp_path).server.test_client()
    own = {"Host": f"192.168.1.5:{PORT}"}
    assert client.get("/", base_url=HOME, headers=own).status_code == 403
    assert client.get(f"/?token={TOKEN}", base_url=HOME, headers=own).status_code == 302
    assert client.get(f"/?token={TOKEN}", base_url=HOME, headers={"Host": f"evil.example:{PORT}"}).status_code == 403
    assert address.matches(f"{socket.gethostname()}:{PORT}")
    assert not ServerAddress(host="127.0.0.1", port=PORT, token=TOKEN).matches(f"192.168.1.5:{PORT}")


def test_the_server_listens_on_this_machine_alone_and_every_token_is_new():
    (first, one), (second, two) = (listen("127.0.0.1", 0, Models()) for _ in range(2))
    try:
        assert first.server_address[0] == "127.0.0.1"
        assert len(one.token) >= 32
        assert one.token != two.token
        with pytest.raises(ContactLearnError, match=f"cannot listen on 127.0.0.1, port {one.port}"):
            listen("127.0.0.1", one.port, Models())
        with pytest.raises(ContactLearnError, match="a port is a number from 0 to 65535, got 80800"):
            listen("127.0.0.1", 80800, Models())
    finally:
        first.server_close()
        second.server_close()


def test_wrong_words_are_one_error_line(capsys):
    assert main(["workbench", "data=mystry", "--no-browser"]) == 2
    assert "did you mean 'mystery'" in capsys.readouterr().err
    assert main(["workbench", "model=[]", "--no-browser"]) == 2
    assert "the workbench takes data=" in capsys.readouterr().err


def test_without_dash_the_command_says_what_to_install():
    start = "from contactlearn.__main__ import main; sys.exit(main(['workbench']) - 2)"
    printed = run_alone("-c", f"import sys; sys.modules['dash'] = None; {start}")
    assert (
        printed
        == "error: the workbench needs Dash: pip install 'contactlearn[workbench]', or '.[workbench]' in a checkout\n"
    )
