"""Which joint states are believed: what a machine can do is, and nothing that it cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from draws import ALL
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.pipeline.joint_checks import BEYOND_TRAVEL, JUMP, JointChecks
from rotary_error_monitor.pipeline.joint_freezes import FROZEN
from rotary_error_monitor.pipeline.joints import JointTrack

MACHINE = load_machine("xyzac_trt")
MS = 1_000_000
SPEEDS = dict.fromkeys("XYZAC", 0.0)


def position(t):
    """X, Y, Z swing, A tilts, C turns on and on."""
    return np.array([0.2 * np.sin(0.8 * t), 0.1 * np.cos(1.3 * t), 0.05 * t % 0.2, 1.2 * np.sin(0.9 * t), 6.0 * t])


def judged(rows, period_ms=10, speeds=SPEEDS, jitter=None):
    checks = JointChecks(MACHINE)
    times = np.arange(len(rows)) * period_ms * MS
    if jitter is not None:
        times = times + (jitter * MS).astype(int)
    return checks, [
        checks.judge(int(time), np.asarray(row, float), speeds) for time, row in zip(times, rows, strict=True)
    ]


def smooth(count=400):
    rows = np.array([position(0.01 * k) for k in range(count)])
    rows[:, 2] = 0.1 * np.sin(0.5 * 0.01 * np.arange(count))
    return rows


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.booleans())
def test_a_machine_in_production_is_believed(seed, wrapped):
    """Also with stamps that jitter by milliseconds, and a table that is told modulo a turn."""
    generator = np.random.default_rng(seed)
    rows = smooth() + generator.normal(0.0, 1e-7, (400, 5))
    if wrapped:
        rows[:, 4] = np.mod(rows[:, 4] + np.pi, 2 * np.pi) - np.pi
    _, said = judged(rows, jitter=generator.uniform(0.0, 2.0, 400))
    assert set(said) == {""}


@pytest.mark.parametrize(
    ("axis", "value", "reason"),
    [
        (0, 1.0, BEYOND_TRAVEL),  # X 1 m beyond
        (3, 10.0, BEYOND_TRAVEL),  # A in another turn
        (3, math.degrees(0.4), BEYOND_TRAVEL),  # A in degrees
        (1, 1e300, BEYOND_TRAVEL),
        (4, 1e30, BEYOND_TRAVEL),
        (0, 0.24, JUMP),
        (4, 2.0, JUMP),
    ],
)
def test_what_no_axis_does_is_refused_and_its_end_believed_at_once(axis, value, reason):
    rows = smooth()
    wrong = rows.copy()
    wrong[100:150, axis] = value
    checks, said = judged(wrong)
    assert all(reason in each for each in said[100:150])
    assert set(said[:100] + said[150:]) == {""}
    assert checks.refused == {reason: 50}


@pytest.mark.parametrize("offset", [0.02, -0.05, 0.1])
def test_an_offset_that_came_by_a_jump_stays_wrong_however_long_it_lasts(offset):
    wrong = smooth(2000)
    wrong[:, 0] *= 0.5
    wrong[300:, 0] += offset
    _, said = judged(wrong)
    assert set(said[:300]) == {""}
    assert all(f"axis X made {JUMP} of {offset:.3g} m" in each or JUMP in each for each in said[300:])


def test_after_a_pause_an_axis_may_be_elsewhere():
    checks = JointChecks(MACHINE)
    assert checks.judge(0, position(0.0), SPEEDS) == ""
    assert checks.judge(600 * MS, position(0.0) + 0.05, SPEEDS) == ""


def test_reset_believes_the_next_one():
    checks = JointChecks(MACHINE)
    checks.judge(0, position(0.0), SPEEDS)
    assert JUMP in checks.judge(10 * MS, position(0.0) + 0.05, SPEEDS)
    checks.reset()
    assert checks.judge(20 * MS, position(0.0) + 0.05, SPEEDS) == ""


def test_positions_that_stand_while_the_controller_says_they_move():
    rows = np.tile(position(1.0), (100, 1))
    checks, said = judged(rows, speeds=SPEEDS | {"Y": 0.05})
    assert said[0] == said[1] == ""
    assert all(f"axis Y is {FROZEN}" in each for each in said[4:])
    assert checks.refused[FROZEN] >= 95
    assert set(judged(rows)[1]) == {""}, "a machine may stand"
    assert set(judged(rows, speeds=dict.fromkeys("XYZAC", 1.0))[1]) == {""}, "signs of the travel, not speeds"


@pytest.mark.parametrize("stall", [2, 5, 10, 30, 100])
@pytest.mark.parametrize("begin", [50, 111, 247])
def test_a_controller_that_stalls_is_believed_again_at_once(stall, begin):
    """For some periods of 10 ms it repeats what it said, and then says where the axes are."""
    checks, rows = JointChecks(MACHINE), smooth()
    said = []
    for k in range(len(rows)):
        told = begin if begin <= k < begin + stall else k
        speed = (rows[min(told + 1, len(rows) - 1)] - rows[told]) / 0.01
        said.append(checks.judge(k * 10 * MS, rows[told], dict(zip("XYZAC", speed.tolist(), strict=True))))
    assert set(said[:begin]) == {""}
    assert set(said[begin + stall :]) == {""}, checks.refused


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("late_ms", [3.0, 7.0, 12.0])
@pytest.mark.parametrize("axis", [0, 3])
def test_an_axis_that_a_late_servo_thread_leaves_behind_and_then_puts_right_made_no_jump(axis, late_ms, told):
    """X at 0.1 m/s, A at 1 rad/s; each 20th look sees where it was, the next one comes at once and where it is."""
    rows, stamps, speed = [], [], [0.1, 1.0][axis > 0]
    for k in range(200):
        stamps.append((8 * k + (7 if k % 20 == 10 else 0)) * MS)
        behind = late_ms * 1e-3 if k % 20 == 10 else 0.0
        row = np.zeros(5)
        row[axis] = speed * (stamps[-1] * 1e-9 - behind) - 0.1
        rows.append(row)
    checks = JointChecks(MACHINE)
    speeds = SPEEDS | {"XYZAC"[axis]: speed} if told else {}
    assert {checks.judge(stamp, row, speeds) for stamp, row in zip(stamps, rows, strict=True)} == {""}


@pytest.mark.parametrize("said", [0.0, 1e300])
def test_what_a_controller_says_of_speeds_makes_no_jump_of_a_standing_axis_right(said):
    """No faster than the axis can go: 0.5 m/s for 20 ms are 10 mm, not any distance."""
    checks = JointChecks(MACHINE)
    courses = [0.0, 1e-6, 0.02]  # one that stood exactly would be frozen by what is said
    rows = [np.array([x, 0.0, 0.0, 0.0, 0.0]) for x in courses]
    *before, last = [checks.judge(10 * k * MS, row, SPEEDS | {"X": said}) for k, row in enumerate(rows)]
    assert set(before) == {""}
    assert f"axis X made {JUMP}" in last


def test_a_step_within_the_speed_of_the_axis_is_refused_for_a_second():
    """It may be a stamp that is late, or an acceleration beyond the stated one: no more than millimetres off."""
    rows = smooth()
    rows[200:, 0] += 0.004
    _, said = judged(rows)
    assert set(said[:200]) == {""}
    assert all(JUMP in each for each in said[200:299])
    assert set(said[301:]) == {""}


def test_an_axis_that_is_not_named_is_not_judged():
    rows = smooth()
    rows[:, 4] = np.nan
    checks = JointChecks(MACHINE)
    assert {checks.judge(k * 10 * MS, row, SPEEDS, unnamed="C") for k, row in enumerate(rows)} == {""}
    assert checks.judge(60_000 * MS, rows[0], SPEEDS).startswith("axis C at nan rad is beyond its travel")


def told(axis, stamps, places, speeds):
    """What is said of joint states with stamps (s) in which one axis is at `places` and the others stand."""
    checks, rows = JointChecks(MACHINE), np.zeros((len(stamps), len(MACHINE.axes)))
    rows[:, axis] = places
    said = [checks.judge(round(t * 1e9), row, speeds) for t, row in zip(stamps.tolist(), rows, strict=True)]
    return np.array(said)


def braking(speed, deceleration):
    """Course, m or rad at times in s, of an axis that comes at a speed, brakes, and stands at 0 from 0 s on."""

    def course(t):
        left = np.maximum(-np.asarray(t, float), 0.0)
        brakes = np.minimum(left, abs(speed) / deceleration)
        return -np.sign(speed) * (0.5 * deceleration * brakes**2 + abs(speed) * (left - brakes))

    return course


@pytest.mark.parametrize("velocities", ["left out", "zero"])
@pytest.mark.parametrize("rate", [20.0, 50.0, 100.0, 333.0, 1000.0])
@pytest.mark.parametrize("seed", range(6))
def test_an_axis_that_stands_at_once_though_it_cannot_brake_as_fast_is_frozen(seed, rate, velocities):
    """From 1.5 times the speed that its brakes take away in a period, or in 5 ms where messages come faster."""
    draw = np.random.default_rng([seed, int(rate)])
    axis = int(draw.integers(len(MACHINE.axes)))
    described = MACHINE.axes[axis]
    least = 1.5 * described.quickest * max(1.0 / rate, 5e-3)
    speed = draw.choice([-1, 1]) * draw.uniform(least, max(least, 0.9 * described.fastest))
    stamps = np.arange(-0.3, 0.35, 1.0 / rate) + draw.uniform(0.0, 1.0 / rate)
    course = speed * stamps
    frozen = (stamps > 0.0) & (stamps <= 0.2)
    course[frozen] = course[stamps <= 0.0][-1]
    said = told(axis, stamps, course, SPEEDS if velocities == "zero" else {})
    assert set(said[stamps <= 0.0]) == {""}
    late = max(0.03, 2.0 / rate)
    seen = set(said[frozen & (stamps > late)])
    assert seen
    assert all(f"axis {described.letter} is {FROZEN}" in each for each in seen), seen
    assert set(said[stamps > 0.2]) == {""}, "believed as soon as it is where the axis is"


@settings(deadline=None, max_examples=300 if ALL else 100)
@given(
    seed=st.integers(0, 2**31),
    rate=st.sampled_from([5.0, 20.0, 50.0, 100.0, 333.0, 1000.0]),
    jitter=st.sampled_from([0.0, 1e-3, 2.5e-3]),
    rounded=st.sampled_from([0.0, 1e-6, 1e-5]),
)
def test_an_axis_that_brakes_as_hard_as_it_may_and_stands_is_believed(seed, rate, jitter, rounded):
    """Any axis and speed, with stamps that are off either way and positions that are rounded."""
    draw = np.random.default_rng(seed)
    axis = int(draw.integers(len(MACHINE.axes)))
    described = MACHINE.axes[axis]
    course = braking(draw.choice([-1, 1]) * draw.uniform(0.0, described.fastest), described.quickest)
    times = np.arange(-0.4, 1.0, 1.0 / rate) + draw.uniform(0.0, 1.0 / rate)
    jitter = min(jitter, 0.4 / rate)
    places = course(times)
    places = np.round(places / rounded) * rounded if rounded else places
    said = told(axis, times + draw.uniform(-jitter, jitter, len(times)), places, {})
    assert set(said) == {""}


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 2**31), rate=st.sampled_from([100.0, 333.0, 1000.0]), stall=st.floats(0.0, 0.02))
def test_an_axis_that_brakes_in_a_stall_of_the_controller_is_believed(seed, rate, stall):
    """Messages of the stall repeat the position before it; the first after it says where the axis is by then."""
    draw = np.random.default_rng(seed)
    axis = int(draw.integers(len(MACHINE.axes)))
    described = MACHINE.axes[axis]
    course = braking(draw.uniform(0.0, described.fastest), described.quickest)
    times = np.arange(-0.4, 1.0, 1.0 / rate) + draw.uniform(0.0, 1.0 / rate)
    begin = draw.uniform(-0.06, 0.01)
    looked = np.where((times > begin) & (times <= begin + stall), begin, times)
    assert not [each for each in told(axis, times, course(looked), {}) if FROZEN in each]


def course_of(seed, rate, duration):
    """Stamps (s) and rows of a machine of which each axis swings within its limits."""
    draw = np.random.default_rng([seed, int(rate)])
    stamps = np.arange(0.0, duration, 1.0 / rate) + draw.uniform(0.0, 1.0 / rate)
    rows = np.empty((len(stamps), len(MACHINE.axes)))
    for i, axis in enumerate(MACHINE.axes):
        size = min(0.4 * (axis.travel[1] - axis.travel[0]), 5.0) * draw.uniform(0.2, 1.0)
        angular = draw.uniform(0.3, 0.9) * min(axis.fastest / size, math.sqrt(axis.quickest / size))
        rows[:, i] = size * np.sin(angular * stamps + draw.uniform(0.0, 2.0 * np.pi))
    return stamps, rows


def judged_at(stamps, rows):
    checks = JointChecks(MACHINE)
    return np.array([checks.judge(round(t * 1e9), row, {}) for t, row in zip(stamps.tolist(), rows, strict=True)])


@pytest.mark.parametrize("count", [1, 2, 10])
@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0, 1000.0])
@pytest.mark.parametrize("wrong", ["all zeros", "off by centimetres"])
@pytest.mark.parametrize("seed", range(4))
def test_a_course_that_begins_wrong_is_over_within_a_second(seed, wrong, rate, count):
    stamps, rows = course_of(seed, rate, 6.0)
    count = min(count, math.ceil(0.3 * rate))
    if wrong == "all zeros":
        rows[:count] = 0.0
    else:
        rows[:count, 0] = 0.5 * rows[:count, 0] + 0.08
    said = judged_at(stamps, rows)
    assert set(said[stamps > stamps[count - 1] + 0.9]) == {""}
    if rate >= 100.0:
        far = np.abs(rows[count] - rows[count - 1]) > [axis.fastest * 0.02 for axis in MACHINE.axes]
        assert not far.any() or all(JUMP in each for each in said[count : count + int(0.3 * rate)])


@pytest.mark.parametrize("ahead", [0.01, 0.03, 0.06, 0.09])
@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_joint_state_that_is_stamped_ahead_is_over_when_its_stamp_is(seed, rate, ahead):
    """Those of before its stamp are not taken: they come after it."""
    stamps, rows = course_of(seed, rate, 4.0)
    which = len(stamps) // 2
    kept = (stamps > stamps[which] + ahead + 1e-6) | (np.arange(len(stamps)) <= which)
    stamps[which] += ahead
    said = judged_at(stamps[kept], rows[kept])
    assert set(said[:which]) == {""}
    assert set(said[stamps[kept] > stamps[which] + max(0.3, 2.0 / rate)]) == {""}


@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0, 1000.0])
@pytest.mark.parametrize("seed", range(4))
def test_an_offset_beyond_what_the_axis_can_go_stays_wrong_at_any_rate(seed, rate):
    stamps, rows = course_of(seed, rate, 8.0)
    period = 1.0 / rate
    rows[:, 0] = 0.2 * rows[:, 0] - 0.1  # with its offset it is within its travel
    after = stamps > 1.0
    rows[after, 0] += MACHINE.axes[0].fastest * (1.2 * period + 5e-3) + 0.01
    said = judged_at(stamps, rows)
    assert set(said[~after]) == {""}
    assert all(each for each in said[after])


def test_a_state_with_the_stamp_of_one_that_was_refused_is_not_looked_at():
    """A controller that sends each period twice: the second has no time in which an axis could have moved."""
    track = JointTrack(load_machine("xyzac_trt"), 0, 0)
    axes = dict.fromkeys("XYZAC", 0.1)
    for number in range(400):
        stamp_ns = 10_000_000 * number
        for x in (0.2, 0.1) if number == 200 else (0.1,):
            track.push(stamp_ns, axes | {"X": x}, {"X": 0.0})
    assert track.checks.refused == {JUMP: 1}
    assert not track.doubt


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("velocities", ["left out", "zero"])
@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("seed", range(8))
def test_axes_that_were_frozen_where_they_are_slow_are_believed_again(seed, rate, velocities, wrapped):
    """They may stand there, so nothing is said; where they are afterwards no axis gets at once: all was refused."""
    draw = np.random.default_rng([seed, int(rate)])
    some = draw.permutation(len(MACHINE.axes))[: draw.integers(1, 4)].tolist()
    some = [*some, 4] if wrapped and 4 not in some else some
    stamps = np.arange(-1.5, 6.0, 1.0 / rate) + draw.uniform(0.0, 1.0 / rate)
    rows = np.zeros((len(stamps), len(MACHINE.axes)))
    long = draw.uniform(0.3, 1.2)
    frozen = (stamps > 0.0) & (stamps <= long)
    for axis in some:
        described = MACHINE.axes[axis]
        pace = draw.uniform(0.5, 1.2)  # rad/s of a swing that turns back where it begins to be frozen
        most = 0.4 * min(np.ptp(described.travel) / 2, described.fastest / pace, described.quickest / pace**2)
        rows[:, axis] = most * np.cos(pace * (stamps - draw.uniform(-0.05, 0.0)))
    if wrapped:  # a table that is told modulo a turn, and goes over its end while it is frozen
        half = 0.5 * (rows[stamps <= 0.0, 4][-1] + rows[stamps > long, 4][0])
        rows[:, 4] = np.mod(rows[:, 4] - half, 2 * np.pi) - np.pi
    rows[frozen] = rows[stamps <= 0.0][-1]
    checks = JointChecks(MACHINE)
    speeds = SPEEDS if velocities == "zero" else {}
    said = np.array([checks.judge(round(t * 1e9), row, speeds) for t, row in zip(stamps.tolist(), rows, strict=True)])
    assert set(said[stamps <= 0.0]) == {""}
    assert set(said[stamps > long + 0.5]) == {""}


@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("seed", range(8))
def test_an_axis_that_stood_and_is_set_elsewhere_stays_refused(seed, rate):
    """Also where it moves on from there a while later, as the controller goes on from what it was set to."""
    draw = np.random.default_rng([seed, int(rate), 1])
    axis = int(draw.integers(len(MACHINE.axes)))
    described = MACHINE.axes[axis]
    stamps = np.arange(-2.0, 6.0, 1.0 / rate)
    pace = draw.uniform(0.5, 1.2)
    most = 0.3 * min(np.ptp(described.travel) / 2, described.fastest / pace, described.quickest / pace**2)
    swings = np.maximum(np.maximum(-1.0 - stamps, 0.0), np.maximum(stamps - draw.uniform(0.3, 2.0), 0.0))
    places = most * (1.0 - np.cos(pace * swings)) / 2
    offset = draw.choice([-1, 1]) * draw.uniform(2.0, 6.0) * described.fastest * max(1.0 / rate, 0.01)
    said = told(axis, stamps, places + np.where(stamps > 0.0, offset, 0.0), {})
    assert set(said[stamps <= 0.0]) == {""}
    assert all(JUMP in each for each in said[stamps > 0.0])


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("size", [1.5e-3, 3e-3, 5e-3, 0.05])
@pytest.mark.parametrize("seed", range(3))
def test_an_axis_that_jumps_to_and_fro_is_not_believed_by_turns(seed, size, every):
    """It was as soon as the time since it was right allowed for the jump: up to 0.6 s at a time, 12 deviations off."""
    draw = np.random.default_rng([seed, every])
    rows = smooth(700)
    rows[:, 0] *= 0.5
    wrong = np.zeros(len(rows), bool)
    wrong[200:400] = np.arange(200) % every == 0
    rows[wrong, 0] += draw.choice([-1, 1]) * size
    _, said = judged(rows)
    said = np.array(said)
    assert set(said[:200]) == {""}
    believed = np.flatnonzero(wrong & (said == ""))
    assert len(believed) <= 4, believed
    assert set(said[400 + 100 :]) == {""}
