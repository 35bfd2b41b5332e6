"""The play of a drive against what follows it: something heavy that only the walls of a slot can push."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.plant.play import play

WIDTH = 2e-6


def pushed(path, width, here):
    """Positions of a weight that stands until the front or the back of the slot round it comes to it."""
    for position in path:
        here = min(max(here, position - width / 2), position + width / 2)
        yield here


@given(st.lists(st.floats(-5e-6, 5e-6), min_size=1, max_size=60), st.sampled_from([-1.0, 1.0]))
def test_the_reversal_error_is_what_a_pushed_weight_lags_behind(path, side):
    found = play(np.array(path)[:, None], np.array([WIDTH]), np.array([side]))[:, 0]
    lag = np.array(path) - list(pushed(path, WIDTH, path[0] - side * WIDTH / 2))
    assert found * WIDTH / 2 == pytest.approx(lag, abs=1e-18)


def test_an_axis_without_play_has_the_sign_of_its_travel():
    path = np.array([0.0, 1.0, 1.0, 0.5, 0.7])[:, None]
    assert play(path, np.zeros(1), np.ones(1))[:, 0].tolist() == [1, 1, 1, -1, 1]
