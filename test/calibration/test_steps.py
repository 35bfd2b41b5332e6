"""Each step from a file of measurements to a machine file that the model then runs on; the commands around them."""

from __future__ import annotations

import argparse
import difflib
import hashlib
import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from faults.documenting import Row, shows
from kernels import computing_by
from numpy.typing import NDArray

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.calibration.parameters import apply_parameters, list_parameters
from rotary_error_monitor.calibration.volume import sample_volume
from rotary_error_monitor.codec.contents import Content, JointState, PointStamped, Temperature
from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.topics import pose_topics
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.resources import config

JOINT_STATES, TOOL_PROBE, TEMPERATURE = pose_topics()

Array = NDArray[np.float64]
DAY = "2026-11-21"


def run(*words: object) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser)
    arguments = parser.parse_args([*map(str, words)])
    return int(arguments.run(arguments))


def calibration_of(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))["machine"]["calibration"]


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("machines/pan2013.yaml"), tmp_path / "machine.yaml"))


def positioning_file(folder: Path, rotary: bool = False) -> Path:
    targets = [-300, -170, -50, 60, 180, 300] if rotary else [-3000, -1710, -620, 450, 1800, 3000]
    rng = np.random.default_rng(1)
    lines = ["target_deg,direction,cycle,deviation_arcsec" if rotary else "target_mm,direction,cycle,deviation_um"]
    for cycle in range(1, 6):
        for direction, way in ((1, targets), (-1, targets[::-1])):
            for target in way:
                value = 10 * target / max(targets) - 2 * direction + 0.1 * rng.normal()
                lines.append(f"{target},{direction},{cycle},{value:.4f}")
    path = folder / "runs.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_positioning(tmp_path: Path, machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, figure = positioning_file(tmp_path), tmp_path / "x.png"
    words = ["positioning", source, "--machine", machine, "--axis", "X", "--date", DAY, "--figure", figure]
    assert run(*words) == 0
    text = capsys.readouterr().out
    assert "reversal error B 4." in text
    assert "accuracy A 2" in text
    assert figure.stat().st_size > 10_000
    after = load_machine(machine)
    # What was half of the reversal error in the file is in the table's two columns now.
    assert after.axis("X").reversal == 0.0
    model = arrange_machine(after)
    pose = np.array([[0.45, 0.0, 0.0, 0.0, 0.0]] * 2)
    before = predict_tool_offset(arrange_machine(load_machine("pan2013")), pose)
    offset = predict_tool_offset(model, pose, direction=[[1.0] + [0.0] * 4, [-1.0] + [0.0] * 4])
    np.testing.assert_allclose((offset - before)[:, 0], [1.5e-6 - 2e-6 - 5.25e-6, 1.5e-6 + 2e-6 - 5.25e-6], atol=0.2e-6)
    note = yaml.safe_load(machine.read_text(encoding="utf-8"))["machine"]["calibration"]["EXX"]
    assert note["date"] == DAY
    assert note["sha256"] == hashlib.sha256(source.read_bytes()).hexdigest()
    assert note["source"] == "runs.csv"
    assert 0 < note["uncertainty"] < 1e-7
    assert note["figures"]["reversal_error"] == pytest.approx(4e-6, rel=0.1)
    content = machine.read_text(encoding="utf-8")
    assert "# [T2] 0.05/2000" in content
    assert "# [T2] 0.07/6000" not in content


def test_positioning_of_a_rotary_axis(tmp_path: Path, machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.yaml"
    assert (
        run("positioning", positioning_file(tmp_path, rotary=True), "--machine", machine, "--axis", "C", "-o", out) == 0
    )
    assert "arcsec" in capsys.readouterr().out
    table = load_machine(out).errors["ECC"].table
    assert table is not None
    assert table.positions[0] == pytest.approx(-math.radians(300), rel=1e-5)
    assert table.forward[-1] == pytest.approx(math.radians(8 / 3600), rel=0.05)
    assert load_machine(machine) == load_machine("pan2013")


@pytest.mark.parametrize("targets", [range(0, 360, 45), range(0, 361, 45), range(-150, 181, 30)])
def test_a_rotary_axis_measured_all_round_repeats_itself(tmp_path: Path, targets: range) -> None:
    """One turn of targets, two turns of travel to either side: the same error in every turn."""
    machine, source = tmp_path / "machine.yaml", tmp_path / "c.csv"
    shutil.copy(config("machines/xyzac_trt.yaml"), machine)
    lines = ["target_deg,direction,cycle,deviation_arcsec"]
    for cycle in range(1, 6):
        for direction, way in ((1, targets), (-1, targets[::-1])):
            for target in way:
                error = 5 * math.sin(math.radians(target)) - direction + cycle % 2 + 1e-5 * cycle
                lines.append(f"{target},{direction},{cycle},{error}")
    source.write_text("\n".join(lines), encoding="utf-8")
    assert run("positioning", source, "--machine", machine, "--axis", "C") == 0
    table = load_machine(machine).errors["ECC"].table
    assert table is not None
    assert table.positions[0] == pytest.approx(-2 * math.pi, abs=1e-4)
    assert table.positions[-1] == pytest.approx(2 * math.pi, abs=1e-4)
    arcsec = math.radians(1 / 3600)
    for turn in (-360, 0, 360):
        for target in targets:
            if abs(target + turn) <= 359:
                at = math.radians(target + turn)
                forward = np.interp(at, table.positions, table.forward)
                assert forward == pytest.approx((5 * math.sin(at) - 1 + 0.6) * arcsec, abs=1e-3 * arcsec)
                backward = np.interp(at, table.positions, table.backward)
                assert backward - forward == pytest.approx(2 * arcsec, abs=1e-3 * arcsec)


def test_targets_over_a_part_of_the_travel_are_told(
    tmp_path: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["target_mm,direction,cycle,deviation_um"]
    lines += [f"{target},1,{cycle},{cycle}" for cycle in (1, 2) for target in (-1500, 0, 1500)]
    source = tmp_path / "x.csv"
    source.write_text("\n".join(lines), encoding="utf-8")
    assert run("positioning", source, "--machine", machine, "--axis", "X") == 0
    assert "note: the targets cover 50% of the travel" in capsys.readouterr().out


@pytest.mark.parametrize(("axis", "scale"), [("X", 1e-3), ("C", math.pi / 180)])
def test_targets_in_another_unit_are_written_by_force_only(
    tmp_path: Path, machine: Path, axis: str, scale: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """Metres for mm, and radians for degrees."""
    source = positioning_file(tmp_path, rotary=axis == "C")
    head, *rows = source.read_text(encoding="utf-8").splitlines()
    rows = [f"{float(at) * scale:.9g},{rest}" for at, _, rest in (row.partition(",") for row in rows)]
    source.write_text("\n".join([head, *rows]), encoding="utf-8")
    before = machine.read_bytes()
    assert run("positioning", source, "--machine", machine, "--axis", axis) == calibrate.NOT_GOOD
    assert re.search(rf"does not fit: the targets cover \d\.\d+% of the travel of {axis}", capsys.readouterr().out)
    assert machine.read_bytes() == before
    assert run("positioning", source, "--machine", machine, "--axis", axis, "--force") == 0


@pytest.mark.parametrize(("axis", "scale"), [("X", 1e-3), ("C", 1 / 3600)])
@pytest.mark.parametrize("seed", range(3))
def test_deviations_that_repeat_better_than_any_instrument_are_asked_for_their_unit(
    tmp_path: Path, machine: Path, axis: str, scale: float, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Scatter of 0.3 µm and of 0.3″; mm under a header in µm, and degrees under one in arcsec."""
    rng = np.random.default_rng(seed)
    head, *rows = positioning_file(tmp_path, rotary=axis == "C").read_text(encoding="utf-8").splitlines()
    rows = [row.rpartition(",")[0] for row in rows]
    for unit in (1.0, scale):
        lines = [f"{row},{unit * rng.normal(0, 0.3):.9f}" for row in rows]
        source = tmp_path / "scattered.csv"
        source.write_text("\n".join([head, *lines]), encoding="utf-8")
        assert run("positioning", source, "--machine", machine, "--axis", axis, "--force") == 0
        text = capsys.readouterr().out
        assert ("no instrument repeats to" in text) == (unit != 1.0), text


@pytest.mark.parametrize(("axis", "scale"), [("X", 1e-3), ("C", 1 / 3600)])
def test_deviations_in_another_unit_are_written_by_force_only(
    tmp_path: Path, machine: Path, axis: str, scale: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of an axis that is off by 10 µm (10″) and scatters by 4 µm (0.5″), as mm and degrees."""
    rng = np.random.default_rng(1)
    head, *rows = positioning_file(tmp_path, rotary=axis == "C").read_text(encoding="utf-8").splitlines()
    source, before = tmp_path / "other.csv", machine.read_bytes()
    for unit, code in ((scale, calibrate.NOT_GOOD), (1.0, 0)):
        lines = []
        for row in rows:
            start, _, value = row.rpartition(",")
            lines.append(f"{start},{unit * (float(value) + rng.normal(0, 4.0 if axis == 'X' else 0.5)):.9f}")
        source.write_text("\n".join([head, *lines]), encoding="utf-8")
        assert run("positioning", source, "--machine", machine, "--axis", axis) == code
        told = capsys.readouterr().out
        assert ("are the readings in the unit of the header?" in told) == (code != 0)
        assert (machine.read_bytes() == before) == (code != 0)


def test_startup_outlier_is_named_and_counted(
    tmp_path: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = positioning_file(tmp_path)
    lines = source.read_text(encoding="utf-8").splitlines()
    lines[1] = "-3000,1,1,-2.0"
    source.write_text("\n".join(lines), encoding="utf-8")
    before = machine.read_bytes()
    assert run("positioning", source, "--machine", machine, "--axis", "X") == calibrate.NOT_GOOD
    text = capsys.readouterr().out
    assert "flagged (start-up): cycle 1, direction +1, target -3000 mm: +10" in text
    assert "the figures include it" in text
    assert "does not fit: 1 reading(s) stand off from the others at their target, by up to +10" in text
    assert "not written; --force writes it all the same, standard uncertainty" in text
    assert machine.read_bytes() == before
    assert run("positioning", source, "--machine", machine, "--axis", "X", "--force") == 0
    counted = load_machine(machine).errors["EXX"].table
    note = calibration_of(machine)["EXX"]
    assert note["uncertainty"] > 2e-6
    assert note["remark"].startswith("1 reading(s) stand off")
    assert note["history"] == [
        {
            "values": {"errors.EXX": {"poly": [0.0, 3.5e-5]}, "axes.X.reversal": 4.95e-6},
            "comment": "[T2] 0.07/6000 (text: 0.069909 mm)",
        }
    ]
    assert run("positioning", source, "--machine", machine, "--axis", "X", "--drop-outliers") == 0
    assert "standard deviations; dropped" in capsys.readouterr().out
    dropped = load_machine(machine).errors["EXX"].table
    assert counted is not None
    assert dropped is not None
    # One of five readings stood 10 µm off: it moves their mean by 2 µm.
    assert counted.forward[0] - dropped.forward[0] == pytest.approx(2e-6, abs=0.1e-6)
    assert counted.forward[1:] == dropped.forward[1:]
    history = calibration_of(machine)["EXX"]["history"]
    assert ["date" in row for row in history] == [True, False]
    assert history[0]["values"]["errors.EXX"]["table"]["forward"] == list(counted.forward)
    assert "remark" not in calibration_of(machine)["EXX"]


def test_targets_beyond_the_travel(tmp_path: Path, machine: Path) -> None:
    with pytest.raises(InputError, match=r"runs.csv: positions from -3 to 3 leave the travel of Y, -1 to 1"):
        run("positioning", positioning_file(tmp_path), "--machine", machine, "--axis", "Y")
    with pytest.raises(InputError, match="no axis"):
        run("positioning", positioning_file(tmp_path), "--machine", machine, "--axis", "B")


GRINDER_Z = np.linspace(-0.8, 0.0, 201)
"""Positions over the travel of the grinder's Z, so near that their range is that of the curve."""


def mirror_form(distance: Array) -> Array:
    """Form of a curved mirror, µm over mm."""
    return 0.4 * (distance / 220 - 1) ** 2


def straightness_file(folder: Path, runs: int = 6, curved: float = 0.0, turn: bool = False) -> tuple[Path, Array]:
    """Z of the grinder at two placements of a 440 mm mirror, measured back and forth; the first both ways up."""
    rng = np.random.default_rng(2)
    lines = ["segment,run,direction,position_mm,reading_um,mirror"]
    placements = [(-800, 1), (-440, 1)] + ([(-800, -1)] if turn else [])
    for number, (start, side) in enumerate(placements):
        tilt = rng.normal(0, 20)
        for k in range(runs):
            direction = 1 if k % 2 == 0 else -1
            x = np.arange(start, start + 440.5, 2)[::direction]
            y = curve(x * 1e-3) * 1e6 + tilt * (x - start) * 1e-3 + 0.06 * rng.normal(size=x.size)
            y = y + side * curved * mirror_form(x - start)
            lines += [f"{number},{k},{direction},{p:g},{v:.4f},{side}" for p, v in zip(x, y, strict=True)]
    path = folder / "straightness.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    q = GRINDER_Z
    truth = curve(q)
    return path, truth - np.polyval(np.polyfit(q, truth, 1), q)


def curve(z: Array) -> Array:
    return 2.9e-6 * np.sin(9 * z) + 0.5e-6 * np.cos(21 * z)


@pytest.mark.parametrize("runs", [6, 1])
def test_straightness(tmp_path: Path, runs: int, capsys: pytest.CaptureFixture[str]) -> None:
    source, truth = straightness_file(tmp_path, runs)
    machine = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "grinder.yaml"))
    figure = tmp_path / "z.png"
    words = ["--component", "EYZ", "--mirror-length-mm", 440, "--mirror-flatness-um", 0.08, "--noise-um", 0.06]
    assert run("straightness", source, "--machine", machine, *words, "--monotone", "--figure", figure) == 0
    text = capsys.readouterr().out
    assert "overlap of segments 1 and 2: 18% of the mirror" in text  # 80 of 440 mm
    assert "-800 to 0 mm" in text
    assert ("largest deviation of a run" in text) == (runs > 1)
    assert figure.stat().st_size > 10_000
    component = load_machine(machine).errors["EYZ"]
    assert component.table is not None
    found = np.interp(GRINDER_Z, component.table.positions, component.table.forward)
    uncertainty = calibration_of(machine)["EYZ"]["uncertainty"]
    assert np.abs(found - truth).max() < 4 * uncertainty < 0.8e-6
    # The slope beside the table makes the sum monotone.
    q = np.array(component.table.positions)
    rotated = np.array(component.table.forward) + component.poly[1] * (q + 0.4) / 0.4
    steps = np.diff(rotated)
    assert steps.min() > -1e-11 or steps.max() < 1e-11


@pytest.mark.parametrize("way", ["turned", "calibrated"])
def test_straightness_with_a_curved_mirror(tmp_path: Path, way: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A mirror hollow by 0.4 µm: measured both ways up, or with its calibration."""
    source, truth = straightness_file(tmp_path, curved=1.0, turn=way == "turned")
    machine = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "grinder.yaml"))
    words = ["straightness", source, "--machine", machine, "--component", "EYZ", "--mirror-length-mm", 440]
    if way == "turned":
        words += ["--mirror-flatness-um", "unknown", "--noise-um", 0.06]
    else:
        profile = tmp_path / "mirror.csv"
        rows = [f"{x},{mirror_form(np.array(float(x))):.5f}" for x in range(0, 441, 10)]
        profile.write_text("\n".join(["distance_mm,height_um", *rows]), encoding="utf-8")
        words += ["--mirror-flatness-um", 0.005, "--noise-um", 0.06, "--mirror-profile", profile]
    assert run(*words) == 0
    text = capsys.readouterr().out
    assert "warning" not in text
    found = re.search(r"EYZ\) ([\d.]+) µm(?:.*\n)+?.*through the ends ([\d.]+) µm, minimum zone ([\d.]+) µm", text)
    assert found is not None
    squares, ends, zone = map(float, found.groups())
    assert zone <= squares == pytest.approx(np.ptp(truth) * 1e6, abs=0.15)
    assert zone <= ends
    table = load_machine(machine).errors["EYZ"].table
    assert table is not None
    q = np.linspace(-0.795, -0.005, 80)
    error = np.interp(q, table.positions, table.forward) - curve(q)
    assert np.abs(error - np.polyval(np.polyfit(q, error, 1), q)).max() <= 0.1e-6


def test_straightness_with_an_unknown_mirror_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, _ = straightness_file(tmp_path)
    machine = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "grinder.yaml"))
    words = ["--mirror-length-mm", 440, "--mirror-flatness-um", "unknown", "--noise-um", 0.06]
    before = machine.read_bytes()
    assert run("straightness", source, "--machine", machine, "--component", "EYZ", *words) == calibrate.NOT_GOOD
    told = capsys.readouterr().out
    assert "warning: the mirror's flatness is unknown" in told
    assert "does not fit: the mirror's flatness is unknown, and a curved mirror looks like a curved guideway" in told
    assert machine.read_bytes() == before
    assert run("straightness", source, "--machine", machine, "--component", "EYZ", *words, "--force") == 0
    # all of the curve may be the mirror's
    assert calibration_of(machine)["EYZ"]["uncertainty"] > 2e-6
    with pytest.raises(InputError, match=r"straightness.csv: segment 1 runs from .* beyond the mirror"):
        run("straightness", source, "--machine", machine, "--component", "EYZ", "--mirror-length-mm", 300, *words[2:])
    for name, message in (("EZZ", "no straightness of a linear axis"), ("XYZ", "names no straightness")):
        with pytest.raises(InputError, match=message):
            run("straightness", source, "--machine", machine, "--component", name, *words)


def coarse_file(folder: Path, runs: int, noise: float = 0.0, seed: int = 0) -> Path:
    """A bow of 35 µm at 21 stops over 5 m, there and back."""
    rng = np.random.default_rng(seed)
    lines = ["segment,run,direction,position_mm,reading_um"]
    for number in range(runs):
        way = 1 if number % 2 == 0 else -1
        for x in np.linspace(-2500, 2500, 21)[::way]:
            lines.append(f"1,{number},{way},{x:g},{35 * (x / 2500) ** 2 + noise * rng.normal() + 5 * number:.6f}")
    path = folder / f"coarse_{runs}_{seed}.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


COARSE = ["--component", "EYX", "--mirror-length-mm", 5000, "--mirror-flatness-um", 0, "--noise-um", 0.1]


@pytest.mark.parametrize("runs", [1, 2, 3, 4])
def test_repeated_coarse_runs_keep_travel_and_height(
    tmp_path: Path, machine: Path, runs: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("straightness", coarse_file(tmp_path, runs), "--machine", machine, *COARSE) == 0
    text = capsys.readouterr().out
    found = re.search(r"\(EYX\) ([\d.]+) µm .* uncertainty ([\d.]+) µm, (\S+) to (\S+) mm", text)
    assert found is not None
    error, uncertainty, first, last = map(float, found.groups())
    assert error == pytest.approx(35.0, abs=0.001)
    assert (first, last) == (-2500, 2500)
    assert uncertainty < 0.2
    assert "readings 250 mm apart; waves shorter than 500 mm stay unseen" in text
    table = load_machine(machine).errors["EYX"].table
    assert table is not None
    x = np.array(table.positions)
    truth = 35e-6 * (x / 2.5) ** 2
    np.testing.assert_allclose(np.array(table.forward) - np.mean(table.forward), truth - truth.mean(), atol=2e-9)


@pytest.mark.long
def test_stated_uncertainty_of_coarse_runs_covers(tmp_path: Path, machine: Path) -> None:
    shares, stated = [], []
    for seed in range(12):
        assert run("straightness", coarse_file(tmp_path, 3, 0.3, seed), "--machine", machine, *COARSE) == 0
        table, note = load_machine(machine).errors["EYX"].table, calibration_of(machine)["EYX"]
        assert table is not None
        x = np.array(table.positions)
        error = np.array(table.forward) - 35e-6 * (x / 2.5) ** 2
        error -= np.polyval(np.polyfit(x, error, 1), x)
        shares.append(np.mean(np.abs(error) < 2 * note["uncertainty"]))
        stated.append(note["uncertainty"])
    assert np.mean(shares) >= 0.95
    # one reading forward and back each would have 0.3 µm / sqrt(2)
    assert np.median(stated) < 0.22e-6
    assert np.mean(np.array(stated) < 0.4e-6) >= 0.9
    assert len(calibration_of(machine)["EYX"]["history"]) == 10


@pytest.mark.parametrize("step", ["positioning", "straightness"])
def test_all_but_the_calibrated_section_stays_byte_for_byte(tmp_path: Path, machine: Path, step: str) -> None:
    """Comments, line ends and digits of a file as its owner writes it, through two calibrations."""
    text = machine.read_text(encoding="utf-8").replace("0.0,", "0.000,").replace("e-0", "E-0")
    text = "# our machine\n" + text + "\n# end of it  \n"
    machine.write_bytes(text.replace("\n", "\r\n").encode())
    before = machine.read_bytes().split(b"\r\n")
    name, words = {
        "positioning": ("EXX", [positioning_file(tmp_path), "--axis", "X"]),
        "straightness": ("EYX", [coarse_file(tmp_path, 3, 0.1), *COARSE]),
    }[step]
    for _ in range(2):
        assert run(step, *words, "--machine", machine) == 0
        after = machine.read_bytes().split(b"\r\n")
        assert all(b"\n" not in line for line in after)
        changes = difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
        gone = [line for kind, i, j, _, _ in changes if kind in ("replace", "delete") for line in before[i:j]]
        own = [f"{name}:".encode()] + ([b"reversal:"] if step == "positioning" else [])
        assert 1 <= len(gone) <= len(own)
        assert all(any(key in line for key in own) for line in gone)
        added = [line for kind, _, _, i, j in changes if kind in ("replace", "insert") for line in after[i:j]]
        assert b"  calibration:" in added
    assert name in load_machine(machine).errors


def test_a_reading_that_stands_off_is_written_by_force_only(
    tmp_path: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = coarse_file(tmp_path, 4, 0.1)
    lines = source.read_text(encoding="utf-8").splitlines()
    cells = lines[10].split(",")
    lines[10] = ",".join([*cells[:4], str(float(cells[4]) + 12)])
    source.write_text("\n".join(lines), encoding="utf-8")
    before = machine.read_bytes()
    words = ["straightness", source, "--machine", machine, *COARSE]
    assert run(*words) == calibrate.NOT_GOOD
    text = capsys.readouterr().out
    assert re.search(
        r"does not fit: segment 1: \d reading\(s\) stand off from those of other runs, by up to \+\d", text
    )
    assert text.endswith("not written; --force writes it all the same\n")
    assert machine.read_bytes() == before
    assert run(*words, "--force") == 0
    forced = calibration_of(machine)["EYX"]
    # one of two readings forward and two back at that stop: a quarter of 12 µm
    assert 2e-6 < forced["uncertainty"] < 6e-6
    assert run(*words, "--drop-outliers") == 0
    assert calibration_of(machine)["EYX"]["uncertainty"] < 0.2e-6


@shows(
    Row(
        "files",
        "Straightness measurements that contradict one another where they overlap",
        "on the output: which segments differ by how much; exit code 10",
        "nothing is written",
        "the machine file stays byte for byte",
        "a better measurement; or `--force`, with an uncertainty that covers it",
    )
)
def test_overlaps_that_contradict_are_written_by_force_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Dirt of 0.8 µm on the mirror in one of two placements, where they overlap."""
    source, truth = straightness_file(tmp_path)
    lines = source.read_text(encoding="utf-8").splitlines()
    for k, line in enumerate(lines[1:], start=1):
        segment, number, way, position, reading, side = line.split(",")
        if segment == "1":
            dirt = 0.8 * math.exp(-(((float(position) + 400) / 10) ** 2))
            lines[k] = f"{segment},{number},{way},{position},{float(reading) + dirt:.4f},{side}"
    source.write_text("\n".join(lines), encoding="utf-8")
    machine = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "grinder.yaml"))
    before = machine.read_bytes()
    words = ["straightness", source, "--machine", machine, "--component", "EYZ", "--mirror-length-mm", 440]
    words += ["--mirror-flatness-um", 0.08, "--noise-um", 0.06]
    assert run(*words) == calibrate.NOT_GOOD
    assert "does not fit: segments 1 and 2 differ by 0." in capsys.readouterr().out
    assert machine.read_bytes() == before
    assert run(*words, "--force") == 0
    table, note = load_machine(machine).errors["EYZ"].table, calibration_of(machine)["EYZ"]
    assert table is not None
    found = np.interp(GRINDER_Z, table.positions, table.forward)
    assert np.abs(found - truth).max() < 2.5 * note["uncertainty"]


def poses_bag(folder: Path, name: str) -> Path:
    """Poses of a machine a little other than the one of that name, as its bag would hold them."""
    shipped = load_machine(name)
    parameters = list_parameters(shipped)
    rng = np.random.default_rng(7)
    truth = apply_parameters(shipped, parameters, 3e-6 * rng.normal(size=len(parameters)))
    positions = sample_volume(truth, 220)
    direction = rng.choice([-1.0, 1.0], size=positions.shape)
    offset = predict_tool_offset(arrange_machine(truth), positions, direction=direction, temperature=20.0)
    contents: dict[str, list[Content]] = {JOINT_STATES: [], TOOL_PROBE: [], TEMPERATURE: []}
    for k, row in enumerate(offset):
        stamp = 1_763_700_000_000_000_000 + k * 1_000_000_000
        point = row[:3] + 1.5e-6 * rng.normal(size=3)
        state = JointState(stamp, truth.letters, positions[k], direction[k], np.array([]))
        contents[JOINT_STATES].append(state)
        contents[TOOL_PROBE].append(PointStamped(stamp, point))
        contents[TEMPERATURE].append(Temperature(stamp, 20.0))
    bag = folder / "bag"
    write_messages(bag, contents)
    return bag


def test_machine_verdict_number_sentence_and_exit_code(
    tmp_path: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = poses_bag(tmp_path, "pan2013")
    limits = ["--limits", "X=-2700,2700", "Y=-900,900", "Z=-900,900", "C=-270,270", "A=-95,95"]
    assert run("machine", bag, "--machine", machine, *limits) == 0
    text = capsys.readouterr().out
    assert text.startswith("The calibration is good: it predicts the tool in the working volume to ")
    assert "poses that would add most (X, Y, Z, C, A; mm, degrees):" in text
    # Reading the file again gives a machine that the poses fit: a second calibration finds nothing to change.
    again = tmp_path / "again.yaml"
    assert run("machine", bag, "--machine", machine, "-o", again, *limits) == 0
    first, second = load_machine(machine), load_machine(again)
    for body in first.bodies:
        np.testing.assert_allclose(
            body.location_error.rotation, second.body(body.name).location_error.rotation, rtol=0, atol=2e-10
        )
    before, strict = again.read_bytes(), ["--required-um", 0.1, *limits]
    assert run("machine", bag, "--machine", machine, "-o", again, *strict) == calibrate.NOT_GOOD
    text = capsys.readouterr().out
    assert "not good" in text
    assert text.endswith("not written; --force writes it all the same\n")
    assert again.read_bytes() == before
    assert run("machine", bag, "--machine", machine, "-o", again, "--force", *strict) == 0
    assert calibration_of(again)["machine"]["remark"].startswith("The calibration is not good")


def test_identification_takes_over_what_was_calibrated_before(tmp_path: Path, machine: Path) -> None:
    """Sections of their own are from the poses then, and say so; the others are told of in one."""
    assert run("positioning", positioning_file(tmp_path), "--machine", machine, "--axis", "X") == 0
    first = calibration_of(machine)["EXX"]
    limits = ["--limits", "X=-2700,2700", "Y=-900,900", "Z=-900,900", "C=-270,270", "A=-95,95"]
    assert run("machine", poses_bag(tmp_path, "pan2013"), "--machine", machine, "--required-um", 30, *limits) == 0
    notes = calibration_of(machine)
    assert notes["EXX"]["source"] == notes["machine"]["source"] == "bag"
    assert notes["EXX"]["history"][0]["sha256"] == first["sha256"]
    assert "table" in notes["EXX"]["history"][0]["values"]["errors.EXX"]
    assert "errors.EYY" in notes["machine"]["history"][0]["values"]
    assert "errors.EXX" not in notes["machine"]["history"][0]["values"]


def test_tables_and_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "x.comp"
    assert run("tables", "xyzac_trt", "--axis", "X", "--rows", 50, "--type", 1, "-o", table) == 0
    assert len(table.read_text(encoding="ascii").splitlines()) == 50
    assert "COMP_FILE_TYPE = 1" in capsys.readouterr().out
    grid = tmp_path / "grid.csv"
    assert run("tables", "xyzac_trt", "--grid", "X=3", "Y=2", "-o", grid) == 0
    assert len(grid.read_text(encoding="ascii").splitlines()) == 7
    figure = tmp_path / "errors.png"
    assert run("errors", "pan2013", "--figure", figure, "--map", "X", "Y", "--limits", "A=-60,60") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].split()[0] != lines[2].split()[0]
    assert figure.stat().st_size > 30_000
    for words, message in (
        (["errors", "pan2013", "--uncertainty", 0], r"--uncertainty 0; expected 1 to 10000000 poses"),
        (["errors", "pan2013", "--uncertainty", 10], "machine pan2013 states no uncertainty; its file needs a section"),
        (["errors", "pan2013", "--limits", "X"], "expected an axis, =, and a value"),
        (["errors", "pan2013", "--limits", "X=5"], "expected two numbers"),
        (["tables", "xyzac_trt", "--grid", "X=many", "-o", grid], "'many' is no number"),
        (["tables", "xyzac_trt", "--grid", "X=2.5", "-o", grid], "X=2.5: expected a whole number of points"),
        (
            ["tables", "xyzac_trt", "--grid", "X=3", "-o", tmp_path / "no" / "t"],
            "t: cannot be written .*folder that exists",
        ),
        (["errors", "pan2013", "--figure", tmp_path / "no" / "e.png"], r"e.png: cannot be written"),
        (["positioning", grid, "--machine", "pan2013", "--axis", "X"], "pan2013: no such file; calibrate a copy"),
    ):
        with pytest.raises(InputError, match=message):
            run(*words)


@pytest.mark.long
def test_what_the_uncertainty_of_a_file_leaves(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = yaml.safe_load(machine.read_text(encoding="utf-8"))
    content["machine"]["uncertainty"] = {"location.linear": 2e-6}
    machine.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with computing_by("numpy"):
        assert run("errors", machine, "--uncertainty", 300) == 0
    told = capsys.readouterr()
    assert "note: the machine model is computed by numpy, which is slower" in told.err
    found = re.search(
        r" 300 poses: (\S+) µm rms.*\n.*: (\S+) µm rms, (\S+) µm at most\n95 %.* (\S+) µm everywhere$", told.out.strip()
    )
    assert found, told.out
    # Five bodies that move, three directions each.
    assert float(found[2]) == pytest.approx(2.0 * math.sqrt(15), rel=0.15)
    assert float(found[4]) > float(found[1])


def test_a_twin_of_parameters_becomes_a_tree_of_bodies(tmp_path: Path) -> None:
    twin, out = tmp_path / "twin.yaml", tmp_path / "out.yaml"
    travel = {letter: [-3.0, 3.0] for letter in "XYZ"} | {letter: [-2 * math.pi, 2 * math.pi] for letter in "CA"}
    section = {"travel": travel, "head_length": 0.3, "tool_length": 0.1, "squareness": {"XY": 1.234567e-05}}
    errors = {"EYX": {"poly": [0.0, 0.0, 3e-6]}, "ECC": {"harmonic": [{"order": 1, "cos": 1e-6, "sin": 0.0}]}}
    twin.write_text(yaml.safe_dump({"machine": {**section, "errors": errors}}), encoding="utf-8")
    assert run("positioning", positioning_file(tmp_path), "--machine", twin, "--axis", "X", "-o", out) == 0
    before, after = load_machine(twin), load_machine(out)
    assert after.axes == before.axes
    assert after.bodies == before.bodies
    assert {name: after.errors[name] for name in before.errors} == dict(before.errors)
    assert after.errors["EXX"].table is not None
    assert "bodies" not in yaml.safe_load(twin.read_text(encoding="utf-8"))["machine"]


@pytest.mark.cases("open", "machine", "null", most=2)
def test_the_twin_of_a_case_is_calibrated_from_its_bag(case: Path, tmp_path: Path) -> None:
    """The twin is exact there: the calibration is good and changes no more than the probe's noise lets it."""
    out = tmp_path / "out.yaml"
    limits = ["--limits", "X=-2700,2700", "Y=-900,900", "Z=-900,900", "C=-150,150", "A=-95,95"]
    assert run("machine", case / "bag", "--machine", case / "twin.yaml", "-o", out, *limits) == 0
    before, after = load_machine(case / "twin.yaml"), load_machine(out)
    poses = sample_volume(before, 200, {"X": (-2.7, 2.7), "A": (-1.6, 1.6)})
    offsets = [predict_tool_offset(arrange_machine(machine), poses)[:, :3] for machine in (before, after)]
    assert np.sqrt(np.mean((offsets[1] - offsets[0]) ** 2)) < 1.5e-6


@pytest.mark.parametrize(
    ("option", "value", "problem"),
    [
        ("--mirror-length-mm", "0", "0 is not above 0"),
        ("--mirror-length-mm", "abc", "'abc' is no number; expected one above 0"),
        ("--mirror-length-mm", "1,5", "'1,5' is no number; write a decimal point, not a comma"),
        ("--mirror-length-mm", "nan", "nan is not above 0"),
        ("--mirror-flatness-um", "-0.1", "-0.1 is below 0"),
        ("--mirror-flatness-um", "thin", "'thin' is no number, and not 'unknown'"),
        ("--noise-um", "0", "0 is not above 0"),
        ("--date", "28.11.2026", "'28.11.2026' is no day; write year-month-day, such as 2026-11-28"),
    ],
)
def test_impossible_arguments(option: str, value: str, problem: str, capsys: pytest.CaptureFixture[str]) -> None:
    given = {"--mirror-length-mm": "440", "--mirror-flatness-um": "0.08", "--noise-um": "0.06"} | {option: value}
    words = [f"{name}={number}" for name, number in given.items()]
    with pytest.raises(SystemExit) as ended:
        run("straightness", "some.csv", "--machine", "some.yaml", "--component", "EYZ", *words)
    assert ended.value.code == 2
    assert f"argument {option}: {problem}" in capsys.readouterr().err
