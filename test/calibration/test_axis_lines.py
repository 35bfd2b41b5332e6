"""Squareness and location errors from made tracker readings: what went in comes back, wherever the tracker stands."""

from __future__ import annotations

import argparse
import math
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
import yaml
from calibration import tracked_axes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.calibration.axis_lines import calibrate_squareness
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.parameters import apply_parameters, list_parameters, without_errors
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import MachineModel, arrange_machine, stand
from rotary_error_monitor.metrology.tracker import TrackerNoise
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
HEADER = "feature,distance_mm,elevation_deg,azimuth_deg"
STATION = np.array([6.0, 3.0, -1.0])


def run(*words: object) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser)
    arguments = parser.parse_args(["squareness", *map(str, words)])
    return int(arguments.run(arguments))


def shipped(folder: Path, name: str) -> Path:
    return Path(shutil.copy(config(f"machines/{name}.yaml"), folder / "machine.yaml"))


def tracked(folder: Path, features: dict[str, Array], noise: float = 0.0, seed: int = 0) -> Path:
    """File of what a tracker that stands anywhere reads of points in the machine's frame."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec([0.4, -0.8, 2.1]).as_matrix()
    lines = [HEADER]
    for feature, points in features.items():
        seen = spherical(points @ turn.T + STATION + noise * rng.normal(size=points.shape))
        lines += [f"{feature},{d:.9f},{e:.12f},{a:.12f}" for d, e, a in seen]
    source = folder / "tracker.csv"
    source.write_text("\n".join(lines), encoding="utf-8")
    return source


def spherical(points: Array) -> Array:
    distance = np.linalg.norm(points, axis=1)
    elevation, azimuth = np.arcsin(points[:, 2] / distance), np.arctan2(points[:, 1], points[:, 0])
    return np.stack([distance * 1e3, np.rad2deg(elevation), np.rad2deg(azimuth)], axis=1)


def head_machine_tracks() -> tuple[dict[str, Array], dict[str, tuple[Array, Array]]]:
    """Targets moved by the model of pan2013 with other location errors, and these by body: rotation and shift."""
    truth = load_machine("pan2013")
    parameters = [p for p in list_parameters(truth) if ".rotation." in p.name or p.name == "rotary_head.shift.y"]
    values = np.array([-3e-5, 2e-5, 4e-5, 1.5e-5, -2.5e-5, 1e-5, 3e-5, -1.7e-5])
    shifted = apply_parameters(truth, parameters, values)
    # Location errors alone, and a target off the axis of C so that A and C carry it round.
    shifted = replace(shifted, errors={}, axes=tuple(replace(axis, reversal=0.0) for axis in shifted.axes))
    model, ideal = arrange_machine(shifted), arrange_machine(without_errors(shifted))

    def path(letter: str, at: float = 0.0) -> Array:
        q = np.zeros((25, 5))
        number = model.letters.index(letter)
        low, high = truth.axis(letter).travel
        q[:, number] = np.linspace(0.9 * low, 0.9 * high, 25) if letter in "XYZ" else np.linspace(-1.5, 1.5, 25)
        q[:, 4] += at
        return stand_tip(ideal, q) + predict_tool_offset(model, q)[:, :3]

    tracks = {letter: path(letter) for letter in "YXZ"}
    tracks |= {"C.1": path("C", 0.8), "C.2": path("C", 1.4), "A.1": path("A")}
    places = {body.name: body.location_error for body in shifted.bodies}
    return tracks, {name: (np.array(at.rotation), np.array(at.shift)) for name, at in places.items()}


def stand_tip(model: MachineModel, q: Array) -> Array:
    return stand(model, q.T, None).tool_in_workpiece()[:, 3].T


def test_a_machine_with_its_rotary_axes_in_the_head(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tracks, expected = head_machine_tracks()
    machine = tracked_axes.straight(tmp_path, "pan2013")
    assert run(tracked(tmp_path, tracks), "--machine", machine) == 0
    text = capsys.readouterr().out
    assert "X to Y" in text
    assert "its place is that of the file" in text
    after = load_machine(machine)
    for name in ("carriage", "ram", "swivel_head", "rotary_head"):
        found = after.body(name).location_error.rotation
        np.testing.assert_allclose(found, expected[name][0], atol=3e-8, err_msg=name)
    # Of A's place only the distance from C can be seen: along y.
    before, found = (each.body("rotary_head").location_error.shift[1] for each in (load_machine("pan2013"), after))
    assert found == pytest.approx(expected["rotary_head"][1][1], abs=2e-8)
    assert abs(found - before) > 1e-5


class Trunnion:
    """The tilting-table machine in closed form: its axes as lines in the base, turned about by hand."""

    shift_a = np.array([0.0, 2.1e-5, -3.3e-5])
    tilt_a = np.array([0.0, -4e-5, 2.5e-5])
    shift_c = np.array([-1.6e-5, 2.7e-5, 0.0])
    tilt_c = np.array([3.5e-5, 1.2e-5, 0.0])
    x_to_y, z_to_x, z_to_y = -3e-5, 2e-5, 4e-5

    def tracks(self) -> dict[str, Array]:
        turn_a = Rotation.from_rotvec(self.tilt_a)
        place_a = np.array([0.0, 0.020, 0.010]) + self.shift_a
        place_c = place_a + turn_a.apply(np.array([0.0, -0.020, -0.010]) + self.shift_c)
        along_a = turn_a.apply([1.0, 0.0, 0.0])
        along_c = (turn_a * Rotation.from_rotvec(self.tilt_c)).apply([0.0, 0.0, 1.0])
        y = np.array([0.0, 1.0, 0.0])
        x = np.array([math.cos(self.x_to_y), -math.sin(self.x_to_y), 0.0])
        z = np.array([-math.sin(self.z_to_x), -math.sin(self.z_to_y), 1.0])
        z[0] -= x[1] * z[1]
        steps = np.linspace(-0.2, 0.2, 21)[:, None]
        turns = np.linspace(-1.2, 1.2, 25)
        tracks = {"X": steps * x, "Y": steps * y, "Z": steps * z / np.linalg.norm(z)}
        for name, place, along, target in (
            ("A.1", place_a, along_a, [0.20, 0.15, 0.1]),
            ("A.2", place_a, along_a, [-0.15, -0.1, 0.12]),
            ("C.1", place_c, along_c, [0.12, 0.0, 0.02]),
            ("C.2", place_c, along_c, [0.0, -0.1, 0.25]),
        ):
            tracks[name] = place + Rotation.from_rotvec(turns[:, None] * along).apply(np.array(target) - place)
        return tracks


def test_a_table_that_carries_the_workpiece_is_located_from_the_tool_at_zero(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, machine = Trunnion(), tracked_axes.straight(tmp_path, "xyzac_trt")
    source = tracked(tmp_path, {**truth.tracks(), "zero": np.zeros((3, 3))})
    assert run(source, "--machine", machine) == 0
    assert "axis A tilted by" in capsys.readouterr().out
    after = load_machine(machine)
    for name, shift, tilt in (
        ("trunnion", truth.shift_a, truth.tilt_a),
        ("table", truth.shift_c, truth.tilt_c),
    ):
        found = after.body(name).location_error
        np.testing.assert_allclose(found.shift, shift, rtol=0, atol=2e-9, err_msg=name)
        np.testing.assert_allclose(found.rotation, tilt, rtol=0, atol=2e-9, err_msg=name)
    content = yaml.safe_load(machine.read_text(encoding="utf-8"))["machine"]
    ram = next(body for body in content["bodies"] if body["name"] == "ram")
    assert ram["squareness"] == pytest.approx({"X": 2e-5, "Y": 4e-5}, abs=2e-9)
    assert {"squareness", "location of A", "location of C"} <= set(content["calibration"])


def test_without_zero_axes_are_located_against_the_first_one(tmp_path: Path) -> None:
    truth, machine = Trunnion(), tracked_axes.straight(tmp_path, "xyzac_trt")
    assert run(tracked(tmp_path, truth.tracks()), "--machine", machine) == 0
    before, after = load_machine("xyzac_trt"), load_machine(machine)
    assert after.body("trunnion").location_error.shift == before.body("trunnion").location_error.shift
    found = after.body("table").location_error
    assert found.shift[0] == before.body("table").location_error.shift[0]
    np.testing.assert_allclose(found.shift[1], truth.shift_c[1], rtol=0, atol=2e-9)
    np.testing.assert_allclose(found.rotation, truth.tilt_c, rtol=0, atol=2e-9)


@pytest.mark.long
@pytest.mark.parametrize("with_zero", [True, False])
def test_errors_are_as_large_as_the_uncertainty_says(tmp_path: Path, with_zero: bool) -> None:
    """A tracker that errs by 1 µm each way, many times: errors over their uncertainty scatter by one."""
    truth, machine = Trunnion(), tracked_axes.straight(tmp_path, "xyzac_trt")
    tracks = {**truth.tracks(), **({"zero": np.zeros((2, 3))} if with_zero else {})}
    angle = 1e-6 / 6.8
    ratios: dict[str, list[float]] = {"tilt": [], "shift": []}
    for seed in range(25):
        source = tracked(tmp_path, tracks, noise=1e-6, seed=seed)
        job = Job(source, MachineFile(machine), tmp_path / "out.yaml", date(2026, 11, 21))
        found = calibrate_squareness(job, TrackerNoise(1e-6, 0.0, angle, angle)).locations
        for letter, shift, tilt, across in (
            ("A", truth.shift_a, truth.tilt_a, (1, 2)),
            ("C", truth.shift_c, truth.tilt_c, (0, 1)),
        ):
            one = found[letter]
            for k in across:
                ratios["tilt"].append(float((one.rotation[k] - tilt[k]) / one.rotation_uncertainty[k]))
                if np.isfinite(one.shift_uncertainty[k]):
                    ratios["shift"].append(float((one.shift[k] - shift[k]) / one.shift_uncertainty[k]))
    assert len(ratios["shift"]) == (100 if with_zero else 25)
    for name, values in ratios.items():
        # A line's place and direction count as uncorrelated, which tells a little too much for the shift.
        assert 0.6 < math.sqrt(np.mean(np.square(values))) < 1.3, name


def test_zero_tells_nothing_of_axes_that_move_the_tool(tmp_path: Path) -> None:
    tracks, _ = head_machine_tracks()
    source = tracked(tmp_path, {**tracks, "zero": np.zeros((1, 3))})
    with pytest.raises(InputError, match=r"tracker.csv: feature zero: axis C moves the tool itself"):
        run(source, "--machine", shipped(tmp_path, "pan2013"))


def test_another_axis_than_the_file_has_is_refused(tmp_path: Path) -> None:
    tracks = Trunnion().tracks()
    tracks["C.1"], tracks["C.2"] = tracks.pop("A.1"), tracks.pop("A.2")
    with pytest.raises(InputError, match=r"tracker.csv: feature C: the axis lies 90\.0° off its nominal direction"):
        run(tracked(tmp_path, tracks), "--machine", shipped(tmp_path, "xyzac_trt"))


def check_refused(source: Path, machine: Path, capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """What is said of readings that are not written."""
    before = machine.read_bytes()
    assert run(source, "--machine", machine, *words) == calibrate.NOT_GOOD
    assert machine.read_bytes() == before
    return capsys.readouterr().out


@pytest.mark.parametrize("pair", ["XY", "YZ", "ZX"])
@pytest.mark.parametrize("rotary", [False, True])
def test_exchanged_axes_make_another_hand(
    tmp_path: Path, pair: str, rotary: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, machine = Trunnion(), shipped(tmp_path, "xyzac_trt")
    names = [*"XYZ", *(["C.1", "C.2"] if rotary and pair == "XY" else [])]
    tracks = {name: truth.tracks()[name] for name in names}
    tracks = {{pair[0]: pair[1], pair[1]: pair[0]}.get(name, name): points for name, points in tracks.items()}
    source = tracked(tmp_path, tracks, noise=1e-7)
    text = check_refused(source, machine, capsys)
    assert "as measured form a left-handed machine, in the file a right-handed one: are two features exchanged" in text
    assert run(source, "--machine", machine, "--force") == 0
    ram = load_machine(machine).body("ram").location_error.rotation
    note = yaml.safe_load(machine.read_text(encoding="utf-8"))["machine"]["calibration"]["squareness"]
    assert np.abs(np.subtract(ram[:2], [truth.z_to_y, -truth.z_to_x])).max() < 2 * note["uncertainty"]


@pytest.mark.parametrize("letter", "XYZ")
def test_an_axis_that_was_measured_backwards(tmp_path: Path, letter: str, capsys: pytest.CaptureFixture[str]) -> None:
    tracks = Trunnion().tracks()
    tracks[letter] = tracks[letter][::-1]
    source, machine = tracked(tmp_path, tracks, noise=1e-7), shipped(tmp_path, "xyzac_trt")
    assert "does one run against its axis" in check_refused(source, machine, capsys)


@pytest.mark.parametrize(("scale", "said"), [(1e-3, "span 0.4 mm"), (10.0, "mm: another axis, or a distance in")])
def test_a_distance_in_another_unit(
    tmp_path: Path, scale: float, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tracks = {name: points for name, points in Trunnion().tracks().items() if name in "XYZ"}
    source, machine = tracked(tmp_path, tracks), shipped(tmp_path, "xyzac_trt")
    head, *rows = source.read_text(encoding="utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    rows = [",".join([name, f"{float(distance) * scale:.12g}", *angles]) for name, distance, *angles in cells]
    source.write_text("\n".join([head, *rows]), encoding="utf-8")
    text = check_refused(source, machine, capsys)
    assert said in text
    assert "and its travel is 500 mm" in text


def test_readings_too_coarse_to_tell_anything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An uncertainty larger than the errors, and one much larger than that of the calibration before."""
    tracks, machine = Trunnion().tracks(), shipped(tmp_path, "xyzac_trt")
    coarse = ["--distance-um", 100, "--angle-arcsec", 20]
    text = check_refused(tracked(tmp_path, tracks, noise=5e-4), machine, capsys, *coarse)
    assert "squareness: a standard uncertainty of" in text
    assert "tells nothing" in text
    fine = ["--distance-um", 0.1, "--distance-ppm", 0, "--angle-arcsec", 0.003]
    for seed in range(3):
        assert run(tracked(tmp_path, tracks, noise=1e-7, seed=seed), "--machine", machine, *fine) == 0
    middle = ["--distance-um", 1, "--distance-ppm", 0, "--angle-arcsec", 0.03]
    capsys.readouterr()
    text = check_refused(tracked(tmp_path, tracks, noise=1e-6), machine, capsys, *middle)
    assert "squareness: a standard uncertainty of" in text
    assert run(tracked(tmp_path, tracks, noise=1e-6), "--machine", machine, *middle, "--force") == 0


def test_squareness_needs_two_linear_axes(tmp_path: Path) -> None:
    machine, source = shipped(tmp_path, "pan2013"), tmp_path / "tracker.csv"
    rows = [f"X,{2000 + k * 100},0,{k}" for k in range(5)]
    source.write_text("\n".join([HEADER, *rows]), encoding="utf-8")
    with pytest.raises(InputError, match="features of 1 linear axes"):
        run(source, "--machine", machine)
    source.write_text("\n".join([HEADER, *rows[:2]]), encoding="utf-8")
    with pytest.raises(InputError, match=r"tracker.csv: feature X: 2 points"):
        run(source, "--machine", machine)


def test_what_no_machine_file_may_say_is_told_of_the_measurements(tmp_path: Path) -> None:
    """The file that is not written has no line to look at, though its draft would have."""
    file, out = MachineFile(shipped(tmp_path, "xyzac_trt")), tmp_path / "out.yaml"
    file.set_location("C", np.array([0.0, 0.02, 0.0]), np.zeros(3))
    with pytest.raises(InputError) as caught:
        file.save(out, Path("inch.csv"))
    told = str(caught.value)
    assert told.startswith(f"inch.csv: what was found cannot stand in {out}: machine.bodies.")
    assert "0.02 is greater than the maximum" in told and told.endswith("a length in m of at most 10 mm")
    assert list(tmp_path.glob("*out*")) == []
