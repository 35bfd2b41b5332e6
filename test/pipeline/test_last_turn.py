"""The picture of error motion, against closed forms: an ellipse, an oval, a tilt."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.last_turn import CELLS, LARGEST_PART, LastTurn, magnification_of

RADIUS = 0.1


def motion(theta, radial, tilt=(0.0, 0.0), observable=(1, 1, 0, 1, 1, 1)):
    components = np.zeros((len(theta), 6))
    components[:, :2], components[:, 3:5] = radial, tilt
    seen = np.tile(np.array(observable, bool), (len(theta), 1))
    return ErrorMotion.of(theta, np.where(seen, components, 0.0), seen, np.zeros((len(theta), 6, 6)))


def middles(turns=1):
    return (np.arange(turns * CELLS) + 0.5) * 2 * np.pi / CELLS


@pytest.mark.parametrize(
    ("largest", "expected"), [(1e-6, 20_000.0), (2.5e-7, 100_000.0), (3e-7, 50_000.0), (0.02, 1.0), (1.0, 1.0), (0, 1)]
)
def test_magnification_is_round_and_leaves_room(largest, expected):
    assert magnification_of(largest, RADIUS) == pytest.approx(expected)


def test_no_magnification_takes_more_room_than_there_is_nor_less_than_two_fifths_of_it():
    for largest in np.random.default_rng(5).uniform(-9, -4, 500):
        part = magnification_of(10.0**largest, RADIUS) * 10.0**largest / (LARGEST_PART * RADIUS)
        assert 0.4 - 1e-9 <= part <= 1.0 + 1e-9


def test_orbit_and_polar_plot_of_an_ellipse():
    theta = middles()
    radial = np.stack([1e-6 * np.cos(theta), 0.5e-6 * np.sin(theta)], axis=1)
    view = LastTurn(RADIUS)
    view.add(motion(theta, radial))
    picture = view.picture()
    assert picture.magnification == 20_000.0
    np.testing.assert_allclose(picture.orbit[:-1, :2], 20_000.0 * radial, atol=1e-12)
    np.testing.assert_array_equal(picture.orbit[0], picture.orbit[-1])
    seen = np.hypot(*picture.polar[:-1, :2].T) - RADIUS
    np.testing.assert_allclose(seen, 20_000.0 * (0.75e-6 + 0.25e-6 * np.cos(2 * theta)), atol=1e-12)
    np.testing.assert_allclose(np.arctan2(*picture.polar[:-1, 1::-1].T) % (2 * np.pi), theta, atol=1e-12)


def test_each_angle_shows_its_last_pass_whichever_way_and_turn():
    view = LastTurn(RADIUS)
    view.add(motion(middles(), np.full((CELLS, 2), 1e-6)))
    back = -middles()[:90]
    view.add(motion(back - 20 * np.pi, np.full((90, 2), 2e-6)))
    picture = view.picture()
    assert len(picture.orbit) == CELLS + 1
    size = np.round(picture.orbit[:-1, 0] / picture.magnification, 12)
    assert set(size[:-90]) == {1e-6} and set(size[-90:]) == {2e-6}


def test_an_arc_stays_an_arc_and_nothing_is_drawn_of_what_is_not_observable():
    view = LastTurn(RADIUS)
    assert len(view.picture().orbit) == 0 and view.picture().magnification == 0.0
    view.add(motion(middles()[:100], np.full((100, 2), 1e-6), observable=(1, 1, 0, 0, 0, 1)))
    picture = view.picture()
    assert len(picture.orbit) == 100 and len(picture.axis) == 0 and picture.tilt_magnification == 0.0
    view.add(motion(middles(), np.zeros((CELLS, 2)), (1e-6, 0.0), observable=(1, 0, 0, 1, 1, 1)))
    assert len(view.picture().orbit) == 100


def test_the_axis_leans_where_a_tilt_takes_it():
    """A rotation of 2 µrad about x takes what stands above the ring towards -y."""
    view = LastTurn(RADIUS)
    view.add(motion(middles(), np.zeros((CELLS, 2)), (2e-6, 1e-6)))
    picture = view.picture()
    scale = picture.tilt_magnification
    np.testing.assert_allclose(picture.axis, [[0, 0, 0], [1e-7 * scale, -2e-7 * scale, RADIUS]], atol=1e-12)
    assert 0.1 * RADIUS <= np.hypot(*picture.axis[1, :2]) <= LARGEST_PART * RADIUS
