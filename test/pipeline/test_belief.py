"""What is believed of the inputs where nothing else tells: limits of the stage, stamps, and readings that repeat."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pipeline.test_estimation import AZIMUTHS, SPEED, STAGE, START, in_order, run, streams, true_motion
from pushed_inputs import push_block

from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.pipeline.evidence import COLUMNS, INDEX, EvidenceWindow, Means, Scatter
from rotary_error_monitor.pipeline.tilt_belief import TiltBelief
from rotary_error_monitor.signals.blocks import SampleBlock

COARSE = replace(STAGE, autocollimator=replace(STAGE.autocollimator, resolution=1.4e-6, noise=4e-7))
"""A stage whose autocollimator repeats a reading for many samples."""


def heads_only(*letters):
    """The stage with some of its heads."""
    return replace(STAGE, encoder=replace(STAGE.encoder, azimuths={each: AZIMUTHS[each] for each in letters}))


def changed(found, name, change):
    """The streams with the blocks of one changed."""
    return found | {name: [change(block) for block in found[name]]}


def late(seconds):
    """Stamps are later than the samples by so much."""
    return lambda block: SampleBlock(block.stamp_ns + round(seconds * 1e9), block.names, block.rows)


def spread(block, off, noise, gen):
    """Readings are off by so much, and noisy."""
    readings = block.rows[:, 1:]
    return SampleBlock(
        block.stamp_ns,
        block.names,
        np.column_stack([block.rows[:, 0], readings + off + gen.normal(0.0, noise, readings.shape)]),
    )


def window(number, reading, *, there=True, described=0.0, theta=0.0):
    mean = [0.0] * len(COLUMNS)
    mean[INDEX["theta"]] = theta
    for name in ("heads", "command", "radial", "head_samples", "tilt_samples"):
        mean[INDEX[name]] = 1.0
    mean[INDEX["tilt"]] = float(there)
    mean[INDEX["tilt_x"]], mean[INDEX["tilt_surplus_x"]] = reading, reading - described
    # a little of it in y, which would else be stuck
    mean[INDEX["tilt_y"]], mean[INDEX["tilt_surplus_y"]] = 1e-3 * reading, 1e-3 * (reading - described)
    mean[INDEX["tilt_variance"]] = STAGE.autocollimator.noise**2
    return EvidenceWindow(number, 0.01, 10, Means(*mean), Scatter(0.0, 0.0, 0.0), np.zeros(2), 63, True)


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 2), st.integers(1, 3)), max_size=60))
def test_a_tilt_that_comes_goes_and_repeats_is_judged(course):
    """Readings of few steps repeat by chance, also behind a silence."""
    belief, number = TiltBelief(STAGE), 0
    for there, reading, passed in course:
        number += passed
        belief.judge(window(number, 1e-7 * reading, there=there))
    for each in range(200):
        belief.judge(window(number + 1 + each, 5e-7))
    assert belief.doubt.startswith("stuck")


@pytest.mark.parametrize("pace", [1e-8, 1e-7])
def test_a_reading_that_repeats_is_as_uncertain_as_it_should_have_moved(pace):
    """It may be stuck, or within a step of its resolution: until one shows, both are."""
    belief = TiltBelief(COARSE)
    for number in range(100):
        belief.judge(window(number, 0.0, described=pace * number))
        if belief.doubt:
            break
        assert belief.scale * STAGE.autocollimator.noise >= pace * number
    assert number > 5
    right = pace * (number + 1)
    belief.judge(window(number + 1, right, described=right))
    assert belief.scale == 1.0


@pytest.mark.parametrize("dark", [150, 400, 1000])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_autocollimator_that_went_dark_is_believed_once_it_sees_again(sign, dark):
    """Its readings, which repeat by chance for some time, fade to zero no faster than the stage tilts, and stay."""
    coarse = replace(STAGE, autocollimator=replace(STAGE.autocollimator, resolution=2e-6, noise=4e-7))
    generator, belief, noise = np.random.default_rng(dark), TiltBelief(coarse), 1e-6
    fading = np.arange(1.0, 0.0, -0.2)
    mirror = sign * 0.9 * STAGE.limits.tilt_rate * 0.01 * len(fading)
    sees = 200 + len(fading)
    end = sees + dark
    doubts = []
    for number in range(end + 200):
        reading = mirror + noise * generator.normal()
        if 200 <= number < end:
            reading = mirror * fading[number - 200] if number < sees else 0.0
        belief.judge(window(number, reading, described=mirror))
        doubts.append(belief.doubt)
    assert not any(doubts[:200])
    assert doubts[end - 1].startswith("stuck")
    assert not any(doubts[end + 60 :]), "half a second of agreement, and a few windows"


@pytest.mark.parametrize("size", [4e-5, -8e-5])
def test_a_step_that_came_back_may_come_again(size):
    """What goes out before it shows is within six of the stated standard deviations, from the second on."""
    belief, gen = TiltBelief(STAGE), np.random.default_rng(1)

    def show(first, count, off):
        for number in range(first, first + count):
            belief.judge(window(number, off + gen.normal(0.0, 1e-7)))

    show(0, 20, 0.0)
    assert belief.scale < 1.5
    show(20, 3, size)
    assert "a step" in belief.doubt
    show(23, 60, 0.0)
    assert not belief.doubt
    assert 6 * belief.scale * STAGE.autocollimator.noise >= 0.99 * abs(size)
    show(83, 1100, 0.0)
    assert belief.scale < 1.5


@pytest.mark.parametrize("seconds", [0.01, -0.01])
def test_a_head_of_two_whose_stamps_are_off_makes_no_radial_error_motion(seconds):
    """It looks like a motion of half of what the rotor turns meanwhile: far more than this stage can do."""
    stage = heads_only("a", "b")
    found = changed({name: each for name, each in streams().items() if name[-1] not in "cd"}, "head_b", late(seconds))
    apart = SPEED * abs(seconds) * stage.encoder.disc_radius / 2
    assert apart > 10 * stage.limits.radial
    _, motion = run(in_order(found), stage=stage)
    said = motion.observable[:, 1] & (motion.times_ns > START + 100_000_000)
    assert not said.any()


@pytest.mark.parametrize("letters", ["abc", "abcd"])
@pytest.mark.parametrize("factor", [1.001, 3.0, 57.3, 3438.0, 206264.8])
def test_no_tick_shows_more_than_the_stage_can_do(factor, letters):
    """Also where the heads have not been judged yet, or agree by chance: all of them count in another unit."""
    stage = heads_only(*letters)
    estimator, seen = Estimator(stage), []
    for name, block in in_order(streams()):
        if name[-1] in letters or not name.startswith("head"):
            scale = factor if name.startswith("head") else 1.0
            scaled = SampleBlock(block.stamp_ns, block.names, block.rows * [1.0, *[scale] * (len(block.names) - 1)])
            for each in push_block(estimator, name, scaled):
                seen += np.hypot(*np.where(each.observable, each.components, 0.0)[:, :2].T).tolist()
    assert max(seen, default=0.0) <= stage.limits.radial * 1.1


def test_what_the_stamps_of_opposed_heads_may_be_off_by_is_stated():
    """It contradicts no other head: c late and d early by 3 µs shift the ring's centre by R ω 3 µs."""
    off = 3e-6
    found = changed(changed(streams(), "head_c", late(off)), "head_d", late(-off))
    _, motion = run(in_order(found), settings=EstimatorSettings(check_turns=0.0))
    t = (motion.times_ns - START) * 1e-9
    judged = t > 0.1
    truth = np.column_stack(true_motion(t)[1:3])
    error = np.abs(motion.components[:, :2] - truth)[judged].max(axis=0)
    assert error.max() == pytest.approx(STAGE.encoder.disc_radius * SPEED * off, rel=0.05)
    deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))[judged, :2]
    assert (error <= 6 * deviation).all()
    assert (deviation <= 2 * STAGE.encoder.disc_radius * SPEED * off).all()


@pytest.mark.parametrize("bias", [5e-6, 1e-5, 2e-5, 4e-5])
@pytest.mark.parametrize("gone", [(0.3, 0.38), (0.3, 9.0)], ids=["for a moment", "for good"])
def test_a_contradiction_outlives_the_head_that_showed_it(gone, bias):
    """Head c is off and nothing tells that it is c; without d nothing shows it, and it weighs more."""
    noise = 1e-5
    stage = replace(
        STAGE,
        encoder=replace(STAGE.encoder, noise=noise),
        stated_limits={"radial_rate": 2e-5},
        uncertainty={"encoder.timing": 0.0},
    )
    found, gen = streams(head_d={"drop": [gone]}), np.random.default_rng(1)
    for name in ("head_a", "head_b", "head_c", "head_d"):
        off = bias if name == "head_c" else 0.0
        found = changed(found, name, lambda each, off=off: spread(each, off, noise, gen))
    _, motion = run(in_order(found), stage=stage, settings=EstimatorSettings(check_turns=0.0))
    t = (motion.times_ns - START) * 1e-9
    judged = (t > 0.1) & motion.observable[:, 1]
    assert judged[(t > 0.3) & (t < 0.38)].any()
    truth = np.column_stack(true_motion(t)[1:3])
    deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))[:, :2]
    wrong = np.abs(motion.components[:, :2] - truth) > 6 * deviation
    assert wrong[judged].mean() <= 0.002


def rippled(t0, frequency, size):
    """What is shown has a ripple from a time on."""

    def change(block):
        t = (block.times_ns - START) * 1e-9
        ripple = size * np.sin(2 * np.pi * frequency * t) * (t > t0)
        return SampleBlock(
            block.stamp_ns, block.names, block.rows + np.outer(ripple, [0.0] + [1.0] * len(block.names[1:]))
        )

    return change


@pytest.mark.parametrize("frequency", [50.0, 100.0, 200.0])
@pytest.mark.parametrize(("name", "size", "component"), [("autocollimator", 8e-6, 3), ("command", 4e-5, 5)])
def test_a_ripple_in_step_with_the_windows_counts_as_noise(name, size, component, frequency):
    """Its mean over each window is zero; a tenth of a second after it begins its size is in the deviations."""
    _, motion = run(in_order(changed(streams(), name, rippled(0.3, frequency, size))))
    t = (motion.times_ns - START) * 1e-9
    judged = (t > 0.4) & motion.observable[:, component]
    truth = true_motion(t)[component] if component < 5 else 1e-5 * np.sin(2.0 * t)
    error = motion.components[:, component] - truth
    deviation = np.sqrt(motion.covariance[:, component, component])
    assert judged.any()
    assert (np.abs(error) > 6 * deviation)[judged].mean() <= 0.002


def test_a_reading_whose_last_digits_alone_move_is_stuck_after_a_turn():
    """Until then the uncertainty holds what the description has gone meanwhile."""
    belief, gen, windows = TiltBelief(STAGE), np.random.default_rng(1), 100  # of a turn
    near = STAGE.autocollimator.resolution + 6 * STAGE.autocollimator.noise
    for number in range(3 * windows):
        theta = 2 * np.pi * number / windows
        gone = 2e-5 * (1 - np.cos(theta))
        belief.judge(window(number, gen.normal(0.0, 1e-7), described=gone, theta=theta))
        if belief.doubt:
            break
        assert gone < near or 6 * belief.scale * STAGE.autocollimator.noise >= gone
    assert belief.doubt.startswith("stuck")
    assert windows <= number < 1.5 * windows


@pytest.mark.parametrize("phase", np.linspace(0, 2 * np.pi, 8, endpoint=False))
def test_a_reading_that_stands_at_a_turning_point_is_believed(phase):
    """A sound one: there the mirror goes against an error motion that nobody has described."""
    belief, gen = TiltBelief(STAGE), np.random.default_rng(1)
    for number in range(400):
        theta = 2 * np.pi * number / 200
        shown = 4e-5 * (1 - np.cos(theta - phase)) ** 2
        belief.judge(window(number, shown + gen.normal(0.0, 1e-7), described=1e-5 * np.sin(theta - phase), theta=theta))
        assert not belief.doubt


def test_a_reading_that_follows_its_description_is_never_stuck():
    belief, gen = TiltBelief(STAGE), np.random.default_rng(1)
    for number in range(2000):
        described = 5e-5 * np.sin(0.01 * number)
        belief.judge(window(number, described + gen.normal(0.0, 2e-7), described=described))
        assert not belief.doubt


def noisy(std):
    """A judge of an autocollimator with that noise, rad, and what makes a window of what it should show."""
    belief = TiltBelief(replace(STAGE, autocollimator=replace(STAGE.autocollimator, noise=std)))

    def judge(number, shown, gen, **described):
        seen = window(number, shown + std / np.sqrt(10) * gen.normal(), **described)
        belief.judge(seen._replace(mean=seen.mean._replace(tilt_variance=std**2)))
        return belief.doubt

    return judge


def test_a_wrong_sign_that_ended_is_not_held_against_it_between_two_looks_at_the_figure():
    """Where the figure shows it no more; by the last look of before, one fault in four went on for good."""
    ended = []
    for seed in range(40):
        gen, judge = np.random.default_rng(seed), noisy(5e-6)
        size, speed, phase = gen.uniform(1e-4, 2e-4), gen.uniform(0.003, 0.03), gen.uniform(0.0, 2 * np.pi)
        begin, end = 100, 100 + int(gen.integers(60, 100))
        doubts = []
        for number in range(end + 100):
            theta = phase + speed * number
            shown = size * np.cos(theta)
            wrong = -1.0 if begin <= number < end else 1.0
            doubts.append(judge(number, wrong * shown, gen, described=shown, theta=theta))
        if doubts[end - 1]:
            ended.append(not doubts[-1])
    assert len(ended) > 15
    assert np.mean(ended) >= 0.95


def test_what_went_beyond_the_limit_unseen_is_believed_once_it_is_where_it_was_most_of_the_time():
    """It was wrong already just before it was told, and steps back within its noise."""
    for seed in range(20):
        gen = np.random.default_rng(seed)
        judge, off = noisy(gen.uniform(1e-4, 3e-4)), gen.uniform(2.0, 2.6) * STAGE.limits.tilt
        rise, end = int(gen.integers(10, 30)), 300 + int(gen.integers(40, 120))
        doubts = [
            judge(number, off * min(1.0, (number - 300) / rise) if 300 <= number < end else 0.0, gen)
            for number in range(end + 100)
        ]
        assert "the stage tilts by" in doubts[end - 1]
        assert not doubts[-1]
