"""Fixtures that every room's tests use."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
import yaml

hypothesis.settings.register_profile("shared computer", deadline=None)  # an example takes what else runs leaves it
hypothesis.settings.load_profile("shared computer")

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job, and all it starts, would ignore it

LIVE = ("controller", "clock", "live", "network", "nodes", "scenario", "security", "testing")
"""Folders of tests that run processes against the clock. What else a shared computer does may fail one of them; a fault
of the package fails each try. That one try is enough has not been shown yet."""

CASES = Path(__file__).parents[2] / "shared" / "cases"


def case_folders(kind: str, family: str, truth: str) -> list[Path]:
    """Folders of the gap cases in `../shared/cases/<kind>` of one family whose truth is of one kind."""
    found = []
    for path in sorted((CASES / kind).glob("*/truth.yaml")):
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        if (content["family"], content["kind"]) == (family, truth):
            found.append(path.parent)
    return found


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test marked `cases(kind, family, truth, most=…)` runs on each such case, and skips where there are none."""
    marker = metafunc.definition.get_closest_marker("cases")
    if marker is None:
        return
    folders = case_folders(*marker.args)[: marker.kwargs.get("most")]
    absent = pytest.param(None, id="absent", marks=pytest.mark.skip(reason=f"no cases in {CASES / marker.args[0]}"))
    metafunc.parametrize("case", [pytest.param(folder, id=folder.name) for folder in folders] or [absent])


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Tests against the clock get one more try, where pytest-rerunfailures is installed."""
    for item in items if config.pluginmanager.hasplugin("rerunfailures") else ():
        if item.path.parent.name in LIVE:
            item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What failed at its first try is told, though a further one passed."""
    for report in terminalreporter.stats.get("rerun", ()):
        terminalreporter.section(f"failed at first: {report.nodeid}")
        terminalreporter.line(report.longreprtext)


@pytest.fixture(autouse=True)
def _scheduled_as_before() -> Iterator[None]:
    """No test leaves this process, and with it all that later tests start, with another claim to the processors."""
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    yield
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before


@pytest.fixture(autouse=True)
def _no_figures_left() -> Iterator[None]:
    """Figures that a test made are closed with it."""
    yield
    import sys

    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
