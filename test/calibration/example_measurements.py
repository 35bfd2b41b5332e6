"""The measurements of doc/calibration: simulated, so that what they should show is known.

PYTHONPATH=test python test/calibration/example_measurements.py writes them anew.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from calibration import tracked_axes
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import load_machine

Array = NDArray[np.float64]
FOLDER = Path(__file__).parents[2] / "doc" / "calibration"

REVERSAL = 1.2e-6
X_TO_Y, Z_TO_X, Z_TO_Y = -16e-6, 11e-6, -19e-6
STARTUP = 2.5e-6
ROLL_DEG, DRIFT_ARCSEC_H = 3.0, 2.0
SPOT_ARCSEC = (500.0, 480.0)
"""Radius (1/e^2) of the spot on the quadrants, as tilts about x and y."""


def positioning_error(x: Array) -> Array:
    """EXX of the simulated machine without its reversal error, m."""
    return np.asarray(-12e-6 * x + 1.5e-6 * np.cos(9 * x) - 1.5e-6)


def straightness_error(x: Array) -> Array:
    """EZX, m."""
    return np.asarray(0.8e-6 * np.sin(11 * x) + 0.3e-6 * np.cos(24 * x))


def mirror_form(distance: Array) -> Array:
    """Form of the mirror of 300 mm, hollow by 0.2 µm, m."""
    return np.asarray(0.2e-6 * (distance / 0.15 - 1) ** 2)


def positioning() -> str:
    """Five cycles over eleven targets, the first reading before the axis had settled."""
    rng = np.random.default_rng(1)
    targets = np.array([-240.0, -196, -147, -103, -46, 2, 51, 97, 148, 195, 240])
    lines = [
        "# simulated: X of a small five-axis machine, laser interferometer",
        "target_mm,direction,cycle,deviation_um",
    ]
    for cycle in range(1, 6):
        for direction, way in ((1, targets), (-1, targets[::-1])):
            for k, target in enumerate(way):
                error = positioning_error(np.array(target * 1e-3)) - 0.5 * direction * REVERSAL
                error = error + 0.12e-6 * rng.normal() + STARTUP * ((cycle, direction, k) == (1, 1, 0))
                lines.append(f"{target:g},{direction},{cycle},{error * 1e6:.3f}")
    return "\n".join(lines) + "\n"


def straightness() -> str:
    """Two placements of the mirror, the first one measured both ways up; two runs forth and two back in each."""
    rng = np.random.default_rng(2)
    lines = [
        "# simulated: X in Z, displacement sensor along a mirror of 300 mm; mirror -1: turned over about its long axis",
        "segment,run,direction,mirror,position_mm,reading_um",
    ]
    for segment, (start, side) in enumerate(((-250, 1), (-250, -1), (-50, 1)), start=1):
        tilt, height = rng.normal(0, 15e-6), rng.normal(0, 5e-6)
        for run in range(1, 5):
            direction = 1 if run % 2 else -1
            x = np.arange(start, start + 301, 5.0)[::direction] * 1e-3
            distance = x - start * 1e-3
            y = straightness_error(x) + side * mirror_form(distance) + tilt * distance + height
            y = y + 60e-9 * rng.normal(size=x.size)
            lines += [
                f"{segment},{run},{direction},{side},{p * 1e3:g},{v * 1e6:.3f}" for p, v in zip(x, y, strict=True)
            ]
    return "\n".join(lines) + "\n"


def tracker() -> str:
    """A reflector in the spindle moved along Y, X and Z, seen from a tracker 1.6 m away."""
    rng = np.random.default_rng(3)
    x_axis = np.array([math.cos(X_TO_Y), -math.sin(X_TO_Y), 0.0])
    z_axis = np.array([-Z_TO_X, -Z_TO_Y, 1.0])
    lines = ["# simulated: laser tracker, reflector in the spindle", "feature,distance_mm,elevation_deg,azimuth_deg"]
    for name, axis in (("Y", np.array([0.0, 1.0, 0.0])), ("X", x_axis), ("Z", z_axis)):
        for step in np.linspace(-0.24, 0.24, 13):
            point = np.array([1.5, 0.4, -0.3]) + step * axis + 0.2e-6 * rng.normal(size=3)
            distance = float(np.linalg.norm(point))
            elevation, azimuth = math.asin(point[2] / distance), math.atan2(point[1], point[0])
            lines.append(f"{name},{distance * 1e3:.6f},{math.degrees(elevation):.9f},{math.degrees(azimuth):.9f}")
    return "\n".join(lines) + "\n"


def tracker_head() -> str:
    """Axes and spindle of the machine of Pan et al. 2013, as it is described."""
    features = tracked_axes.tracks(load_machine("pan2013"), points=15)
    table = tracked_axes.rows(features, tracked_axes.NOISE, np.random.default_rng(4), digits=(6, 9))
    return f"# simulated: laser tracker, reflectors on the spindle's nose and beside it\n{table}\n"


def autocollimator() -> str:
    """A quadrant detector under a Gaussian spot, turned by 3 degrees, before a reference of ±0.2 arcsec."""
    rng = np.random.default_rng(5)
    roll = math.radians(ROLL_DEG)
    lines = [
        "# simulated: quadrant detector before a reference autocollimator of ±0.2 arcsec, arcsec and V",
        "step,time_s,reference_x_arcsec,reference_y_arcsec,q1_V,q2_V,q3_V,q4_V",
    ]
    way = [*range(-100, 101, 20), *range(100, -101, -20)]
    off: dict[tuple[int, int], Array] = {}
    time = 0.0
    for step, (x, y) in enumerate([*((x, 0) for x in way), *((0, y) for y in way)], start=1):
        tilt = np.array([x, y]) + off.setdefault((x, y), 0.115 * rng.normal(size=2))
        a, b = math.cos(roll) * tilt[0] - math.sin(roll) * tilt[1], math.sin(roll) * tilt[0] + math.cos(roll) * tilt[1]
        for _ in range(3):
            time += 2.0
            drift = DRIFT_ARCSEC_H * time / 3600
            noise = 0.1 * rng.normal(size=2)
            right = math.erf(math.sqrt(2) * (b + 6.0 + noise[1]) / SPOT_ARCSEC[1])
            up = math.erf(-math.sqrt(2) * (a - 3.0 + drift + noise[0]) / SPOT_ARCSEC[0])
            light = 2.0 + 0.1 * math.sin(time / 50)
            volts = [light / 4 * (1 + i * right) * (1 + j * up) for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
            lines.append(f"s{step},{time:g},{x},{y}," + ",".join(f"{volt + 0.02:.6f}" for volt in volts))
    return "\n".join(lines) + "\n"


FILES = {
    "x_positioning.csv": positioning,
    "x_straightness.csv": straightness,
    "tracker.csv": tracker,
    "tracker_head.csv": tracker_head,
    "autocollimator.csv": autocollimator,
}


def main() -> None:
    """Write the files."""
    for name, make in FILES.items():
        (FOLDER / name).write_text(make(), encoding="utf-8")


if __name__ == "__main__":
    main()
