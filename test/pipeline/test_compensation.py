"""The compensator: offsets of the model at the true positions, and what it does when inputs fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pushed_inputs import push_error_motion, push_joint_state

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.limits import CorrectionOutcome
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import CompensationSettings, Compensator, InputsUsed
from rotary_error_monitor.pipeline.joints import unpack_directions

MACHINE = load_machine("xyzac_trt")
MODEL = arrange_machine(MACHINE)
START = 1_763_700_000_000_000_000
MILLISECOND = 1_000_000


def position(letter, t):
    return {
        "X": 0.05 * np.sin(0.8 * t),
        "Y": 0.03 * t,
        "Z": -0.02 * t + 0.1,
        "A": 0.4 + 0.2 * np.sin(0.5 * t),
        "C": 1.5 * t,
    }[letter]


def motion_block(first_ms, count=5, observable=0b111011, command=lambda t: 1.5 * t):
    times = START + (first_ms + np.arange(count)) * MILLISECOND + MILLISECOND // 2
    t = (times - START) * 1e-9
    motion = replace(ErrorMotion.unknown(count), theta=command(t) + 8e-6, times_ns=times)
    for place, value in {0: 3e-6 * np.cos(t), 1: -2e-6, 3: 1e-5 * np.sin(t), 4: 2e-5, 5: 8e-6}.items():
        if observable >> place & 1:
            motion.components[:, place], motion.observable[:, place] = value, True
    motion.covariance[:] = np.diag([1e-14, 2e-14, 0.0, 1e-13, 1e-13, 1e-13])
    return motion


def joint_state(ms, **moved):
    t = ms * 1e-3
    positions = {letter: float(position(letter, t)) for letter in "XYZAC"} | moved
    return START + ms * MILLISECOND, positions, dict.fromkeys(positions, 0.0)


def run(compensator, until_ms=400, *, joints=lambda ms: True, joint_delay_ms=2, blocks=motion_block, warmth=20.0):
    """Blocks of 5 ms and joint states of 10 ms as they would arrive."""
    offsets, corrections = [], []
    if warmth is not None:
        for before in (1_000_000_000, 0):  # the first is not certain before another one has confirmed it
            compensator.push_temperature(warmth, START - before)
    for ms in range(0, until_ms, 5):
        found = push_error_motion(compensator, blocks(ms))
        offsets += found.offsets
        corrections += found.corrections
        due = ms - joint_delay_ms + 5
        stamp = due - due % 10
        if due % 10 < 5 and stamp >= 0 and joints(stamp):
            found = push_joint_state(compensator, *joint_state(stamp))
            offsets += found.offsets
            corrections += found.corrections
    return offsets, corrections


def joined(offsets):
    times = np.concatenate([block.times_ns for block in offsets])
    return times, np.concatenate([block.rows[:, 1:] for block in offsets])


def expected_offset(times, **live):
    t = (times - START) * 1e-9
    q = np.stack([position(letter, t) for letter in MACHINE.letters], axis=1)
    direction = np.sign(
        np.stack([position(letter, t) - position(letter, t - 0.03) for letter in MACHINE.letters], axis=1)
    )
    monitored = np.stack(
        [3e-6 * np.cos(t), -2e-6 + 0 * t, np.nan + 0 * t, 1e-5 * np.sin(t), 2e-5 + 0 * t, 8e-6 + 0 * t], axis=1
    )
    return predict_tool_offset(MODEL, q, direction=direction, monitored=monitored, **live)


def test_offsets_are_those_of_the_model_at_the_true_positions():
    compensator = Compensator(MACHINE)
    times, rows = joined(run(compensator)[0])
    late = (times - START) * 1e-9 > 0.1
    assert late.sum() > 280
    # extrapolating 40 ms of this motion errs by 0.1 mm, which errors of 10 µrad turn into nanometres
    np.testing.assert_allclose(rows[late, :6], expected_offset(times[late]), atol=3e-9)
    assert compensator.hold == ""


def test_offsets_come_with_the_error_motion_and_do_not_wait_for_the_next_joint_state():
    compensator = Compensator(MACHINE)
    run(compensator, 200)
    found = push_error_motion(compensator, motion_block(200))
    assert [len(block.rows) for block in found.offsets] == [5]


def test_what_an_offset_rests_on_stands_in_columns_of_its_own():
    """They are filled by their order in the wire contract, which another order would make one another's."""
    block = run(Compensator(MACHINE), warmth=23.5)[0][-1]
    expected = expected_offset(block.times_ns, temperature=23.5)
    for place, name in enumerate("xyzabc"):
        np.testing.assert_allclose(block.column(name), expected[:, place], atol=3e-9)
    assert (block.column("temperature") == 23.5).all()
    assert ((block.column("joint_age") > 0.0) & (block.column("joint_age") < 0.1)).all()
    t = (block.times_ns - START) * 1e-9
    moved = [np.sign(position(letter, t) - position(letter, t - 0.03)) for letter in MACHINE.letters]
    np.testing.assert_array_equal(unpack_directions(block.column("directions"), len(moved)), np.stack(moved, axis=1))


def test_corrections_null_the_offset_and_say_what_remains():
    _, corrections = run(Compensator(MACHINE))
    assert len(corrections) > 30
    for correction in corrections[10:]:
        assert correction.outcome == CorrectionOutcome.FOLLOWED
        assert correction.direction_spanned
    reports = [correction.report for correction in corrections[10:] if correction.report is not None]
    assert len(reports) == len(corrections[10:]) // 5, "one each 50 ms"
    for report in reports:
        assert np.abs(report.remaining[:3]).max() <= 1e-9
        assert np.abs(report.offset[:3]).max() > 1e-6
        assert (np.diag(report.covariance)[:3] > 0).all()
        assert np.isfinite(report.covariance).all()
    spacing = np.diff([correction.stamp_ns for correction in corrections])
    assert (spacing == 10 * MILLISECOND).all()
    moved = np.diff([c.values for c in corrections], axis=0) / 0.010
    np.testing.assert_allclose([c.rates for c in corrections][1:], moved, atol=1e-12)


@pytest.mark.parametrize("delay", [0, 7, 14, 19])
def test_bits_do_not_depend_on_when_joint_states_arrive(delay):
    reference = joined(run(Compensator(MACHINE), joint_delay_ms=2)[0])
    other = joined(run(Compensator(MACHINE), joint_delay_ms=delay)[0])
    common = np.intersect1d(reference[0], other[0])
    assert len(common) > 320
    np.testing.assert_array_equal(reference[1][np.isin(reference[0], common)], other[1][np.isin(other[0], common)])


def test_when_joint_states_stop_it_holds_and_says_so():
    compensator = Compensator(MACHINE, CompensationSettings(age_limit_ns=60 * MILLISECOND))
    offsets, corrections = run(compensator, 600, joints=lambda ms: ms < 200)
    last = (joined(offsets)[0][-1] - START) * 1e-9
    assert last < 0.19 + 0.06 + 0.001
    assert "joint states" in compensator.hold
    assert "limit 0.06 s" in compensator.hold
    assert compensator.held > 100
    assert (corrections[-1].stamp_ns - START) * 1e-9 <= last
    again = push_joint_state(compensator, *joint_state(600))
    assert again.offsets == ()
    for ms in (610, 620, 630, 640):
        push_joint_state(compensator, *joint_state(ms))
    assert push_error_motion(compensator, motion_block(650)).offsets
    assert compensator.hold == ""


def test_without_any_joint_state_nothing_is_computed():
    compensator = Compensator(MACHINE)
    offsets, corrections = run(compensator, joints=lambda ms: False)
    assert (offsets, corrections) == ([], [])
    assert "no joint states" in compensator.hold


def test_an_encoder_that_contradicts_the_joint_states_is_not_believed():
    compensator = Compensator(MACHINE)
    offsets, _ = run(compensator, blocks=lambda ms: motion_block(ms, command=lambda t: 1.5 * t + np.radians(10)))
    assert offsets == []
    assert "axis C stands at" in compensator.hold
    assert "set the encoder's zero" in compensator.hold


def test_an_encoder_some_turns_away_agrees():
    compensator = Compensator(MACHINE)
    offsets, _ = run(compensator, blocks=lambda ms: motion_block(ms, command=lambda t: 1.5 * t + 6 * np.pi))
    assert offsets


def test_unobservable_components_come_from_the_description():
    t = np.array([0.2505])
    compensator = Compensator(MACHINE)
    times, rows = joined(run(compensator, blocks=lambda ms: motion_block(ms, observable=0))[0])
    row = rows[times == START + 250_500_000]
    q = np.array([[position(letter, t[0]) for letter in MACHINE.letters]])
    q[0, MACHINE.letters.index("C")] = 1.5 * t[0] + 8e-6
    direction = np.array([[1, 1, -1, 1, 1]])
    assert MACHINE.letters == ("X", "Y", "Z", "A", "C")
    np.testing.assert_allclose(row[0, :6], predict_tool_offset(MODEL, q, direction=direction)[0], atol=3e-9)


def test_height_and_azimuth_of_the_ring_are_carried_to_the_body():
    settings = CompensationSettings(ring_height=0.04, ring_azimuth=np.pi / 2)
    times, rows = joined(run(Compensator(MACHINE, settings))[0])
    t = (times - START) * 1e-9
    q = np.stack([position(letter, t) for letter in MACHINE.letters], axis=1)
    exc, eyc = 3e-6 * np.cos(t) + 0.04 * 2e-5, -2e-6 - 0.04 * 1e-5 * np.sin(t)
    eac, ebc = 1e-5 * np.sin(t), 2e-5 + 0 * t
    monitored = np.stack([-eyc, exc, np.nan + 0 * t, -ebc, eac, 8e-6 + 0 * t], axis=1)
    direction = np.tile([1, 1, -1, 1, 1], (len(t), 1))
    late = t > 0.1
    expected = predict_tool_offset(MODEL, q[late], direction=direction[late], monitored=monitored[late])
    np.testing.assert_allclose(rows[late, :6], expected, atol=3e-9)


def test_an_error_limit_latches_until_reset():
    settings = CompensationSettings(linear_limits=(1e-6, 2e-6, 1.0))
    compensator = Compensator(MACHINE, settings)
    offsets, corrections = run(compensator)
    assert compensator.state.latched
    assert "beyond the error limit" in compensator.state.reason
    assert corrections == []  # what would be applied is held, what is measured goes on
    assert len(offsets) > 50
    compensator.reset()
    assert not compensator.state.latched


def test_a_warning_limit_warns_and_a_rate_limit_slows():
    warned = run(Compensator(MACHINE, CompensationSettings(linear_limits=(1e-9, 1e-3, 1.0))))[1]
    assert {correction.outcome for correction in warned[5:]} == {CorrectionOutcome.WARNING}
    slow = run(Compensator(MACHINE, CompensationSettings(linear_limits=(1e-4, 5e-4, 1e-5))))[1]
    assert slow[3].outcome == CorrectionOutcome.RATE_LIMITED
    assert np.abs(np.diff([c.values[:3] for c in slow], axis=0)).max() <= 1e-5 * 0.010 * (1 + 1e-9)
    assert max(np.abs(each.report.remaining[:3]).max() for each in slow[:5] if each.report) > 1e-7


def test_temperature_moves_the_scales():
    warm = Compensator(MACHINE)
    times, rows = joined(run(warm, warmth=26.0)[0])
    late = (times - START) * 1e-9 > 0.1
    np.testing.assert_allclose(rows[late, :6], expected_offset(times[late], temperature=26.0), atol=3e-9)
    assert (rows[:, 8] == 26.0).all()
    for number, wrong in enumerate((float("nan"), 100.0, -300.0, 18.0)):
        warm.push_temperature(wrong)
        found = push_error_motion(warm, motion_block(400 + 5 * number))
        assert (found.offsets[0].rows[:, -1] == 26.0).all()
        assert "temperature not believed" in "; ".join(warm.remarks)


def test_error_motion_that_came_before_is_refused():
    compensator = Compensator(MACHINE)
    run(compensator, 200)
    again = push_error_motion(compensator, motion_block(197))
    assert compensator.late == 3
    assert [len(block.rows) for block in again.offsets] == [2]
    assert push_error_motion(compensator, motion_block(100)).offsets == ()
    assert compensator.late == 8


def test_a_replay_repeats_the_inputs_of_the_live_run():
    """Live, one joint state was lost on its way; the bag holds it, yet the replay repeats the live choice."""
    live_times, live_rows = joined(run(Compensator(MACHINE), joints=lambda ms: ms != 200)[0])
    decisions = {
        int(time): InputsUsed(int(time) - round(row[6] * 1e9), float(row[7]), float(row[8]))
        for time, row in zip(live_times, live_rows, strict=True)
    }
    times, rows = joined(run(Compensator(MACHINE, decisions=decisions), joints=lambda ms: True)[0])
    np.testing.assert_array_equal(times, live_times)
    before = live_times < START + 240 * MILLISECOND
    np.testing.assert_array_equal(rows[before], live_rows[before])
    np.testing.assert_array_equal(rows[:, 6:], live_rows[:, 6:])


def test_a_joint_state_without_an_axis_is_refused():
    stamp, positions, velocities = joint_state(0)
    del positions["Y"]
    with pytest.raises(InputError, match="lacks axis Y"):
        push_joint_state(Compensator(MACHINE), stamp, positions, velocities)


@pytest.mark.parametrize("behind", [5, 35, 120], ids="{} ms behind".format)
def test_live_corrections_come_back_after_those_of_the_description_alone(behind):
    """Error motion comes later than joint states of the same time do, over a network most of all."""
    compensator = Compensator(MACHINE, CompensationSettings(hold_limit_ns=500 * MILLISECOND))
    compensator.push_temperature(20.0, START)
    silent = range(1000, 2000)
    corrections = []
    for ms in range(0, 3000, 5):
        if ms % 10 == 0:
            corrections += push_joint_state(compensator, *joint_state(ms)).corrections
        if ms >= behind and (ms - behind) not in silent:
            corrections += push_error_motion(compensator, motion_block(ms - behind - 5)).corrections
    stamps = np.array([correction.stamp_ns for correction in corrections])
    assert (np.diff(stamps) > 0).all(), "a controller refuses what is older than what it had"
    described = np.array([correction.described for correction in corrections])
    ms = (stamps - START) / MILLISECOND
    assert described[(ms > 1700) & (ms < 2000)].all()
    assert described.sum() > 20
    late = ms > 2000 + 2 * behind + 20
    assert late.sum() > 60
    assert not described[late].any(), f"still from the description {ms[described].max() - 2000:.0f} ms after"
    assert compensator.holding.since_ns is None
