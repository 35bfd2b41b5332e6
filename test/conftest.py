"""Fixtures that every room's tests use."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
import yaml

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description import definition_files, sensor_section, topics
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.plant import instruments
from rotary_error_monitor.sensors import library
from rotary_error_monitor.twin.recording import record_stage

# An example takes what else runs leaves it; `make rates` tries twice as many.
EXAMPLES = 100 if os.environ.get("SWEEPS") else 50
hypothesis.settings.register_profile("shared computer", deadline=None, max_examples=EXAMPLES)
hypothesis.settings.load_profile("shared computer")

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job, and all it starts, would ignore it

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


def _values(case: pytest.Function) -> set[tuple[str, str]]:
    """Values of a case's parameters, by name."""
    return {(name, repr(value)) for name, value in case.callspec.params.items()}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test marked `few(count)` all cases but so many are marked `long`: what is left has most of the values."""
    cases: dict[tuple[str, str, int], list[pytest.Function]] = {}
    for item in items:
        if isinstance(item, pytest.Function) and (marker := item.get_closest_marker("few")):
            cases.setdefault((item.nodeid.partition("[")[0], str(item.parent), marker.args[0]), []).append(item)
    for (_, _, count), left in cases.items():
        seen: set[tuple[str, str]] = set()
        for _ in range(min(count, len(left))):
            case = max(left, key=lambda each: len(_values(each) - seen))  # of equal ones the first
            seen |= _values(case)
            left.remove(case)
        for item in left:
            item.add_marker("long")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """What failed goes to the file that the environment names too: `make test` shows it at its end."""
    if report.failed and (failed := os.environ.get("FAILED_TESTS")):
        with Path(failed).open("a", encoding="utf-8") as file:
            file.write(f"FAILED {report.nodeid} ({report.when})\n{report.longreprtext[-6000:]}\n\n")


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


@pytest.fixture(scope="session")
def stage_problem():
    """Function that gives the problem and the truth of a case of the plant."""

    def make(seed, kind, effects=None, snr=None, rough=False, duration=20.0, stage_effects=None, **others):
        case = make_stage_case(seed, kind, effects, snr, rough, duration, **others)
        blocks = {stream: list(found) for stream, found in case.blocks.items()}
        recording = record_stage(blocks, sorted(case.twin.encoder.azimuths))
        known = load_effects(StageEffect) if stage_effects is None else stage_effects
        return StageProblem(case.twin, recording, known), case.truth

    yield make
    gc.collect()  # a problem and its caches refer to one another: hundreds of MB that Python counts as few objects


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Function that leaves a package in a folder for `import` as pip would, its entry points as they are given."""

    def installed(package, entry_points):
        site = tmp_path / f"site_of_{package.name}"
        shutil.copytree(package, site / package.name)
        info = site / f"{package.name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package.name}\nVersion: 1.0\n")
        lines = [
            line for group, rows in entry_points.items() for line in (f"[{group}]", *map(" = ".join, rows.items()))
        ]
        (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
        monkeypatch.syspath_prepend(str(site))
        for name in [name for name in sys.modules if name.partition(".")[0] == package.name]:
            monkeypatch.delitem(sys.modules, name)

    return installed


KINDS_FOUND = (
    sensor_section.listed_kinds,
    library._kinds,
    library.sensor_kinds,
    library.input_kinds,
    library.kind_of,
    library.is_listed,
    library.instrument_of,
    definition_files.plugged_files,
    topics._contract,
    topics._patterns,
    topics.samples_topic,
    topics.samples_columns,
    topics.columns_named,
    instruments.geometries,
)
"""What a process finds out once of kinds of sensors and their topics."""


@pytest.fixture
def forget_kinds():
    """Function after which the kinds of sensors are looked for anew."""

    def forget():
        for found in KINDS_FOUND:
            found.cache_clear()

    return forget


@pytest.fixture
def install_kind(install, forget_kinds, monkeypatch):
    """Function that installs a package with a kind of sensor, by default with the entry points that it states."""

    def installed(package, entry_points=None):
        if entry_points is None:
            project = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))["project"]
            entry_points = project["entry-points"]
        install(package, entry_points)
        forget_kinds()

    yield installed
    monkeypatch.undo()  # the package is no longer found
    forget_kinds()
