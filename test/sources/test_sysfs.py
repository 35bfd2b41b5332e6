"""Devices in sysfs, on files of the same shape: counter, quadrant detector, voltage of a probe."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.counter import Counter
from rotary_error_monitor.sources.iio import QuadrantDetector, VoltageProbe
from rotary_error_monitor.sources.unwrapping import unwrap_angle, unwrap_count

COUNTS = 3_148_800


def write(folder: Path, **files: object) -> Path:
    folder.mkdir(exist_ok=True)
    for name, value in files.items():
        (folder / name).write_text(f"{value}\n")
    return folder


def test_a_count_is_an_angle(tmp_path):
    folder = write(tmp_path / "count0", count=0, enable=1)
    counter = Counter(folder, COUNTS)
    assert counter.read() == (0.0,)
    write(folder, count=COUNTS // 4)
    assert counter.read() == (pytest.approx(math.pi / 2),)
    assert Counter(folder, COUNTS, reverse=True).read() == (pytest.approx(-math.pi / 2),)


def test_a_count_goes_on_over_its_ceiling(tmp_path):
    folder = write(tmp_path / "count0", count=65_000, ceiling=65_535)
    counter = Counter(folder, 65_536)
    write(folder, count=10)
    (angle,) = counter.read()
    assert angle == pytest.approx(2 * math.pi * (65_546 / 65_536))
    write(folder, count=65_530)
    assert counter.read()[0] == pytest.approx(2 * math.pi * (65_530 / 65_536))


def test_backward_from_zero_on_a_counter_without_ceiling(tmp_path):
    folder = write(tmp_path / "count0", count=0)
    counter = Counter(folder, COUNTS)
    write(folder, count=2**64 - 5)
    assert counter.read() == (pytest.approx(-5 * 2 * math.pi / COUNTS),)


@pytest.mark.parametrize(
    ("files", "problem"),
    [
        ({}, "count: no count can be read"),
        ({"count": "many"}, "count: no count can be read"),
        ({"count": 1, "enable": 0}, "switched off; write 1"),
        ({"count": 1, "ceiling": 0}, "largest value is 0"),
    ],
)
def test_what_is_no_counter(tmp_path, files, problem):
    with pytest.raises(InputError, match=problem):
        Counter(write(tmp_path / "count0", **files), COUNTS)


@given(st.integers(-(2**70), 2**70), st.integers(-1000, 1000))
def test_unwrapping_recovers_what_was_wrapped(before, step):
    assert unwrap_count((before + step) % 2**32, before, 2**32) == before + step


@given(st.floats(-1e4, 1e4), st.floats(-3.1, 3.1))
def test_unwrapping_an_angle(before, step):
    wrapped = math.remainder(before + step, 2 * math.pi)
    assert unwrap_angle(wrapped, before) == pytest.approx(before + step, abs=1e-10)


def quadrants(folder: Path, volts: tuple[float, ...], scale: float = 0.5, offset: float = -100.0) -> Path:
    """Raw values that the kernel's rule, mV = (raw + offset) * scale, turns into these voltages."""
    raw = {f"in_voltage{i}_raw": round(1e3 * volt / scale - offset) for i, volt in enumerate(volts)}
    return write(folder, in_voltage_scale=scale, in_voltage_offset=offset, **raw)


def test_voltages_are_a_tilt(tmp_path):
    detector = QuadrantDetector(quadrants(tmp_path / "iio", (1.0, 1.0, 1.0, 1.0)), (0, 1, 2, 3), 5e-4)
    assert detector.read() == (pytest.approx(0.0), pytest.approx(0.0))
    quadrants(tmp_path / "iio", (1.5, 0.5, 0.5, 1.5))  # the spot moved along +x: a tilt about +y
    assert detector.read() == (pytest.approx(0.0), pytest.approx(2.5e-4))
    quadrants(tmp_path / "iio", (1.5, 1.5, 0.5, 0.5))  # along +y: a tilt about -x
    assert detector.read() == (pytest.approx(-2.5e-4), pytest.approx(0.0))


def test_dark_voltages_and_channels_of_their_own_scale(tmp_path):
    folder = quadrants(tmp_path / "iio", (1.2, 0.7, 0.7, 1.2))
    write(folder, in_voltage1_scale=1.0, in_voltage1_offset=0, in_voltage1_raw=700)
    detector = QuadrantDetector(folder, (0, 1, 2, 3), 1e-3, dark=(0.2, 0.2, 0.2, 0.2))
    assert detector.read() == (pytest.approx(0.0), pytest.approx(1e-3 / 3))


def test_what_is_no_detector(tmp_path):
    folder = quadrants(tmp_path / "iio", (1.0, 1.0, 1.0, 1.0))
    with pytest.raises(InputError, match="expected four of each"):
        QuadrantDetector(folder, (0, 1, 2), 5e-4)
    with pytest.raises(InputError, match="in_voltage7_raw: no voltage can be read"):
        QuadrantDetector(folder, (0, 1, 2, 7), 5e-4)
    with pytest.raises(InputError, match="is it an IIO device"):
        QuadrantDetector(tmp_path, (0, 1, 2, 3), 5e-4)
    detector = QuadrantDetector(folder, (0, 1, 2, 3), 5e-4)
    quadrants(folder, (0.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="no light"):
        detector.read()


def test_the_voltage_of_one_channel_is_a_displacement(tmp_path):
    folder = quadrants(tmp_path / "iio", (0.0, 0.0, -1.5, 0.0))
    probe = VoltageProbe(folder, 2, 2e-5)
    assert probe.read() == (pytest.approx(-3e-5),)
    quadrants(folder, (0.0, 0.0, 0.25, 0.0))
    assert probe.read() == (pytest.approx(5e-6),)
    (folder / "in_voltage2_raw").unlink()
    with pytest.raises(InputError, match="in_voltage2_raw: no voltage can be read"):
        probe.read()
    with pytest.raises(InputError, match="in_voltage9_raw: no voltage can be read"):
        VoltageProbe(folder, 9, 2e-5)
