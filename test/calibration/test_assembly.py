"""The shaft between centres, made by the plant with exact geometry: assembly errors come back into the stage file."""

from __future__ import annotations

import argparse
import re
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import simulated_shaft
import yaml
from faults.documenting import Row, shows
from shaft_bags import TRUTH, simulated

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.calibration.assembly import calibrate_assembly, read_shaft_recording
from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant import Motion, MotionSegment, StagePlant, reversing_motion
from rotary_error_monitor.resources import config

EPOCH = 1_763_700_000_000_000_000
# Between centres the shaft has no error motion of its own.
CENTRED = replace(load_stage(), spindle=Spindle())


def recorded(folder: Path, streams: list[str], motion: Motion | None = None, duration: float = 40.0) -> Path:
    plant = StagePlant(CENTRED, seed=3, epoch_ns=EPOCH, motion=motion or reversing_motion())
    wire = load_wire()
    contents = {}
    for stream in streams:
        name = wire.topic("head_samples", stream[-1]) if stream.startswith("head_") else wire.topic(f"{stream}_samples")
        last = plant.index_at(stream, EPOCH + round(duration * 1e9))
        contents[name.name] = [plant.samples(stream, k, min(250, last - k)) for k in range(0, last, 250)]
    bag = folder / "bag"
    write_messages(bag, contents, wire)
    return bag


ALL = ["head_a", "head_b", "head_c", "head_d", "autocollimator"]


def test_assembly_comes_back_into_the_stage_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = recorded(tmp_path, ALL)
    stage = Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml"))
    section = yaml.safe_load(stage.read_text(encoding="utf-8"))
    section["stage"]["encoder"] |= {"eccentricity": [0.0, 0.0], "graduation": []}
    section["stage"]["mirror"] = {"tilt": [0.0, 0.0]}
    stage.write_text(yaml.safe_dump(section), encoding="utf-8")
    parser = argparse.ArgumentParser()
    calibrate.add(parser)
    words = ["assembly", str(bag), "--stage", str(stage), "--date", "2026-11-21", *map(str, IDEAL)]
    arguments = parser.parse_args(words)
    assert arguments.run(arguments) == 0
    text = capsys.readouterr().out
    assert "orders up to 39 were looked for; these heads cannot see 4, 8, 12" in text
    found = load_stage(stage)
    np.testing.assert_allclose(found.encoder.eccentricity, CENTRED.encoder.eccentricity, atol=10e-9)
    for row in CENTRED.encoder.graduation:
        other = next(wave for wave in found.encoder.graduation if wave.order == row.order)
        np.testing.assert_allclose([other.cos, other.sin], [row.cos, row.sin], atol=0.1e-6)
    np.testing.assert_allclose(found.mirror.tilt, CENTRED.mirror.tilt, atol=0.1e-6)
    for wave in CENTRED.mirror.flatness:
        same = next(other for other in found.mirror.flatness if other.order == wave.order)
        np.testing.assert_allclose([*same.x, *same.y], [*wave.x, *wave.y], atol=0.1e-6)
    note = yaml.safe_load(stage.read_text(encoding="utf-8"))["stage"]["calibration"]
    assert note["encoder"]["date"] == "2026-11-21"
    assert 0 < note["encoder"]["uncertainty"] < 5e-9
    assert len(note["mirror"]["sha256"]) == 64


def test_comments_stay_and_without_autocollimator_the_mirror_stays(tmp_path: Path) -> None:
    bag = recorded(tmp_path, ALL[:4])
    out = tmp_path / "out.yaml"
    result = calibrate_assembly(bag, config("stage.yaml"), out, date(2026, 11, 21))
    assert result.mirror is None
    assert load_stage(out).mirror == load_stage().mirror
    assert "# RESM20-USA200" in out.read_text(encoding="utf-8")
    error = np.abs(np.subtract(result.ring.eccentricity, CENTRED.encoder.eccentricity))
    assert np.all(error <= 4 * np.array(result.ring.eccentricity_std))


def test_a_recording_that_does_not_determine_the_assembly_is_refused(tmp_path: Path) -> None:
    quarter = Motion((MotionSegment(1.0, 0.0), MotionSegment(9.0, 0.17), MotionSegment(1.0, 0.0)))
    bag = recorded(tmp_path, ALL, quarter, duration=10.0)
    with pytest.raises(InputError, match=r"bag: the recording covers .* of rotation; a whole turn"):
        calibrate_assembly(bag, config("stage.yaml"), tmp_path / "out.yaml", date(2026, 11, 21))
    assert not (tmp_path / "out.yaml").exists()


def test_one_head_and_a_short_recording_are_refused(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    with pytest.raises(InputError, match="no message on /stage/head_b/samples"):
        read_shaft_recording(recorded(tmp_path / "one", ALL[:1], duration=5.0), CENTRED)
    with pytest.raises(InputError, match=r"bag: the streams overlap for .* s only"):
        read_shaft_recording(recorded(tmp_path, ALL, duration=0.5), CENTRED)


SHIPPED = load_stage()
IDEAL = ("--centre-radial-um", 0, "--centre-lean-arcsec", 0)
"""Centres in which the shaft has no motion of its own."""


def run(*words: object) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser)
    arguments = parser.parse_args(["assembly", *map(str, words), "--date", "2026-11-21"])
    return int(arguments.run(arguments))


def section_of(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))["stage"]


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml"))


def check_truth(path: Path, tilt_within: float = 5e-8) -> None:
    found = load_stage(path)
    np.testing.assert_allclose(found.encoder.eccentricity, TRUTH["eccentricity"], atol=8e-9)
    rows = {row.order: (row.cos, row.sin) for row in found.encoder.graduation}
    for order, truth in TRUTH["graduation"].items():
        np.testing.assert_allclose(rows[order], truth, atol=8e-8)
    np.testing.assert_allclose(found.mirror.tilt, TRUTH["tilt"], atol=tilt_within)


def test_only_the_calibrated_lines_change_and_what_they_were_is_kept(tmp_path: Path, stage: Path) -> None:
    before = stage.read_text(encoding="utf-8")
    assert run(simulated(tmp_path), "--stage", stage) == 0
    check_truth(stage)
    after = stage.read_text(encoding="utf-8")
    gone = [line for line in before.splitlines() if line not in after.splitlines()]
    start, end = before.splitlines().index("    eccentricity: [2.4e-05, -1.1e-05]"), before.index("  autocollimator: #")
    assert set(gone) <= set(before.splitlines()[start : before[:end].count("\n")])
    assert after.startswith(before[: before.index("    eccentricity:")])
    assert before[end : before.index("  environment:")] in after
    old, notes = section_of(Path(config("stage.yaml"))), section_of(stage)["calibration"]
    assert notes["encoder"]["history"] == [
        {"values": {f"encoder.{key}": old["encoder"][key] for key in ("eccentricity", "graduation")}}
    ]
    assert notes["mirror"]["history"][0]["values"]["mirror.tilt"] == old["mirror"]["tilt"]
    assert notes["mirror"]["figures"]["autocollimator_delay_uncertainty"] < 1e-3
    first, values = dict(notes["encoder"]), section_of(stage)["encoder"]
    del first["history"]
    assert run(simulated(tmp_path, seed=1), "--stage", stage) == 0
    history = section_of(stage)["calibration"]["encoder"]["history"]
    assert [sorted(row) for row in history] == [
        ["date", "figures", "sha256", "source", "uncertainty", "values"],
        ["values"],
    ]
    assert {key: value for key, value in history[0].items() if key != "values"} == first
    assert history[0]["values"]["encoder.eccentricity"] == values["eccentricity"]


def test_the_uncertainty_that_was_found_is_that_of_the_description(tmp_path: Path, stage: Path) -> None:
    before = load_stage(stage).uncertainty
    assert run(simulated(tmp_path), "--stage", stage) == 0
    notes, found = section_of(stage)["calibration"], load_stage(stage).uncertainty
    assert before.items() <= found.items()
    assert not before.keys() & {"encoder.eccentricity", "encoder.graduation"}
    assert found["encoder.eccentricity"] == notes["encoder"]["uncertainty"] > 0.0
    assert found["encoder.graduation"] == notes["encoder"]["figures"]["graduation_uncertainty"] > 0.0
    assert found["mirror.tilt"] == notes["mirror"]["uncertainty"] > 0.0
    assert found["mirror.flatness"] == notes["mirror"]["figures"]["flatness_uncertainty"] > 0.0
    text = stage.read_text(encoding="utf-8")
    stage.write_text(
        text.replace("    encoder.timing:", "    mirror.tilt: 1.0e-5\n    encoder.timing:", 1), encoding="utf-8"
    )
    assert load_stage(stage).uncertainty == {**found, "mirror.tilt": 1e-5}, "what is stated counts before"


@pytest.mark.long
def test_the_history_has_an_end(tmp_path: Path, stage: Path) -> None:
    bag = simulated(tmp_path)
    for _ in range(12):
        assert run(bag, "--stage", stage) == 0
    notes = section_of(stage)["calibration"]
    assert len(notes["encoder"]["history"]) == len(notes["mirror"]["history"]) == 10
    assert all("date" in row for row in notes["mirror"]["history"])


def test_rows_that_the_recording_cannot_tell_stay(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Orders 4 (hidden from four heads), 2 (from two) and 190 (above the sampling) stand in the file and stay."""
    text = stage.read_text(encoding="utf-8")
    text = text.replace(
        "    graduation:\n",
        "    graduation:\n      - {order: 190, cos: 1.0e-07, sin: 0.0}\n"
        "      - {order: 4, cos: 2.0e-06, sin: -3.0e-06}\n",
    ).replace("    flatness:\n", "    flatness:\n      - {order: 170, x: [1.0e-07, 0.0], y: [0.0, 1.0e-07]}\n")
    stage.write_text(text, encoding="utf-8")
    graduation = {**TRUTH["graduation"], 4: (2e-6, -3e-6), 190: (1e-7, 0.0)}
    flatness = {**TRUTH["flatness"], 170: (1e-7, 0.0, 0.0, 1e-7)}
    bag = simulated(tmp_path, {"graduation": graduation, "flatness": flatness})
    assert run(bag, "--stage", stage) == 0
    printed = capsys.readouterr().out
    assert "graduation order 4: 0.744 arcsec, kept from before: these heads cannot see it" in printed
    assert "graduation order 190: 0.021 arcsec, kept from before: not told by this sampling" in printed
    assert "flatness order 170: 0.021 arcsec, kept from before: not told by this sampling" in printed
    rows = section_of(stage)["encoder"]["graduation"]
    assert [row["order"] for row in rows] == [2, 3, 4, 13, 190]
    assert rows[2] == {"order": 4, "cos": 2e-6, "sin": -3e-6}
    assert section_of(stage)["mirror"]["flatness"][-1]["order"] == 170
    check_truth(stage)
    two = simulated(tmp_path, {"graduation": graduation, "flatness": flatness, "azimuths": {"a": 0.0, "b": np.pi}})
    assert run(two, "--stage", stage) == 0
    assert "graduation order 2: 0.4" in (printed := capsys.readouterr().out)
    assert re.search(r"order 2: \S+ arcsec, kept from before: these heads cannot see it", printed)
    assert [row["order"] for row in section_of(stage)["encoder"]["graduation"]] == [2, 3, 4, 13, 190]
    check_truth(stage)


def test_orders_above_those_of_the_file_are_found(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ring with orders above 8 and a mirror with orders above 3: the residual is the noise."""
    more = {
        "graduation": {**TRUTH["graduation"], 9: (3e-6, 0.0), 22: (0.0, 2e-6)},
        "flatness": {**TRUTH["flatness"], 4: (6e-6, 0.0, 0.0, 6e-6), 7: (0.0, 0.0, 4e-6, 0.0)},
    }
    assert run(simulated(tmp_path, more), "--stage", stage) == 0
    ratios = [float(found) for found in re.findall(r"residual ([\d.]+) times the noise", capsys.readouterr().out)]
    assert len(ratios) == 2
    assert max(ratios) < 1.2
    assert {4, 6, 7} <= {row.order for row in load_stage(stage).mirror.flatness}


def test_one_direction_is_enough_for_the_ring_and_tells_how_well_the_mirror_is_known(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = simulated(tmp_path, {"delay": 1e-3}, simulated_shaft.one_way(2.0, 12.0))
    assert run(bag, "--stage", stage, *IDEAL) == 0
    assert re.search(r"autocollimator -?0\.\d+ ms old, standard uncertainty [45]\.\d+ ms", capsys.readouterr().out)
    check_truth(stage, tilt_within=3 * 2.0 * 5e-3 * 6.3e-5)
    note = section_of(stage)["calibration"]["mirror"]
    assert note["uncertainty"] == pytest.approx(2.0 * 5e-3 * 5.5e-5, rel=0.1)
    assert section_of(stage)["calibration"]["encoder"]["uncertainty"] < 5e-9
    assert run(bag, "--stage", stage, "--delay-ms", 1, "--delay-std-ms", 0.05, *IDEAL) == 0
    check_truth(stage)
    assert section_of(stage)["calibration"]["mirror"]["uncertainty"] < 5e-8


MOVING = {"radial": lambda a, t, w: 2e-6 * np.exp(-1j * a) + 1e-6 * np.exp(2j * a)}


@shows(
    Row(
        "files",
        "A recording for `calibrate assembly` that does not fit the stage",
        "on the output, with the p-value and what of it goes with the rotation; exit code 10",
        "nothing is written",
        "the stage file stays byte for byte",
        "a better recording; or `--force`, with an uncertainty that covers what is left",
    )
)
def test_what_does_not_fit_is_not_written_but_by_force(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A shaft that turns on its own bearings: 2 µm in the first order, against the rotation, and 1 µm in the second."""
    before = stage.read_bytes()
    bag = simulated(tmp_path, MOVING)
    assert run(bag, "--stage", stage) == calibrate.NOT_GOOD
    text = capsys.readouterr().out
    assert stage.read_bytes() == before
    assert re.search(r"the recording does not fit:\n  heads: \d\.\d+ µm at the ring are left beyond the noise", text)
    assert re.search(r"\(p-value \S+\): order 1 of the rotation \d\.\d+, order 2 of the rotation", text)
    assert text.endswith("not written; --force writes it with an uncertainty that covers what is left\n")
    assert run(bag, "--stage", stage, "--force") == 0
    note = section_of(stage)["calibration"]["encoder"]
    error = np.abs(np.subtract(load_stage(stage).encoder.eccentricity, TRUTH["eccentricity"]))
    assert error.max() < 2 * note["uncertainty"]
    assert note["uncertainty"] > 1e-6
    assert note["remark"].startswith("heads: ")
    assert note["history"][0]["values"]["encoder.eccentricity"] == [2.4e-5, -1.1e-5]


def test_a_drift_of_the_autocollimator_alone_leaves_the_file(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = stage.read_bytes()
    bag = simulated(tmp_path, {"lean": lambda a, t, w: 1e-5 * t / 20})
    assert run(bag, "--stage", stage) == calibrate.NOT_GOOD
    assert re.search(r"autocollimator: .* arcsec are left .*: a trend over time", capsys.readouterr().out)
    assert stage.read_bytes() == before


def test_a_stuck_autocollimator_leaves_the_mirror(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = {"tilt": (0.0, 0.0), "flatness": {}, "tilt_noise": 0.0}
    assert run(simulated(tmp_path, still), "--stage", stage) == 0
    assert re.search(r"mirror: the autocollimator's tilt_x is .* it is stuck, left as it was", capsys.readouterr().out)
    assert load_stage(stage).mirror == SHIPPED.mirror
    assert "mirror" not in section_of(stage)["calibration"]


def test_impossible_delays(capsys: pytest.CaptureFixture[str]) -> None:
    for option, value, problem in (
        ("--delay-ms", "nan", "nan is not finite"),
        ("--delay-ms", "late", "'late' is no number; expected a finite one"),
        ("--delay-std-ms", "-1", "-1 is below 0"),
        ("--delay-std-ms", "late", "'late' is no number; expected one that is 0 or above"),
        ("--centre-radial-um", "-1", "-1 is below 0"),
        ("--centre-lean-arcsec", "nan", "nan is below 0"),
    ):
        with pytest.raises(SystemExit) as ended:
            run("bag", "--stage", "stage.yaml", f"{option}={value}")
        assert ended.value.code == 2
        assert f"argument {option}: {problem}" in capsys.readouterr().err
