"""The covariance of an offset: what each uncertain input adds, one by one, and what it costs."""

from dataclasses import replace

import numpy as np
import pytest
from kernels import computing_by

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.machine import kinematics
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.pipeline.offset_spread import OffsetSpread
from rotary_error_monitor.pipeline.poses import TimedPoses

MACHINE = load_machine("xyzac_trt")
MODEL = arrange_machine(MACHINE)
AXES = len(MACHINE.letters)


def poses(count=4, age=0.0, turned=0.0, warmth=0.0):
    generator = np.random.default_rng(5)
    live = generator.normal(0.0, 1e-6, (count, 6))
    return TimedPoses(
        np.arange(count) * 10_000_000,
        generator.uniform(-0.2, 0.2, (count, AXES)),
        np.ones((count, AXES)),
        np.full((count, AXES), turned),
        np.full(count, age),
        np.full(count, 21.0),
        np.full(count, warmth),
        live,
        lambda index: np.tile(np.diag([1e-16] * 6), (len(index), 1, 1)),
    )


def spread(at):
    return OffsetSpread(MACHINE, MODEL, StageLimits()).at(at, at.offsets(MODEL))


def changed(at, **inputs):
    return replace(at, **inputs).offsets(MODEL) - at.offsets(MODEL)


def outer(effect):
    return effect[:, :, None] * effect[:, None, :]


def test_what_lasts_and_what_passes():
    """Each input moved by its standard uncertainty, alone: the squares add up (JCGM 102:2011, 6.2.1)."""
    base = spread(poses())
    np.testing.assert_array_equal(base.lasting, base.reported)
    warm = poses(warmth=2.0)
    expected = base.lasting + outer(2.0 * changed(warm, temperature=warm.temperature + 1.0))
    np.testing.assert_allclose(spread(warm).lasting, expected, rtol=1e-9, atol=1e-30)
    turned = poses(turned=0.25)
    expected = base.lasting.copy()
    for axis, each in enumerate(MACHINE.axes):
        directions = turned.directions.copy()
        directions[:, axis] = -1.0
        expected += outer(0.5 * changed(turned, directions=directions)) * (each.reversal != 0.0)
    found = spread(turned)
    np.testing.assert_array_equal(found.lasting, base.lasting)
    np.testing.assert_allclose(found.reported, expected, rtol=1e-9, atol=1e-30)
    moved = poses(age=0.02)
    expected = base.lasting.copy()
    for axis, each in enumerate(MACHINE.axes):
        if each.letter == MACHINE.monitored:
            continue  # its encoder says where it is
        positions = moved.positions.copy()
        positions[:, axis] += min(0.5 * each.quickest * 0.02**2, each.fastest * 0.02) / np.sqrt(3.0)
        expected += outer(changed(moved, positions=positions))
    np.testing.assert_allclose(spread(moved).lasting, expected, rtol=1e-9, atol=1e-30)


@pytest.mark.parametrize("count", [0, 1, 7])
def test_the_axes_cost_one_pass_over_the_machine(count, monkeypatch):
    """Twenty corrections a second report it, each with every axis moved and turned back."""
    passes = []

    def counted(*arguments):
        passes.append(arguments)
        return kinematics.stand(*arguments)

    monkeypatch.setattr("rotary_error_monitor.machine.error_model.stand", counted)
    at = poses(count, age=0.02, turned=0.25, warmth=2.0)
    with computing_by("numpy"):  # where a pass is dear
        covariance = OffsetSpread(MACHINE, MODEL, StageLimits()).at(at, np.zeros((count, 6)))
    assert covariance.reported.shape == (count, 6, 6)
    # the ideal and the actual machine for all changes together, and the ideal one for the jacobian
    assert len(passes) == (3 if count else 0)
