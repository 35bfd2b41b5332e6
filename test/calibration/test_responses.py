"""Assembly errors from a recording by instruments with zero, sign, gain, axes and delay of their own."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import date

import numpy as np
import yaml

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.calibration.assembly import calibrate_assembly
from rotary_error_monitor.calibration.assembly_doubts import Centres
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.plant import StagePlant

EPOCH = 1_763_700_000_000_000_000
RESPONSES = {
    "head_a": Response((2.7,)),
    "head_b": Response((-1.9,), -1.0),
    "head_c": Response((5.1,), latency=3e-4),
    "head_d": Response((0.4,), -1.0),
    "autocollimator": Response((2e-5, -3e-5), 1.02, math.radians(12), 2e-3),
}
# Between centres the shaft has no error motion of its own.
CENTRED = replace(load_stage(), spindle=Spindle(), responses=RESPONSES)


def recorded(folder, known):
    """A bag of the stage, and a file of it without what is to be calibrated, in which `known` responses stand."""
    plant, wire = StagePlant(CENTRED, seed=3, epoch_ns=EPOCH), wire_of(CENTRED)
    blocks = {}
    for stream in RESPONSES:
        last = plant.index_at(stream, EPOCH + 40_000_000_000)
        blocks[wire.of_stream(stream).name] = [
            plant.samples(stream, k, min(250, last - k)) for k in range(0, last, 250)
        ]
    write_messages(folder / "bag", blocks, wire)
    section = stage_mapping(replace(CENTRED, responses=known))
    section["encoder"] |= {"eccentricity": [0.0, 0.0], "graduation": []}
    section["mirror"] = {"tilt": [0.0, 0.0]}
    (folder / "stage.yaml").write_text(yaml.safe_dump({"stage": section}, sort_keys=False), encoding="utf-8")
    return folder / "bag", folder / "stage.yaml"


def test_assembly_comes_back_and_the_responses_stay(tmp_path):
    bag, stage = recorded(tmp_path, RESPONSES)
    result = calibrate_assembly(bag, stage, tmp_path / "out.yaml", date(2026, 11, 21), centres=Centres(0.0, 0.0))
    assert result.written and result.fits
    found = load_stage(tmp_path / "out.yaml")
    assert found.responses == RESPONSES
    np.testing.assert_allclose(found.encoder.eccentricity, CENTRED.encoder.eccentricity, atol=10e-9)
    np.testing.assert_allclose(found.mirror.tilt, CENTRED.mirror.tilt, atol=0.1e-6)
    for rows, true in (
        (found.encoder.graduation, CENTRED.encoder.graduation),
        (found.mirror.flatness, CENTRED.mirror.flatness),
    ):
        for row in true:
            same = next(other for other in rows if other.order == row.order)
            for field in ("cos", "sin") if hasattr(row, "cos") else ("x", "y"):
                np.testing.assert_allclose(getattr(same, field), getattr(row, field), atol=0.1e-6)


def test_a_recording_by_a_head_whose_sign_is_not_described_is_not_written(tmp_path):
    bag, stage = recorded(tmp_path, {**RESPONSES, "head_b": Response((-1.9,))})
    result = calibrate_assembly(bag, stage, tmp_path / "out.yaml", date(2026, 11, 21))
    assert not result.fits and not result.written
