"""Spliced profiles against the truth of synthetic guideways; refusals and warnings."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.reference_mirror import (
    MIRROR_ORDERS,
    MIRROR_RANGE,
    PlacementReadings,
    ReferenceMirror,
)
from rotary_error_monitor.metrology.splicing import SplicedProfile, splice_segments

Array = NDArray[np.float64]
SPACING = 5e-3


def wave(rng: np.random.Generator, length: float, error: float, orders: range) -> tuple[Array, Array]:
    """Table of a smooth random curve of a given straightness error about its least squares line."""
    x = np.linspace(0, length, 4001)
    curve = sum(
        rng.normal() / order * np.cos(np.pi * order * x / length + rng.uniform(0, 2 * np.pi)) for order in orders
    )
    curve = curve - np.polyval(np.polyfit(x, curve, 1), x)
    return x, curve * error / np.ptp(curve)


class Guideway:
    """A guideway and a mirror of known form, measured in placements that overlap by a share of the mirror."""

    def __init__(
        self,
        seed: int,
        placements: int,
        *,
        mirror_length: float = 0.44,
        overlap: float = 0.18,
        straightness: float = 5.8e-6,
        flatness: float = 0.08e-6,
        noise: float = 60e-9,
        spacing: float = 1e-3,
        runs: int = 10,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        step = mirror_length * (1 - overlap)
        self.starts = step * np.arange(placements)
        self.length = float(self.starts[-1]) + mirror_length
        self.table = wave(self.rng, self.length, straightness, range(1, 9))
        self.mirror_table = wave(self.rng, mirror_length, flatness, range(1, 5))
        self.mirror_length, self.noise, self.spacing, self.runs = mirror_length, noise, spacing, runs

    def truth(self, x: Array) -> Array:
        return np.interp(x, *self.table)

    def segments(self) -> list[PlacementReadings]:
        """Each placement measured several times at irregular positions, the mirror put down anew each time."""
        return [self.segment(start) for start in self.starts.tolist()]

    def segment(self, start: float, *, turned: bool = False) -> PlacementReadings:
        count = round(self.mirror_length / self.spacing) * self.runs
        x = start + np.sort(self.rng.uniform(0, self.mirror_length, count))
        form = np.interp(x - start, *self.mirror_table)
        placed = self.rng.normal(0, 20e-6) * (x - start) + self.rng.normal(0, 10e-6)
        y = self.truth(x) + (-form if turned else form) + placed + self.noise * self.rng.normal(size=count)
        return PlacementReadings(x, y, self.noise, start, turned)


def level(x: Array, y: Array) -> Array:
    return y - np.polyval(np.polyfit(x, y, 1), x)


def error_of(result: SplicedProfile, guideway: Guideway) -> Array:
    truth = level(result.positions, guideway.truth(result.positions))
    return result.straightness().deviations - truth


@pytest.mark.few(3)
@pytest.mark.parametrize("placements", range(2, 11))
def test_error_is_what_the_covariance_says(placements: int) -> None:
    """Sensor 60 nm, mirror 0.08 µm of unknown form, straightness 5.8 µm, many seeds."""
    ratios = []
    for seed in range(30):
        guideway = Guideway(100 * placements + seed, placements)
        result = splice_segments(guideway.segments(), ReferenceMirror(0.44, 0.08e-6), spacing=SPACING)
        variance = np.mean(np.diag(result.deviation_covariance()))
        ratios.append(np.mean(error_of(result, guideway) ** 2) / variance)
        assert result.warnings == ()
    # The curvature of a mirror has one degree of freedom a seed: the mean of 30 scatters by 13 %.
    assert 0.6 < np.sqrt(np.mean(ratios)) < 1.2


def test_two_segments_with_a_calibrated_mirror_stay_below_a_tenth_of_a_micrometre() -> None:
    for seed in range(30):
        guideway = Guideway(seed, 2)
        mirror = ReferenceMirror(0.44, 5e-9, np.column_stack(guideway.mirror_table))
        result = splice_segments(guideway.segments(), mirror, spacing=SPACING)
        assert np.abs(error_of(result, guideway)).max() <= 0.1e-6


def test_two_segments_with_the_mirror_as_it_is() -> None:
    errors = []
    for seed in range(30):
        guideway = Guideway(seed, 2)
        errors.append(
            error_of(splice_segments(guideway.segments(), ReferenceMirror(0.44, 0.08e-6), spacing=SPACING), guideway)
        )
    assert np.sqrt(np.mean(np.square([np.sqrt(np.mean(e**2)) for e in errors]))) <= 0.1e-6
    assert max(np.abs(e).max() for e in errors) <= 0.3e-6  # Zhou et al. 2023, Figure 11


@pytest.mark.parametrize("flatness", [0.08e-6, 1e-6])
def test_a_placement_with_the_mirror_turned_makes_any_mirror_do(flatness: float) -> None:
    """Nothing is known of the mirror, however curved: two segments to 0.1 µm, errors as the covariance says."""
    ratios = []
    for seed in range(20):
        guideway = Guideway(seed, 2, flatness=flatness)
        segments = [*guideway.segments(), guideway.segment(float(guideway.starts[0]), turned=True)]
        result = splice_segments(segments, ReferenceMirror(0.44, None), spacing=SPACING)
        error = error_of(result, guideway)
        assert np.abs(error).max() <= 0.1e-6
        assert result.warnings == ()
        ratios.append(np.mean(error**2) / np.mean(np.diag(result.deviation_covariance())))
    assert 0.6 < np.sqrt(np.mean(ratios)) < 1.2


@pytest.mark.parametrize("placements", [3, 6, 10])
def test_turned_placements_keep_the_error_small_over_many_joints(placements: int) -> None:
    ratios, largest = [], []
    for seed in range(6):
        guideway = Guideway(100 * placements + seed, placements)
        turned = [guideway.segment(start, turned=True) for start in guideway.starts.tolist()]
        result = splice_segments([*guideway.segments(), *turned], ReferenceMirror(0.44, None), spacing=SPACING)
        error = error_of(result, guideway)
        largest.append(np.abs(error).max())
        ratios.append(np.mean(error**2) / np.mean(np.diag(result.deviation_covariance())))
    assert np.median(largest) <= 0.2e-6  # 2.4 µm at ten placements with the mirror one way up
    assert np.sqrt(np.mean(ratios)) < 1.7  # six seeds, of little more than one degree of freedom each


@pytest.mark.parametrize("placements", [2, 4, 6])
def test_overlaps_show_the_mirror_but_for_its_curvature(placements: int) -> None:
    for seed in range(6):
        guideway = Guideway(100 * placements + seed, placements)
        result = splice_segments(guideway.segments(), ReferenceMirror(0.44, 0.08e-6), spacing=SPACING)
        error = error_of(result, guideway)
        curved = error - np.polyval(np.polyfit(result.positions, error, 2), result.positions)
        assert np.abs(curved).max() <= 0.12e-6


def test_spliced_and_direct_routes_agree() -> None:
    """Zhou et al. 2023, Figure 11: mirror No. 1 (440 mm, 0.08 µm) twice against No. 2 (840 mm, 0.12 µm) once."""
    largest = []
    for seed in range(10):
        guideway = Guideway(seed, 2, overlap=80 / 440)
        spliced = splice_segments(guideway.segments(), ReferenceMirror(0.44, 0.08e-6), spacing=SPACING)
        other = Guideway(1000 + seed, 1, mirror_length=0.84, flatness=0.12e-6)
        other.length, other.table = guideway.length, guideway.table
        x = np.linspace(0, guideway.length, 8001)
        form = np.interp(x, *other.mirror_table)
        y = guideway.truth(x) + form + 60e-9 * other.rng.normal(size=x.size)
        direct = splice_segments([PlacementReadings(x, y, 60e-9)], ReferenceMirror(0.84, 0.12e-6), spacing=SPACING)
        assert direct.overlaps == ()
        both = np.interp(spliced.positions, direct.positions, direct.straightness().deviations)
        difference = spliced.straightness().deviations - both
        largest.append(np.abs(difference).max())
        variance = np.diag(spliced.deviation_covariance()).mean() + np.diag(direct.deviation_covariance()).mean()
        assert np.mean(difference**2) <= 9 * variance
    # The paper saw 0.3 µm once; mirrors of other forms scatter about such a value.
    assert np.median(largest) <= 0.3e-6


def test_uncertainty_grows_with_every_joint() -> None:
    guideway = Guideway(3, 6)
    result = splice_segments(guideway.segments(), ReferenceMirror(0.44, 0.08e-6), spacing=SPACING)
    middles = guideway.starts + 0.22
    uncertainty = np.interp(middles, result.positions, np.sqrt(np.diag(result.covariance)))
    assert np.all(np.diff(uncertainty) > 0)
    assert len(result.overlaps) == 5
    for overlap in result.overlaps:
        assert overlap.share == pytest.approx(0.18, abs=0.01)
        assert overlap.probability > 1e-3
        assert overlap.difference == pytest.approx(overlap.expected, rel=0.7)


def test_order_of_segments_and_of_samples_does_not_matter() -> None:
    guideway = Guideway(4, 3)
    segments = guideway.segments()
    mirror = ReferenceMirror(0.44, 0.08e-6)
    result = splice_segments(segments, mirror, spacing=SPACING)
    shuffled = [
        PlacementReadings(s.positions[::-1], s.readings[::-1], s.noise, s.start)
        for s in (segments[2], segments[0], segments[1])
    ]
    other = splice_segments(shuffled, mirror, spacing=SPACING)
    np.testing.assert_allclose(other.profile, result.profile, rtol=0, atol=1e-14)
    np.testing.assert_allclose(other.slopes, result.slopes[[2, 0, 1]], rtol=0, atol=1e-14)


def test_placements_are_found_without_noise() -> None:
    """Equation 1 with a true rotation: slopes and heights of the placements come back."""
    x = np.linspace(0, 0.44, 441)
    shape = lambda p: 2e-6 * np.sin(9 * p)  # noqa: E731
    first = PlacementReadings(x, shape(x), 1e-9)
    second = PlacementReadings(x + 0.36, shape(x + 0.36) + 30e-6 * (x + 0.36) - 4e-6, 1e-9)
    result = splice_segments([first, second], ReferenceMirror(0.44, None), spacing=SPACING)
    assert result.slopes[1] == pytest.approx(30e-6, rel=1e-4)
    assert result.offsets[1] == pytest.approx(-4e-6, rel=1e-3)
    np.testing.assert_allclose(result.profile, shape(result.positions), atol=1e-9)


def test_rotation_of_equation_1_is_a_slope_to_second_order() -> None:
    """The linear model against Equation 1 with both sines of opposite sign, at a hundred microradians and 10 µm."""
    alpha, shift = 100e-6, 10e-6
    x = np.linspace(0, 0.44, 45)
    y = 6e-6 * np.cos(8 * x)
    rotation = np.array([[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]])
    turned = rotation @ np.stack([x, y]) + np.array([[0.0], [shift]])
    np.testing.assert_allclose(np.interp(turned[0], x, y + alpha * x + shift), turned[1], atol=1e-10)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_short_overlap_is_warned_of() -> None:
    result = splice_segments(Guideway(5, 2, overlap=0.1).segments(), ReferenceMirror(0.44, 0.08e-6), spacing=SPACING)
    assert len(result.warnings) == 1
    assert "segments 1 and 2 share 10.0% of the mirror's length; 15% is good practice" in result.warnings[0]


def test_unknown_mirror_that_is_flat_is_warned_of_and_one_that_is_not_is_refused() -> None:
    flat = Guideway(6, 2, flatness=1e-12)
    result = splice_segments(flat.segments(), ReferenceMirror(0.44, None), spacing=SPACING)
    assert any("flatness is unknown" in warning for warning in result.warnings)
    for seed in range(6, 12):
        curved = Guideway(seed, 2, flatness=1e-6).segments()
        with pytest.raises(InputError, match="flatness is unknown; have the mirror calibrated"):
            splice_segments(curved, ReferenceMirror(0.44, None), spacing=SPACING)


def test_noise_larger_than_stated_shows_in_the_overlap() -> None:
    segments = [PlacementReadings(s.positions, s.readings, 10e-9, s.start) for s in Guideway(7, 2).segments()]
    result = splice_segments(segments, ReferenceMirror(0.44, 0.08e-6), spacing=SPACING)
    assert any("noise explains" in warning for warning in result.warnings)


def test_bad_segments_are_refused() -> None:
    x = np.linspace(0, 0.44, 221)
    segment = PlacementReadings(x, np.zeros_like(x), 60e-9)
    mirror = ReferenceMirror(0.44, 0.08e-6)
    with pytest.raises(InputError, match=r"segment 2 begins at 500 mm and those before it end at 440 mm"):
        splice_segments([segment, PlacementReadings(x + 0.5, np.zeros_like(x), 60e-9)], mirror)
    with pytest.raises(InputError, match=r"beyond the mirror of 440 mm"):
        splice_segments([PlacementReadings(x * 1.1, np.zeros_like(x), 60e-9)], mirror)
    with pytest.raises(InputError, match=r"its form is calibrated from 0 mm to 400 mm"):
        splice_segments([segment], ReferenceMirror(0.44, 5e-9, np.array([[0.0, 0.0], [0.4, 0.0]])))
    with pytest.raises(InputError, match="above 0"):
        splice_segments([PlacementReadings(x, np.zeros_like(x), 0.0)], mirror)
    with pytest.raises(InputError, match="no sample from"):
        gap = np.concatenate([x[:80], x[120:]])
        splice_segments([PlacementReadings(gap, np.zeros_like(gap), 60e-9)], mirror)
    with pytest.raises(InputError, match="at least one"):
        splice_segments([], mirror)


def test_scale_of_the_mirror_prior() -> None:
    coefficients = np.random.default_rng(0).normal(size=(20000, len(MIRROR_ORDERS)))
    u = np.linspace(-1, 1, 401)
    polynomials = np.stack([np.polynomial.Legendre.basis(order)(u) for order in MIRROR_ORDERS])
    assert np.ptp(coefficients @ polynomials, axis=1).mean() == pytest.approx(MIRROR_RANGE, rel=0.01)
