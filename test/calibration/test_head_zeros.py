"""Heads whose zeros are elsewhere than the stage file says: all phases of ring and mirror turn with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import simulated_shaft

from rotary_error_monitor.calibration.assembly_doubts import Centres, Doubts, doubt_assembly
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.mirror_assembly import estimate_mirror_assembly
from rotary_error_monitor.metrology.ring_assembly import estimate_ring_assembly
from rotary_error_monitor.metrology.shaft_recording import record_shaft

SHAFT = simulated_shaft.Shaft(graduation={2: (1e-6, 2e-6), 3: (-1e-6, 1e-6)}, flatness={2: (3e-6, -1e-6, 2e-6, 1e-6)})
BOTH_WAYS = simulated_shaft.reversing((np.pi / 2, np.pi), 5.0)


def doubts(turned: float, seed: int) -> tuple[Doubts, float]:
    """What is doubted with one head turned by so much, rad, and by how much the eccentricity is off, m."""
    stage = replace(load_stage(), uncertainty={})
    heads, tilt = simulated_shaft.record(SHAFT, *BOTH_WAYS, seed)
    name = sorted(heads)[seed % len(heads)]
    times, values = heads[name]
    recording = record_shaft(stage, {**heads, name: (times, values + turned)}, tilt)
    ring = estimate_ring_assembly(stage, recording)
    off = float(np.hypot(*np.subtract(ring.eccentricity, SHAFT.eccentricity)))
    return doubt_assembly(stage, ring, estimate_mirror_assembly(stage, recording), Centres()), off


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("turned", [1.0, -2.0])
def test_a_head_that_is_turned_does_not_fit(turned: float, seed: int) -> None:
    found, off = doubts(turned, seed)
    assert off > 5e-6
    assert "heads: their zeros are up to" in " ".join(found.misfits)
    assert max(found.ring.eccentricity_std) > off / 2


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("turned", [0.0, 0.02])
def test_a_head_that_is_where_mounting_leaves_it_fits(turned: float, seed: int) -> None:
    """A millimetre at the circumference moves the ring by less than the centres do."""
    found, off = doubts(turned, seed)
    assert found.misfits == () and off < 1e-6
