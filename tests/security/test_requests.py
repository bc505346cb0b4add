"""What a request may be, whoever sends it: tried with bytes on a socket, since clients would not send most of these."""

import json
import socket
import time

import pytest
from attacking import connect, head, received, sent
from boxes import TRUTH

from dipcg.app import limits, protocol
from dipcg.app.client import ApiError, Client

UPLOAD = "POST /api/v1/pictures"
PNG = {"Content-Type": "image/png"}


def test_no_body_is_chunked(address):
    both = head(UPLOAD, PNG | {"Content-Length": "10", "Transfer-Encoding": "chunked"})
    assert sent(address, both).status == 400
    assert sent(address, head(UPLOAD, PNG | {"Transfer-Encoding": "chunked"})).status == 411
    assert sent(address, head(UPLOAD, {"Content-Length": "10, 20"})).status == 400


@pytest.mark.parametrize("path", ["/api/v1/pictures", "/api/v1/estimates", "/api/v1/assets", "/api/v1/jobs/x", "/"])
def test_a_body_that_is_too_long_is_not_read(address, path):
    asked = head(f"POST {path}", {"Content-Type": "application/json", "Content-Length": str(600 * 2**20)})
    started = time.monotonic()
    assert sent(address, asked).status == 413
    assert time.monotonic() - started < 5


def test_more_than_was_stated_is_no_part_of_the_body(address):
    asked = head("POST /api/v1/estimates", {"Content-Type": "application/json", "Content-Length": "2"})
    assert "Give either a picture or a text" in sent(address, asked + b"{}" + b"x" * 100_000).body


def test_long_words_are_refused_before_they_are_read(address):
    with pytest.raises(ApiError) as error:
        Client(address).describe("box " * 6_000_000)
    assert error.value.status == 413
    with pytest.raises(ApiError, match="at most 500 characters"):
        Client(address).describe("box " * 200)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "", "localhost@evil.example", "[::1"])
def test_other_host_names_are_refused(address, host):
    assert sent(address, head("GET /api/v1/about", {}, host)).status in (400, 421)


@pytest.mark.parametrize("host", ["127.0.0.1:7860", "localhost", "LOCALHOST:80", "[::1]:7860", "192.168.0.7"])
def test_addresses_and_this_machine_are_answered(address, host):
    assert sent(address, head("GET /api/v1/about", {"Connection": "close"}, host)).status == 200


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "http://localhost:1", "http://127.0.0.1.evil.example"]
)
@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
def test_other_websites_are_refused(address, origin, method):
    asked = head(f"{method} /api/v1/jobs/x", {"Origin": origin, "Content-Length": "0"}, "127.0.0.1:7860")
    assert sent(address, asked).status == 403


def test_the_page_itself_may_ask(address):
    own = {"Origin": "http://127.0.0.1:7860", "Connection": "close"}
    assert sent(address, head("GET /api/v1/about", own, "127.0.0.1:7860")).status == 200


def test_a_name_that_is_allowed_may_ask_and_be_asked(process):
    proxied = {"Origin": "https://dipcg.example", "Connection": "close"}
    for host in ("dipcg.example", "127.0.0.1:7860"):
        assert sent(process.url, head("GET /api/v1/about", proxied, host)).status == 200


ELSEWHERE = [
    "/../../../../etc/passwd",
    "/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
    "/docs/..%2f..%2f..%2f..%2fetc/passwd",
    "//etc/passwd",
    "/api/v1/files/x/..%2f..%2fetc%2fpasswd",
    "/api/v1/examples/..%2f..%2fchair.py",
    "/api/v1/pictures/..%2f..%2fx",
    "/gradio_api/file=https://evil.example/",
    "/gradio_api/run/cut_out",
    "/server.py",
]


@pytest.mark.parametrize("path", ELSEWHERE)
def test_no_path_leads_to_a_file_of_the_machine(address, path):
    answer = sent(address, head(f"GET {path}", {"Connection": "close"}))
    assert answer.status in (400, 404, 405, 422)
    assert "root:" not in answer.body


def test_neither_paths_nor_addresses_stand_for_pictures(address, picture):
    for given in (str(picture), f"file://{picture}", "http://192.0.2.1/a.png", "data:image/png;base64,AAAA"):
        for body in ({"picture": given}, {"picture": {"path": given}}, {"text": "a box", "url": given}):
            with pytest.raises(ApiError) as error:
                Client(address).send("POST", "/estimates", json.dumps(body).encode())
            assert error.value.status == 422


def test_every_answer_says_what_the_browser_may_do(address):
    for path in ("/", "/docs/", "/api/v1/about", "/api/v1/nothing", "/openapi.json"):
        headers = sent(address, head(f"GET {path}", {"Connection": "close"})).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert not {"unsafe-inline", "unsafe-eval", "*"} & set(policy.replace("'", "").split())
        assert "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "begun", [b"", b"GET /api/v1/about HT", head("GET /", {})[:-2], head(UPLOAD, PNG | {"Content-Length": "100"})]
)
def test_a_request_that_does_not_come_is_given_up(address, begun, monkeypatch):
    for name in ("HEADERS_S", "BODY_S"):
        monkeypatch.setattr(protocol, name, 0.5)
    with connect(address) as line:
        line.sendall(begun)
        assert line.recv(1000) == b""


def test_headers_have_an_end(address):
    with connect(address) as line:
        line.sendall(head("GET /", {"X-Long": "x" * 2**20})[:-4])
        assert received(line).status in (0, 400)


@pytest.mark.slow
def test_half_sent_requests_shut_nobody_out(address, monkeypatch):
    monkeypatch.setattr(protocol, "MOST_CONNECTIONS", 200)
    lines = [connect(address) for _ in range(300)]
    try:
        for number, line in enumerate(lines):
            begun = head(UPLOAD, PNG | {"Content-Length": "1000"}) if number % 2 else b"GET / HT"
            try:
                line.sendall(begun)
            except OSError:
                # This one had to go for a later one.
                assert number < 150
        started = time.monotonic()
        assert len(Client(address).preview("box", TRUTH)) > 1000
        assert time.monotonic() - started < 10
    finally:
        for line in lines:
            line.close()


def test_an_answer_that_nobody_reads_is_given_up(address, monkeypatch):
    monkeypatch.setattr(protocol, "UNREAD_S", 0.5)
    with connect(address) as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        with pytest.raises(OSError, match=r"reset|Broken pipe|timed out"):
            _ask_for_ever(line)


def _ask_for_ever(line: socket.socket) -> None:
    for _ in range(2000):
        line.sendall(head("GET /openapi.json", {}))
        time.sleep(0.01)


def test_the_limits_are_those_that_are_written_down():
    assert limits.MOST_PICTURE_BYTES == 25 * 2**20
    assert limits.HEADERS_S + limits.BODY_S + limits.MOST_PICTURE_BYTES / limits.BODY_BYTES_PER_S < 300
