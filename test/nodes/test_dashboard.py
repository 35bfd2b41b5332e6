"""The page of a running mock cell in a browser: it moves, tells a dead head, outlives nodes and its own server.

One cell and one browser for all of these; each test leaves the cell as it found it.
"""

from __future__ import annotations

import re
import signal
import time
import urllib.error
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from faults.live.other_programs import stated
from lifecycle_msgs.msg import Transition
from nodes.mock_cells import mock_parameters
from ports import free_port

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.dashboard import Dashboard, _answer
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.messages import pose_message
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.testing import Cell
from rotary_error_monitor.testing.cell import PATIENCE

BROWSER = Path("/usr/bin/chromium-headless-shell")
MACHINE = "xyzac_trt"
DEAD_WITHIN = 2.0
ENDS_WITHIN = 2.0
"""s, beside what other programs take of them."""

MOCK = {"source": "mock", "rate": 1000.0}
PATIENCE_MS = 1e3 * PATIENCE


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    if not BROWSER.exists():
        pytest.skip(f"there is no browser {BROWSER}")
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"], timeout=PATIENCE_MS)
        yield found
        found.close()


class Place:
    """A running cell, its dashboard in a process of its own, and a browser that shows it."""

    def __init__(self, cell, browser, folder):
        self.cell, self.port = cell, free_port()
        self.dashboard = self.serve()
        cell.start("encoder_head", "encoder_head_d", **MOCK)
        for letter in "abc":
            cell.run(EncoderHead, f"encoder_head_{letter}", **MOCK)
        cell.run(AutocollimatorNode, "autocollimator", **MOCK)
        cell.run(MockController, "mock_controller", machine=MACHINE, rate=1000.0)
        self.estimator = cell.run(ErrorEstimator, "error_estimator")
        # limits below what any machine needs: the first correction latches
        limits = {"linear__warning": 1e-9, "linear__error": 1e-9}
        cell.run(Compensation, "compensation", machine=MACHINE, uncertainty_limit=1.0, **limits)
        cell.run(Recorder, "recorder", folder=str(folder / "bag"))
        cell.wait_for_status("dashboard: server", "serving")
        self.page = browser.new_page(viewport={"width": 1024, "height": 768})
        self.page.context.set_default_timeout(PATIENCE_MS)
        self.wrong, self.asked = [], set()
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("request", lambda request: self.asked.add(request.url))
        self.page.on("websocket", lambda opened: self.asked.add(opened.url))
        self.page.goto(f"http://127.0.0.1:{self.port}/")

    def serve(self):
        return self.cell.start("dashboard", port=self.port, machine=MACHINE, allow_control=True)

    def text(self, part):
        return self.page.inner_text(f".part-{part}")

    def until(self, condition, what):
        self.cell.wait_until(condition, what)

    def value(self, name):
        """Figure of error motion by its name, as it stands on the page, µm or µrad; None where there is none."""
        found = re.search(rf"^{name}\s+(−?[\d.,]+)\s", self.text("figures"), re.MULTILINE)
        return float(found[1].replace("−", "-").replace(",", "")) if found else None

    def moves(self):
        """Whether the figures change."""
        before = self.value("exc")
        self.until(lambda: self.value("exc") not in (None, before), "exc to change on the page")

    def is_without(self, head):
        return f"head_{head}" in self.text("verdict") or f"head {head}" in self.text("verdict")

    def press(self, label, answer):
        self.page.click(f"text={label}")
        self.page.click(f".q-dialog >> text={answer}")


@pytest.fixture(scope="module")
def place(browser, tmp_path_factory):
    settings = MockSettings(seed=7, epoch_ns=time.time_ns() - 5_000_000_000, speeds=(2.0, 4.0), forces=True)
    with Cell(parameters=mock_parameters(settings)) as cell:
        found = Place(cell, browser, tmp_path_factory.mktemp("dashboard"))
        yield found
        found.page.close()
        assert found.wrong == [], "no script of the page failed"
        own = (f"http://127.0.0.1:{found.port}/", f"ws://127.0.0.1:{found.port}/", "data:")
        assert [url for url in found.asked if not url.startswith(own)] == [], "nothing is asked of another host"


def test_figures_and_pictures_move_as_the_stage_does(place):
    place.moves()
    shown = {part: place.page.inner_html(f".part-{part}") for part in ("polar", "orbit")}
    place.until(lambda: all(place.page.inner_html(f".part-{p}") != s for p, s in shown.items()), "pictures to change")
    assert "µm" in place.text("figures") and "µrad" in place.text("figures")
    assert re.search(r"× [\d,]+, ring of radius 100 mm; one division [\d.]+ µm", place.text("polar"))
    place.cell.wait_for_status("compensation: correction", "latched")  # until then it says itself what remains
    send = place.cell.publish_on(place.cell.wire.topic("corrected_offset_pose"), "dashboard")
    offset = np.array([3e-7, 0.0, -4e-7, 0.0, 2e-6, 0.0])

    def is_shown():  # said again and again, as it is while a machine works: an onlooker may miss one
        send(pose_message(time.time_ns(), "workpiece", offset, np.eye(6)))
        shown = place.text("offset")
        shift, tilt = r"shift\s+[\d.,]+\s+0\.500\s+µm", r"b\s+−?[\d.,]+\s+2\.000\s+µrad"
        return re.search(shift, shown) and re.search(tilt, shown)

    place.until(is_shown, "a tool offset")
    place.until(lambda: "SIMULATED" in place.text("verdict"), "a word that it is simulated")
    assert any(url.startswith("ws:") for url in place.asked), "what the page asks for is seen here"
    values = []
    place.until(lambda: values.append(place.value("exc")) or values[-1] is not None, "a figure")
    assert abs(values[-1]) < 50.0


@pytest.mark.parametrize(("width", "height"), [(800, 1280), (1024, 768), (1280, 800)])
def test_nothing_is_wider_than_the_screen(place, width, height):
    place.page.set_viewport_size({"width": width, "height": height})
    place.cell.spin_for(0.2)
    assert place.page.evaluate("document.documentElement.scrollWidth") <= width
    cut = "[...document.querySelectorAll('section')].filter(s => s.scrollWidth > s.clientWidth).map(s => s.innerText)"
    assert place.page.evaluate(cut) == [], "nothing sticks out of its section"
    size = "parseFloat(getComputedStyle(document.querySelector('.verdict strong')).fontSize)"
    assert place.page.evaluate(size) >= 48, "it is read at two metres"


def test_a_dead_head_is_shown_within_two_seconds(place):
    place.until(lambda: not place.is_without("d"), "all heads")
    head = next(process for process in place.cell._processes if process.name == "encoder_head_d")
    with stated("a dead head on the page", DEAD_WITHIN):
        head.send(signal.SIGKILL)
        place.until(lambda: place.is_without("d"), "the page to tell of head d")
    place.until(lambda: "FAULT" in place.text("verdict"), "a fault")
    place.until(lambda: place.page.query_selector(".health .stale") is not None, "the silent node to be greyed")
    place.cell.start("encoder_head", "encoder_head_d", **MOCK)
    place.until(lambda: not place.is_without("d"), "head d to be back")


def test_the_page_goes_on_after_the_estimator_was_started_anew(place):
    place.cell.remove(place.estimator)
    place.until(lambda: place.page.query_selector(".part-figures table.old") is not None, "old figures to be greyed")
    place.until(lambda: "FAULT" in place.text("verdict"), "a fault")
    place.estimator = place.cell.run(ErrorEstimator, "error_estimator")
    place.until(lambda: place.page.query_selector(".part-figures table.old") is None, "new figures")
    place.moves()


def test_the_latch_is_reset_after_it_was_confirmed(place):
    place.until(lambda: "LATCHED" in place.text("correction"), "the latch")
    place.press("Reset the latch", "Cancel")
    place.cell.spin_for(0.5)
    assert place.page.query_selector(".q-notification") is None
    place.press("Reset the latch", "Yes")
    place.until(lambda: "compensation: released" in place.page.inner_text("body"), "the answer of the compensation")


def test_recording_is_paused_and_goes_on(place):
    told = r"size\s+[\d.,]+ MB[\s\S]*free on its disk\s+[\d.,]+ [GM]B"
    place.until(lambda: re.search(told, place.text("recording")), "its size and the room on the disk")
    assert "bag" in place.text("recording")
    place.press("Pause recording", "Yes")
    place.until(lambda: "paused: nothing is recorded" in place.text("recording"), "a pause")
    place.press("Go on recording", "Yes")
    place.until(lambda: "paused" not in place.text("recording"), "the recording to go on")


def test_without_allow_control_there_is_no_button_and_no_client(place, onlooker):
    node, port = onlooker
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=PATIENCE) as answer:
        text = answer.read().decode()
    assert "Corrections and limits" in text and "Reset the latch" not in text and "Pause recording" not in text
    assert node.get_client_names_and_types_by_node(node.get_name(), "/") == []


def test_a_life_cycle_manager_takes_it_down_and_up_again(place, onlooker):
    node, port = onlooker
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
        assert place.cell.change_state(node.get_name(), transition)
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=PATIENCE)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert place.cell.change_state(node.get_name(), transition)
    page = place.page.context.browser.new_page()
    page.goto(f"http://127.0.0.1:{port}/")
    before = page.inner_text(".part-figures")
    place.until(lambda: page.inner_text(".part-figures") != before, "the page of the second server to move")
    page.close()


@pytest.fixture(scope="module")
def onlooker(place):
    """A dashboard in this process that controls nothing, and its port."""
    port = free_port()
    node = place.cell.run(Dashboard, "dashboard_of_onlookers", port=port)
    yield node, port
    place.cell.remove(node)


def test_who_is_not_there_is_not_waited_for():
    nobody = SimpleNamespace(service_is_ready=lambda: False)
    with pytest.raises(StopIteration) as ended:  # it never waits
        _answer(nobody, None).send(None)
    assert ended.value.value is None


def test_a_port_that_is_taken_is_said(place):
    holder = rf"a node of rotary_error_monitor, process {place.dashboard.pid} .*dashboard"
    with pytest.raises(InputError, match=rf"/second: port {place.port} of 127\.0\.0\.1 is taken by {holder}"):
        place.cell.run(Dashboard, "second", port=place.port)


def test_it_ends_in_time_with_a_browser_there_which_says_so_and_recovers(place):
    with stated("the end of the server", ENDS_WITHIN):
        assert place.dashboard.stop() == 0, place.dashboard.output
    place.until(lambda: "NO CONNECTION" in place.page.inner_text("body"), "the page to say that the server is gone")
    place.dashboard = place.serve()
    place.until(lambda: "NO CONNECTION" not in place.page.inner_text("body"), "the page to recover")
    place.moves()
