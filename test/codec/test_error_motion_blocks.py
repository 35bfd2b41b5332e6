"""Error motion as columns and back: the same numbers, each under its name; what a block lacks is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_numbers import assert_same_bits

from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion, error_motion_from_block
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.signals.blocks import SampleBlock

COLUMNS = load_wire(sensors=("axial_probe_top",)).topic("error_motion_samples").columns
COUNT = 7


def drawn(seed: int) -> ErrorMotion:
    """All that can be said, a different number each."""
    draw = np.random.default_rng(seed)
    half = draw.normal(size=(COUNT, 6, 6))
    masks = {name: draw.integers(0, 1 << 7, COUNT) for name in ("streams", "doubts")}
    beside = ("head_scale", "tilt_scale", "lag", "unresolved", "unresolved_tilt", "sensor_scale", "sensor_conflict")
    motion = ErrorMotion.of(
        draw.normal(size=COUNT), draw.normal(size=(COUNT, 6)), draw.random((COUNT, 6)) < 0.5, half + half.swapaxes(1, 2)
    )
    times = 1_763_700_000_000_000_000 + np.cumsum(draw.integers(1, 10**7, COUNT))
    return replace(motion, times_ns=times, **masks, **{name: draw.random(COUNT) for name in beside})


@pytest.mark.parametrize("seed", range(3))
def test_every_number_travels_under_its_name(seed):
    motion = drawn(seed)
    block = block_from_error_motion(motion, COLUMNS)
    assert block.names == ("t", *COLUMNS)
    np.testing.assert_array_equal(block.column("ebc"), motion.components[:, 4])
    np.testing.assert_array_equal(block.column("cov_eyc_ecc"), motion.covariance[:, 1, 5])
    np.testing.assert_array_equal(
        block.column("observable"), [sum(1 << i for i in np.flatnonzero(row)) for row in motion.observable]
    )
    assert_same_bits(error_motion_from_block(block), motion)


def without(block: SampleBlock, *names: str) -> SampleBlock:
    kept = [place for place, name in enumerate(block.names) if name not in names]
    return SampleBlock(block.stamp_ns, tuple(block.names[place] for place in kept), block.rows[:, kept])


def test_what_an_earlier_version_did_not_say_raises_and_doubts_nothing():
    block = block_from_error_motion(drawn(0), COLUMNS)
    found = error_motion_from_block(without(block, "doubts", "head_scale", "sensor_conflict", "lag", "cov_eac_ebc"))
    assert (found.head_scale == 1.0).all() and (found.sensor_conflict == 1.0).all()
    assert not found.doubts.any() and not found.lag.any() and not found.covariance[:, [3, 4], [4, 3]].any()


@pytest.mark.parametrize("name", ["theta", *COMPONENTS, "observable", "var_ecc", "cov_exc_eyc", "streams"])
def test_a_column_that_each_stage_has_is_asked_for(name):
    block = block_from_error_motion(drawn(0), COLUMNS)
    with pytest.raises(InputError, match=f"but no field '{name}'"):
        error_motion_from_block(without(block, name))
