"""Whether rotation and command belong together, of drives in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from world import random_stage

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.pipeline.command_belief import CommandBelief
from rotary_error_monitor.pipeline.evidence import COLUMNS, SIGMAS, EvidenceWindow, Means, Scatter

PERIOD, TICKS = 0.01, 10
COUNT = 1200


@pytest.fixture(scope="module")
def stage() -> StageDescription:
    return stage_of(random_stage(3))


def windows(
    theta: np.ndarray,
    command: np.ndarray,
    there: np.ndarray | None = None,
    bends: np.ndarray | None = None,
    scatter: np.ndarray | None = None,
) -> list[EvidenceWindow]:
    """Windows in which the command is `there` for a part of the ticks, without it for all.

    Third differences of the heads are `bends` (rad), and ticks scatter by `scatter` (rad) about a line.
    """
    shown = {"heads": 1.0, "radial": 1.0, "head_samples": 1.0, "radial_variance": 1e-18}
    parts = np.ones(len(theta)) if there is None else there
    bent = np.zeros(len(theta)) if bends is None else bends
    scattered = np.full(len(theta), 1e-7) if scatter is None else scatter
    values = [
        shown | {"theta": angle, "ecc": part * (angle - commanded), "command": part, "head_bend": bend}
        for angle, commanded, part, bend in zip(theta, command, parts, bent, strict=True)
    ]
    return [
        EvidenceWindow(
            number,
            PERIOD,
            TICKS,
            Means._make(float(each.get(name, 0.0)) for name in COLUMNS),
            Scatter(float(scattered[number]), 1e-7, 1e-7),
            np.zeros(1),
            0,
            True,
        )
        for number, each in enumerate(values)
    ]


def course(
    stage: StageDescription, theta: np.ndarray, command: np.ndarray, there: np.ndarray | None = None
) -> list[str]:
    """What is doubted after each window."""
    belief, found = CommandBelief(stage), []
    for window in windows(theta, command, there):
        belief.judge(window)
        found.append(belief.doubt)
    return found


def doubts(stage: StageDescription, theta: np.ndarray, command: np.ndarray) -> set[str]:
    return {*course(stage, theta, command)} - {""}


def moved(time: np.ndarray) -> np.ndarray:
    """A command that goes to and fro, 1 rad/s at most, and stands every other while."""
    return np.where(time % 4.0 < 2.0, 1.0 - np.cos(np.pi * time), 0.0) / np.pi


@pytest.mark.parametrize("settling", [0.02, 0.05, 0.3, 2.0])
def test_a_drive_that_settles_while_its_command_stands_is_not_late(settling, stage):
    """Its distance goes as its speed does, with the time it settles in; stamps have no part in that."""
    generator = np.random.default_rng(round(1e3 * settling))
    time = PERIOD * np.arange(COUNT)
    for _ in range(4):
        since = time % generator.uniform(1.0, 4.0)  # some disturbance sets it off again and again
        off = generator.uniform(0.02, 0.05) * stage.limits.following_error * np.exp(-since / settling)
        theta = np.cumsum(np.diff(off, prepend=0.0)) + 1e-8 * generator.normal(size=COUNT)
        assert not doubts(stage, theta, np.zeros(COUNT))


@pytest.mark.parametrize("part", [0.5, 2.0, -2.0])
def test_heads_that_are_late_are_found_where_the_command_moves(part, stage):
    generator = np.random.default_rng(7)
    time, late = PERIOD * np.arange(COUNT), part * stage.limits.latency
    for _ in range(4):
        theta = moved(time - late) + 1e-7 * generator.normal(size=COUNT)
        found = doubts(stage, theta, moved(time))
        assert any("behind the command" in text for text in found) is (abs(part) > 1.0)


@pytest.mark.parametrize("seconds", [0.04, 0.3, 2.0])
@pytest.mark.parametrize("part", [0.6, -0.9])
def test_a_command_that_was_silent_made_no_step(part, seconds, stage):
    """However far the rotor stays behind it: of a window that lacks a part of it the distance is not known."""
    generator = np.random.default_rng(round(1e3 * seconds))
    for _ in range(4):
        theta = moved(PERIOD * np.arange(COUNT)) + 1e-7 * generator.normal(size=COUNT)
        there, begin = np.ones(COUNT), int(generator.integers(5, 900))
        end = begin + round(seconds / PERIOD)
        there[begin:end] = 0.0
        there[[begin, end]] = generator.uniform(0.1, 0.9, 2)
        assert not any(course(stage, theta, theta - part * stage.limits.following_error, there))


@pytest.mark.parametrize("drift", [0.0, 10.0])
@pytest.mark.parametrize("silent", [0, 10])
@pytest.mark.parametrize("off", [3e-4, -2e-3, 0.5])
def test_a_command_that_came_back_wrong_is_believed_once_it_is_right(off, silent, drift, stage):
    """It is silent, comes back elsewhere, stays off or drifts (rad/s, as in another unit), and is then as it was."""
    generator = np.random.default_rng(5)
    theta = moved(PERIOD * np.arange(COUNT)) + 1e-7 * generator.normal(size=COUNT)
    there, wrong = np.ones(COUNT), np.zeros(COUNT)
    begin, end = int(generator.integers(300, 500)), 700
    there[begin - 10 : begin] = 0.0
    there[end : end + silent] = 0.0
    wrong[begin:end] = off + drift * PERIOD * np.arange(end - begin)
    found = course(stage, theta, theta - wrong, there)
    assert not any(found[:begin])
    assert all(found[begin + 15 : end]), "while it is wrong"
    assert not any(found[end + silent + round(0.7 / PERIOD) :]), "once it has been right for half a second"


@pytest.mark.parametrize("count", [2, 3, 10])
def test_distances_of_a_head_that_was_wrong_are_forgotten_with_it(count, stage):
    """Behind a silence the rotation comes of a wrong head for some windows, until that is left out."""
    generator = np.random.default_rng(3)
    theta = moved(PERIOD * np.arange(COUNT)) + 1e-7 * generator.normal(size=COUNT)
    there, begin = np.ones(COUNT), 400
    there[begin - 10 : begin] = 0.0
    shown = theta.copy()
    shown[begin : begin + count] += 2.5 * np.arange(1, count + 1)
    belief, found = CommandBelief(stage), []
    for window in windows(shown, theta, there):
        belief.judge(window)
        found.append(belief.doubt)
        if window.number == begin + count - 1:
            assert belief.doubt
            belief.retract(doubt=True)
    assert not any(found[begin + count :])


@pytest.mark.parametrize("part", [0.0, 0.7])
@pytest.mark.parametrize("speeds", [(3.0, 3.0), (3.0, 6.0), (6.0, -3.0)])
def test_behind_a_silence_at_another_speed_an_unseen_delay_leaves_positioning_open(speeds, part, stage):
    """It may be that of the drive, or counts that all heads lost, until a change of speed shows which."""
    generator, late = np.random.default_rng(5), part * stage.limits.latency
    before, behind, again = (np.full(300, speed) for speed in (*speeds, speeds[0]))
    speed, silent = np.concatenate([before, behind, again]), range(290, 310)
    command = PERIOD * np.cumsum(speed)
    theta = command - late * speed + 1e-8 * generator.normal(size=len(speed))
    belief, untold = CommandBelief(stage), {}
    for window in windows(theta, command):
        if window.number in silent:
            continue
        if window.number == silent.stop:
            belief.note_silence(window.number)
        belief.judge(window)
        assert not belief.doubt
        untold[window.number] = belief.untold
    faster = abs(speeds[1] - speeds[0])
    if faster:
        assert untold[590] >= 0.99 * stage.limits.latency * faster / SIGMAS
    else:
        assert not untold[590]
    assert not untold[899]


def stepped(ticks: np.ndarray, samples: int, spread: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, third differences and scatter of windows of ticks, which are interpolated from each `spread`-th."""
    sampled = ticks[::spread]
    at = np.arange(len(ticks)) / spread
    place = np.minimum(np.maximum(at.astype(int), 1), len(sampled) - 3)
    part = (at - place)[:, None]
    four = sampled[place[:, None] + np.arange(-1, 3)]
    weights = np.hstack(
        [
            -part * (part - 1) * (part - 2) / 6,
            (part + 1) * (part - 1) * (part - 2) / 2,
            -(part + 1) * part * (part - 2) / 2,
            (part + 1) * part * (part - 1) / 6,
        ]
    )
    seen, bend = (weights * four).sum(axis=1).reshape(-1, samples), four @ [-1.0, 3.0, -3.0, 1.0]
    course = np.arange(samples) - 0.5 * (samples - 1)
    off = seen - seen.mean(axis=1, keepdims=True)
    off -= course * ((off @ course) / (course @ course))[:, None]
    scatter = np.sqrt((off**2).sum(axis=1) / (samples - 2))
    return seen.mean(axis=1), bend.reshape(-1, samples).mean(axis=1), scatter


@pytest.mark.parametrize("spread", [1, 2, 4, 10, 16])
def test_a_step_is_told_wherever_in_a_window_and_between_samples_it_falls(spread, stage):
    """Samples are so many ticks of 1 ms apart; it ends as it began, and what was before is believed again."""
    generator = np.random.default_rng(spread)
    for _ in range(3):
        off = generator.choice([-1.0, 1.0]) * generator.uniform(0.3, 0.8) * stage.limits.following_error
        begin, end = int(generator.integers(3000, 3000 + 10 * spread)), int(generator.integers(6000, 6100))
        ticks = np.zeros(TICKS * COUNT)
        ticks[begin:end] = off
        distance, bends, scatter = stepped(ticks, TICKS, spread)
        theta = moved(PERIOD * np.arange(COUNT))
        distance += 1e-7 * generator.normal(size=COUNT)
        belief, found = CommandBelief(stage), []
        for window in windows(theta + distance, theta, None, bends, np.hypot(scatter, 1e-7)):
            belief.judge(window)
            found.append(belief.doubt)
        assert not any(found[: begin // TICKS])
        assert all(found[begin // TICKS + 10 : end // TICKS]), (off, begin)
        assert not any(found[end // TICKS + 70 :]), (off, end)


def ramped(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Angle and acceleration of a command that goes to and fro by constant accelerations, in windows."""
    times = PERIOD * np.arange(COUNT)
    knots, speeds, last = [0.3], [0.0], 0.0
    while knots[-1] < times[-1]:
        speed = 0.0 if last and generator.uniform() < 0.5 else float(generator.uniform(-3.0, 3.0))
        knots += [knots[-1] + generator.uniform(0.05, 0.4)]
        knots += [knots[-1] + generator.uniform(0.4, 1.0)]
        speeds += [speed, speed]
        last = speed
    fine = np.arange(0.0, PERIOD * COUNT, PERIOD / TICKS)
    speed = np.interp(fine, knots, speeds)
    accelerated = np.gradient(speed, fine)
    return tuple(each.reshape(COUNT, TICKS).mean(axis=1) for each in (np.cumsum(speed) * PERIOD / TICKS, accelerated))


def behind(accelerated: np.ndarray, settling: float, most: float) -> np.ndarray:
    """What a drive stays behind, `most` (rad) at its largest, that follows the acceleration within some windows."""
    left = np.exp(-1.0 / settling) if settling else 0.0
    off = np.array(accelerated)
    for place in range(1, len(off)):
        off[place] += left * (off[place - 1] - off[place])
    return most * off / np.abs(off).max()


@pytest.mark.parametrize("settling", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("part", [0.5, 0.9, -0.9])
def test_a_drive_that_stays_behind_as_it_accelerates_makes_no_step(part, settling, stage):
    generator = np.random.default_rng(11)
    for _ in range(4):
        command, accelerated = ramped(generator)
        off = behind(accelerated, settling, part * stage.limits.following_error)
        theta = command - off + 1e-7 * generator.normal(size=COUNT)
        assert not doubts(stage, theta, command)


@pytest.mark.parametrize("part", [0.0, 0.5])
@pytest.mark.parametrize("what", ["heads", "command"])
def test_a_step_of_such_a_drive_is_uncertain_until_it_is_told(what, part, stage):
    generator = np.random.default_rng(13)
    told, unsure = [], []
    for _ in range(8):
        command, accelerated = ramped(generator)
        theta = command - behind(accelerated, 1.0, part * stage.limits.following_error)
        theta += 1e-7 * generator.normal(size=COUNT)
        begin, off = int(generator.integers(200, 900)), np.zeros(COUNT)
        off[begin:] = generator.choice([-1.0, 1.0]) * generator.uniform(0.5, 0.95) * stage.limits.following_error
        shown, asked = (theta + off, command) if what == "heads" else (theta, command - off)
        belief, found, covered = CommandBelief(stage), [], []
        for window in windows(shown, asked):
            belief.judge(window)
            found.append(bool(belief.doubt))
            covered.append(SIGMAS * belief.lag >= abs(off[window.number]) or bool(belief.doubt))
        told.append(any(found[begin : begin + 150]))
        unsure.append(all(covered[begin : begin + 150]))
        assert not any(found[:begin])
    assert np.mean(told) >= 0.8, "beside a step as the speed changes first, which a delay may have made"
    assert np.mean(unsure) >= 0.9, unsure
