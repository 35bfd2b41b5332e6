"""Assembly calibration recovers known errors from recordings made by the contract's formulas, and refuses the rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rotary_error_monitor.description.stage import Autocollimator, Encoder, StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.assembly import (
    ShaftRecording,
    estimate_mirror_assembly,
    estimate_ring_assembly,
)

RADIUS = 0.1
AZIMUTHS = {"a": 0.0, "b": np.pi, "c": np.pi / 2, "d": 3 * np.pi / 2}
STAGE = StageDescription(Encoder(RADIUS, 31488, 100, 3e-7, AZIMUTHS), Autocollimator(5e-4, 5e-7, 5e-7))
ECCENTRICITY, GRADUATION = (3.1e-5, -1.2e-5), {2: (-7e-7, 3.4e-6), 3: (2.3e-6, -5e-7)}
TILT, FLATNESS = (7.2e-5, 2.4e-5), {2: ((-6e-6, -2e-6), (1.5e-6, -4e-6))}
NOISE = 7e-7


def recording(heads="abcd", turns=3.0, both=True, seed=0, delay=0.0, offsets=0.0):
    generator = np.random.default_rng(seed)
    theta = np.linspace(0, 2 * np.pi * turns, 4000)
    speed = np.full(4000, 2.0)
    if both:
        theta, speed = np.concatenate([theta, theta[::-1]]), np.concatenate([speed, -speed])
    x = ECCENTRICITY[0] * np.cos(theta) - ECCENTRICITY[1] * np.sin(theta)
    y = ECCENTRICITY[0] * np.sin(theta) + ECCENTRICITY[1] * np.cos(theta)
    columns = []
    for i, name in enumerate(heads):
        phi = AZIMUTHS[name]
        error = sum(c * np.cos(k * (phi - theta)) + s * np.sin(k * (phi - theta)) for k, (c, s) in GRADUATION.items())
        columns.append(theta + (-x * np.sin(phi) + y * np.cos(phi)) / RADIUS + error + i * offsets)
    read = np.stack(columns, 1) + generator.normal(size=(len(theta), len(heads))) * NOISE
    old = theta - speed * delay
    tilt = np.stack(
        [
            TILT[0] * np.cos(old) - TILT[1] * np.sin(old) + 1e-5,
            TILT[0] * np.sin(old) + TILT[1] * np.cos(old) - 2e-5,
        ],
        1,
    )
    for k, (row_x, row_y) in FLATNESS.items():
        tilt[:, 0] += row_x[0] * np.cos(k * old) + row_x[1] * np.sin(k * old)
        tilt[:, 1] += row_y[0] * np.cos(k * old) + row_y[1] * np.sin(k * old)
    tilt += generator.normal(size=tilt.shape) * NOISE
    variances = np.full(read.shape, NOISE**2)
    return ShaftRecording(tuple(heads), read, variances, speed, tilt, np.full(tilt.shape, NOISE**2))


@pytest.mark.parametrize("heads", ["ab", "cd", "abc", "abcd"])
def test_ring_comes_back_within_its_uncertainty(heads):
    # with two opposed heads only odd orders show
    errors = []
    for seed in range(20):
        found = estimate_ring_assembly(STAGE, recording(heads, seed=seed, offsets=1e-5), 3)
        errors += list((np.array(found.eccentricity) - ECCENTRICITY) / found.eccentricity_std)
        for row, std in zip(found.graduation, found.graduation_std, strict=True):
            errors += list((np.array([row.cos, row.sin]) - GRADUATION[row.order]) / std)
        assert {row.order for row in found.graduation} == ({3} if len(heads) == 2 else {2, 3})
        assert found.eccentricity_std[0] < 3e-9
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.06)
    assert np.max(np.abs(errors)) < 4.5


def test_orders_that_no_head_difference_shows_are_named():
    assert estimate_ring_assembly(STAGE, recording(), 8).hidden_orders == (4, 8)
    assert estimate_ring_assembly(STAGE, recording("ab"), 6).hidden_orders == (2, 4, 6)


def test_mirror_comes_back_with_its_delay():
    errors = []
    for seed in range(20):
        found = estimate_mirror_assembly(recording(seed=seed, delay=2e-3), orders=(2,))
        errors += list((np.array(found.tilt) - TILT) / found.tilt_std)
        errors.append((found.delay - 2e-3) / found.delay_std)
        np.testing.assert_allclose(found.flatness[0].x, FLATNESS[2][0], atol=5 * found.flatness_std[0])
        np.testing.assert_allclose(found.line_of_sight, (1e-5, -2e-5), atol=1e-7)
        assert found.noise_ratio == pytest.approx(1.0, abs=0.05)
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.06)


def test_one_direction_tells_the_mirror_only_with_a_known_delay():
    one_way = recording(both=False, delay=1e-3)
    with pytest.raises(InputError, match="record both directions, or give the delay"):
        estimate_mirror_assembly(one_way, orders=(2,))
    found = estimate_mirror_assembly(one_way, orders=(2,), delay=1e-3)
    np.testing.assert_allclose(found.tilt, TILT, atol=1e-7)


def test_unmodelled_orders_widen_the_uncertainty():
    clean = estimate_ring_assembly(STAGE, recording(), 3)
    blind = estimate_ring_assembly(STAGE, recording(), 1)
    assert blind.noise_ratio > 2
    assert blind.eccentricity_std[0] > 2 * clean.eccentricity_std[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turns": 0.8}, r"covers 288.0° of rotation; a whole turn"),
        ({"heads": "a"}, "1 read head in the recording"),
    ],
)
def test_what_the_recording_cannot_determine_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        estimate_ring_assembly(STAGE, recording(**change), 3)


def test_heads_at_one_place_are_refused():
    crowded = dataclasses.replace(STAGE, encoder=dataclasses.replace(STAGE.encoder, azimuths={"a": 0.0, "b": 1e-4}))
    with pytest.raises(InputError, match="stand at one place"):
        estimate_ring_assembly(crowded, recording("ab"), 3)


def test_a_recording_without_autocollimator_is_refused():
    bare = dataclasses.replace(recording(), tilt=None)
    with pytest.raises(InputError, match="no autocollimator samples"):
        estimate_mirror_assembly(bare)
