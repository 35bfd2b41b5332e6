"""Messages that never came are counted, whoever else publishes, begins, ends or is silent."""

from __future__ import annotations

import random

import pytest

from rotary_error_monitor.signals.numbering import MessageCount


def count(numbers, publishers=1):
    found = MessageCount(lambda: publishers)
    for number in numbers:
        found.observe(number)
    return found.lost


def test_nothing_is_lost_of_what_goes_on():
    assert count(range(1, 100)) == 0
    assert count(range(500, 600)) == 0, "what was sent before one listened"


def test_what_is_left_out_is_lost():
    found = MessageCount(lambda: 1)
    assert [found.observe(number) for number in (1, 2, 5, 6, 10)] == [0, 0, 2, 0, 3]
    assert found.lost == 5


def test_a_publisher_that_begins_anew_loses_nothing():
    assert count([*range(1, 50), *range(1, 50)]) == 0
    assert count([*range(1, 50), *range(4, 50)]) == 0


def test_a_pause_of_the_listener_is_no_loss():
    found = MessageCount(lambda: 1)
    for number in range(1, 10):
        found.observe(number)
    found.forget()
    assert found.observe(40) == 0


@pytest.mark.parametrize("silent", [1, 3])
def test_a_publisher_that_says_nothing_hides_no_loss(silent):
    """It is told a few messages later: until then the leap may be the silent one's first word."""
    found = MessageCount(lambda: 1 + silent)
    lost = [found.observe(number) for number in (1, 2, 3, *range(103, 115))]
    assert sum(lost) == found.lost == 99
    assert sum(lost[:10]) == 99


def test_a_second_publisher_is_no_loss():
    assert count([1, 2, 3, 50, 4, 51, 5, 52, 6, 53, 7], publishers=2) == 0


def test_random_losses_of_many_publishers():
    """Messages of up to nine publishers at one rate, each begun at another time; some are lost."""
    for _ in range(300):
        publishers = random.randint(1, 9)
        first = [random.choice([1, random.randint(1, 50)]) for _ in range(publishers)]
        found = MessageCount(lambda n=publishers: n)
        lost = 0
        for turn in range(200):
            for publisher in random.sample(range(publishers), publishers):
                if 8 < turn < 190 and random.random() < 0.02:  # each is heard first and last
                    lost += 1
                else:
                    found.observe(first[publisher] + turn)
        assert found.lost == lost


def test_a_stretch_in_which_all_are_lost():
    for publishers in (1, 2, 8):
        found = MessageCount(lambda n=publishers: n)
        for number in (*range(1, 20), *range(120, 140)):
            for _ in range(publishers):
                found.observe(number)
        assert found.lost == 100 * publishers
