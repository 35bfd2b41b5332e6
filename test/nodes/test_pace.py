"""How often nodes speak to people."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.nodes.pace import Pace

START = 1_790_000_000_000_000_000


@pytest.mark.parametrize("block_ns", [1_000_000, 5_000_000, 7_000_000, 19_999_999])
def test_once_in_each_period(block_ns):
    pace = Pace(20_000_000)
    stamps = START + block_ns * np.arange(2000)
    said = np.array([pace.is_due(int(stamp)) for stamp in stamps])
    assert len(set(stamps[said] // 20_000_000)) == said.sum()
    duration = (stamps[-1] - stamps[0]) / 20_000_000
    assert duration - 1 <= said.sum() <= duration + 2


def test_each_message_where_they_are_rarer():
    pace = Pace(20_000_000)
    assert all(pace.is_due(START + k * 50_000_000) for k in range(100))


def test_a_clock_that_was_set_back_an_hour_silences_nobody():
    pace = Pace(50_000_000)
    assert pace.is_due(START)
    back = START - 3_600_000_000_000
    assert sum(pace.is_due(back + k * 5_000_000) for k in range(1000)) == 100
