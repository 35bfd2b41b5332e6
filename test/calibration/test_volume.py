"""Maps and ranking of errors in the working volume, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.calibration.parameters import without_errors
from rotary_error_monitor.calibration.volume import estimate_volumetric_map, rank_errors, sample_volume
from rotary_error_monitor.description.machine import ErrorComponent, Harmonic, load_machine
from rotary_error_monitor.errors import InputError

IDEAL = without_errors(load_machine("pan2013"))


def test_samples_fill_the_volume_and_stay_the_same() -> None:
    poses = sample_volume(IDEAL, 400, {"A": (-0.5, 0.25)})
    np.testing.assert_array_equal(poses, sample_volume(IDEAL, 400, {"A": (-0.5, 0.25)}))
    assert poses[:, 4].min() >= -0.5
    assert poses[:, 4].max() <= 0.25
    for column, axis in zip(poses.T, IDEAL.axes, strict=True):
        low, high = (-0.5, 0.25) if axis.letter == "A" else axis.travel
        assert np.mean(column) == pytest.approx((low + high) / 2, abs=0.01 * (high - low))
        assert np.std(column) == pytest.approx((high - low) / math.sqrt(12), rel=0.02)
    with pytest.raises(InputError, match="not within its travel"):
        sample_volume(IDEAL, 10, {"A": (-5.0, 0.0)})
    with pytest.raises(InputError, match="no axis"):
        sample_volume(IDEAL, 10, {"B": (-5.0, 0.0)})


def test_costs_in_closed_form() -> None:
    """EXX over a uniform travel: rms of c1 u is c1 / sqrt(3); EBA turns a tool that hangs 0.5 m below."""
    machine = replace(
        IDEAL,
        errors={
            "EXX": ErrorComponent(poly=(0.0, 9e-6)),
            "EYX": ErrorComponent(poly=(2e-6,)),
            "EBA": ErrorComponent(harmonic=(Harmonic(0.0, 4e-6, 0.0),)),
        },
    ).with_axis("Z", reversal=6e-6)
    costs = {cost.name: cost for cost in rank_errors(machine)}
    assert costs["EXX"].position_rms == pytest.approx(9e-6 / math.sqrt(3), rel=0.01)
    assert costs["EXX"].position_largest == pytest.approx(9e-6, rel=0.01)
    assert costs["EXX"].orientation_rms == pytest.approx(0.0, abs=1e-12)
    assert costs["EYX"].position_rms == pytest.approx(2e-6, rel=1e-6)
    assert costs["EBA"].position_rms == pytest.approx(0.5 * 4e-6, rel=1e-6)
    assert costs["EBA"].orientation_rms == pytest.approx(4e-6, rel=1e-6)
    assert costs["reversal of Z"].position_rms == pytest.approx(3e-6, rel=1e-6)
    assert [cost.name for cost in rank_errors(machine)][:2] == ["EXX", "reversal of Z"]
    assert len(costs) == 4


def test_location_errors_are_ranked_by_their_names_in_the_standard() -> None:
    names = [cost.name for cost in rank_errors(load_machine("pan2013"), count=50)]
    assert {"squareness X-Y (EC0X)", "coplanarity A-C (EY0A)", "squareness spindle-A (EB0S)"} <= set(names)
    assert not [name for name in names if "carriage" in name]
    assert len(names) == len(set(names))


def test_map_of_the_grinder_is_its_error_matrix() -> None:
    grinder = load_machine("grinder_zhou2023")
    chart = estimate_volumetric_map(grinder, ("X", "Z"), count=9)
    assert chart.position_error.shape == (9, 9)
    curves = []
    for name, q in (("EYX", chart.first), ("EYZ", chart.second)):
        component, (low, high) = grinder.errors[name], grinder.axis(name[2]).travel
        assert component.table is not None
        u = (2 * q - low - high) / (high - low)
        curves.append(np.interp(q, component.table.positions, component.table.forward) + component.poly[1] * u)
    # Y stands in the middle of its travel, where its own straight-line error is zero.
    np.testing.assert_allclose(chart.position_error, np.abs(curves[0][:, None] + curves[1][None, :]), atol=1e-12)
    np.testing.assert_allclose(chart.orientation_error, 0.0, atol=1e-12)
    held = estimate_volumetric_map(grinder, ("X", "Z"), held={"Y": 0.55}, count=9)
    assert np.abs(held.position_error - chart.position_error).max() > 1e-9
