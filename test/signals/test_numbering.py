"""Messages that never came are counted, whoever else publishes, begins, ends or is silent."""

from __future__ import annotations

import random

import pytest
from scipy.stats import binom

from rotary_error_monitor.signals.numbering import MessageCount


def most(cells, rate):
    """Cells of so many that may be wrong at a rate: more of them only once in a million times."""
    return int(binom.isf(1e-6, cells, rate))


def count(numbers, publishers=1):
    found = MessageCount(lambda: publishers)
    for number in numbers:
        found.observe(number)
    found.finish()
    return found.lost


def test_nothing_is_lost_of_what_goes_on():
    assert count(range(1, 100)) == 0
    assert count(range(500, 600)) == 0, "what was sent before one listened"


def test_what_is_left_out_is_lost():
    """It is told some messages later: until then it may be another publisher's first word."""
    found = MessageCount(lambda: 1)
    lost = [found.observe(number) for number in (1, 2, 5, 6, 10, *range(11, 30))]
    assert sum(lost) == sum(lost[:13]) == found.lost == 5
    assert found.finish() == 0


def test_what_is_lost_last_is_found_when_all_ends():
    found = MessageCount(lambda: 1)
    assert [found.observe(number) for number in (1, 2, 5, 6)] == [0, 0, 0, 0]
    assert found.finish() == found.lost == 2


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
    counts = []
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
        found.finish()
        counts.append((found.lost, lost))
    off = [found - lost for found, lost in counts if found != lost]
    assert len(off) <= most(300, 0.003), "some mix up several losses at once"
    assert all(abs(messages) < 100 for messages in off), "by where publishers began, twice at most"


def test_a_stretch_in_which_all_are_lost():
    for publishers in (1, 2, 8):
        found = MessageCount(lambda n=publishers: n)
        for number in (*range(1, 20), *range(120, 140)):
            for _ in range(publishers):
                found.observe(number)
        assert found.lost == 100 * publishers


def messages(publisher, losses, draws):
    """Times and numbers of what a publisher of 1 Hz sends and a listener hears, and how many it does not hear.

    Some come late by some tenths of a second, in order; for three seconds the publisher may get no processor.
    """
    begins, ends, number, stalls = publisher
    stall = draws.uniform(begins, ends) if stalls else ends
    sent = [begins + draws.random()]
    while sent[-1] + 1.0 < ends:
        sent.append(sent[-1] + 1.0)
    heard, lost, latest = [], 0, 0.0
    for place, time in enumerate(sent):
        if 3 < place < len(sent) - 6 and draws.random() < losses:
            lost += 1
            continue
        late = draws.expovariate(5.0) if draws.random() < 0.2 else 0.0
        latest = max(latest + 1e-4, stall + 3.0 if stall < time < stall + 3.0 else time + late)
        heard.append((latest, number + place))
    return heard, lost


def hear(publishers, losses, draws):
    """What is counted of random publishers, whose coming and going is known half a second later, and what was lost."""
    each = [messages(publisher, losses, draws) for publisher in publishers]
    reached = [0.0]
    found = MessageCount(lambda: sum(begins + 0.5 <= reached[0] < ends + 0.5 for begins, ends, _, _ in publishers))
    for reached[0], number in sorted(message for heard, _ in each for message in heard):
        found.observe(number)
    found.finish()
    return found.lost, sum(lost for _, lost in each)


def cell(draws, joining=0, restarting=0, stalling=0.0):
    """Up to nine publishers of a minute, some that join, and some that end and begin anew."""
    first = [
        [draws.choice([0.0, draws.uniform(0.0, 3.0)]), 60.0, draws.choice([1, draws.randint(1, 50)])]
        for _ in range(draws.randint(1, 9))
    ]
    later = [[draws.uniform(5.0, 50.0), 60.0, 1] for _ in range(joining)]
    for publisher in draws.sample(first, min(restarting, len(first))):
        publisher[1] = draws.uniform(10.0, 40.0)
        later.append([publisher[1] + draws.uniform(0.5, 4.0), 60.0, 1])
    return [(*publisher, draws.random() < stalling) for publisher in first + later]


WITHOUT_LOSSES = [
    ({}, 0.0004),
    ({"joining": 3}, 0.0004),
    ({"restarting": 3}, 0.0004),
    ({"joining": 2, "stalling": 0.5}, 0.002),
]


@pytest.mark.parametrize(("world", "rate"), WITHOUT_LOSSES, ids=[",".join(world) for world, _ in WITHOUT_LOSSES])
def test_no_loss_is_seen_where_there_is_none(world, rate):
    """Tenths of a second late, joined before the graph shows them, begun anew, without a processor for a while."""
    draws = random.Random()
    wrong = [lost for _ in range(200) if (lost := hear(cell(draws, **world), 0.0, draws)[0])]
    assert len(wrong) <= most(200, rate), wrong


@pytest.mark.parametrize(("world", "rate"), [({}, 0.004), ({"joining": 2}, 0.02), ({"restarting": 2}, 0.1)])
def test_losses_are_counted_to_the_message(world, rate):
    """Whoever ends while messages of another are lost, may be taken for the one that lost them."""
    draws = random.Random()
    cells = [hear(cell(draws, **world), 0.02, draws) for _ in range(200)]
    assert sum(found != lost for found, lost in cells) <= most(200, rate)
    assert sum(found for found, _ in cells) == pytest.approx(sum(lost for _, lost in cells), rel=0.5)
