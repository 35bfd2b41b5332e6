"""The page doc/calibration.md: its commands run in their order, print what it shows, and find what was put in."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import re
import shlex
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from calibration.drawn_calibrations import true_flatness, true_graduation

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.testing import Cell

ROOT = Path(__file__).parents[2]
DATA = ROOT / "doc" / "calibration"
NODE = "ros2 run rotary_error_monitor compensation --ros-args -p machine:=my_machine.yaml"


def load_example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("example", Path(__file__).with_name("example_measurements.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


EXAMPLE = load_example()


def blocks() -> list[tuple[str, list[str]]]:
    """Each block of the page: its language and its lines."""
    page = (ROOT / "doc" / "calibration.md").read_text(encoding="utf-8")
    return [(language, text.splitlines()) for language, text in re.findall(r"```(sh|text)\n(.*?)```", page, re.DOTALL)]


def run_command(line: str) -> str:
    """What a command of the page prints."""
    words, printed = shlex.split(line), io.StringIO()
    if words[0] == "cp":
        shutil.copy(words[1], words[2])
    elif words[0] == "rotary_error_monitor":
        with contextlib.redirect_stdout(printed):
            assert main(words[1:]) == 0, line
    else:
        assert line == NODE
    return printed.getvalue()


@pytest.fixture(scope="module")
def worked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Folder in which the page was worked through, and lines that it shows though nothing printed them."""
    folder = tmp_path_factory.mktemp("tutorial")
    for name in ("doc", "config"):
        shutil.copytree(ROOT / name, folder / name)
    texts = [path.read_text(encoding="utf-8") for path in (*DATA.glob("*.csv"), *DATA.glob("*.txt"))]
    rows = {line for text in texts for line in text.splitlines()}
    printed, wrong = "", []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for language, lines in blocks():
            if language == "sh":
                printed = "".join(map(run_command, lines))
            else:
                wrong += [line for line in lines if line not in printed.splitlines() and line not in rows]
    return folder, wrong


def test_commands_print_what_the_page_shows(worked: tuple[Path, list[str]]) -> None:
    folder, wrong = worked
    assert wrong == []
    for name in ("straightness.png", "runs.png", "flatness.png"):
        assert (folder / name).stat().st_size > 50_000
    assert len((folder / "mirror.csv").read_text(encoding="utf-8").splitlines()) == 2 + 101
    assert len((folder / "wheel.csv").read_text(encoding="utf-8").splitlines()) == 1 + 141 * 51
    assert (folder / "axes.png").stat().st_size > 10_000
    assert (folder / "errors.png").stat().st_size > 10_000
    assert (folder / "autocollimator.png").stat().st_size > 30_000
    assert (folder / "assembly.png").stat().st_size > 100_000
    assert (folder / "x.comp").read_text(encoding="ascii").startswith("-240.000000000 ")
    assert len((folder / "volumetric.csv").read_text(encoding="ascii").splitlines()) == 1 + 11 * 11 * 5


def test_the_measurements_are_those_that_were_simulated() -> None:
    for name, make in EXAMPLE.FILES.items():
        assert (DATA / name).read_text(encoding="utf-8") == make(), name


def test_the_recording_is_that_which_was_simulated() -> None:
    made = EXAMPLE.between_centres()
    read = BagReader(DATA / EXAMPLE.BAG).read_blocks(list(made))
    for topic, blocks in made.items():
        rows = [np.concatenate([block.rows for block in each]) for each in (blocks, read[topic])]
        np.testing.assert_allclose(rows[1], rows[0], rtol=0, atol=1e-12)


def test_the_curves_are_those_of_ring_and_mirror(worked: tuple[Path, list[str]]) -> None:
    """At half degrees, to twice the stated uncertainty (root mean square)."""
    stage, angles = load_stage(worked[0] / "my_stage.yaml"), np.radians(np.arange(0, 360, 0.5))
    ring, mirror = stage.ring.graduation_table, stage.mirror.flatness_table
    assert ring is not None and mirror is not None
    truth = true_graduation(EXAMPLE.GRADUATION, angles)
    assert np.sqrt(np.mean((np.array(ring.values) - truth) ** 2)) < 2 * ring.uncertainty < 3e-7
    flat = np.stack([mirror.x, mirror.y], axis=1) - true_flatness(EXAMPLE.FLATNESS, angles)
    assert np.sqrt(np.mean(flat**2)) < 2 * mirror.uncertainty < 5e-7
    np.testing.assert_allclose(stage.ring.eccentricity, EXAMPLE.SHAFT.eccentricity, atol=1e-8)


def test_an_instruments_own_file_gives_the_same(worked: tuple[Path, list[str]]) -> None:
    tables = [load_machine(worked[0] / name).errors["EXX"].table for name in ("my_machine.yaml", "from_laser.yaml")]
    assert tables[0] is not None and tables[0] == tables[1]


def test_the_machine_file_holds_what_was_put_in(worked: tuple[Path, list[str]]) -> None:
    found = load_machine(worked[0] / "my_machine.yaml")
    table = found.errors["EXX"].table
    assert table is not None
    mean = EXAMPLE.positioning_error(np.array(table.positions))
    for values, sign in ((table.forward, 1), (table.backward, -1)):
        assert np.abs(np.array(values) - mean + 0.5 * sign * EXAMPLE.REVERSAL).max() < 0.25e-6
    table = found.errors["EZX"].table
    assert table is not None
    x = np.array(table.positions)
    error = np.array(table.forward) - EXAMPLE.straightness_error(x)
    assert np.abs(error - np.polyval(np.polyfit(x, error, 1), x)).max() < 0.1e-6
    carriage, ram = (np.array(found.body(name).location_error.rotation) for name in ("carriage", "ram"))
    assert carriage[2] == pytest.approx(-EXAMPLE.X_TO_Y, abs=2e-6)
    np.testing.assert_allclose(ram[:2], [EXAMPLE.Z_TO_Y, -EXAMPLE.Z_TO_X], rtol=0, atol=2e-6)


def test_the_stage_file_holds_the_instrument_that_was_simulated(worked: tuple[Path, list[str]]) -> None:
    """A spot of radius w makes a normalised difference of erf(sqrt(2) tilt / w), whose series begins with x - x^3/3."""
    response = load_stage(worked[0] / "my_stage.yaml").response("autocollimator")
    slopes = 0.0015 * 2 * np.sqrt(2 / np.pi) / (np.array(EXAMPLE.SPOT_ARCSEC) * np.pi / 648000)
    assert response.gain == pytest.approx(slopes.mean(), rel=0.005)
    assert response.gain_difference == pytest.approx(np.subtract(*slopes) / slopes.mean(), abs=0.008)
    assert response.roll == pytest.approx(np.radians(EXAMPLE.ROLL_DEG), abs=0.002)
    bends = -2 / 3 / np.square(np.array(EXAMPLE.SPOT_ARCSEC) * np.pi / 648000)
    np.testing.assert_allclose(response.cubic, bends, rtol=0.3)


def test_the_compensation_starts_on_the_file(worked: tuple[Path, list[str]]) -> None:
    with Cell() as cell:
        cell.run(Compensation, "compensation", machine=str(worked[0] / "my_machine.yaml"))
        cell.wait_for_status("compensation: correction", "held: no error motion yet")
