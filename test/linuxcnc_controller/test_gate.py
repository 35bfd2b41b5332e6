"""A correction message is believed as a whole or not at all, and each refusal says why."""

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from faults.documenting import Row, shows
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.gate import (
    AcceptedCorrection,
    CorrectionGate,
    CorrectionMessage,
    GateLimits,
    RefusalError,
    RefusalReason,
)

AXES = ("X", "Y", "Z", "A", "C")
LARGEST = (5e-4, 5e-4, 5e-4, 5e-3, 5e-3)
LIMITS = GateLimits(AXES, LARGEST, AXES)
NOW = 1_800_000_000_000_000_000
MS, HOUR, DAY = 10**6, 3600 * 10**9, 86400 * 10**9
GOOD = (1e-6, -2e-6, 3e-6, 4e-5, -5e-5)


def message(names=AXES, positions=GOOD, age_ns=20 * MS, velocities=()):
    return CorrectionMessage(NOW - age_ns, names, positions, velocities)


def test_a_whole_message_is_believed_in_the_order_of_the_controller():
    gate = CorrectionGate(LIMITS)
    assert gate.judge(message(), NOW) == AcceptedCorrection(NOW - 20 * MS, GOOD)
    turned = message(AXES[::-1], GOOD[::-1], 10 * MS, (0.0,) * 5)
    assert gate.judge(turned, NOW) == AcceptedCorrection(NOW - 10 * MS, GOOD)


def test_axes_that_are_not_corrected_get_none():
    gate = CorrectionGate(GateLimits(AXES, LARGEST, ("Z", "X")))
    assert gate.judge(message("XZ", (1e-6, 2e-6)), NOW).positions == (1e-6, 0.0, 2e-6, 0.0, 0.0)
    with pytest.raises(RefusalError, match="expected each of Z X once: not corrected here Y"):
        gate.judge(message("XYZ", (0.0, 0.0, 0.0)), NOW)


def change(index, value):
    return GOOD[:index] + (value,) + GOOD[index + 1 :]


FAULTS = [
    ("X alone", message("X", (1e-6,)), RefusalReason.AXES, "corrections of the axes X; .* missing Y Z A C$"),
    ("empty", message((), ()), RefusalReason.AXES, r"corrections of the axes \(none\); .* missing X Y Z A C$"),
    ("X twice", message(("X", *AXES), (3e-4, *GOOD)), RefusalReason.AXES, r"twice X$"),
    ("X for Y", message("XXZAC", GOOD), RefusalReason.AXES, "twice X, missing Y$"),
    ("another axis", message("XYZAB", GOOD), RefusalReason.AXES, "not corrected here B, missing C$"),
    ("lower case", message("xyzac", GOOD), RefusalReason.AXES, "not corrected here x y z a c, missing X Y Z A C$"),
    ("no names", message((), GOOD), RefusalReason.AXES, "missing X Y Z A C$"),
    ("no positions", message(AXES, ()), RefusalReason.NUMBERS, "5 names, 0 positions, 0 velocities; expected as many"),
    ("one position less", message(AXES, GOOD[:4]), RefusalReason.NUMBERS, "5 names, 4 positions"),
    ("one position more", message(AXES, (*GOOD, 0.0)), RefusalReason.NUMBERS, "5 names, 6 positions"),
    ("one velocity", message(velocities=(0.0,)), RefusalReason.NUMBERS, "5 positions, 1 velocities"),
    (
        "NaN",
        message(AXES, change(2, math.nan)),
        RefusalReason.NUMBERS,
        "correction of Z is nan; expected a finite number",
    ),
    ("infinite", message(AXES, change(4, -math.inf)), RefusalReason.NUMBERS, "correction of C is -inf"),
    ("NaN rate", message(velocities=change(1, math.nan)), RefusalReason.NUMBERS, "rate of Y is nan"),
    (
        "1e300",
        message(AXES, change(0, 1e300)),
        RefusalReason.SIZE,
        r"correction of X is 1e\+300; expected at most 0\.0005",
    ),
    (
        "mm for m",
        message(AXES, change(1, -2e-3)),
        RefusalReason.SIZE,
        r"correction of Y is -0\.002; expected at most 0\.0005",
    ),
    (
        "degrees",
        message(AXES, change(3, 6e-3)),
        RefusalReason.SIZE,
        r"correction of A is 0\.006; expected at most 0\.005",
    ),
    ("no stamp", CorrectionMessage(0, AXES, GOOD), RefusalReason.STAMP, "without a stamp"),
    ("of 1969", CorrectionMessage(-5, AXES, GOOD), RefusalReason.STAMP, "without a stamp"),
    ("old", message(age_ns=101 * MS), RefusalReason.AGE, r"correction is 0\.101 s old; expected at most 0\.1 s"),
    ("an hour old", message(age_ns=HOUR), RefusalReason.AGE, r"correction is 3\.6e\+03 s old"),
    (
        "10 ms ahead",
        message(age_ns=-10 * MS),
        RefusalReason.AHEAD,
        r"0\.01 s ahead of the clock; expected at most 0\.005 s",
    ),
    ("1 h ahead", message(age_ns=-HOUR), RefusalReason.AHEAD, r"3\.6e\+03 s ahead"),
    ("365 days ahead", message(age_ns=-365 * DAY), RefusalReason.AHEAD, r"3\.15e\+07 s ahead"),
    ("repeated", message(age_ns=50 * MS), RefusalReason.ORDER, "0 s before the last one believed"),
    ("falling", message(age_ns=60 * MS), RefusalReason.ORDER, r"0\.01 s before the last one believed"),
]


@pytest.mark.parametrize(("wrong", "doubt", "reason"), [fault[1:] for fault in FAULTS], ids=[f[0] for f in FAULTS])
def test_a_wrong_message_is_refused_with_its_reason_and_the_next_right_one_is_believed(wrong, doubt, reason):
    gate = CorrectionGate(LIMITS)
    gate.judge(message(age_ns=50 * MS), NOW)
    for _ in range(3):
        with pytest.raises(RefusalError, match=reason) as caught:
            gate.judge(wrong, NOW)
        assert caught.value.doubt is doubt
    assert gate.judge(message(age_ns=49 * MS), NOW).positions == GOOD


@pytest.mark.parametrize(
    "frame", ["", "workpiece", "Base", "base/", "x" * 10_000], ids=lambda frame: frame[:9] or "none"
)
def test_corrections_in_another_frame_are_refused_and_both_are_named(frame):
    gate = CorrectionGate(replace(LIMITS, frame="base"))
    with pytest.raises(RefusalError, match=f"in the frame '{frame[:90]}.*'; expected 'base'") as caught:
        gate.judge(replace(message(), frame=frame), NOW)
    assert caught.value.doubt is RefusalReason.FRAME and len(str(caught.value)) < 300
    assert gate.judge(replace(message(), frame="base"), NOW).positions == GOOD


SPEED = (2e-3, 2e-3, 2e-3, 2e-2, 2e-2)


def course(seed, seconds=4.0):
    """Corrections of five axes, 100 a second, by a sine each that stays within size and speed: stamps and positions."""
    draw = np.random.default_rng(seed)
    t, pace = np.arange(0.0, seconds, 0.01), draw.uniform(0.5, 5.0, 5)
    size = np.minimum(0.9 * np.array(LARGEST), 0.99 * np.array(SPEED) / pace) * draw.uniform(0.2, 1.0, 5)
    return NOW + np.rint(t * 1e9).astype(np.int64), size * np.sin(np.outer(t, pace) + draw.uniform(0, 6, 5))


def believed(stamps, positions):
    """Which of the messages are believed, as positions by their place."""
    gate, found = CorrectionGate(replace(LIMITS, speed=SPEED)), {}
    for place, (stamp, values) in enumerate(zip(stamps.tolist(), positions.tolist(), strict=True)):
        with suppress(RefusalError):
            found[place] = gate.judge(CorrectionMessage(stamp, AXES, values), stamp + 5 * MS).positions
    return found


@pytest.mark.parametrize("seed", range(20))
def test_corrections_within_the_speed_are_all_believed_however_many_are_lost(seed):
    stamps, positions = course(seed)
    kept = np.random.default_rng(seed).random(len(stamps)) < 0.6
    assert len(believed(stamps, positions)) == len(stamps)
    assert len(believed(stamps[kept], positions[kept])) == kept.sum()


@shows(
    Row(
        "corrections",
        "One axis of the corrections is in another unit, mm for m or degrees for rad, and passes zero",
        "`corrections` of the controller's node: the axis, its step and how fast it may change; `refused_step` counts",
        "the message before has to lead to it within the axis's speed limit, whatever its size",
        "the last correction that was believed is held",
        "with the second message in the right unit",
    )
)
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("axis", range(5))
def test_an_axis_in_another_unit_that_passes_zero_is_not_believed_there(seed, axis):
    """Its amplitude is a tenth of what it may be at least, so that it is far too large but about its zeros."""
    stamps, positions = course(seed)
    positions[:, axis] = 0.3 * LARGEST[axis] * np.sin(1.5e-9 * (stamps - NOW) + 0.4 + seed)
    wrong = slice(100, 300)
    told = positions.copy()
    told[wrong, axis] *= 1000.0 if axis < 3 else 57.3
    assert (np.abs(told[wrong, axis]) < LARGEST[axis]).any() or axis < 3
    found = believed(stamps, told)
    assert not set(range(*wrong.indices(len(told)))) & found.keys()
    assert set(range(302, len(told))) <= found.keys() and set(range(100)) <= found.keys()


def test_corrections_that_go_on_from_elsewhere_are_believed_from_the_second_on():
    """A compensation that was started anew and was not told what is in effect."""
    stamps, positions = course(1)
    positions[200:] = positions[200]
    positions[200:, 0] = positions[199, 0] - 3e-4
    found = believed(stamps, positions)
    assert 200 not in found and set(range(201, len(stamps))) <= found.keys()
    later = np.where(np.arange(len(stamps)) < 200, stamps, stamps + 500 * MS)  # after half a second of silence
    assert 200 in believed(later, positions)


def test_a_step_is_told_with_its_axis_and_the_speed():
    gate = CorrectionGate(replace(LIMITS, speed=SPEED))
    gate.judge(message(age_ns=50 * MS), NOW)
    with pytest.raises(
        RefusalError, match=r"correction of Z steps from 3e-06 to 0.0004 within 0.01 s; .* 0.002 a second"
    ):
        gate.judge(message(positions=change(2, 4e-4), age_ns=40 * MS), NOW)


numbers = st.floats(allow_nan=True, allow_infinity=True, width=64)
names = st.lists(st.one_of(st.sampled_from(AXES), st.text(max_size=3)), max_size=7)
stamps = st.one_of(st.integers(-(2**63), 2**63), st.integers(NOW - 200 * MS, NOW + 20 * MS))
small = st.lists(st.floats(-6e-4, 6e-4), min_size=5, max_size=5)


@given(st.lists(st.one_of(
    st.builds(CorrectionMessage, stamps, names, st.lists(numbers, max_size=7), st.lists(numbers, max_size=7)),
    st.builds(CorrectionMessage, stamps, st.permutations(AXES), small, st.just(())),
), max_size=30))  # fmt: skip
def test_whatever_comes_what_is_believed_is_whole_in_range_in_time_and_in_order(messages):
    gate, last_ns = CorrectionGate(LIMITS), None
    for each in messages:
        try:
            believed = gate.judge(each, NOW)
        except RefusalError as error:
            assert str(error)
            assert len(str(error)) < 1000
            continue
        assert sorted(each.names) == sorted(AXES)
        assert believed.positions == tuple(dict(zip(each.names, each.positions, strict=True))[name] for name in AXES)
        assert all(abs(value) <= largest for value, largest in zip(believed.positions, LARGEST, strict=True))
        assert NOW - 100 * MS <= believed.stamp_ns <= NOW + 5 * MS
        assert last_ns is None or believed.stamp_ns > last_ns
        last_ns = believed.stamp_ns


@pytest.mark.parametrize("step_ns", [-HOUR, -50 * MS, HOUR, 365 * DAY])
def test_a_clock_that_is_set_costs_no_more_than_the_age_of_a_correction(step_ns):
    """Both the controller's clock and the stamps, which follow it by 30 ms, are set at once."""
    gate, period = CorrectionGate(LIMITS), 10 * MS
    believed = []
    for index in range(40):
        now_ns = NOW + index * period + (step_ns if index >= 20 else 0)
        stamp_ns = now_ns - 30 * MS if index < 20 or index > 22 else NOW + index * period - 30 * MS
        try:
            gate.judge(CorrectionMessage(stamp_ns, AXES, GOOD), now_ns)
            believed.append(index)
        except RefusalError:
            continue
    assert set(range(20)) <= set(believed)
    assert set(range(30, 40)) <= set(believed)


def test_a_million_names_are_refused_at_once_and_in_short():
    with pytest.raises(RefusalError) as caught:
        CorrectionGate(LIMITS).judge(message(["X" * 10_000] * 1_000_000, [0.0] * 1_000_000), NOW)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("wrong", ["X\n[ERROR] fake", "\r\x1b[2KX", "\u2028X", "\x85", "\ud800"])
def test_a_name_cannot_forge_a_line_of_the_log(wrong):
    with pytest.raises(RefusalError) as refused:
        CorrectionGate(LIMITS).judge(message((wrong, *AXES[1:])), NOW)
    assert str(refused.value).isprintable()
    assert f"corrections of the axes {repr(wrong)[1:-1]} Y Z A C; expected" in str(refused.value)


@pytest.mark.parametrize("corrected", ["", "B", "XX", "XQ"])
def test_axes_that_the_controller_has_not_cannot_be_corrected(corrected):
    with pytest.raises(
        InputError, match=r"corrected axes '.*'; expected some of the controller's X Y Z A C, each once"
    ):
        GateLimits(AXES, LARGEST, tuple(corrected))


def test_as_many_limits_as_axes_are_needed():
    with pytest.raises(InputError, match="4 largest corrections for the axes X Y Z A C"):
        GateLimits(AXES, LARGEST[:4], AXES)
