"""One head, or two that are not opposed: right without noise by the contract's formulas, and with probes all told."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from motion_numbers import assert_same_bits, decisions_of
from pipeline.test_estimation import AZIMUTHS, START
from pipeline.test_listed_sensors import RADIAL, described, off, probe, recorded, run, truth

from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.pipeline.mixed_rotation import is_mixed
from rotary_error_monitor.pipeline.observability import possible_components, unchecked_sensors

ONE, ASIDE, NEARLY = {"a": 0.0}, {"a": 0.0, "c": np.pi / 2}, {"a": 0.0, "b": np.pi - 0.1}
DRIVE = {"following_error": 2e-5, "latency": 1e-5}  # a fault of the head that they would hide counts as uncertain
AXES = {
    f"radial_probe_{name}": probe("radial_probe", azimuth=azimuth, height=0.0)
    for name, azimuth in (("x", 0.3), ("y", 0.3 + np.pi / 2))
}


def stage_with(heads, sensors, tilt=True, limits=DRIVE):
    stage = described(sensors, tilt)
    ring = dataclasses.replace(stage.encoder, azimuths=heads)
    return dataclasses.replace(stage, encoder=ring, stated_limits={**stage.stated_limits, **limits})


def recorded_of(heads, sensors, **options):
    """What the heads of these letters say, and all others."""
    pairs = recorded(sensors, **options)
    return [pair for pair in pairs if not pair[0].startswith("head_") or pair[0][-1] in heads]


def test_which_layouts_tell_the_rotation():
    assert [HeadLayout(tuple(each)).tells_rotation for each in ((0.0,), (0.0, 1.0), (0.0, np.pi), (0.0, 1.0, 2.0))] == [
        False,
        False,
        True,
        True,
    ]
    assert is_mixed(stage_with(ONE, {})) and not is_mixed(described({}))


def test_what_two_heads_see_goes_over_into_what_opposed_ones_see():
    """Of a displacement the part of it that is in the rotation vanishes, and the part across the heads is told."""
    at = [HeadLayout((0.0, np.pi - apart)) for apart in (1.5, 0.5, 0.1, 0.01)]
    mixed = [float(np.hypot(*each.mixed)) for each in at]
    assert all(later < before for before, later in pairwise(mixed)) and mixed[-1] < 0.006
    np.testing.assert_allclose(at[-1].view[1], HeadLayout((0.0, np.pi)).view[1], atol=0.006)
    np.testing.assert_allclose(HeadLayout((0.4,)).mixed, [-np.sin(0.4), np.cos(0.4)])


@pytest.mark.parametrize("heads", [ONE, ASIDE])
def test_without_probes_rotation_and_tilt_are_there_as_sure_as_the_ring_is_in_place(heads):
    _, motion, doubted = run(recorded_of(heads, {}), stage_with(heads, {}))
    found, t = off(motion)
    assert not doubted
    assert motion.observable.all(axis=0).tolist() == [False, False, False, True, True, True]
    assert np.nanmax(np.abs(found)) < 6.0
    late = t > 2.5
    apart = 1.5e-5 / np.sqrt(3) / 0.1 * np.hypot(*HeadLayout(tuple(heads.values())).mixed)
    assert np.median(np.sqrt(motion.covariance[late, 5, 5])) > apart


@pytest.mark.few(3)
@pytest.mark.parametrize("heads", [ONE, ASIDE, NEARLY])
@pytest.mark.parametrize("seed", range(3))
def test_with_two_probes_all_but_the_axial_error_motion_is_told(heads, seed, monkeypatch):
    for letter, azimuth in heads.items():
        monkeypatch.setitem(AZIMUTHS, letter, azimuth)
    _, motion, doubted = run(recorded_of(heads, AXES, seed=seed), stage_with(heads, AXES))
    found, t = off(motion)
    late = t > 2.5  # after the first turn
    assert not doubted
    assert motion.observable[late].all(axis=0).tolist() == [True, True, False, True, True, True]
    assert np.nanmax(np.abs(found)) < 6.0
    error = motion.components[late] - truth(t[late])
    # the error motion of 3 µm would be 30 µrad of rotation: what is left is the heads' noise, steps and the forms' zero
    assert np.sqrt(np.mean(error[:, 5] ** 2)) < 1e-6
    assert np.abs(error[:, :2]).max() < 2e-7
    # a fault that the command would hide, of (20 + 30 + 150) µrad; without probes the ring's place is 87 µrad beside it
    assert np.sqrt(np.median(motion.covariance[late, 5, 5])) < 4e-5


def test_two_heads_aside_contradict_a_probe_that_is_wrong():
    """Their difference sees a part of the displacement: both probes then count as uncertain as the contradiction."""

    def off_from_the_begin(name, t, readings, draw):
        return readings + 2e-6 if name == "radial_probe_x" else readings

    pairs = recorded_of(ASIDE, AXES, fault=off_from_the_begin)
    _, motion, _ = run(pairs, stage_with(ASIDE, AXES))
    found, t = off(motion)
    assert motion.observable[t > 2.5, :2].all()
    assert np.median(motion.sensor_conflict[t > 2.5]) > 3.0
    assert (np.abs(found[:, :2]) > 6.0).sum() <= 0.002 * len(found)


def test_a_head_that_goes_off_from_its_command_ends_the_output():
    """Whether head or command is wrong nothing tells, and all else is taken at that rotation."""

    def stuck(name, t, readings, draw):
        return np.where(t[:, None] > 2.0, readings[np.searchsorted(t, 2.0)], readings) if name == "head_a" else readings

    _, motion, doubted = run(recorded_of(ONE, AXES, fault=stuck), stage_with(ONE, AXES))
    assert "command" in doubted
    assert (motion.times_ns - START).max() * 1e-9 < 2.1


def test_a_replay_repeats_it_to_the_last_bit():
    pairs = recorded_of(ASIDE, AXES)
    _, motion, _ = run(pairs, stage_with(ASIDE, AXES))
    _, again, _ = run(pairs, stage_with(ASIDE, AXES), decisions=decisions_of(motion))
    assert_same_bits(motion, again)


def test_what_sensors_can_tell_is_told():
    assert possible_components(stage_with(ONE, {})) == ("eac", "ebc", "ecc")
    assert possible_components(stage_with(ONE, AXES)) == ("exc", "eyc", "eac", "ebc", "ecc")
    assert set(unchecked_sensors(stage_with(ONE, AXES))) == set(AXES)
    assert possible_components(stage_with(ASIDE, {"radial_probe_x": AXES["radial_probe_x"]}))[:2] == ("exc", "eyc")
    assert not unchecked_sensors(stage_with(ASIDE, RADIAL))
    assert set(COMPONENTS) - set(possible_components(stage_with(ONE, RADIAL, tilt=False))) == {"ezc"}
