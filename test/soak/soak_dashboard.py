"""The live page left open: what node and browser hold at its start and its end. Minutes by SOAK_PAGE_MINUTES (30).

make soak
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import pytest
from nodes.mock_cells import mock_parameters
from ports import free_port

from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.testing import Cell

from .endurance import resident

MINUTES = float(os.environ.get("SOAK_PAGE_MINUTES", "30"))
MARKS = 60
"""Times at which memory is looked at."""

WARM = 0.2
"""Part of the run after which everything has been drawn once, and the browser's caches are as large as they become."""

COMPARED = (0, round(WARM * MARKS), MARKS)
"""Marks at the start, after the first part, and at the end."""

GROWTH = 0.05
"""Most that may be held more from then on: memory is handed back in pieces, and the day's trend has a point a minute. A
leak of all that is sent, 40 kB a second, would be 58 MB, ten times that."""

BROWSER = Path("/usr/bin/chromium-headless-shell")
MACHINE = "xyzac_trt"


@dataclass(frozen=True)
class Held:
    """Memory at one time, bytes, and elements of the page.

    Attributes:
        node: held by the process of the node `dashboard`.
        renderer: held by the browser's process that draws the page.
        heap: of the page's script.
        elements: of the document, those that are kept beside it included.
    """

    node: int
    renderer: int
    heap: int
    elements: int


@pytest.fixture
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="no browser without playwright")
    if not BROWSER.exists():
        pytest.skip(f"there is no browser {BROWSER}")
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"])
        yield found
        found.close()


def renderers() -> Iterator[int]:
    """Processes below this one that draw pages."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(status.parent.name)] = int(status.read_text(encoding="utf-8").rsplit(")", 1)[1].split()[1])
        except OSError:  # ended meanwhile
            continue
    for process in parents:
        above = process
        while above in parents and above != os.getpid():
            above = parents[above]
        if above == os.getpid() and b"--type=renderer" in Path(f"/proc/{process}/cmdline").read_bytes():
            yield process


def measured(page, session, node, *, collect: bool) -> Held:
    """What is held now; only where it will be compared is the browser told to throw away what nobody needs."""
    if collect:
        session.send("HeapProfiler.collectGarbage")
    heap = session.send("Runtime.getHeapUsage")["usedSize"]
    elements = session.send("Memory.getDOMCounters")["nodes"]
    return Held(resident(node.pid), sum(map(resident, renderers())), round(heap), elements)


def start_cell(cell: Cell, folder: Path, port: int):
    """A mock cell of processes; gives that of the dashboard."""
    mock = {"source": "mock", "rate": 500.0}
    for letter in "abcd":
        cell.start("encoder_head", f"encoder_head_{letter}", head=letter, **mock)
    cell.start("autocollimator", **mock)
    cell.start("mock_controller", machine=MACHINE, rate=500.0)
    cell.start("error_estimator")
    cell.start("compensation", machine=MACHINE)
    cell.start("recorder", folder=str(folder / "bag"))
    dashboard = cell.start("dashboard", port=port, machine=MACHINE)
    cell.wait_for_status("dashboard: server", "serving", 120)
    return dashboard


def test_a_page_left_open_holds_no_memory(browser, tmp_path, capsys):
    settings = MockSettings(seed=7, epoch_ns=time.time_ns() - 5_000_000_000, speeds=(2.0, 4.0), forces=True)
    port, found, shown = free_port(), list[Held](), set[str]()
    with Cell(parameters=mock_parameters(settings)) as cell:
        node = start_cell(cell, tmp_path, port)
        page = browser.new_page(viewport={"width": 1024, "height": 1290})
        session = page.context.new_cdp_session(page)
        page.goto(f"http://127.0.0.1:{port}/")
        cell.wait_until(lambda: "µm" in page.inner_text(".part-figures"), "figures on the page", 60)
        for mark in range(MARKS + 1):
            found.append(measured(page, session, node, collect=mark in COMPARED))
            shown.add(page.inner_text(".part-figures"))
            cell.spin_for(MINUTES * 60 / MARKS)
        page.close()
    warm = found[COMPARED[1]]
    with capsys.disabled():
        print(f"\nthe live page of a mock cell, {MINUTES:g} minutes open")
        for field in fields(Held):
            first, begin, end = (getattr(each, field.name) for each in (found[0], warm, found[-1]))
            course = [getattr(each, field.name) for each in found]
            unit, size = ("", 1) if field.name == "elements" else (" MB", 1e6)
            print(
                f"  {field.name}: {first / size:.4g} at first, {begin / size:.4g} after {WARM:.0%}, "
                f"{end / size:.4g}{unit} at the end, {max(course) / size:.4g} at most; each tenth "
                f"{' '.join(f'{each / size:.4g}' for each in course[:: MARKS // 10])}"
            )
    assert len(shown) > MARKS / 2, "the page moved all the time"
    for name in ("node", "renderer", "heap"):
        before, after = getattr(warm, name), getattr(found[-1], name)
        assert after < (1 + GROWTH) * before, f"{name}: {before} became {after}"
