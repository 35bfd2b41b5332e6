"""Courses keep their limits whatever is asked, arrive, and do not overshoot a target that stands still."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.shaping import LONGEST_STEP, CourseLimits, ShapedCourse

LARGEST, SPEED = 5e-4, 2e-3
LOOK_NS = 4_000_000
LONGEST_NS = round(LONGEST_STEP * 1e9)
ROUNDING = 1e-6

accelerations = st.floats(1e-3, 1.0)
shares = st.floats(-1.0, 1.0)
intervals = st.one_of(st.just(LOOK_NS), st.integers(200_000, LONGEST_NS))
targets = st.one_of(st.none(), st.none(), st.just("halt"), shares, st.sampled_from([-1.0, 0.0, 1.0]))
histories = st.lists(st.tuples(intervals, targets), min_size=3, max_size=150)


def make(acceleration, start=0.0):
    return ShapedCourse(CourseLimits((LARGEST,), (SPEED,), (acceleration,)), (start,))


def ask(course, target):
    if target == "halt":
        course.halt()
    elif target is not None:
        course.aim((target * LARGEST,))


def follow(course, history):
    """Positions at each step, and the times between them, s."""
    now_ns, positions, steps = 0, [course.advance(0)[0]], []
    for interval_ns, target in history:
        ask(course, target)
        now_ns += interval_ns
        positions.append(course.advance(now_ns)[0])
        steps.append(interval_ns * 1e-9)
    return positions, steps, now_ns


@settings(max_examples=300, deadline=None)
@given(accelerations, shares, histories)
def test_size_speed_and_acceleration_keep_their_limits_whatever_is_asked(acceleration, start, history):
    positions, steps, _ = follow(make(acceleration, start * LARGEST), history)
    speeds = np.diff(positions) / steps
    changes = np.diff(speeds) / (np.add(steps[1:], steps[:-1]) / 2)
    assert np.abs(positions).max() <= LARGEST * (1 + ROUNDING)
    assert np.abs(speeds).max() <= SPEED * (1 + ROUNDING)
    assert np.abs(changes).max() <= acceleration * (1 + ROUNDING)


@settings(max_examples=200, deadline=None)
@given(accelerations, histories, shares)
def test_it_arrives_and_stays(acceleration, history, last):
    course = make(acceleration)
    _, _, now_ns = follow(course, history)
    course.aim((last * LARGEST,))
    # Turn round at worst, the way at full speed, and once more the time to get there and back from it.
    enough = 2 * LARGEST / SPEED + 4 * SPEED / acceleration
    for index in range(math.ceil(enough * 1e9 / LOOK_NS) + 1):
        course.advance(now_ns + (index + 1) * LOOK_NS)
    assert (course.positions, course.velocities, course.to_go) == ((last * LARGEST,), (0.0,), (0.0,))


@settings(max_examples=200, deadline=None)
@given(accelerations, histories, shares, st.lists(intervals, min_size=1, max_size=150))
def test_a_target_that_stands_is_overshot_by_no_more_than_the_way_to_brake(acceleration, history, last, steps):
    course = make(acceleration)
    _, _, now_ns = follow(course, history)
    course.aim((last * LARGEST,))
    distance, speed = course.to_go[0], course.velocities[0]
    braking = speed * abs(speed) / (2 * acceleration)
    low, high = sorted((0.0, distance))
    low, high = min(low, braking), max(high, braking)
    begin = course.positions[0]
    for step_ns in steps:
        now_ns += step_ns
        moved = course.advance(now_ns)[0] - begin
        assert low - 1e-15 <= moved <= high + 1e-15


@settings(max_examples=200, deadline=None)
@given(accelerations, shares, shares, st.lists(intervals, min_size=2, max_size=150))
@example(0.001, 8e-06, 0.0, [4_000_000, 4_000_000])
def test_from_rest_it_goes_straight_to_its_target(acceleration, start, end, steps):
    course = make(acceleration, start * LARGEST)
    course.aim((end * LARGEST,))
    positions, _, _ = follow(course, [(step_ns, None) for step_ns in steps])
    assert positions == sorted(positions, reverse=end < start)
    assert min(start, end) * LARGEST <= min(positions)
    assert max(positions) <= max(start, end) * LARGEST


@given(accelerations, histories)
def test_a_halt_takes_the_shortest_way_and_holds(acceleration, history):
    course = make(acceleration)
    _, _, now_ns = follow(course, history)
    begin, speed = course.positions[0], course.velocities[0]
    course.halt()
    for index in range(math.ceil(SPEED / acceleration * 1e9 / LOOK_NS) + 1):
        course.advance(now_ns + (index + 1) * LOOK_NS)
    assert course.positions[0] - begin == pytest.approx(speed * abs(speed) / (2 * acceleration), abs=1e-15)
    assert course.velocities == (0.0,)


@given(accelerations, st.integers(LONGEST_NS + 1, 10**13), shares)
def test_a_pause_allows_no_jump(acceleration, pause_ns, last):
    course = make(acceleration)
    course.aim((LARGEST,))
    _, _, now_ns = follow(course, [(LOOK_NS, None)] * 20)
    before = course.positions[0]
    course.aim((last * LARGEST,))
    after = course.advance(now_ns + pause_ns)[0]
    assert abs(after - before) <= acceleration * LONGEST_STEP**2 / 2 * (1 + ROUNDING)


@given(histories, st.integers(0, 10**13))
def test_a_clock_that_stands_or_falls_moves_nothing(history, back_ns):
    course = make(0.05)
    _, _, now_ns = follow(course, history)
    before = course.positions
    course.aim((LARGEST,))
    assert course.advance(now_ns - back_ns) == before


def test_axes_have_limits_of_their_own():
    course = ShapedCourse(CourseLimits((1e-3, 1e-2), (1e-3, 1e-2), (0.1, 0.2)), (0.0, 0.0))
    course.aim((1e-3, -1e-2))
    for index in range(51):
        course.advance(index * LOOK_NS)
    assert course.velocities == pytest.approx((1e-3, -1e-2))
    assert course.slowed
    assert course.to_go == pytest.approx((1e-3 - 1e-3 * (0.2 - 0.005), -1e-2 + 1e-2 * (0.2 - 0.025)))
    course.rebase((0.0, 0.0))
    assert course.velocities == pytest.approx((1e-3, -1e-2))
    assert course.to_go == (1e-3, -1e-2)


def test_axes_left_beyond_the_limits_come_back_within_them():
    course = make(0.05, 3 * LARGEST)
    course.aim((LARGEST,))
    positions, _, _ = follow(course, [(LOOK_NS, None)] * 200)
    assert positions == sorted(positions, reverse=True)
    assert course.positions == (LARGEST,)


@pytest.mark.parametrize("target", [(math.nan,), (math.inf,), (1.001 * LARGEST,), (), (0.0, 0.0)])
def test_a_wrong_target_is_refused_and_the_last_one_stays(target):
    course = make(0.05)
    course.aim((1e-6,))
    with pytest.raises(InputError, match="expected at most"):
        course.aim(target)
    assert course.to_go == (1e-6,)


@pytest.mark.parametrize(
    "limits", [((1.0,), (1.0,), ()), ((math.nan,), (1.0,), (1.0,)), ((1.0,), (0.0,), (1.0,)), ((1.0,), (1.0,), (-1.0,))]
)
def test_wrong_limits_are_refused(limits):
    with pytest.raises(InputError, match="expected"):
        CourseLimits(*limits)
