"""Error motion by weighted least squares, held against closed forms and against what chance makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.metrology.rigid_motion import (
    Seen,
    combine,
    disagreement,
    disagreements,
    extend,
    observable_components,
    redundant_sensors,
)

AXIAL = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


def radial(azimuth: float, height: float) -> list[float]:
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    return [cos, sin, 0.0, -height * sin, height * cos, 0.0]


def face(azimuth: float, radius: float) -> list[float]:
    return [0.0, 0.0, 1.0, radius * np.sin(azimuth), -radius * np.cos(azimuth), 0.0]


def known(count: int, **components: tuple[float, float]) -> ErrorMotion:
    """Value and standard deviation of some components, the same at all times."""
    names = ("exc", "eyc", "ezc", "eac", "ebc", "ecc")
    values, covariance, observable = np.zeros((count, 6)), np.zeros((count, 6, 6)), np.zeros((count, 6), bool)
    for name, (value, std) in components.items():
        place = names.index(name)
        values[:, place], covariance[:, place, place], observable[:, place] = value, std**2, True
    return ErrorMotion.of(np.zeros(count), values, observable, covariance)


def test_an_axial_probe_alone_is_the_axial_error_motion():
    found = combine(known(1, exc=(1e-6, 1e-8)), Seen(np.array([AXIAL]), np.array([[3e-7]]), np.array([[4e-16]])))
    assert found.observable[0].tolist() == [True, False, True, False, False, False]
    np.testing.assert_allclose(found.components[0], [1e-6, 0, 3e-7, 0, 0, 0], rtol=1e-9, atol=0)
    np.testing.assert_allclose(np.diag(found.covariance[0]), [1e-16, 0, 4e-16, 0, 0, 0], rtol=1e-7)


def test_two_readings_of_one_thing_are_weighed_by_their_variances():
    motion = known(1, exc=(2e-6, 2e-8))
    found = combine(motion, Seen(np.array([radial(0.0, 0.0)]), np.array([[1e-6]]), np.array([[1e-16]])))
    np.testing.assert_allclose(found.components[0, 0], (2e-6 / 4 + 1e-6) / (1 / 4 + 1), rtol=1e-7)
    np.testing.assert_allclose(found.covariance[0, 0, 0], 1 / (1 / 4e-16 + 1 / 1e-16), rtol=1e-7)


def test_two_heights_show_the_tilt_as_their_difference_over_the_distance():
    """Abbe: beside a radial error motion that is not known otherwise."""
    low, high, noise = 0.05, 0.25, 1e-8
    rows = np.array([radial(0.0, low), radial(0.0, high), radial(np.pi / 2, low), radial(np.pi / 2, high)])
    shown = np.array([[1e-6, 5e-6, 2e-6, -3e-6]])
    found = combine(known(1), Seen(rows, shown, np.full((1, 4), noise**2)))
    ebc, eac = (5e-6 - 1e-6) / (high - low), -(-3e-6 - 2e-6) / (high - low)
    assert found.observable[0].tolist() == [True, True, False, True, True, False]
    np.testing.assert_allclose(found.components[0, [3, 4]], [eac, ebc], rtol=1e-9)
    np.testing.assert_allclose(found.components[0, :2], [1e-6 - low * ebc, 2e-6 + low * eac], rtol=1e-8, atol=1e-18)
    np.testing.assert_allclose(np.sqrt(found.covariance[0, 4, 4]), np.sqrt(2) * noise / (high - low), rtol=1e-7)
    # displacement at the ring and tilt go against one another: both are extrapolated from the same readings
    assert found.covariance[0, 0, 4] < 0


def test_three_probes_on_a_face_show_its_tilt_and_the_axial_error_motion():
    radius, azimuths = 0.08, 2 * np.pi / 3 * np.arange(3)
    truth = np.array([0.0, 0.0, 4e-7, 3e-6, -2e-6, 0.0])
    rows = np.array([face(each, radius) for each in azimuths])
    found = combine(known(1), Seen(rows, (rows @ truth)[None], np.full((1, 3), 1e-16)))
    assert found.observable[0].tolist() == [False, False, True, True, True, False]
    np.testing.assert_allclose(found.components[0], truth, rtol=1e-9, atol=1e-18)
    # three equal weights: the axial one is the mean, each tilt has two thirds of the readings' information
    np.testing.assert_allclose(
        np.diag(found.covariance[0])[2:5], 1e-16 * np.array([1 / 3, 2 / 3 / radius**2, 2 / 3 / radius**2]), rtol=1e-7
    )


def test_what_a_single_radial_probe_mixes_is_not_called_determined():
    motion = known(1, exc=(1e-6, 1e-8))
    found = combine(motion, Seen(np.array([radial(np.pi / 4, 0.1)]), np.array([[2e-6]]), np.array([[1e-16]])))
    assert found.observable[0].tolist() == [True, False, False, False, False, False]
    np.testing.assert_allclose(found.components[0, 0], 1e-6, rtol=1e-9)
    np.testing.assert_allclose(found.covariance[0, 0, 0], 1e-16, rtol=1e-7)
    assert not observable_components(motion.observable[0], np.array([radial(np.pi / 4, 0.1)]))[1:].any()


@pytest.mark.parametrize("seed", range(4))
def test_estimates_scatter_as_their_covariance_says(seed):
    """Over 4000 draws: numpy's least squares on whitened rows, and chi-square of the truth."""
    draw, count = np.random.default_rng(seed), 4000
    rows = np.array([
        radial(*draw.uniform([0, -0.1], [6, 0.3])) if kind else face(*draw.uniform([0, 0], [6, 0.1]))
        for kind in [0, 0, 1, 1, 1, 1]
    ])  # fmt: skip
    truth = draw.normal(size=6) * [1e-6, 1e-6, 1e-6, 1e-5, 1e-5, 1e-5]
    mixing = draw.normal(size=(3, 3)) * 1e-8
    prior = mixing @ mixing.T + 1e-17 * np.eye(3)
    at = [0, 1, 5]
    observable, covariance, components = np.zeros((count, 6), bool), np.zeros((count, 6, 6)), np.zeros((count, 6))
    observable[:, at] = True
    covariance[np.ix_(range(count), at, at)] = prior
    components[:, at] = truth[at] + draw.multivariate_normal(np.zeros(3), prior, count)
    std = draw.uniform(1e-8, 5e-8, len(rows))
    shown = rows @ truth + draw.normal(size=(count, len(rows))) * std
    found = combine(
        ErrorMotion.of(np.zeros(count), components, observable, covariance),
        Seen(rows, shown, np.tile(std**2, (count, 1))),
    )
    assert found.observable.all()
    whitener = np.linalg.inv(np.linalg.cholesky(prior))
    design = np.vstack([whitener @ np.eye(6)[at], rows / std[:, None]])
    for k in range(3):
        data = np.concatenate([whitener @ components[k, at], shown[k] / std])
        np.testing.assert_allclose(
            found.components[k], np.linalg.lstsq(design, data, rcond=None)[0], rtol=1e-6, atol=1e-13
        )
    np.testing.assert_allclose(found.covariance[0], np.linalg.inv(design.T @ design), rtol=1e-5, atol=1e-20)
    off = found.components - truth
    squares = np.einsum("mi,mij,mj->m", off, np.linalg.inv(found.covariance), off)
    assert squares.mean() == pytest.approx(6.0, abs=5 * np.sqrt(12 / count))


def test_what_is_exact_already_stays():
    found = combine(
        known(1, exc=(1e-6, 0.0)), Seen(np.array([radial(0.0, 0.0)]), np.array([[2e-6]]), np.array([[1e-16]]))
    )
    np.testing.assert_allclose(found.components[0, 0], 1e-6, rtol=1e-6)


def test_redundancy_says_which_fault_would_show():
    radials = np.array([True, True, False, False, False, False])
    assert redundant_sensors(radials, np.array([AXIAL, radial(0.0, 0.0)])).tolist() == [False, True]
    assert redundant_sensors(radials, np.array([AXIAL, AXIAL])).all()
    three = [face(azimuth, 0.08) for azimuth in (0.0, 2.0, 4.0)]
    assert not redundant_sensors(radials, np.array(three)).any()
    assert redundant_sensors(radials, np.array([*three, AXIAL])).all()
    # beside a known tilt each of the three has the others
    assert redundant_sensors(np.array([True, True, False, True, True, True]), np.array(three)).all()


def tilts(roll: float) -> list[list[float]]:
    cos, sin = np.cos(roll), np.sin(roll)
    return [[0.0, 0.0, 0.0, cos, -sin, 0.0], [0.0, 0.0, 0.0, sin, cos, 0.0]]


def test_a_sensor_of_two_fields_is_checked_by_what_all_the_others_say_of_both():
    radials, tilted = np.array([True, True, False, False, False, True]), np.array([True, True, False, True, True, True])
    rows, owner = np.array(tilts(0.4)), np.array([0, 0])
    assert not redundant_sensors(radials, rows, owner).any()
    assert redundant_sensors(tilted, rows, owner).tolist() == [True]
    # a probe at a height tells tilt across one direction: one of the fields could be wrong unseen
    beside = np.array([*tilts(0.4), radial(0.0, 0.1)]), np.array([0, 0, 1])
    assert redundant_sensors(radials, *beside).tolist() == [False, True]
    beside = np.array([*tilts(0.4), radial(0.0, 0.1), radial(1.5, 0.2)]), np.array([0, 0, 1, 2])
    assert redundant_sensors(radials, *beside).tolist() == [True, True, True]


@pytest.mark.parametrize("roll", [0.0, 0.9, -2.0])
def test_fields_in_rad_and_in_m_are_weighed_by_their_variances(roll):
    """The tilt by a probe over its lever beside that of an instrument, in closed form; other units change nothing."""
    truth, height = np.array([0.0, 0.0, 0.0, 3e-6, -2e-6, 0.0]), 0.2
    rows = np.array([*tilts(roll), radial(0.0, height)])
    shown, variance = (rows @ truth)[None] + [[0.0, 0.0, 1e-8]], np.array([[1e-14, 1e-14, 1e-16]])
    motion = known(1, exc=(0.0, 1e-12), eyc=(0.0, 1e-12))
    found = combine(motion, Seen(rows, shown, variance))
    assert found.observable[0].tolist() == [True, True, False, True, True, False]
    by_probe = 1e-16 / height**2  # of ebc, beside 1e-14 of the instrument
    expected = -2e-6 + 1e-8 / height * (1 / by_probe) / (1 / by_probe + 1 / 1e-14)
    np.testing.assert_allclose(found.components[0, 3:5], [3e-6, expected], rtol=1e-6)
    np.testing.assert_allclose(found.covariance[0, 4, 4], 1 / (1 / by_probe + 1 / 1e-14), rtol=1e-4)
    scale = np.array([1e3, 1e3, 1.0])
    again = combine(motion, Seen(rows * scale[:, None], shown * scale, variance * scale**2))
    np.testing.assert_allclose(again.components, found.components, rtol=1e-9, atol=1e-20)


def test_the_bits_of_a_time_do_not_depend_on_how_many_there_are():
    draw = np.random.default_rng(3)
    rows = np.array([face(1.0, 0.08), radial(2.0, 0.1), radial(0.3, 0.2)])
    shown, variance = draw.normal(size=(40, 3)) * 1e-6, draw.uniform(1e-17, 1e-15, (40, 3))
    motion = known(40, exc=(1e-6, 1e-8), eac=(1e-6, 1e-7))
    whole = combine(motion, Seen(rows, shown, variance))
    for part in (slice(0, 1), slice(7, 12), slice(12, 40)):
        index = np.arange(40)[part]
        alone = combine(motion.at(index), Seen(rows, shown[part], variance[part]))
        assert (alone.components == whole.components[part]).all()
        assert (alone.covariance == whole.covariance[part]).all()


def test_what_is_known_stays_and_the_rest_is_as_by_all_together():
    """And with its true covariances: over 4000 draws, the error of what is new against that of what was known."""
    draw, count = np.random.default_rng(7), 4000
    rows = np.array([radial(0.0, 0.05), radial(0.0, 0.25), face(1.0, 0.05)])
    truth = np.array([1e-6, 0.0, 3e-7, 0.0, 5e-6, 0.0])
    motion = known(count, exc=(1e-6, 3e-8), eac=(0.0, 1e-7))
    motion.components[:, 0] += draw.normal(size=count) * 3e-8
    motion.components[:, 3] += draw.normal(size=count) * 1e-7
    std = np.array([2e-8, 1e-8, 1e-8])
    shown = rows @ truth + draw.normal(size=(count, 3)) * std
    variance = np.tile(std**2, (count, 1))
    found, joined = (each(motion, Seen(rows, shown, variance)) for each in (extend, combine))
    assert (found.components[:, [0, 3]] == motion.components[:, [0, 3]]).all()
    assert (found.covariance[:, 0, 0] == motion.covariance[:, 0, 0]).all()
    assert (found.components[:, [2, 4]] == joined.components[:, [2, 4]]).all()
    scale = np.array([1e-8, 1e-8, 1e-7, 1e-7])
    off = (found.components - truth)[:, [0, 2, 3, 4]] / scale
    stated = found.covariance[0][np.ix_([0, 2, 3, 4], [0, 2, 3, 4])] / np.outer(scale, scale)
    np.testing.assert_allclose(np.cov(off.T), stated, atol=5 * np.abs(stated).max() / np.sqrt(count))
    assert np.linalg.eigvalsh(stated).min() > 0


def test_disagreement_is_chi_square_of_what_is_redundant():
    draw, rows = np.random.default_rng(8), np.array([face(a, 0.08) for a in (0.0, 2.0, 4.0)] + [AXIAL, AXIAL])
    std, found = 1e-8, []
    for _ in range(600):
        shown = rows @ np.array([0.0, 0.0, 4e-7, 3e-6, -2e-6, 0.0]) + draw.normal(size=5) * std
        chi_square, freedom = disagreement(known(1, exc=(1e-6, 1e-8)), Seen(rows, shown[None], np.full((1, 5), std**2)))
        assert freedom == 2
        found.append(chi_square)
    assert np.mean(found) == pytest.approx(2.0, abs=5 * 2 / np.sqrt(600))
    one = np.array([radial(0.5, 0.1)])  # alone it contradicts nothing, though what it mixes is not told apart
    assert disagreement(known(1, exc=(1e-6, 1e-8)), Seen(one, np.array([[1e-6]]), np.full((1, 1), 1e-16))) == (
        pytest.approx(0.0, abs=1e-9),
        0,
    )


@pytest.mark.parametrize("seed", range(4))
def test_three_probes_at_120_degrees_contradict_one_another_by_their_sum_at_each_time(seed):
    """Closed form: the mean of such readings is no displacement, and has a third of the variance of one."""
    draw, std = np.random.default_rng(seed), 2e-8
    rows = np.array([radial(0.3 + 2 * np.pi * k / 3, 0.0) for k in range(3)])
    shown = draw.normal(size=(50, 3)) * 1e-7
    seen = Seen(rows, shown, np.full((50, 3), std**2))
    chi_square, freedom = disagreements(known(50), seen)
    assert freedom == 1
    np.testing.assert_allclose(chi_square, shown.sum(axis=1) ** 2 / (3 * std**2), rtol=1e-7)
    one = Seen(rows, shown[:1], seen.variance[:1])
    assert disagreement(known(1), one) == (chi_square[0], 1)
    found = combine(known(50), seen)
    angles = 0.3 + 2 * np.pi * np.arange(3) / 3
    np.testing.assert_allclose(found.components[:, 0], 2 / 3 * shown @ np.cos(angles), rtol=1e-7, atol=1e-15)
    np.testing.assert_allclose(found.components[:, 1], 2 / 3 * shown @ np.sin(angles), rtol=1e-7, atol=1e-15)
