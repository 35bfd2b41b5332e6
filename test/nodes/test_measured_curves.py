"""A cell whose stage file has measured curves of ring and mirror: live against the truth, replayed bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from drawn_curves import DrawnCurves
from nodes.mock_cells import mock_parameters
from nodes.replayed_motion import ESTIMATOR, REPLAY, assert_repeated
from received_blocks import block_of

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell

SIGMAS = 6.0
RADIAL_AND_TILT = [0, 1, 3, 4]


@pytest.fixture
def stage_file(tmp_path: Path) -> Path:
    """The stage that ships, with the ring in a file beside it and the mirror written out."""
    drawn = DrawnCurves(7, even=False, u=2e-8)
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    rows = zip(drawn.ring_table.angles, drawn.ring_table.values, drawn.ring_table.uncertainties, strict=True)
    lines = ["angle_rad,graduation_rad,uncertainty_rad", *(f"{a!r},{v!r},{u!r}" for a, v, u in rows)]
    (tmp_path / "ring.csv").write_text("\n".join(lines), encoding="utf-8")
    content["stage"]["encoder"] |= {"graduation": [], "graduation_table": {"file": "ring.csv"}}
    table = drawn.mirror_table
    columns = {"angles": table.angles, "x": table.x, "y": table.y, "uncertainties": table.uncertainties}
    written = {name: list(column) for name, column in columns.items()}
    content["stage"]["mirror"] |= {"flatness": [], "flatness_table": written}
    path = tmp_path / "curved.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


@pytest.fixture
def curved(settings, stage_file: Path) -> Iterator[Cell]:
    with Cell("abcd", mock_parameters(settings, stage=stage_file)) as cell:
        yield cell


def test_error_motion_of_a_stage_with_measured_curves(curved: Cell, settings, stage_file: Path, tmp_path: Path) -> None:
    estimates = curved.collect(curved.wire.topic("error_motion_samples"))
    recorder = curved.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    for head in "abcd":
        curved.run(EncoderHead, f"encoder_head_{head}", source="mock")
    curved.run(AutocollimatorNode, "autocollimator", source="mock")
    curved.run(MockController, "mock_controller")
    curved.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
    curved.wait_until(lambda: len(estimates) > 10, "estimates")
    curved.forget_status("error_estimator: estimate")
    curved.wait_for_status("error_estimator: estimate", "complete")
    curved.remove(recorder)
    stage = load_stage(stage_file)
    assert len(stage.tables) == 2
    plant = mock_stage(stage, settings)
    bound: list[bool] = []
    for message in estimates:
        block = block_of(message)
        motion = error_motion_from_block(block)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
        assert (np.abs(motion.components - truth) <= SIGMAS * deviation)[motion.observable].all()
        bound += list((deviation[:, RADIAL_AND_TILT] < 1e-5)[motion.observable[:, RADIAL_AND_TILT]])
        # a tilt that stands at a turning point may be that of an autocollimator that is stuck: its scale says so
        deviation[:, 3:5] /= motion.tilt_scale[:, None]
        small = deviation[:, RADIAL_AND_TILT] < 1e-5
        assert small[motion.observable[:, RADIAL_AND_TILT]].all(), "a bound on something"
    assert np.mean(bound) > 0.5, "it does not stand for long"
    replayed = replay_bag(tmp_path / "bag", stage, settings=REPLAY)
    assert_repeated(estimates, replayed)
