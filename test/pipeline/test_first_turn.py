"""What is not as in the first turn, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.pipeline.first_turn import YIELDED, FirstTurn, own_part


def followed(places, step=0.05):
    """What does not repeat of a course (n,) of places along x, a window each, at rotations a step apart."""
    turn, found = FirstTurn(), []
    for number, place in enumerate(places):
        turn.follow(number, step * number, (place, 0.0))
        found.append(turn.unrepeated)
    return np.array(found)


def test_what_turns_with_the_rotor_repeats_and_a_step_does_not():
    angle = 0.05 * np.arange(600)
    orbit = 1e-5 * np.cos(3 * angle)
    known = 140  # windows until a turn is over, and one for the ends of its steps
    assert followed(orbit).max() < 2e-6, "what the angles of a degree miss of it"
    stepped = followed(orbit + 5e-6 * (angle > 15.0))
    assert stepped[known:295].max() < 2e-6 and np.abs(stepped[310:] - 5e-6).max() < 2e-6
    assert followed(orbit + 1e-8 * np.arange(600))[-1] == pytest.approx(5e-6, rel=0.4), "since it was there first"


def test_what_came_in_the_first_turn_belongs_to_it_until_it_is_forgotten():
    turn = FirstTurn()
    for number in range(300):
        turn.follow(number, 0.05 * number, (1e-6, 0.0), sure=number > 130)
    assert turn.unrepeated == 0.0
    turn.follow(300, 15.0, (4e-6, 0.0))
    assert turn.unrepeated == pytest.approx(3e-6)
    turn.forget()
    turn.follow(301, 15.05, (4e-6, 0.0))
    assert turn.unrepeated == 0.0


def test_what_the_rotor_yields_by_is_its_own_for_the_most_part():
    push = (3e-6, -4e-6)
    assert own_part(push, push) == pytest.approx(YIELDED * 4e-6)
    assert own_part(push, (0.0, 0.0)) == own_part(push, (-3e-6, 4e-6)) == 4e-6
    assert own_part((9e-6, 0.0), (3e-6, 0.0)) == pytest.approx(6e-6)
