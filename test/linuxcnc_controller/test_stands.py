"""Corrections that stand while the axes move are refused; those that may stand are not."""

import random

import numpy as np
import pytest
from faults.documenting import Row, shows

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.linuxcnc_controller.gate import CorrectionMessage, GateLimits, RefusalError, RefusalReason
from rotary_error_monitor.linuxcnc_controller.intake import CorrectionIntake
from rotary_error_monitor.linuxcnc_controller.stands import LASTS, MOVED
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine

MS = 10**6
NOW = 1_800_000_000_000_000_000
LARGE = (1e-2,) * 5


class Controller:
    """An intake of five axes, a correction each 10 ms, and where the program has the axes then."""

    def __init__(self, corrected="XYZAC", max_age=0.1):
        self.corrected = corrected
        self.intake = CorrectionIntake(GateLimits(tuple("XYZAC"), LARGE, tuple(corrected), max_age))
        self.intake.sources.enlist(("/compensation",), 0)
        self.time_ns, self.number = 0, 100

    def send(self, axes, corrections, after_ms=10):
        """Why the correction is refused; none where it is believed."""
        self.time_ns += after_ms * MS
        self.number += 1
        self.intake.note_axes(axes, self.time_ns)
        message = CorrectionMessage(NOW + self.time_ns - 30 * MS, self.corrected, corrections)
        try:
            self.intake.take(message, self.number, NOW + self.time_ns, self.time_ns)
        except RefusalError as error:
            return error.doubt
        return None

    def run(self, axes, corrections, **how):
        return [self.send(place, told, **how) for place, told in zip(axes, corrections, strict=True)]


def moving(seed, count=300):
    """(count, 5) places of axes of which some move, some mm/s or hundredths of rad/s, from anywhere."""
    chance = np.random.default_rng(seed)
    begin = chance.uniform([-0.2, -0.2, -0.2, -1.0, -3.0], [0.2, 0.2, 0.2, 1.0, 3.0])
    which = chance.random(5) < 0.4
    which[chance.integers(5)] = True
    speeds = which * chance.choice([-1.0, 1.0], 5) * chance.uniform(2e-3, 5e-2, 5)
    return begin + 0.01 * np.arange(count)[:, None] * speeds


def wave(count=300):
    """(count, 5) corrections that change all the time."""
    return 1e-5 * np.sin(0.01 * np.arange(count)[:, None] + np.arange(5))


@shows(
    Row(
        "corrections",
        "The publisher of the corrections is stuck, or another one says the same constant ones again and again, within "
        "all limits, under fresh stamps",
        "`corrections` of the bridge: the same to the last bit while the axes move; `refused_stands` counts",
        "what comes is held against the axes' motion: of every description the last bits change with the place",
        "the constant ones are walked to, within the limits of size and speed, and held there",
        "with the first one that is another",
    )
)
@pytest.mark.parametrize("seed", range(8))
def test_corrections_that_stand_while_the_axes_move_are_refused_until_they_change(seed):
    controller, axes = Controller(), moving(seed)
    assert not any(controller.run(axes, wave()))
    stuck = random.Random(seed).choice([wave()[-1], np.full(5, 4e-6), np.array([2e-6, 0, 0, 0, 0])])
    found = controller.run(axes, [stuck] * 300)
    speed = np.abs(np.diff(axes[:2], axis=0)).max() / 0.01
    within = round((LASTS + MOVED / speed) / 0.01) + 5
    assert set(found[within:]) == {RefusalReason.STANDS}
    assert RefusalReason.STANDS not in found[: round(LASTS / 0.01)]
    assert not any(controller.run(axes, wave())[1:])


@pytest.mark.parametrize("name", ["xyzac_trt", "pan2013"])
@pytest.mark.parametrize("seed", range(8))
def test_those_of_a_description_alone_never_stand(name, seed):
    machine = load_machine(name)
    order = [machine.letters.index(letter) for letter in "XYZAC"]
    axes = moving(seed)
    joints = np.zeros_like(axes)
    joints[:, order] = axes
    ones = np.ones_like(joints)
    solved = solve_axis_corrections(
        arrange_machine(machine), joints, direction=ones, temperature=np.full(len(axes), 21.0)
    )
    assert not (np.diff(solved.corrections, axis=0) == 0.0).all(axis=1).any()
    assert RefusalReason.STANDS not in Controller().run(axes, solved.corrections[:, order])


CONSTANT = np.full((300, 5), 4e-6)


@pytest.mark.parametrize(
    ("axes", "corrections", "how"),
    [
        (np.zeros((300, 5)), CONSTANT, {}),
        (moving(3), np.zeros((300, 5)), {}),
        (np.repeat(moving(3)[:3], 100, axis=0) * [1e-3, 1e-3, 1e-3, 1e-3, 1e-3], CONSTANT, {}),
        (moving(3), CONSTANT, {"after_ms": 150}),
    ],
    ids=["at rest", "without errors", "hardly moving", "messages that come seldom"],
)
def test_what_may_stand_is_followed(axes, corrections, how):
    assert not any(Controller().run(axes, corrections, **how))


def test_constant_corrections_of_a_rest_are_not_refused_when_it_ends():
    """They come some hundredths of a second after the place that they are for."""
    controller, axes = Controller(), moving(5)
    assert not any(controller.run([axes[0]] * 300, CONSTANT))
    assert not any(controller.run(axes[:10], CONSTANT[:10]))
    assert not any(controller.run(axes, 4e-6 + wave()))


def test_after_a_pause_in_which_the_axes_moved_to_and_fro_the_same_is_followed():
    """However old a correction may be: a compensation that begins again goes on from what is in effect."""
    controller = Controller(max_age=10.0)
    assert not any(controller.run(np.zeros((100, 5)), CONSTANT[:100]))
    for position in (0.1, 0.0):
        controller.time_ns += 1000 * MS
        controller.intake.note_axes((position,) * 5, controller.time_ns)
    assert not any(controller.run(np.zeros((200, 5)), CONSTANT[:200]))


def test_the_motion_of_an_axis_that_is_not_corrected_says_nothing():
    controller, axes = Controller("XYZ"), np.zeros((300, 5))
    axes[:, 4] = moving(1)[:, 4] + 0.01 * np.arange(300)
    assert not any(controller.run(axes, CONSTANT[:, :3]))
