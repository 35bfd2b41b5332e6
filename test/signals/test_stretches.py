"""The recording among stamps that lie years apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.signals.stretches import PAUSE_NS, longest_stretch

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND
YEAR = 365 * 86400 * SECOND


def blocks(start_s: float, stop_s: float, streams: range) -> list[tuple[int, int, int]]:
    """Pieces of 5 ms of several streams, without a gap."""
    times = np.arange(round(start_s * 200), round(stop_s * 200)) * (SECOND // 200)
    return [(NOW + int(t), NOW + int(t) + SECOND // 250, s) for t in times for s in streams]


def stretch(pieces: list[tuple[int, int, int]], **options: int) -> tuple[int, int]:
    first, last, stream = np.array(pieces, dtype=np.int64).reshape(-1, 3).T
    return longest_stretch(first, last, stream, **options)


WHOLE = (NOW, NOW + 2 * SECOND - SECOND // 200 + SECOND // 250)


@pytest.mark.parametrize(
    "stray",
    [
        (-1000 * SECOND, -1000 * SECOND, 0),
        (0, SECOND, 1),
        (NOW + 30 * 86400 * SECOND, NOW + 30 * 86400 * SECOND, 2),
        (NOW + PAUSE_NS + 3 * SECOND, NOW + PAUSE_NS + 3 * SECOND, 0),
        (NOW + YEAR, NOW + 2 * YEAR, 3),
    ],
)
def test_a_stray_piece_is_outside(stray: tuple[int, int, int]) -> None:
    assert stretch([*blocks(0, 2, range(4)), stray]) == WHOLE


def test_a_stream_on_a_clock_of_its_own_is_outside() -> None:
    assert stretch([*blocks(86400, 86400 + 2, range(1)), *blocks(0, 2, range(1, 4))]) == WHOLE


def test_what_ran_alone_for_longer_is_not_the_recording() -> None:
    """Two seconds of all streams, and an hour of the thermometer alone on the next day."""
    alone = [(NOW + (86400 + k) * SECOND, NOW + (86400 + k) * SECOND, 9) for k in range(3600)]
    assert stretch([*alone, *blocks(0, 2, range(4))]) == WHOLE


def test_a_pause_within_a_recording_belongs_to_it() -> None:
    pieces = [*blocks(0, 2, range(2)), *blocks(600, 602, range(2))]
    assert stretch(pieces) == (NOW, NOW + 602 * SECOND - SECOND // 200 + SECOND // 250)
    assert stretch(pieces, pause_ns=SECOND) == WHOLE
    # one stream alone fills a pause of the others
    assert stretch([*pieces, (NOW, NOW + 601 * SECOND, 2)], pause_ns=SECOND)[1] > NOW + 601 * SECOND


def test_one_stream_alone_has_a_recording_too() -> None:
    assert stretch([(0, 0, 0), *blocks(0, 2, range(1))]) == WHOLE
    assert stretch([(5, 5, 0)]) == (5, 5)
    assert stretch([(5, 5, 0), (YEAR, YEAR, 0), (YEAR, YEAR, 0)]) == (YEAR, YEAR)
    assert stretch([(5, 5, 0), (YEAR, YEAR, 0)]) == (5, 5)


@given(
    st.lists(st.tuples(st.integers(-(2**61), 2**61), st.integers(0, 2**40), st.integers(0, 3)), min_size=1),
    st.integers(0, 2**41),
    st.randoms(),
)
def test_the_stretch_holds_whole_pieces_whatever_their_order(pieces, pause_ns, random) -> None:
    pieces = [(first, first + length, stream) for first, length, stream in pieces]
    begin, end = stretch(pieces, pause_ns=pause_ns)
    assert begin in {first for first, _, _ in pieces} and end in {last for _, last, _ in pieces}
    for first, last, _ in pieces:
        inside = begin <= first and last <= end
        assert inside or last < begin - pause_ns or first > end + pause_ns
    random.shuffle(pieces)
    assert stretch(pieces, pause_ns=pause_ns) == (begin, end)
