"""Recorded machines without a gap: what the model leaves is the tracker's noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine

CASES = Path(__file__).parents[3] / "shared" / "cases" / "open"
TRACKER_NOISE = 1.5e-6


def null_cases() -> list[Path]:
    found = []
    for truth in sorted(CASES.glob("*/truth.yaml")):
        content = yaml.safe_load(truth.read_text(encoding="utf-8"))
        if (content["family"], content["kind"]) == ("machine", "null"):
            found.append(truth.parent)
    return found


@pytest.mark.skipif(not CASES.is_dir(), reason=f"no recorded cases in {CASES}")
@pytest.mark.parametrize("exact", [True, False], ids=["exact", "first_order"])
@pytest.mark.parametrize("case", null_cases(), ids=lambda case: case.name)
def test_residual_is_the_trackers_noise(case: Path, exact: bool) -> None:
    machine = load_machine(case / "twin.yaml")
    positions, directions, temperature, probe = [], [], [], []
    with AnyReader([case / "bag"]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/machine/joint_states":
                order = [list(message.name).index(letter) for letter in machine.letters]
                positions.append(message.position[order])
                directions.append(message.velocity[order])
            elif connection.topic == "/machine/temperature":
                temperature.append(message.temperature)
            elif connection.topic == "/machine/tool_probe":
                probe.append([message.point.x, message.point.y, message.point.z])
    offset = predict_tool_offset(
        arrange_machine(machine), positions, direction=directions, temperature=temperature, exact=exact
    )
    residual = np.array(probe) - offset[:, :3]
    assert np.std(probe) > 10 * TRACKER_NOISE
    assert np.std(residual) == pytest.approx(TRACKER_NOISE, rel=0.05)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(TRACKER_NOISE, rel=0.05)
