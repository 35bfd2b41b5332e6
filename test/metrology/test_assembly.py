"""Ring and mirror from recordings made by the contract's formulas: right within their uncertainty, or refused.

The recordings are not the package's: `test/simulated_shaft.py` makes them sample by sample, with departures. Rates are
over many seeds: of 100 standard uncertainties that hold, 95 errors are within 1.96 of them.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable

import numpy as np
import pytest
import simulated_shaft
from draws import seeds

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.mirror_assembly import DELAY_STD, doubt_mirror, estimate_mirror_assembly
from rotary_error_monitor.metrology.ring_assembly import estimate_ring_assembly
from rotary_error_monitor.metrology.shaft_recording import ShaftRecording, record_shaft

GRADUATION = {2: (-7e-7, 3.2e-6), 3: (2.1e-6, -5e-7), 11: (0.0, 8e-7)}
FLATNESS = {2: (-6e-6, -2.2e-6, 1.5e-6, -4e-6), 3: (-3.9e-6, -4e-7, 1e-7, 8e-7), 9: (1e-6, 0.0, 0.0, -1e-6)}
SHAFT = simulated_shaft.Shaft(graduation=GRADUATION, flatness=FLATNESS)
BOTH_WAYS = simulated_shaft.reversing((np.pi / 2, 2 * np.pi), 4.5)


def describe(shaft, graduation=(), flatness=()) -> StageDescription:
    lines = round(2 * np.pi / shaft.head_step / 100)
    encoder = Encoder(shaft.radius, lines, 100, SHAFT.head_noise, dict(shaft.azimuths), graduation=tuple(graduation))
    collimator = Autocollimator(shaft.tilt_range, shaft.tilt_step, SHAFT.tilt_noise)
    return StageDescription(encoder, collimator, Mirror((0.0, 0.0), tuple(flatness)))


def recorded(shaft, motion, seed: int, stage: StageDescription | None = None) -> ShaftRecording:
    return record_shaft(stage or describe(shaft), *simulated_shaft.record(shaft, *motion, seed))


class Errors:
    """Errors over their standard uncertainty, from many recordings."""

    def __init__(self) -> None:
        self.ring: list[float] = []
        self.mirror: list[float] = []
        self.strays = 0
        self.missed = 0

    def add_ring(self, shaft, ring) -> None:
        self.ring += list((np.array(ring.eccentricity) - shaft.eccentricity) / ring.eccentricity_std)
        found = {row.order: (row, std) for row, std in zip(ring.graduation, ring.graduation_std, strict=True)}
        for order, truth in shaft.graduation.items():
            if order in found:
                row, std = found[order]
                self.ring += list((np.array([row.cos, row.sin]) - truth) / std)
        self.strays += len(set(found) - set(shaft.graduation))
        self.missed += len(set(shaft.graduation) - set(found) - set(ring.hidden_orders))

    def add_mirror(self, shaft, mirror) -> None:
        self.mirror += list((np.array(mirror.tilt) - shaft.tilt) / mirror.tilt_std)
        self.mirror.append((mirror.delay - shaft.delay) / mirror.delay_std)
        for row, std in zip(mirror.flatness, mirror.flatness_std, strict=True):
            if row.order in shaft.flatness:
                self.mirror += list((np.array([*row.x, *row.y]) - shaft.flatness[row.order]) / std)
        found = {row.order for row in mirror.flatness}
        self.strays += len(found - set(shaft.flatness))
        self.missed += len(set(shaft.flatness) - found)

    def check(self, least: float) -> None:
        for errors in (np.array(self.ring), np.array(self.mirror)):
            if errors.size:
                assert np.mean(np.abs(errors) < 1.96) >= least
                assert np.sqrt(np.mean(errors**2)) < 1.3


DEPARTURES: dict[str, tuple[dict[str, object], object]] = {
    "both ways": ({"delay": 1e-3}, BOTH_WAYS),
    "noise of the heads and of the air wanders": ({"head_colour": 0.1, "tilt_colour": 0.3}, BOTH_WAYS),
    "slowly": ({"head_colour": 0.3, "tilt_colour": 1.0}, simulated_shaft.reversing((1.0,), 15.0)),
    "coarse rate": ({"head_rate": 30.0, "tilt_rate": 20.0}, simulated_shaft.reversing((0.5, 1.0), 7.5)),
    "fast rate": ({"head_rate": 3000.0, "tilt_rate": 2000.0}, simulated_shaft.reversing((2.0,), 4.0)),
    "uneven speed, one way": ({"delay": -2e-3}, simulated_shaft.one_way(1.6, 10.0, 0.3)),
    "a turn and a bit": ({}, simulated_shaft.one_way(1.0, 6.5)),
    "three heads": ({"azimuths": {"a": 0.0, "b": np.pi, "c": np.pi / 2}}, BOTH_WAYS),
    "two heads at a right angle": ({"azimuths": {"a": 0.0, "c": np.pi / 2}}, BOTH_WAYS),
    "two opposed heads": ({"azimuths": {"a": 0.0, "b": np.pi}}, BOTH_WAYS),
    "heads whole turns apart": ({"turns_off": {"b": 3, "c": -1}}, BOTH_WAYS),
    "24 stops": ({}, simulated_shaft.stops(24, 0.4, 0.2)),
    "24 stops, read only there": ({"standing": True, "jitter": 0.0}, simulated_shaft.stops(24, 0.4, 0.2)),
}


@pytest.mark.parametrize("departure", DEPARTURES)
def test_standard_uncertainties_hold(departure: str) -> None:
    changes, motion = DEPARTURES[departure]
    errors = Errors()
    for seed in seeds(12):
        rng = np.random.default_rng(seed)
        eccentricity, tilt = tuple(2e-5 * rng.normal(size=2)), tuple(5e-5 * rng.normal(size=2))
        shaft = dataclasses.replace(SHAFT, eccentricity=eccentricity, tilt=tilt, **changes)
        stage = describe(shaft)
        recording = recorded(shaft, motion, seed, stage)
        ring, mirror = estimate_ring_assembly(stage, recording), estimate_mirror_assembly(stage, recording)
        assert ring.fit.fits
        assert mirror.fit.fits
        errors.add_ring(shaft, ring)
        errors.add_mirror(shaft, mirror)
        if "24" not in departure:
            assert ring.fit.ratio == pytest.approx(1.0, abs=0.3)
    # about 180 errors, or half as many: 0.88 is four standard deviations below 0.95, or three
    errors.check(0.88)
    # a false alarm of 0.1 % for ring and for mirror in each recording
    assert errors.strays <= 1
    if "24" not in departure:
        assert errors.missed <= len(seeds(12)) * (1 if shaft.head_colour else 0)


def test_one_direction_counts_what_is_unknown_of_the_delay() -> None:
    """At one speed only, the mirror's direction is known as well as the delay, and no better."""
    errors = Errors()
    for seed in range(25):
        delay = DELAY_STD * np.random.default_rng(seed + 100).normal()
        shaft = dataclasses.replace(SHAFT, delay=delay)
        stage = describe(shaft)
        mirror = estimate_mirror_assembly(stage, recorded(shaft, simulated_shaft.one_way(1.3, 10.0), seed, stage))
        expected = 1.3 * DELAY_STD * np.array(SHAFT.tilt[::-1])
        np.testing.assert_allclose(mirror.tilt_std, np.hypot(expected, mirror.tilt_std[0] * 0.2), rtol=0.3)
        errors.mirror += list((np.array(mirror.tilt) - shaft.tilt) / mirror.tilt_std)
        errors.mirror.append((mirror.delay - delay) / mirror.delay_std)
    assert np.mean(np.abs(errors.mirror) < 1.96) >= 0.85
    known = estimate_mirror_assembly(
        stage, recorded(shaft, simulated_shaft.one_way(1.3, 10.0), 0, stage), delay=(delay, 0.0)
    )
    assert max(known.tilt_std) < 5e-8
    np.testing.assert_allclose(known.tilt, shaft.tilt, atol=5 * max(known.tilt_std))


def test_orders_far_up_are_found_and_the_residual_is_the_noise() -> None:
    """A ring with orders above 8, a mirror with orders above 3."""
    shaft = dataclasses.replace(
        SHAFT,
        graduation={**GRADUATION, 17: (6e-7, 0.0), 26: (0.0, -6e-7), 38: (5e-7, 5e-7)},
        flatness={**FLATNESS, 5: (0.0, 3e-6, 3e-6, 0.0), 13: (1e-6, 1e-6, 0.0, 0.0), 31: (0.0, 0.0, 1e-6, 0.0)},
    )
    stage, errors = describe(shaft), Errors()
    for seed in range(6):
        recording = recorded(shaft, BOTH_WAYS, seed, stage)
        ring, mirror = estimate_ring_assembly(stage, recording), estimate_mirror_assembly(stage, recording)
        errors.add_ring(shaft, ring)
        errors.add_mirror(shaft, mirror)
        assert ring.fit.ratio == pytest.approx(1.0, abs=0.1)
        assert mirror.fit.ratio == pytest.approx(1.0, abs=0.1)
    assert errors.missed == 0
    assert errors.strays <= 1
    errors.check(0.88)


def test_a_recording_of_noise_alone_shows_an_order_once_in_a_thousand() -> None:
    shaft = simulated_shaft.Shaft(eccentricity=(0.0, 0.0), tilt=(0.0, 0.0))
    errors, motion = Errors(), simulated_shaft.one_way(3.0, 4.3)
    for seed in seeds(60):
        stage = describe(shaft)
        recording = recorded(shaft, motion, seed, stage)
        errors.add_ring(shaft, estimate_ring_assembly(stage, recording))
        errors.add_mirror(shaft, estimate_mirror_assembly(stage, recording))
    # 120 fits at 0.1 %: more than two have a probability of 0.03 %
    assert errors.strays <= 2


def test_rounding_that_repeats_in_every_turn_counts() -> None:
    """Steps of 13 arcsec without noise, a speed in step with the sampling: the errors are the same turn by turn."""
    shaft = dataclasses.replace(
        SHAFT, head_step=2 * np.pi / 100000, tilt_step=2e-5, tilt_noise=1e-6, head_noise=0.0, jitter=0.0
    )
    errors = Errors()
    for seed in range(10):
        rng = np.random.default_rng(seed)
        turned = dataclasses.replace(
            shaft, eccentricity=tuple(2.4e-5 * rng.normal(size=2)), tilt=tuple(7e-5 * rng.normal(size=2))
        )
        stage = describe(turned)
        stage = dataclasses.replace(stage, autocollimator=dataclasses.replace(stage.autocollimator, noise=1e-6))
        recording = recorded(turned, BOTH_WAYS, seed, stage)
        errors.add_ring(turned, estimate_ring_assembly(stage, recording))
        errors.add_mirror(turned, estimate_mirror_assembly(stage, recording))
    for found in (errors.ring, errors.mirror):
        assert np.mean(np.abs(found) < 1.96) >= 0.85


def test_orders_that_cannot_be_told_are_kept_and_taken_into_account() -> None:
    hidden = {4: (3e-6, 2e-6), 2: (-7e-7, 3.2e-6), 300: (1e-6, 0.0)}
    shaft = dataclasses.replace(SHAFT, graduation={**GRADUATION, **hidden})
    rows = [AngularHarmonic(order, *values) for order, values in hidden.items()]
    far = PlanarHarmonic(300, (1e-6, 0.0), (0.0, 1e-6))
    stage = describe(shaft, rows, [far])
    recording = recorded(shaft, BOTH_WAYS, 0, stage)
    ring, mirror = estimate_ring_assembly(stage, recording), estimate_mirror_assembly(stage, recording)
    assert ring.kept == (rows[0], rows[2])
    assert 2 in {row.order for row in ring.graduation}
    assert mirror.kept == (far,)
    two = dataclasses.replace(shaft, azimuths={"a": 0.0, "b": np.pi})
    stage = describe(two, rows)
    ring = estimate_ring_assembly(stage, recorded(two, BOTH_WAYS, 0, stage))
    assert [row.order for row in ring.kept] == [4, 2, 300]
    assert all(row.order % 2 for row in ring.graduation)
    errors = Errors()
    errors.add_ring(dataclasses.replace(two, graduation=GRADUATION), ring)
    assert np.max(np.abs(errors.ring)) < 4.5


def test_what_stood_in_the_file_and_is_not_there_is_told_to_be_small() -> None:
    """An order that the recording can tell is measured, however small it is."""
    stage = describe(SHAFT, [AngularHarmonic(6, 1e-6, 1e-6)], [PlanarHarmonic(1, (1e-6, 0.0), (0.0, -1e-6))])
    recording = recorded(SHAFT, BOTH_WAYS, 3, stage)
    ring, mirror = estimate_ring_assembly(stage, recording), estimate_mirror_assembly(stage, recording)
    row, std = next((r, s) for r, s in zip(ring.graduation, ring.graduation_std, strict=True) if r.order == 6)
    assert abs(row.cos) < 4.5 * std[0] < 1e-7
    assert mirror.flatness[0].order == 1
    assert abs(mirror.flatness[0].x[0]) < 4.5 * mirror.flatness_std[0] < 2e-7


def spindle(seed: int, size: float) -> Callable[..., np.ndarray]:
    """Error motion of orders 1, 2, 3 and 5, as m or rad in x + i y."""
    rows = {k: size / k * np.random.default_rng(seed).normal(size=4) for k in (1, 2, 3, 5)}
    return lambda theta, t, way: sum(
        (r[0] * np.cos(k * theta) + r[1] * np.sin(k * theta))
        + 1j * (r[2] * np.cos(k * theta) + r[3] * np.sin(k * theta))
        for k, r in rows.items()
    )


def pushes(seed: int, size: float) -> Callable[..., np.ndarray]:
    """A force that now and then pushes the shaft by `size`."""
    rng = np.random.default_rng(seed)
    centres, ways = rng.uniform(2, 16, 4), np.exp(1j * rng.uniform(0, 2 * np.pi, 4))
    return lambda theta, t, way: (
        size * sum(w * np.exp(-(((t - c) / 0.5) ** 2)) for c, w in zip(centres, ways, strict=True))
    )


def line(seed: int, size: float) -> complex:
    return complex(size * np.exp(1j * np.random.default_rng(seed).uniform(0, 2 * np.pi)))


MISFITS: dict[str, tuple[Callable[[int], dict[str, object]], str]] = {
    "a spindle of 3 um": (
        lambda seed: {"radial": spindle(seed, 3e-6), "lean": spindle(seed + 99, 1e-5)},
        r"order 1 of the rotation",
    ),
    "a spindle of 0.5 um": (
        lambda seed: {"radial": spindle(seed, 5e-7), "lean": spindle(seed + 99, 5e-6)},
        r"order [125] of the rotation",
    ),
    "a drift of 1 um": (lambda seed: {"radial": lambda a, t, w: line(seed, 1e-6) * t / 18}, "a trend over time"),
    "pushes of 1 um": (lambda seed: {"radial": pushes(seed, 1e-6)}, "neither the rotation nor a slow change|a trend"),
    "play of 1 um": (lambda seed: {"radial": lambda a, t, w: line(seed, 5e-7) * w}, "the direction of rotation"),
}


@pytest.mark.parametrize("misfit", MISFITS)
def test_what_is_not_between_centres_does_not_fit_and_its_uncertainty_covers(misfit: str) -> None:
    change, reason = MISFITS[misfit]
    errors = Errors()
    for seed in range(8):
        shaft = dataclasses.replace(SHAFT, **change(seed))
        stage = describe(shaft)
        recording = recorded(shaft, BOTH_WAYS, seed, stage)
        ring = estimate_ring_assembly(stage, recording)
        mirror = doubt_mirror(estimate_mirror_assembly(stage, recording), ring)
        assert not ring.fit.fits
        named = ", ".join(words for words, _ in ring.fit.causes())
        assert re.search(reason, named), named
        errors.ring += list((np.array(ring.eccentricity) - shaft.eccentricity) / ring.eccentricity_std)
        errors.mirror += list((np.array(mirror.tilt) - shaft.tilt) / mirror.tilt_std)
    assert np.mean(np.abs(errors.ring) < 1.96) >= 0.85
    assert np.mean(np.abs(errors.mirror) < 1.96) >= 0.85


def test_an_error_motion_below_the_noise_of_a_reading_is_allowed_for() -> None:
    """30 nm where a reading has 65 nm: it fits, and the uncertainty has it in."""
    errors = Errors()
    for seed in range(12):
        shaft = dataclasses.replace(SHAFT, radial=spindle(seed, 3e-8), lean=spindle(seed + 99, 3e-7))
        stage = describe(shaft)
        recording = recorded(shaft, BOTH_WAYS, seed, stage)
        ring = estimate_ring_assembly(stage, recording)
        mirror = doubt_mirror(estimate_mirror_assembly(stage, recording), ring)
        assert ring.fit.fits
        errors.ring += list((np.array(ring.eccentricity) - shaft.eccentricity) / ring.eccentricity_std)
        errors.mirror += list((np.array(mirror.tilt) - shaft.tilt) / mirror.tilt_std)
    assert np.mean(np.abs(errors.ring) < 1.96) >= 0.8
    assert np.mean(np.abs(errors.mirror) < 1.96) >= 0.8


def test_another_stage_does_not_fit() -> None:
    stage, recording = describe(SHAFT), recorded(SHAFT, BOTH_WAYS, 0)
    azimuths = {**SHAFT.azimuths, "a": SHAFT.azimuths["c"], "c": SHAFT.azimuths["a"]}
    swapped = dataclasses.replace(stage, encoder=dataclasses.replace(stage.encoder, azimuths=azimuths))
    ring = estimate_ring_assembly(swapped, recording)
    assert not ring.fit.fits
    assert ring.fit.causes()[0][0] == "order 1 of the rotation"
    backwards = dataclasses.replace(recording, readings=recording.readings * [1, 1, 1, -1])
    assert not estimate_ring_assembly(stage, backwards).fit.fits
    stuck = recording.readings.copy()
    stuck[:, 3] = stuck[0, 3]
    assert not estimate_ring_assembly(stage, dataclasses.replace(recording, readings=stuck)).fit.fits
    lost = recording.readings.copy()
    lost[len(lost) // 2 :, 1] += 1e-4
    ring = estimate_ring_assembly(stage, dataclasses.replace(recording, readings=lost))
    assert not ring.fit.fits


def test_an_autocollimator_that_drifts_does_not_fit() -> None:
    shaft = dataclasses.replace(SHAFT, lean=lambda theta, t, way: 1e-5 * (1 + 1j) * t / 18)
    mirror = estimate_mirror_assembly(describe(shaft), recorded(shaft, BOTH_WAYS, 0))
    assert not mirror.fit.fits
    assert mirror.fit.causes()[0][0] == "a trend over time"
    error = np.abs(np.array(mirror.tilt) - shaft.tilt)
    assert np.all(error < 2 * np.array(mirror.tilt_std))


def test_samples_at_the_end_of_the_range_are_left_out() -> None:
    shaft = dataclasses.replace(SHAFT, tilt_range=7.6e-5, flatness={2: FLATNESS[2]})
    stage = describe(shaft)
    recording = recorded(shaft, BOTH_WAYS, 0, stage)
    assert recording.tilt_valid is not None
    assert 0.3 < recording.tilt_valid.mean() < 0.95
    mirror = estimate_mirror_assembly(stage, recording)
    np.testing.assert_allclose(mirror.tilt, shaft.tilt, atol=5 * max(mirror.tilt_std))
    assert max(mirror.tilt_std) < 1e-7
    none = dataclasses.replace(recording, tilt_valid=np.zeros(len(recording.readings), np.bool_))
    with pytest.raises(InputError, match="at the end of its range all the time"):
        estimate_mirror_assembly(stage, none)


def test_a_stuck_autocollimator_is_refused() -> None:
    recording = recorded(SHAFT, BOTH_WAYS, 0)
    assert recording.tilt is not None
    stuck = dataclasses.replace(recording, tilt=np.full_like(recording.tilt, 3e-5))
    with pytest.raises(InputError, match=r"tilt_x is 3e-05 rad all the time: it is stuck"):
        estimate_mirror_assembly(describe(SHAFT), stuck)


def test_what_the_recording_cannot_determine_is_refused() -> None:
    stage = describe(SHAFT)
    with pytest.raises(InputError, match=r"covers 28\d\.\d° of rotation; a whole turn"):
        estimate_ring_assembly(stage, recorded(SHAFT, simulated_shaft.one_way(1.0, 5.0), 0))
    one = dataclasses.replace(SHAFT, azimuths={"a": 0.0})
    with pytest.raises(InputError, match="1 read head in the recording"):
        estimate_ring_assembly(stage, recorded(one, BOTH_WAYS, 0, stage))
    crowded = dataclasses.replace(SHAFT, azimuths={"a": 0.0, "b": 1e-4})
    with pytest.raises(InputError, match="stand at one place"):
        estimate_ring_assembly(describe(crowded), recorded(crowded, BOTH_WAYS, 0))
    bare = dataclasses.replace(recorded(SHAFT, BOTH_WAYS, 0), tilt=None)
    with pytest.raises(InputError, match="no autocollimator samples"):
        estimate_mirror_assembly(stage, bare)
    three = dataclasses.replace(SHAFT, standing=True, jitter=0.0)
    with pytest.raises(InputError, match="leave too much of the turn out"):
        estimate_ring_assembly(stage, recorded(three, simulated_shaft.stops(2, 2.0, 0.5), 0))
    heads, tilt = simulated_shaft.record(SHAFT, *BOTH_WAYS, 0)
    short = {name: (times[:50], values[:50]) for name, (times, values) in heads.items()}
    with pytest.raises(InputError, match=r"the streams overlap for .* s only"):
        record_shaft(stage, short, tilt)
    with pytest.raises(InputError, match="a stream of a single sample"):
        record_shaft(stage, heads, (tilt[0][:1], tilt[1][:1]))


def test_without_noise_the_ring_is_exact() -> None:
    """Second-order terms of some layouts (the mean of their heads is no rotation) are gone."""
    for azimuths in ({"a": 0.0, "c": 1.2}, {"a": 0.3, "b": 1.9, "c": 4.0}):
        shaft = dataclasses.replace(SHAFT, azimuths=azimuths, head_noise=0.0, head_step=0.0, jitter=0.0)
        stage = dataclasses.replace(describe(dataclasses.replace(shaft, head_step=SHAFT.head_step)))
        ring = estimate_ring_assembly(stage, recorded(shaft, simulated_shaft.one_way(1.3, 10.0), 0, stage))
        np.testing.assert_allclose(ring.eccentricity, shaft.eccentricity, atol=5e-11)
