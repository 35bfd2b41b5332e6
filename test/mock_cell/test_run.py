"""The mock cell from starting processes to the table, and what the table says of figures out of bounds."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from nodes.probes import stage_with_probes

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.metrology.radial_comparison import RadialComparison
from rotary_error_monitor.mock_cell import run as mock_run
from rotary_error_monitor.mock_cell.figures import BoundedFigure, _maximum, table
from rotary_error_monitor.mock_cell.run import RunOutcome, _end_together
from rotary_error_monitor.testing import Cell

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def run():
    """The command of the README as a user types it; what it printed."""
    return subprocess.run(["make", "run"], cwd=ROOT, capture_output=True, text=True, timeout=300)


def bag_of(run):
    """Folder of the recording."""
    return ROOT / re.search(r"^bag: (.+)$", run.stdout, re.MULTILINE)[1]


@pytest.mark.cell
def test_every_figure_of_a_run_is_within_its_bound(run):
    assert run.returncode == 0, run.stdout + run.stderr
    for height in (5, 16, 60):
        assert re.search(rf"radial error motion at h = {height} mm: RMS against LVDT, µm +0\.0\d+ .* ok", run.stdout)
        force = re.search(rf"h = {height} mm: external force on the shaft, N +(\d+)", run.stdout)
        assert force is not None
        assert float(force[1]) > 20 or height == 5  # it came and went, and the estimate followed
    assert "tool offset, position, after correction" in run.stdout
    assert "OUT OF BOUNDS" not in run.stdout
    bag = bag_of(run)
    assert (bag / "metadata.yaml").is_file()
    assert (bag.parent / "cell.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.cell
def test_its_recording_replays_to_what_was_published(run, tmp_path):
    """The command gives again, bit for bit, what estimator and compensation published on the wire."""
    from rotary_error_monitor.bags.reader import BagReader

    bag, out = bag_of(run), tmp_path / "out.npz"
    assert main(["replay", str(bag), "--machine", "xyzac_trt", "-o", str(out)]) == 0
    topics = ("/stage/error_motion/samples", "/machine/tool_offset/samples")
    motion, offsets = (BagReader(bag).read_blocks([topic])[topic] for topic in topics)
    with np.load(out) as found:
        stamps = np.concatenate([block.times_ns for block in motion])
        np.testing.assert_array_equal(found["stamp_ns"], stamps)
        np.testing.assert_array_equal(found["theta"], np.concatenate([block.column("theta") for block in motion]))
        for i, name in enumerate(("exc", "eyc", "ezc", "eac", "ebc", "ecc")):
            published = np.concatenate([block.column(name) for block in motion])
            again = found["error_motion"][:, i]
            seen = np.isfinite(again)
            np.testing.assert_array_equal(again[seen], published[seen])
            assert (published[~seen] == 0).all()
        at = np.searchsorted(stamps, np.concatenate([block.times_ns for block in offsets]))
        published = np.concatenate([block.rows[:, 1:7] for block in offsets])
        np.testing.assert_array_equal(found["tool_offset"][at], published)
        assert len(at) > 0.9 * (len(stamps) - at[0]), "from the first one on"


@pytest.mark.few(1)
@pytest.mark.cell
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_what_a_run_started_ends_with_it(number, tmp_path):
    command = [sys.executable, "-m", "rotary_error_monitor.cli", "run", "--folder", str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        started = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        assert _comes_true(lambda: len(started.read_text().split()) >= 9 and (tmp_path / "run" / "bag").exists())
        nodes = [Path("/proc") / each for each in started.read_text().split()]
        run.send_signal(number)
        assert run.wait(60) == 128 + number
    assert not [node for node in nodes if node.exists()]


def _comes_true(condition: Callable[[], bool], patience: float = 60.0) -> bool:
    end = time.monotonic() + patience
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


def test_a_process_that_ends_badly_is_told_with_its_words():
    recording = RunOutcome(Path("bag"), 0)
    with Cell() as cell:
        good = cell.start("encoder_head", "encoder_head_a", source="mock")
        cell.wait_for_status("encoder_head_a: state", "active")
        bad = cell.start("encoder_head", "encoder_head_x", source="mock")
        bad.wait()
        _end_together([good, bad], recording)
    (failure,) = recording.failures
    assert failure.startswith("encoder_head_x ended with exit code 2; it wrote:\n")
    assert "the stage has the heads a, b, c, d" in failure


class ThatStarts:
    """In place of a cell: it notes what is started, and ends once somebody waits for the recorder to hear all."""

    def __init__(self, heads, parameters, sensors=()):
        self.wire = load_wire(heads, sensors=sensors)
        self.started = {}
        self.silent = "none"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def start(self, executable, name="", **parameters):
        self.started[name or executable] = executable, parameters
        return SimpleNamespace(name=name or executable)

    def wait_for_status(self, *_):
        return SimpleNamespace(message="serving on http://127.0.0.1:9001")

    def recorder_hears(self, topics):
        return topics.isdisjoint(self.silent.split(", "))

    def wait_until(self, condition, what, _):
        assert condition(), "every instrument is heard"
        self.silent = "/stage/axial_probe_top/samples, /stage/lvdt/samples"
        assert not condition(), "a probe is waited for as well"
        raise TimeoutError(what)


def test_a_node_is_started_for_each_listed_sensor(tmp_path, monkeypatch):
    cells = []
    monkeypatch.setattr(mock_run, "Cell", lambda *given, **named: cells.append(ThatStarts(*given, **named)) or cells[0])
    file = stage_with_probes(tmp_path)
    with pytest.raises(TimeoutError, match="the recorder to hear every instrument"):
        mock_run.record(mock_run.MockCell(tmp_path / "run", stage=file, quiet=True), load_stage(file))
    (cell,) = cells
    assert {name for name in cell.started if name.startswith("listed")} == {"listed_sensor_top", "listed_sensor_low"}
    executable, parameters = cell.started["listed_sensor_top"]
    assert (executable, parameters["sensor"]) == ("listed_sensor", "axial_probe_top")
    _, of_head = cell.started["encoder_head_a"]
    shared = {name for name in of_head if name.startswith("mock.")}
    assert shared and all(parameters[name] == of_head[name] for name in shared), "the same rotor"


def test_the_page_is_served_before_anything_else_and_its_address_printed(tmp_path, monkeypatch, capsys):
    cells = []
    monkeypatch.setattr(mock_run, "Cell", lambda *given, **named: cells.append(ThatStarts(*given, **named)) or cells[0])
    file = stage_with_probes(tmp_path)
    with pytest.raises(TimeoutError):
        mock_run.record(mock_run.MockCell(tmp_path / "run", stage=file, quiet=True, dashboard=9001), load_stage(file))
    (name, *_), (given, *_) = cells[0].started, cells[0].started.values()
    assert (name, given) == ("dashboard", ("dashboard", {"port": 9001, "machine": "xyzac_trt"}))
    assert capsys.readouterr().out == "dashboard: http://127.0.0.1:9001\n"


def test_a_figure_out_of_its_bound_is_said():
    rows = [
        BoundedFigure("good", 1.0, 2.0),
        BoundedFigure("bad", 3.0, 2.0),
        BoundedFigure("not a number", float("nan"), 2.0),
        BoundedFigure("free", 9.0),
    ]
    assert [row.ok for row in rows] == [True, False, False, True]
    lines = table(rows).splitlines()
    assert lines[0].endswith("at most 2.000  ok")
    assert lines[1].endswith("OUT OF BOUNDS")
    assert lines[3].rstrip().endswith("9.000")


def test_where_the_largest_difference_stands_is_said_if_it_is_too_large():
    """One tick of two seconds is off along y: the figure alone would leave nothing to look for."""
    stamps = 1_000_000_000 + 1_000_000 * np.arange(2000)
    reference = 7e-6 * np.column_stack([np.cos(stamps * 3e-9), np.sin(stamps * 3e-9)])
    spike = np.zeros((2000, 2))
    spike[1234, 1] = -1.5e-6
    std = np.full((2000, 2), 1e-7)
    told = {
        size: table([_maximum("h", RadialComparison(stamps, reference + size * spike, reference, std), 1_000_000_000)])
        for size in (0.1, 1.0)
    }
    assert told[0.1].endswith("0.150  at most 0.500  ok")
    assert "OUT OF BOUNDS: 1.234 s after the start, stamp 2234000000, along y: estimate [" in told[1.0]
    assert told[1.0].endswith("standard deviation 0.100 µm; 1 differences are beyond 0.5 µm")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--duration", "2"], "--duration is 2.0 s; 9.0 s are needed"),
        (["--dashboard", "80"], "--dashboard is 80; expected a port from 1024 to 65535"),
        (["--folder", "."], "--folder . exists already"),
        (["--machine", "no_such"], "no machine 'no_such'"),
        (["--machine", "grinder_zhou2023"], "machine grinder_zhou2023 has no monitored axis"),
    ],
)
def test_wrong_arguments_are_named(arguments, message, capsys):
    assert main(["run", *arguments]) == 2
    assert message in capsys.readouterr().err
