"""The measurements of doc/calibration: simulated, so that what they should show is known.

PYTHONPATH=test python test/calibration/example_measurements.py writes them anew.
"""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import simulated_shaft
import yaml
from calibration import tracked_axes
from numpy.typing import NDArray

from rotary_error_monitor.bags.metadata import SIMULATED
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

Array = NDArray[np.float64]
FOLDER = Path(__file__).parents[2] / "doc" / "calibration"
GRINDER = Path(__file__).parents[2] / "config" / "machines" / "grinder_zhou2023.yaml"
TRUNNION = Path(__file__).parents[2] / "config" / "machines" / "xyzac_trt.yaml"

BAG = "between_centres"
"""Folder of the bag of the shaft between centres."""

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


def level_straightness(x: float) -> float:
    """The same about its line of least squares, as `calibrate straightness` writes it, m."""
    travel = np.linspace(-0.25, 0.25, 1001)
    line = np.polyfit(travel, straightness_error(travel), 1)
    return float(straightness_error(np.array(x)) - np.polyval(line, x))


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


def laser() -> str:
    """The same readings as an instrument with decimal commas writes them, among columns that nobody asked for."""
    lines = ["Linear measurement, axis X (simulated)", "", "No;Run;Direction;Position;Error (µm);Air (°C)"]
    for number, line in enumerate(positioning().splitlines()[2:], start=1):
        target, direction, cycle, deviation = line.split(",")
        sign = "+" if direction == "1" else "-"
        lines.append(f"{number};{cycle};{sign};{target};{deviation.replace('.', ',')};20,1")
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


def direct() -> str:
    """The same straightness by an interferometer without a mirror, over the whole axis; two runs forth and two back."""
    rng = np.random.default_rng(4)
    lines = [
        "# simulated: X in Z, laser interferometer with straightness optics",
        "segment,run,direction,position_mm,reading_um",
    ]
    for run in range(1, 5):
        direction = 1 if run % 2 else -1
        x = np.arange(-250, 251, 5.0)[::direction] * 1e-3
        y = straightness_error(x) + 40e-6 * x + 60e-9 * rng.normal(size=x.size)
        lines += [f"1,{run},{direction},{p * 1e3:g},{v * 1e6:.3f}" for p, v in zip(x, y, strict=True)]
    return "\n".join(lines) + "\n"


def workpiece(*, compensated: bool) -> str:
    """A workpiece ground on grinder_zhou2023, seen each 50 mm, with ripple of the process and noise of the sensor.

    Compensated, it has the positioning error of the vertical axis, 1.2 µm in waves of 20 µm, where the wheel was.
    """
    rng = np.random.default_rng(6 + compensated)
    errors = yaml.safe_load(GRINDER.read_text(encoding="utf-8"))["machine"]["errors"]
    lines = ["# simulated: workpiece of 1400 mm x 500 mm, confocal sensor", "X_mm,Z_mm,height_um"]
    for x in np.arange(-1400, 1, 50):
        for z in np.arange(-650, -149, 50):
            height = wheel = 0.0
            for name, at, half in (("EYX", x * 1e-3, 0.7), ("EYZ", z * 1e-3, 0.4)):
                table = errors[name]["table"]
                error = float(np.interp(at, table["positions"], table["values"]))
                height += error
                wheel -= error + errors[name]["poly"][1] * (at + half) / half
            if compensated:
                height = 0.6e-6 * math.sin(2 * math.pi * wheel / 20e-6)
            height += 0.3e-6 * math.sin(8 * x * 1e-3 + 9 * z * 1e-3) + 15e-6 * x * 1e-3 + 60e-9 * rng.normal()
            lines.append(f"{x:g},{z:g},{height * 1e6:.3f}")
    return "\n".join(lines) + "\n"


def tracker() -> str:
    """A reflector at the tip moved along Y, X and Z, as straight as those of xyzac_trt, seen from 1.6 m away."""
    rng = np.random.default_rng(3)
    errors = yaml.safe_load(TRUNNION.read_text(encoding="utf-8"))["machine"]["errors"]
    x_axis = np.array([math.cos(X_TO_Y), -math.sin(X_TO_Y), 0.0])
    z_axis = np.array([-Z_TO_X, -Z_TO_Y, 1.0])
    lines = ["# simulated: laser tracker, reflector in the spindle", "feature,distance_mm,elevation_deg,azimuth_deg"]
    for name, axis in (("Y", np.array([0.0, 1.0, 0.0])), ("X", x_axis), ("Z", z_axis)):
        for step in np.linspace(-0.24, 0.24, 13):
            off = [np.polyval(errors.get(f"E{part}{name}", {}).get("poly", [0.0])[::-1], step / 0.25) for part in "XYZ"]
            if name == "X":
                off[2] = level_straightness(step)
            point = np.array([1.5, 0.4, -0.3]) + step * axis + off + 0.2e-6 * rng.normal(size=3)
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


GRADUATION = {2: (-0.7e-6, 3.2e-6), 3: (2.1e-6, -0.5e-6), 5: (0.6e-6, 0.4e-6), 7: (-0.3e-6, 0.5e-6)}
"""Of the ring between centres, rad, by order: cos and sin."""

FLATNESS = {
    2: (-6.0e-6, -2.2e-6, 1.5e-6, -4.0e-6),
    3: (-3.9e-6, -0.4e-6, 0.1e-6, 0.8e-6),
    5: (0.8e-6, 0.0, 0.0, 0.6e-6),
}
"""Of the mirror, rad, by order: cos and sin of x and of y."""

SHAFT = simulated_shaft.Shaft(
    eccentricity=(2.4e-5, -1.1e-5),
    graduation=GRADUATION,
    tilt=(7.0e-5, 2.4e-5),
    flatness=FLATNESS,
    head_rate=100.0,
    tilt_rate=100.0,
)
"""The shaft between centres: the stage of Lou et al. 2019, read a hundred times a second to keep its bag small."""

TURN_AND_BACK = simulated_shaft.reversing((1.6,), 4.5)
"""Rather more than a turn forward in 4.5 s, and back."""


def between_centres() -> dict[str, list[SampleBlock]]:
    """Blocks by topic of the shaft between centres."""
    heads, tilt = simulated_shaft.record(SHAFT, *TURN_AND_BACK, seed=6)
    wire = load_wire()
    streams = {wire.topic("head_samples", name).name: (("angle",), *stream) for name, stream in heads.items()}
    streams[wire.topic("autocollimator_samples").name] = (("tilt_x", "tilt_y"), *tilt)
    return {
        topic: [block_from_samples(times[k : k + 100], names, values[k : k + 100]) for k in range(0, len(times), 100)]
        for topic, (names, times, values) in streams.items()
    }


FILES = {
    "x_positioning.csv": positioning,
    "x_laser.txt": laser,
    "x_straightness.csv": straightness,
    "x_direct.csv": direct,
    "workpiece_before.csv": lambda: workpiece(compensated=False),
    "workpiece_after.csv": lambda: workpiece(compensated=True),
    "tracker.csv": tracker,
    "tracker_head.csv": tracker_head,
    "autocollimator.csv": autocollimator,
}


def main() -> None:
    """Write the files."""
    for name, make in FILES.items():
        (FOLDER / name).write_text(make(), encoding="utf-8")
    contents = between_centres()
    shutil.rmtree(FOLDER / BAG, ignore_errors=True)
    write_messages(FOLDER / BAG, contents, load_wire(), {SIMULATED: ", ".join(contents)})


if __name__ == "__main__":
    main()
