"""Maps and ranking of errors in the working volume, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.calibration.parameters import without_errors
from rotary_error_monitor.calibration.volume import (
    estimate_uncertain_offsets,
    estimate_volumetric_map,
    rank_errors,
    sample_volume,
)
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.machine_parts import ErrorComponent, Harmonic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.uncertainty import drawn_machines, shifts_at_a_pose

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
    assert chart.rotary == (False, False)
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


DRAWS = 2000
"""A standard uncertainty is then known to 1.6 % (JCGM 100:2008, E.4.3); tests allow four times that."""


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_uncertain_places_in_closed_form(seed: int) -> None:
    """Each body that moves is off by a normal deviate in each direction: lengths are chi-distributed, 95 % at 2.795."""
    machine = replace(IDEAL, uncertainty={"location.linear": 3e-6})
    found = estimate_uncertain_offsets(machine, sample_volume(machine, 50), draws=DRAWS, seed=seed)
    size = 3e-6 * math.sqrt(sum(body.axis is not None for body in machine.bodies))
    np.testing.assert_allclose(found.offset, 0.0, atol=1e-15)
    np.testing.assert_allclose(found.deviation[:, :3], size, rtol=4 / math.sqrt(2 * DRAWS))
    np.testing.assert_allclose(found.deviation[:, 3:], 0.0, atol=1e-15)
    # The standard error of a quantile is sqrt(p (1 - p) / n) over the density there, 0.176 / size.
    np.testing.assert_allclose(
        found.position_bound, 2.795 * size, atol=4 * math.sqrt(0.95 * 0.05 / DRAWS) / 0.176 * size
    )


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
@pytest.mark.parametrize("seed", range(2))
def test_uncertain_offsets_are_those_of_the_law_of_propagation(name: str, seed: int) -> None:
    """JCGM 102:2011, 6.2: for errors so small a machine is linear in them."""
    stated = {"errors.linear": 5e-7, "errors.angular": 2e-6, "location.angular": 5e-6, "reversal.linear": 3e-7}
    machine = replace(load_machine(name), uncertainty=stated)
    poses = sample_volume(machine, 20)
    direction = np.where(np.arange(20) % 2 == 0, 1.0, -1.0)[:, None] * np.ones(poses.shape[1])
    found = estimate_uncertain_offsets(machine, poses, draws=DRAWS // 4, seed=seed, direction=direction)
    shifted = [arrange_machine(shift.machine) for shift in shifts_at_a_pose(machine)]
    effects = [predict_tool_offset(model, poses, direction=direction) - found.offset for model in shifted]
    expected = np.sqrt(np.sum(np.square(effects), axis=0))
    assert expected.max() > 1e-6
    np.testing.assert_allclose(found.deviation, expected, rtol=4 / math.sqrt(DRAWS / 2), atol=1e-12)


def test_draws_of_a_seed_are_the_same_and_poses_do_not_depend_on_one_another() -> None:
    machine = replace(load_machine("pan2013"), uncertainty={"errors.angular": 2e-6})
    poses = sample_volume(machine, 5000)
    whole, some = (estimate_uncertain_offsets(machine, poses[:count], draws=20) for count in (5000, 3))
    np.testing.assert_array_equal(some.deviation, whole.deviation[:3])
    np.testing.assert_array_equal(some.position_bound, whole.position_bound[:3])
    assert list(drawn_machines(machine, 2, seed=3)) == list(drawn_machines(machine, 2, seed=3))


def test_what_gives_no_uncertainty() -> None:
    with pytest.raises(InputError, match="pan2013 states no uncertainty"):
        estimate_uncertain_offsets(load_machine("pan2013"), np.zeros((1, 5)))
    with pytest.raises(InputError, match="19 draws; expected at least 20"):
        estimate_uncertain_offsets(replace(IDEAL, uncertainty={"expansion": 1e-6}), np.zeros((1, 5)), draws=19)
