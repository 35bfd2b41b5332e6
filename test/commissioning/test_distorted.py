"""A stage whose autocollimator bends as its file states is commissioned as one that does not."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from world.newly_built import build
from world.recording import AUTOCOLLIMATOR

from commissioning.bags import run, written
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.signals.blocks import SampleBlock

BENDS = (-1.4e5, 2e6)


def bent(recording):
    """The recording as an instrument would have given it whose reading v along an axis is v + bend v^3."""
    made = []
    for block in recording.blocks[AUTOCOLLIMATOR]:
        read = block.rows[:, 1:] + np.array(BENDS) * block.rows[:, 1:] ** 3
        made.append(SampleBlock(block.stamp_ns, block.names, np.column_stack([block.rows[:, 0], read])))
    return recording.with_topics({AUTOCOLLIMATOR: (made, recording.arrivals[AUTOCOLLIMATOR])})


def commissioned(folder, built, recording, stated, code=0):
    folder.mkdir()
    bag, nominal = written(built, folder, recording)
    content = yaml.safe_load(nominal.read_text(encoding="utf-8"))
    content["stage"]["autocollimator"] |= stated
    figures = {"cubic_uncertainty": 5e3, "zero_uncertainty": 1.0}
    note = {"date": "2026-01-01", "source": "steps.csv", "sha256": 64 * "a", "figures": figures}
    content["stage"]["calibration"] = {"autocollimator": note}
    nominal.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    assert run(bag, nominal, folder / "stage.yaml") == code
    return load_stage(folder / "stage.yaml") if code == 0 else None


@pytest.mark.long
def test_a_distortion_that_the_file_states_is_taken_off_and_stays(tmp_path):
    built = build(5, count=4, even=True, swap=False, known_tilt=True, duration=20.0, axes=(1.02, 0.1))
    found = commissioned(tmp_path / "bent", built, bent(built.recording), {"cubic": list(BENDS)})
    straight = commissioned(tmp_path / "straight", built, built.recording, {})
    commissioned(tmp_path / "missed", built, bent(built.recording), {}, code=10)
    response, plain = found.response("autocollimator"), straight.response("autocollimator")
    assert response.cubic == BENDS and plain.cubic == ()
    for name in ("zero", "gain", "roll"):
        np.testing.assert_allclose(getattr(response, name), getattr(plain, name), rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(found.mirror.tilt, straight.mirror.tilt, atol=2e-9)
    assert found.uncertainty["autocollimator.cubic"] == 5e3, "its uncertainty stays with it"
    assert found.uncertainty["autocollimator.zero"] < 1e-6, "that of the zero is told anew"
