"""Which samples are believed: the same ones however they are cut into blocks, and each refusal has its reason."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.admission import (
    ASTRAY,
    BEYOND,
    FAST,
    LATE,
    NOT_FINITE,
    SPIKE,
    Admission,
    SampleLimits,
)
from rotary_error_monitor.signals.arrival import FUTURE, OLD, ArrivalCheck
from rotary_error_monitor.signals.described_path import PLACES, DescribedPath
from rotary_error_monitor.units import TURN

MS = 1_000_000


def shown(size, angle):
    """(n, 2) what a mirror shows whose tilt is that large, and which is a little uneven."""
    return size * np.column_stack([np.cos(angle) + 0.03 * np.sin(2 * angle), np.sin(angle) - 0.05 * np.cos(3 * angle)])


def along(size):
    """Limits of an autocollimator that looks at that mirror."""
    return SampleLimits(largest=1e-3, noise=5e-7, path=DescribedPath(shown(size, np.arange(PLACES) * (TURN / PLACES))))


ANGLE = SampleLimits(largest=1e7, speed=10.0, turns=True, jitter=1e-3)
TILT = along(8e-5)


def admit(admission, times, values, cuts=()):
    """What is taken of samples that come in blocks cut at `cuts`."""
    taken = [admission.admit(t, v) for t, v in zip(np.split(times, cuts), np.split(values, cuts), strict=True)]
    return np.concatenate([t for t, _ in taken]), np.concatenate([v for _, v in taken])


def ramp(count=200, speed=3.0, period=4 * MS, start=0.0):
    times = np.arange(count) * period
    return times, (start + speed * times * 1e-9)[:, None]


def test_what_is_sound_is_taken_as_it_is():
    times, values = ramp()
    admission = Admission(ANGLE)
    taken = admit(admission, times, values, [50, 51, 120])
    np.testing.assert_array_equal(taken[0], times)
    np.testing.assert_array_equal(taken[1], values)
    assert not admission.refused


@pytest.mark.parametrize(
    ("wrong", "reason"), [(np.nan, NOT_FINITE), (np.inf, NOT_FINITE), (1e30, BEYOND), (1e300, BEYOND), (-1e8, BEYOND)]
)
def test_single_wrong_values_cost_only_themselves(wrong, reason):
    times, values = ramp()
    values[17] = wrong
    admission = Admission(ANGLE)
    taken = admit(admission, times, values, [40])[0]
    np.testing.assert_array_equal(taken, np.delete(times, 17))
    assert admission.refused == {reason: 1}
    assert admission.refusals.tolist() == [times[17]]


def test_times_that_do_not_rise_are_refused():
    times, values = ramp(10)
    times[4], times[7] = times[2], times[6]
    admission = Admission(ANGLE)
    assert admit(admission, times, values)[0].tolist() == [t * 4 * MS for t in (0, 1, 2, 3, 5, 6, 8, 9)]
    assert admission.refused == {LATE: 2}


@settings(deadline=None, max_examples=100)
@given(st.data(), st.sampled_from([0.02, 0.3, 1.5, 3600.0, 3e7]), st.integers(2, 60))
def test_a_stamp_ahead_of_those_that_came_with_it_costs_only_its_own_sample(data, ahead, size):
    """With a clock what is in the future is told by it, wherever it stands; without one by the order of the others."""
    times, values = ramp()
    begins = np.arange(0, 200 - size, size)
    wrong = np.array([begin + data.draw(st.integers(0, size - 2)) for begin in begins])
    stamps = times.copy()
    stamps[wrong] += round(ahead * 1e9)
    for clock in (True, False):
        admission, taken = Admission(ANGLE), []
        for begin in range(0, 200, size):
            block = slice(begin, begin + size)
            until = int(times[block][-1]) + 100 * MS if clock else None
            taken.append(admission.admit(stamps[block], values[block], until)[0])
        np.testing.assert_array_equal(np.concatenate(taken), np.delete(times, wrong))
        latest = times[np.minimum(begins + size, 200) - 1] + 100 * MS
        future = int(np.count_nonzero(stamps[wrong] > latest)) if clock else 0
        assert admission.refused == +Counter({FUTURE: future, ASTRAY: len(wrong) - future})
        assert (np.diff(admission.refusals) >= 0).all() and admission.refusals[-1] <= times[-1]


@settings(deadline=None, max_examples=200)
@given(st.lists(st.integers(0, 12), min_size=1, max_size=12))
def test_of_stamps_in_disorder_as_many_are_taken_as_can_be_in_order(stamps):
    times = np.array(stamps, np.int64)
    taken = Admission().admit(times, np.zeros((len(times), 1)))[0]
    assert (np.diff(taken) > 0).all()
    longest = [1] * len(stamps)
    for i in range(len(stamps)):
        longest[i] += max([longest[j] for j in range(i) if stamps[j] < stamps[i]], default=0)
    assert len(taken) == max(longest)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(-9.0, 9.0),
    st.floats(-50.0, 50.0),
    st.sampled_from([(0.0, TURN), (-np.pi, np.pi)]),
    st.lists(st.integers(1, 199), max_size=6),
)
def test_a_reading_that_starts_again_after_a_turn_goes_on(speed, start, interval, cuts):
    times, values = ramp(speed=speed, start=start)
    wrapped = interval[0] + np.mod(values - interval[0], TURN)
    admission = Admission(ANGLE)
    taken = admit(admission, times, wrapped, sorted(cuts))[1]
    np.testing.assert_allclose(taken - taken[0], values - values[0], atol=1e-9)
    assert admission.wraps == np.count_nonzero(np.abs(np.diff(wrapped[:, 0])) > np.pi)
    assert not admission.refused


def test_a_jump_that_no_rotation_makes_is_refused_until_it_can_have_turned_there():
    times, values = ramp(speed=0.0)
    values[100:] += 1.0
    admission = Admission(ANGLE)
    taken = admit(admission, times, values)[0]
    refused = admission.refused[FAST]
    assert 20 <= refused <= 26, "at 10 rad/s it takes 0.1 s, 25 samples, to turn by 1 rad"
    np.testing.assert_array_equal(taken, np.delete(times, np.arange(100, 100 + refused)))


def tilts(generator, count=400):
    times = np.arange(count) * 2_500_000
    angle = 2.0 * times * 1e-9
    noise = generator.normal(0.0, TILT.noise, (count, 2))
    return times, shown(8e-5, angle) + noise


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**31), st.integers(1, 2), st.lists(st.integers(1, 399), max_size=40))
def test_spikes_are_left_out_and_nothing_else(seed, width, cuts):
    generator = np.random.default_rng(seed)
    times, values = tilts(generator)
    wrong = np.sort(generator.choice(np.arange(5, 390, 12), 8, replace=False))
    spikes = np.concatenate([wrong + i for i in range(width)])
    values[spikes] += generator.choice([-1, 1], (len(wrong), 1)).repeat(width, 0).reshape(-1, 1)[: len(spikes)] * 4e-5
    admission = Admission(TILT)
    taken = admit(admission, times, values, sorted(cuts))[0]
    missing = np.setdiff1d(times, taken)
    waiting = missing[missing > times[-3]]
    np.testing.assert_array_equal(np.setdiff1d(missing, waiting), times[np.sort(spikes)])
    assert admission.refused[SPIKE] == len(spikes)


def moving(seed, rate, speed, order, size):
    """What of 400 readings is refused of a signal that moves with a rotor, and how many are taken."""
    generator = np.random.default_rng(seed)
    times = np.round(np.arange(400) / rate * 1e9).astype(np.int64)
    angle = order * speed * np.arange(400) / rate + generator.uniform(0.0, TURN)
    motion = size * np.column_stack([np.cos(angle), np.sin(angle)])
    values = motion + generator.normal(0.0, TILT.noise, motion.shape)
    admission = Admission(TILT)
    taken = admit(admission, times, values, np.sort(generator.integers(1, 400, 30)))[0]
    return admission.refused, len(taken)


@settings(deadline=None, max_examples=150)
@given(
    st.integers(0, 2**31),
    st.floats(math.log(20.0), math.log(50_000.0)).map(math.exp),
    st.floats(-60.0, 60.0),
    st.integers(1, 20),
    st.floats(-6.0, -3.3).map(lambda power: 10.0**power),
)
def test_a_signal_that_moves_as_fast_as_its_samples_follow_has_no_spikes(seed, rate, speed, order, size):
    # noise alone makes one of 400 samples a spike in fewer than 1 of 10,000 recordings, and two never
    refused, taken = moving(seed, rate, speed, order, size)
    assert sum(refused.values()) == refused[SPIKE] <= 1
    assert taken >= 397, "no more than two wait"


def test_nor_does_noise_make_one_in_hundreds_of_such_recordings():
    draw = np.random.default_rng(5)
    for seed in range(300):
        rate, size = math.exp(draw.uniform(math.log(20.0), math.log(50_000.0))), 10.0 ** draw.uniform(-6.0, -3.3)
        refused, taken = moving(seed, rate, draw.uniform(-60.0, 60.0), int(draw.integers(1, 21)), size)
        assert not refused
        assert taken >= 398


@pytest.mark.parametrize("jolt", [20.0, 60.0], ids=lambda jolt: f"{jolt:g} rad/s2")
def test_a_signal_that_begins_to_move_loses_next_to_nothing(jolt):
    for seed in range(40):
        generator = np.random.default_rng(seed)
        moving = np.clip(np.arange(600) / 100 - generator.uniform(0.5, 1.5), 0.0, None)
        angle = np.where(moving < 60.0 / jolt, 0.5 * jolt * moving**2, 60.0 * moving - 1800.0 / jolt)
        values = 2e-4 * np.column_stack([np.cos(angle), np.sin(angle)]) + generator.normal(0.0, TILT.noise, (600, 2))
        admission = Admission(TILT)
        admission.admit(np.arange(600) * 10 * MS, values)
        assert admission.refused[SPIKE] <= 2


def turned(seed):
    """Times and angles of a rotor that speeds up and turns back between few samples a turn, a size, a generator."""
    generator = np.random.default_rng(seed)
    rate, size = generator.uniform(52.0, 90.0), math.exp(generator.uniform(math.log(2e-5), math.log(5e-4)))
    steady = generator.choice([-1.0, 1.0]) * generator.uniform(35.0, 60.0)
    ramp = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, round(rate * abs(steady) / generator.uniform(50.0, 400.0))))
    speed = np.concatenate([np.zeros(40), steady * ramp, [steady] * 60, steady * (1.0 - 2.0 * ramp), [-steady] * 60])
    angle = generator.uniform(0.0, TURN) + np.cumsum(speed) / rate
    times = np.round(np.arange(len(speed)) / rate * 1e9).astype(np.int64)
    return times, angle, size, generator


def speeding_up(seed):
    """Times and readings of a rotor that speeds up and turns back between few samples a turn, limits, a generator."""
    times, angle, size, generator = turned(seed)
    values = shown(size, angle)
    return times, values + generator.normal(0.0, TILT.noise, values.shape), along(size), generator


def test_what_goes_on_along_its_description_is_no_spike_however_few_samples_there_are_in_a_turn():
    along_it, without = 0, 0
    for seed in range(60):
        times, values, limits, generator = speeding_up(seed)
        for path in (limits.path, None):
            admission = Admission(replace(limits, path=path))
            admit(admission, times, values, np.sort(generator.integers(1, len(times), 30)))
            along_it += admission.refused[SPIKE] * (path is not None)
            without += admission.refused[SPIKE] * (path is None)
    assert without > 60
    assert along_it <= 0.1 * without


def test_of_few_samples_in_a_turn_the_same_spikes_are_left_out_with_a_description_as_without():
    for seed in range(60):
        times, values, limits, generator = speeding_up(seed)
        values[[15, 25, 35, -50, -30, -10]] += generator.choice([-1.0, 1.0], (6, 2)) * generator.uniform(1e-5, 5e-4)
        kept = [admit(Admission(replace(limits, path=path)), times, values)[0] for path in (limits.path, None)]
        spikes = times[[15, 25, 35, -50, -30, -10]]
        np.testing.assert_array_equal(*(np.intersect1d(each, spikes) for each in kept))


def crossing(seed):
    """The same of a mirror whose readings cross themselves many times in a turn, and spikes."""
    times, angle, _, generator = turned(seed)
    (small, large), order = generator.uniform((2e-6, 1e-5), (1e-5, 2e-5)), int(generator.integers(5, 10))

    def shows(at):
        return np.stack([wave(at) * small + wave(order * at) * large for wave in (np.cos, np.sin)], axis=1)

    limits = replace(TILT, noise=3e-7, path=DescribedPath(shows(np.arange(PLACES) * (TURN / PLACES))))
    return times, shows(angle) + generator.normal(0.0, 3e-7, (len(times), 2)), limits


def test_readings_that_may_stand_at_many_places_of_their_curve_are_no_spikes():
    sound, without, total = 0, 0, 0
    for seed in range(60):
        times, values, limits = crossing(seed)
        for path in (limits.path, None):
            admission = Admission(replace(limits, path=path))
            admit(admission, times, values)
            sound += admission.refused[SPIKE] * (path is not None)
            without += admission.refused[SPIKE] * (path is None)
        total += len(times)
    assert without > 1e-3 * total
    assert sound <= 0.1 * without, (sound, without, total)


def test_a_point_is_a_path_as_well():
    times, values, limits = crossing(0)
    admission = Admission(replace(limits, path=DescribedPath(np.zeros((PLACES, 2)))))
    admit(admission, times, values)
    assert not DescribedPath(np.zeros((PLACES, 2))).goes_on(values[None, :3], np.array([1.0])).any()


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**31), st.integers(1, 2), st.floats(40.0, 1000.0), st.floats(0.0, 3.0))
def test_spikes_of_any_size_beyond_the_noise_are_left_out_of_a_smooth_signal(seed, width, sigmas, speed):
    generator = np.random.default_rng(seed)
    times = np.arange(400) * 2_500_000
    angle = speed * times * 1e-9
    values = shown(8e-5, angle) + generator.normal(0.0, TILT.noise, (400, 2))
    wrong = np.sort(generator.choice(np.arange(20, 380, 40), 4, replace=False))
    spikes = np.sort(np.concatenate([wrong + i for i in range(width)]))
    values[spikes, generator.integers(2)] += generator.choice([-1.0, 1.0]) * sigmas * TILT.noise
    admission = Admission(TILT)
    taken = admit(admission, times, values, np.sort(generator.integers(1, 400, 30)))[0]
    missing = np.setdiff1d(times, taken)
    np.testing.assert_array_equal(missing[missing <= times[-3]], times[spikes])


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**31), st.lists(st.integers(1, 399), max_size=80), st.floats(0.3, 4.0))
def test_what_is_a_spike_does_not_depend_on_how_samples_came(seed, cuts, noisier):
    """Spikes of all sizes, in bursts, steps, more noise than stated, swings that begin and end."""
    generator = np.random.default_rng(seed)
    times = np.arange(400) * 10 * MS
    angle = np.cumsum(np.repeat(generator.uniform(0.0, 1.5, 8), 50))
    size = generator.uniform(0.0, 4e-5)
    limits, values = along(size), shown(size, angle)
    values += noisier * generator.normal(0.0, TILT.noise, values.shape)
    wrong = generator.random(400) < generator.choice([0.01, 0.1, 0.3])
    values[wrong] += generator.normal(0.0, 1.0, (wrong.sum(), 2)) * 10.0 ** generator.uniform(-6.5, -4.0)
    values[generator.integers(400) :] += generator.normal(0.0, 3e-5, 2)
    whole, parts = Admission(limits), Admission(limits)
    at_once, taken = admit(whole, times, values), admit(parts, times, values, sorted(cuts))
    single = admit(Admission(limits), times, values, range(1, 400))
    for other in (taken, single):
        np.testing.assert_array_equal(other[0], at_once[0])
        np.testing.assert_array_equal(other[1], at_once[1])
    assert whole.refused == parts.refused


def test_a_step_is_no_spike():
    times, values = tilts(np.random.default_rng(3))
    values[200:] += 1e-4
    admission = Admission(TILT)
    taken = admit(admission, times, values, range(2, 400, 2))[0]
    np.testing.assert_array_equal(taken, times)
    assert not admission.refused


def test_normal_noise_is_no_spike_in_a_million_samples():
    generator = np.random.default_rng(4)
    count = 1_000_000
    admission = Admission(TILT)
    taken = admission.admit(np.arange(count) * MS, generator.normal(0.0, TILT.noise, (count, 2)))[0]
    assert len(taken) >= count - 2
    assert admission.refused[SPIKE] == 0


def test_turns_are_taken_out_of_what_comes():
    times, values = ramp(start=3 * TURN)
    admission = Admission(ANGLE)
    admission.admit(times[:50], values[:50])
    admission.turn_by(3)
    np.testing.assert_allclose(admission.admit(times[50:], values[50:])[1], values[50:] - 3 * TURN, atol=1e-12)
    assert not admission.refused


def test_arrivals():
    check = ArrivalCheck(max_age_ns=1000 * MS, ahead_ns=100 * MS)
    now = 10_000 * MS
    assert check.judge(now, now) == check.judge(now + 90 * MS, now) == check.judge(now - 900 * MS, now) == ""
    assert check.judge(now + 3600 * 1000 * MS, now).startswith(f"{FUTURE}: 60.0 min ahead")
    assert check.judge(now - 1100 * MS, now).startswith(f"{OLD}: 1.1 s, limit 1 s")
    assert check.judge(now - 600 * MS, now).startswith(f"{OLD}: 0.6 s, limit 0.5 s until it has caught up")
    assert check.judge(now - 140 * MS, now) == "", "a computer that is always somewhat late comes back"
    assert check.refused == {FUTURE: 1, OLD: 2}
    assert check.was_set_back(now, now - 200 * MS)
    assert not check.was_set_back(now, now - 50 * MS)
    assert not check.was_set_back(None, now)


def test_the_newest_of_a_block_is_what_is_not_in_the_future_wherever_it_stands():
    check, now = ArrivalCheck(ahead_ns=100 * MS), 10_000 * MS
    assert check.newest_of(np.array([1, 3, 2]) * MS, now) == 3 * MS
    assert check.newest_of(np.array([now + 101 * MS, now + 99 * MS, 5]), now) == now + 99 * MS
    assert check.newest_of(np.array([now + 200 * MS, now + 300 * MS]), now) == now + 300 * MS


@pytest.mark.parametrize("wrong", [{"max_age_ns": 0}, {"ahead_ns": -1}])
def test_wrong_limits_of_arrival(wrong):
    with pytest.raises(InputError, match="expected above 0"):
        ArrivalCheck(**wrong)
