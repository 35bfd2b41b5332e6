"""A listed sensor of two fields in the estimate: observable, checked and doubted as a whole, the same bits again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from motion_numbers import assert_same_bits
from pipeline.test_estimation import START
from pipeline.test_listed_sensors import (
    AXIAL,
    FACE,
    RADIAL,
    SECOND,
    assert_repeated,
    described,
    drifting,
    jumping,
    noisy,
    off,
    recorded,
    run,
    scaled,
    spoilt,
    stuck,
    without_sensors,
)

from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.pipeline.observability import possible_components, unchecked_sensors

NAME = "tilt_sensor_second"
BEGIN = 2.4


def test_what_a_second_autocollimator_determines_and_who_checks_whom():
    assert possible_components(described(SECOND, tilt=False)) == ("exc", "eyc", "eac", "ebc", "ecc")
    assert possible_components(described(SECOND | AXIAL, tilt=False)) == COMPONENTS
    assert unchecked_sensors(described(SECOND, tilt=False)) == (NAME,)
    assert unchecked_sensors(described(SECOND)) == ()
    assert unchecked_sensors(described(SECOND | RADIAL, tilt=False)) == ()
    one = {"radial_probe_x2": RADIAL["radial_probe_x2"]}
    assert unchecked_sensors(described(SECOND | one, tilt=False)) == (NAME,), "one of its fields is not checked"
    assert unchecked_sensors(described(FACE | SECOND, tilt=False)) == ()


def test_the_standard_deviation_is_that_of_the_instrument():
    _, result, _ = run(recorded(SECOND, tilt=False), described(SECOND, tilt=False))
    late = (result.times_ns - START) > 2.5e9
    expected = np.sqrt(3e-7**2 + 1e-7**2 / 12 + 1e-7**2)
    for place in (3, 4):
        assert 0.7 * expected < np.median(np.sqrt(result.covariance[late, place, place])) < 1.2 * expected


def of_one(fault):
    """A fault of the first field alone."""

    def spoil(name, t, readings, draw):
        return readings if name != NAME else np.column_stack([fault(name, t, readings[:, :1], draw), readings[:, 1:]])

    return spoil


def swapped(name, t, readings, draw):
    return np.where(t[:, None] > BEGIN, readings[:, ::-1], readings) if name == NAME else readings


FAULTS = {
    "a step of 100 µrad": jumping(NAME, BEGIN, 1e-4),
    "a step of one field": of_one(jumping(NAME, BEGIN, 1e-4)),
    "stuck": stuck(NAME, BEGIN),
    "stuck in one field": of_one(stuck(NAME, BEGIN)),
    "ten times the noise": noisy(NAME, BEGIN, 3e-6),
    "axes exchanged": swapped,
    "in millirad": scaled(NAME, 1e3),
    "not a number": spoilt(NAME, BEGIN, np.nan),
    "not a number in one field": of_one(spoilt(NAME, BEGIN, np.nan)),
    "at the end of its range": spoilt(NAME, BEGIN, 5e-4),
    "huge": spoilt(NAME, BEGIN, 1e30),
}


@pytest.mark.parametrize("tilt", [True, False])
@pytest.mark.parametrize("fault", FAULTS)
def test_one_that_fails_makes_nothing_wrong(fault, tilt):
    """From 100 ms after it begins at most 0.2 % of what is published is beyond six stated standard deviations."""
    wrong = total = 0
    for seed in range(3):
        _, result, doubted = run(recorded(SECOND, seed, 3.4, FAULTS[fault], tilt), described(SECOND, tilt))
        found, t = off(result)
        after = t > BEGIN + 0.1
        wrong += int((np.abs(found[after]) > 6.0).any(axis=1).sum())
        total += int(after.sum())
        assert set(doubted) <= {NAME}
    assert total > 2000
    assert wrong <= 0.002 * total


@pytest.mark.parametrize("seed", range(3))
def test_a_drift_beside_the_autocollimator_is_told(seed):
    fault = of_one(drifting(NAME, BEGIN, 2e-5))
    _, result, doubted = run(recorded(SECOND, seed, fault=fault), described(SECOND))
    assert set(doubted) == {NAME}
    assert doubted[NAME].startswith(("tilt_x: ", "tilt_y: ")) and " µrad from " in doubted[NAME]
    found, t = off(result)
    assert (np.abs(found[t > 2.5]) > 6.0).any(axis=1).mean() <= 0.002


def test_a_field_that_is_wrong_leaves_the_sensor_out_as_a_whole():
    fault = FAULTS["stuck in one field"]
    _, result, doubted = run(recorded(SECOND, 1, 3.4, fault, tilt=False), described(SECOND, tilt=False))
    assert doubted[NAME].startswith("tilt_x: ")
    seen = result.observable[:, 3:5]
    t = (result.times_ns - START) * 1e-9
    assert seen[(t > 0.5) & (t < BEGIN)].all() and not seen[t > BEGIN + 0.3].any()


def test_a_replay_gives_the_same_bits_however_blocks_come():
    sensors = AXIAL | SECOND
    stage = described(sensors, tilt=False)
    pairs = recorded(sensors, 5, 1.5, jumping(NAME, 0.6, 1e-4), tilt=False)
    _, live, doubted = run(pairs, stage)
    assert set(doubted) == {NAME}
    assert_repeated(pairs, stage, live)


def test_heads_and_autocollimator_stay_what_they_are():
    """To the last bit, whatever it shows: also one that is described the other way about."""
    wrong = {NAME: dataclasses.replace(SECOND[NAME], gain=1.0)}
    pairs = recorded(SECOND)
    _, alone, _ = run([pair for pair in pairs if pair[0] != NAME], described({}))
    _, beside, doubted = run(pairs, described(wrong))
    assert set(doubted) == {NAME}
    assert_same_bits(without_sensors(beside, alone), alone)
