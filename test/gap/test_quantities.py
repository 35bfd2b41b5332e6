"""Values as people read them: digits by the uncertainty, prefixes by the size."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.effects.effect import ParameterEstimate
from rotary_error_monitor.effects.guideways import AxisBacklash
from rotary_error_monitor.gap.quantities import quantity
from rotary_error_monitor.resources import share

FACTORS = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0}


@pytest.mark.parametrize(
    ("value", "std", "unit", "text"),
    [
        (0.0017089727881, 2.4e-8, "s", "1.708973 ± 0.000024 ms"),
        (-2.66e-5, 3.1e-8, "m", "-26.600 ± 0.031 µm"),
        (0.02091, 6e-5, "1", "0.020910 ± 0.000060"),
        (5e-6, 1e-8, "1/K", "(5.000 ± 0.010)e-06 1/K"),
        (1.5e6, 2e4, "rad^-2", "(1.500 ± 0.020)e+06 rad^-2"),
        (4.2e-7, 1.3e-9, "m/K", "420.0 ± 1.3 nm/K"),
        (1.2e-8, 3e-11, "m s^2/rad^2", "12.000 ± 0.030 nm s^2/rad^2"),
        (9.94e-6, 9.96e-7, "m or rad", "9.94 ± 1.00 µm or µrad"),
        (5.0, 0.0, "1", "5"),
        (0.0, 0.0, "m", "0 m"),
        (0.0, 2e-9, "m", "0.0 ± 2.0 nm"),
        (123.4, 5.6, "s", "123.4 ± 5.6 s"),
        (669.4e-9, 448.7e-9, "m", "670 ± 450 nm"),
        (241e-9, 1166e-9, "rad", "0.2 ± 1.2 µrad"),
        ((1.4000300e-6, -1.936e-6), (5.39e-9, 5.94e-9), "rad", "(1.4000 ± 0.0054, -1.9360 ± 0.0059) µrad"),
        ((512.001, 511.002), (0.0, 0.0), "count", "(512, 511) count"),
    ],
)
def test_as_people_write_it(value: object, std: object, unit: str, text: str) -> None:
    assert quantity(ParameterEstimate(value, std), unit) == text  # type: ignore[arg-type]


@given(
    st.floats(1e-11, 900.0), st.sampled_from([1.0, -1.0]), st.floats(1e-5, 0.3), st.sampled_from(["m", "rad/N", "s"])
)
def test_the_text_holds_the_value_within_its_uncertainty(size: float, sign: float, part: float, unit: str) -> None:
    value, std = sign * size, size * part
    found = re.fullmatch(
        r"(-?[\d.]+) ± ([\d.]+) ([pnµm]?)" + re.escape(unit), quantity(ParameterEstimate(value, std), unit)
    )
    assert found is not None
    factor = FACTORS[found[3]]
    assert abs(float(found[1]) * factor - value) <= 0.051 * std + 1e-15 * abs(value)
    assert float(found[2]) * factor == pytest.approx(std, rel=0.051)
    assert 0.9 <= abs(float(found[1])) < 1001 or factor == 1e-12


@pytest.mark.parametrize("path", sorted(path.stem for path in (share() / "config" / "machines").glob("*.yaml")))
def test_a_backlash_is_in_the_unit_of_its_axis(path):
    units = {"linear": "m", "rotary": "rad"}
    for axis in load_machine(path).axes:
        assert AxisBacklash().units(axis.letter) == {"width": units[axis.kind]}
