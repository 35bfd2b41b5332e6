"""The shaft between centres, made by the plant with exact geometry: assembly errors come back into the stage file."""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
import yaml

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.calibration.assembly import calibrate_assembly, read_shaft_recording
from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.description.stage import Spindle, load_stage
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant import Motion, Segment, StagePlant, reversing_motion
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
    calibrate.add(parser.add_subparsers())
    words = ["calibrate", "assembly", str(bag), "--stage", str(stage), "--date", "2026-11-21"]
    arguments = parser.parse_args(words)
    assert arguments.run(arguments) == 0
    text = capsys.readouterr().out
    assert "orders that these heads cannot see: 4, 8" in text
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
    quarter = Motion((Segment(1.0, 0.0), Segment(9.0, 0.17), Segment(1.0, 0.0)))
    bag = recorded(tmp_path, ALL, quarter, duration=10.0)
    with pytest.raises(InputError, match=r"bag: the recording covers .* of rotation; a whole turn"):
        calibrate_assembly(bag, config("stage.yaml"), tmp_path / "out.yaml", date(2026, 11, 21))
    assert not (tmp_path / "out.yaml").exists()


def test_one_head_and_a_short_recording_are_refused(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    with pytest.raises(InputError, match="no message on /stage/head_b/samples"):
        read_shaft_recording(recorded(tmp_path / "one", ALL[:1], duration=5.0), CENTRED)
    with pytest.raises(InputError, match=r"overlap for .* ms only"):
        read_shaft_recording(recorded(tmp_path, ALL, duration=0.5), CENTRED)
