"""The page over HTTP: what is served, to whom, on which port, and that it ends and begins again."""

from __future__ import annotations

import gc
import http.client
import os
import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
from ports import free_port

from rotary_error_monitor.dashboard.board import Action, PageBoard
from rotary_error_monitor.dashboard.server import WebServer, holder_of, is_own, listen
from rotary_error_monitor.errors import InputError


def fetched(port, path="/", headers=None):
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers or {})
    with urllib.request.urlopen(request, timeout=10) as answer:
        return answer.read().decode(), dict(answer.headers)


@pytest.fixture
def served():
    board, port = PageBoard(), free_port()
    board.show({"verdict": "<p>all is well today</p>"})
    server = WebServer(board, "127.0.0.1", port)
    yield board, port
    server.stop()


async def nothing() -> str:
    return ""


def test_the_page_holds_what_is_drawn_and_names_no_other_host(served):
    board, port = served
    text, headers = fetched(port)
    assert "all is well today" in text
    assert headers["content-security-policy"] == "frame-ancestors 'none'"
    paths = set(re.findall(r"[\"'(](/_nicegui/[^\"')\s]+)", text))
    assert len(paths) > 5
    for path in paths:
        if re.search(r"\.(js|mjs|css)$", path):
            assert fetched(port, path)[0]
    others = re.findall(r"https?://[^\s\"'<>)]+", text)
    assert [url for url in others if not url.startswith(f"http://127.0.0.1:{port}")] == []


def test_a_button_is_there_only_where_control_is_allowed(served):
    board, port = served
    assert "Reset the latch" not in fetched(port)[0]
    board.actions = (Action("Reset the latch", "Really?", "correction", nothing),)
    text = fetched(port)[0]
    assert "Reset the latch" in text and "Really?" in text


@pytest.mark.parametrize(
    "headers", [{"Host": "rebound.example"}, {"Origin": "http://evil.example"}, {"Host": "rebound.example:80"}]
)
def test_pages_of_others_get_no_answer(served, headers):
    _, port = served
    with pytest.raises(urllib.error.HTTPError) as refusal:
        fetched(port, headers=headers)
    assert refusal.value.code == 403
    assert b"address of its computer" in refusal.value.read()
    refusal.value.close()


@pytest.mark.parametrize(
    ("host", "origin", "own"),
    [
        ("127.0.0.1:8088", "", True),
        ("localhost:8088", "http://localhost:8088", True),
        ("[::1]:8088", "http://[::1]:8088", True),
        ("192.168.1.5", "http://192.168.1.5", True),
        (socket.gethostname(), "", True),
        ("", "", False),
        ("127.0.0.1.example:8088", "", False),
        ("127.0.0.1:8088", "http://127.0.0.1:9000", False),
        ("127.0.0.1:8088", "null", False),
    ],
)
def test_who_is_answered(host, origin, own):
    assert is_own({b"host": host.encode(), **({b"origin": origin.encode()} if origin else {})}) is own


def test_no_socket_is_opened_for_a_page_of_another_host(served):
    _, port = served
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    path = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    codes = {}
    for origin in (f"http://127.0.0.1:{port}", "http://evil.example"):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        connection.request("GET", path, headers={**upgrade, "Origin": origin})
        codes[origin] = connection.getresponse().status
        connection.close()
    assert list(codes.values()) == [101, 403]


def test_a_process_serves_one_dashboard(served):
    with pytest.raises(InputError, match="serves a dashboard already"):
        WebServer(PageBoard(), "127.0.0.1", free_port())


@pytest.mark.parametrize("time_again", range(2))
def test_a_server_after_the_last_one_in_this_process(time_again):
    port, board = free_port(), PageBoard()
    board.show({"verdict": f"time {time_again}"})
    server = WebServer(board, "127.0.0.1", port)
    assert f"time {time_again}" in fetched(port)[0]
    begin = time.monotonic()
    server.stop()
    assert not server.is_alive
    assert time.monotonic() - begin < 2.0
    with socket.create_server(("127.0.0.1", port)):
        pass


def test_its_start_does_not_walk_through_all_objects_of_the_process(monkeypatch):
    """Whoever does sees tuples that other threads are about to build, which then fail: `SystemError: bad argument`."""
    walks = []
    monkeypatch.setattr(gc, "get_objects", lambda *_: walks.append(1) or [])
    WebServer(PageBoard(), "127.0.0.1", free_port()).stop()
    assert walks == []


def test_a_port_that_is_taken_is_said_with_who_has_it():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(InputError) as refusal:
            listen("127.0.0.1", port)
    said = str(refusal.value)
    assert f"port {port} of 127.0.0.1 is taken by" in said
    assert f"process {os.getpid()} (" in said
    assert "set the parameter port" in said


def test_a_process_of_ours_is_called_so():
    words = (
        "import socket, time; s = socket.create_server(('127.0.0.1', 0)); print(s.getsockname()[1], flush=True); "
        "time.sleep(60)"
    )
    command = [sys.executable, "-c", words, "rotary_error_monitor.start"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = holder_of(int(process.stdout.readline()))
        finally:
            process.kill()
    assert found.startswith(f"a node of rotary_error_monitor, process {process.pid} (")


def test_nobody_has_a_free_port_and_without_proc_nothing_is_said(tmp_path):
    assert holder_of(free_port()) == ""
    assert holder_of(free_port(), tmp_path) == ""


def test_an_address_that_is_none_of_this_computers_is_said():
    with pytest.raises(InputError, match=r"nothing can be served on 203\.0\.113\.9:8088 .*parameter address"):
        listen("203.0.113.9", 8088)
    with pytest.raises(InputError, match="nothing can be served on no such place"):
        listen("no such place", 8088)


def test_without_the_library_it_is_said_how_to_install_it():
    words = (
        "import sys; sys.modules['nicegui'] = None\n"
        "from rotary_error_monitor.dashboard.page import application\n"
        "application(lambda: None)"
    )
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=False)
    assert "pip install 'rotary_error_monitor[dashboard]'" in done.stderr
