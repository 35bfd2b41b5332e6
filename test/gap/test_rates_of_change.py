"""How departures with time, temperature, speed and load are told: never as a rate beyond what was recorded."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap.departures import by_rate, over_time


@pytest.mark.parametrize(
    ("rate", "span", "per", "size", "words"),
    [
        (0.04, 3.0, "K", 1.0, "by 4 %/K"),
        (0.3, 0.4, "K", 1.0, "by 12 % over the 0.4 K of the recording"),
        (-0.03, 5.0, "rad/s", 1.0, "by 3 % per rad/s"),
        (0.5, 0.2, "rad/s", 1.0, "by 10 % over the 0.2 rad/s of the recording"),
        (0.0036, 120.0, "100 N", 100.0, "by 36 % per 100 N"),
        (0.0036, 50.0, "100 N", 100.0, "by 18 % over the 50 N of the recording"),
    ],
)
def test_a_rate_is_told_for_a_unit_or_over_what_was_recorded(rate, span, per, size, words):
    assert by_rate(rate, span, per, size) == words


@pytest.mark.parametrize("seconds", [5.0, 25.0, 2400.0, 40000.0])
@pytest.mark.parametrize("begin", [0.0, 0.3, 0.9, 1.7])
def test_a_change_with_time_is_a_part_of_the_larger_end(begin, seconds):
    """Beside the two ends of a straight course whose mean is one: no part is above all of it."""
    end = 2.0 - begin
    words = over_time(end - begin, seconds)
    part = 100 * abs(end - begin) / max(begin, end)
    assert f" {'100' if part == 100 else f'{part:.2g}'} %" in words
    assert words.startswith("shrinks with time" if end < begin else "grows with time")


def test_a_change_beyond_nothing_is_one_of_sign():
    assert over_time(-2.4, 25.0) == "changes its sign over the 25 s"
    assert over_time(-0.5, 1500.0) == "shrinks with time by 40 % over the 25 min"
    assert over_time(0.5, 40000.0).endswith("over the 11.1 h")
    assert over_time(np.float64(0.5), 25.0) == "grows with time by 40 % of its final size over the 25 s"
