"""Refraction against the constants of the reference library of the IAU and against another's formula."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.kinds.mount.refraction import Weather, refraction_constants, refraction_of


def test_constants_are_those_that_the_reference_library_tests_itself_with():
    """The test of `eraRefco` in ERFA, from IAU SOFA: 800 hPa, 10 °C, humidity 0.9, 0.4 µm."""
    a, b = refraction_constants(Weather(10.0, 800.0, 0.9, 0.4))
    assert a == pytest.approx(0.2264949956241415009e-3, abs=1e-15)
    assert b == pytest.approx(-0.2598658261729343970e-6, abs=1e-18)


@pytest.mark.parametrize("apparent", [85.0, 60.0, 45.0, 30.0, 20.0, 15.0, 10.0])
def test_refraction_is_that_of_bennett(apparent):
    """Bennett 1982 (J. Navigation 35, 255), improved formula for 1010 hPa and 10 °C, in minutes of arc."""
    plain = 1 / np.tan(np.radians(apparent + 7.31 / (apparent + 4.4)))
    minutes = plain - 0.06 * np.sin(np.radians(14.7 * plain + 13))
    lift = refraction_of(np.array([np.radians(apparent - minutes / 60)]), Weather(10.0, 1010.0, 0.5))
    assert np.degrees(lift[0]) * 60 == pytest.approx(minutes, abs=0.05)


def test_no_air_no_refraction():
    assert refraction_of(np.array([0.5]), Weather(10.0, 0.0, 0.5))[0] == 0.0
