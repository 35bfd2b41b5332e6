"""Tables of measurements: what is read, and one clear error with file and line for each kind of bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.calibration.machine_poses import read_positioning_poses, read_probed_poses
from rotary_error_monitor.calibration.measurements import (
    read_mirror_profile,
    read_positioning,
    read_straightness,
)
from rotary_error_monitor.calibration.tracker_features import read_tracker
from rotary_error_monitor.codec.contents import Content, JointState, PointStamped, Temperature
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.topics import pose_topics
from rotary_error_monitor.errors import InputError

JOINT_STATES, TOOL_PROBE, TEMPERATURE = pose_topics()

HEADER = "target_mm,direction,cycle,deviation_um"
GOOD = [
    "0,1,1,1.0",
    "100,1,1,2.0",
    "200,1,1,3.0",
    "200,-1,1,2.5",
    "100,-1,1,1.5",
    "0,-1,1,0.5",
    "0,1,2,1.2",
    "100,1,2,2.2",
    "200,1,2,3.2",
    "200,-1,2,2.7",
    "100,-1,2,1.7",
    "0,-1,2,0.7",
]


def written(folder: Path, *lines: str) -> Path:
    path = folder / "runs.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_positioning_table(tmp_path: Path) -> None:
    runs = read_positioning(written(tmp_path, "# X, 21 November", HEADER, *GOOD), rotary=False)
    np.testing.assert_allclose(runs.targets, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(runs.forward, 1e-6 * np.array([[1.0, 1.2], [2.0, 2.2], [3.0, 3.2]]))
    assert runs.backward is not None
    np.testing.assert_allclose(runs.backward, 1e-6 * np.array([[0.5, 0.7], [1.5, 1.7], [2.5, 2.7]]))


def test_missing_target_of_one_cycle_becomes_nan(tmp_path: Path) -> None:
    rows = [*GOOD, "0,1,3,1.1", "200,1,3,3.1"]
    runs = read_positioning(written(tmp_path, HEADER, *rows), rotary=False)
    assert np.isnan(runs.forward[1, 2])
    assert runs.backward is not None
    assert np.isnan(runs.backward[:, 2]).all()


def test_readings_of_a_rotary_axis_wrap(tmp_path: Path) -> None:
    lines = ["cycle,target_deg,reading_deg,direction"]
    lines += [
        f"{cycle},{target},{reading},1" for cycle in (1, 2) for target, reading in ((0, 359.999), (180, -179.999))
    ]
    runs = read_positioning(written(tmp_path, *lines), rotary=True)
    np.testing.assert_allclose(np.rad2deg(runs.forward), [[-0.001] * 2, [0.001] * 2], atol=1e-12)
    assert runs.backward is None


def changed(row: int, line: str) -> list[str]:
    return [HEADER, *GOOD[:row], line, *GOOD[row + 1 :]]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], ":1: the file is empty"),
        (["# nothing but a comment"], ":1: the file is empty"),
        ([HEADER], ":1: a header and no row"),
        (
            ["target_mm,direction,deviation_um", "0,1,1"],
            ":1: header target_mm,direction,deviation_um; expected target_mm,",
        ),
        (["target_um,direction,cycle,deviation_um", *GOOD], ":1: header target_um"),
        (changed(3, "200,-1,1,2500"), r":5: deviation_um 2500 is beyond ±1000: is it in another unit\?"),
        (changed(1, "100000000,1,1,2.0"), ":3: target_mm 100000000 is beyond"),
        (changed(1, "100,1,1,nan"), ":3: deviation_um nan is no finite number"),
        (changed(1, "100,1,1,"), ":3: deviation_um '' is empty"),
        (changed(1, "100,1,1,2,0"), ":3: 5 values where the header has 4; write decimal points, not commas"),
        (changed(1, '100,1,1,"2,0"'), ":3: deviation_um '2,0' has a decimal comma"),
        (changed(1, "100,1,1"), ":3: 3 values where the header has 4"),
        (changed(1, "100,1,1,two"), ":3: deviation_um 'two' is no number"),
        (changed(1, "100,2,1,2.0"), ":3: direction 2; expected 1"),
        (changed(1, "0,1,1,2.0"), r":3: target 0 comes twice in cycle 1, direction \+1; first on line 2"),
        (
            changed(1, "300,1,1,2.0"),
            r":4: cycle 1, direction \+1: target 200 after 300; targets of this direction ascend, in",
        ),
        (changed(4, "100,1,1,1.5"), r":6: cycle 1, direction \+1: target 100 after 200"),
        ([HEADER, *GOOD[:8], *GOOD[9:]], ":12: in the table that ends here, target 0.2 m has 1 forward reading"),
        ([HEADER, *(row for row in GOOD if ",-1," in row)], ":2: no forward run"),
    ],
)
def test_bad_positioning_tables(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(InputError, match=f"runs.csv{message}"):
        read_positioning(written(tmp_path, *lines), rotary=False)


def test_readings_in_another_unit_than_targets(tmp_path: Path) -> None:
    lines = ["target_mm,direction,cycle,reading_mm", "0,1,1,0.001", "100,1,1,100000.2", "0,1,2,0", "100,1,2,100.1"]
    with pytest.raises(
        InputError, match=r":3: reading_mm 100000.2 is beyond ±100000|are both in the unit of the header"
    ):
        read_positioning(written(tmp_path, *lines), rotary=False)
    lines[2] = "100,1,1,0.1002"
    with pytest.raises(InputError, match=r":3: the reading is -99899.8 um off its target"):
        read_positioning(written(tmp_path, *lines), rotary=False)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_positioning(tmp_path / "nothing.csv", rotary=False)


SAMPLES = "segment,run,direction,position_mm,reading_um"


def test_straightness_table(tmp_path: Path) -> None:
    rows = [f"1,a,1,{x},{x / 100}" for x in range(5)] + [f"2,b,-1,{x},0.5" for x in range(9, 3, -1)]
    segments = read_straightness(written(tmp_path, SAMPLES, *rows))
    assert list(segments) == ["1", "2"]
    np.testing.assert_allclose(segments["1"].runs[0].positions, 1e-3 * np.arange(5))
    np.testing.assert_allclose(segments["1"].runs[0].readings, 1e-8 * np.arange(5))
    assert segments["2"].runs[0].direction == -1
    assert not segments["1"].turned


def test_a_placement_with_the_mirror_turned(tmp_path: Path) -> None:
    rows = [f"1,a,1,{x},0,1" for x in range(5)] + [f"2,b,{d},{x},0,-1" for d in (1, -1) for x in range(5)[::d]]
    rows[10:] = [row.replace(",b,", ",c,") for row in rows[10:]]
    segments = read_straightness(written(tmp_path, f"{SAMPLES},mirror", *rows))
    assert [(len(each.runs), each.turned) for each in segments.values()] == [(1, False), (2, True)]
    rows[-1] = rows[-1][:-2] + "1"
    with pytest.raises(InputError, match=r"runs.csv:16: segment 2: mirror 1 among others"):
        read_straightness(written(tmp_path, f"{SAMPLES},mirror", *rows))
    rows[-1] = rows[-1][:-1] + "2"
    with pytest.raises(InputError, match=r"runs.csv:16: mirror 2; expected 1 or -1"):
        read_straightness(written(tmp_path, f"{SAMPLES},mirror", *rows))


def test_mirror_profile(tmp_path: Path) -> None:
    header = "distance_mm,height_um"
    profile = read_mirror_profile(written(tmp_path, header, "0,0", "200,0.04", "440,0"))
    np.testing.assert_allclose(profile, [[0, 0], [0.2, 4e-8], [0.44, 0]])
    with pytest.raises(InputError, match=r"runs.csv:4: distance 100 mm after 200 mm; they must rise"):
        read_mirror_profile(written(tmp_path, header, "0,0", "200,0.04", "100,0"))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["1,a,1,0,0", "1,a,1,2,0", "1,a,1,1,0"], ":4: segment 1, run a: position 1 mm after 2 mm does not go on"),
        (["1,a,1,0,0", "1,a,1,0,0"], ":3: segment 1, run a: position 0 mm after 0 mm"),
        (["1,a,1,0,0", "1,a,-1,1,0"], ":3: segment 1, run a: direction -1 after 1; the way back is a run of its own"),
        (["1,a,0,0,0"], ":2: segment 1, run a: direction 0"),
        (
            [f"1,a,1,{x},0" for x in (0, 1, 2, 3, 30, 31)],
            ":6: segment 1, run a: a gap of 27 mm before this sample, 1 mm is usual; are rows missing",
        ),
        (["1,a,2,0,0", "1,a,2,1,0"], ":2: segment 1, run a: direction 2; expected 1 or -1"),
        (["1,a,1,0,4000"], ":2: reading_um 4000 is beyond"),
        (
            [f"1,a,1,{x},0" for x in range(4)] + [f"1,b,-1,{x},0" for x in (3, 2, 1, 0)],
            r":9: segment 1 ends here with 4 position\(s\); a curve takes 5 at least",
        ),
    ],
)
def test_bad_straightness_tables(tmp_path: Path, rows: list[str], message: str) -> None:
    with pytest.raises(InputError, match=f"runs.csv{message}"):
        read_straightness(written(tmp_path, SAMPLES, *rows))


def test_tracker_table(tmp_path: Path) -> None:
    header = "feature,distance_mm,elevation_deg,azimuth_deg"
    features = read_tracker(written(tmp_path, header, "X,2000,10,20", "C.1,3000,0,-90", "X,2100,11,21"))
    line, circle = features["X"], features["C.1"]
    readings = np.array([line.distance, line.elevation, line.azimuth])
    np.testing.assert_allclose(readings, [[2.0, 2.1], np.deg2rad([10, 11]), np.deg2rad([20, 21])])
    np.testing.assert_allclose([circle.distance, circle.elevation, circle.azimuth], [[3.0], [0.0], [-np.pi / 2]])
    with pytest.raises(InputError, match=":2: elevation_deg 100 is beyond ±90"):
        read_tracker(written(tmp_path, header, "X,2000,100,20"))


GRINDER_POSES = "X_mm,Z_mm,Y_mm,temperature_degC,dx_um,dy_um,dz_um"
TABLES = {
    "positioning": (lambda path: read_positioning(path, rotary=False), HEADER, GOOD),
    "rotary": (
        lambda path: read_positioning(path, rotary=True),
        "target_deg,direction,cycle,reading_deg",
        [f"{target},1,{cycle},{target}.001" for cycle in (1, 2) for target in (0, 90, 200)],
    ),
    "straightness": (read_straightness, SAMPLES, [f"1,a,1,{x},0.5" for x in range(6)]),
    "mirror": (read_mirror_profile, "distance_mm,height_um", ["0,0.0", "100,0.04", "200,0.0"]),
    "tracker": (read_tracker, "feature,distance_mm,elevation_deg,azimuth_deg", ["X,2000,10,20", "X,2100,11,21"]),
    "poses": (
        lambda path: read_probed_poses(path, load_machine("grinder_zhou2023"), 1.5e-6),
        GRINDER_POSES,
        ["-100,-20,30,20.5,1,2,3", "-200,-20,30,20.5,1,2,3"],
    ),
}


def with_last_value(row: str, value: str) -> str:
    return f"{row.rpartition(',')[0]},{value}"


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda header, rows: [], ":1: the file is empty"),
        (lambda header, rows: [header], ":1: a header and no row below it"),
        (lambda header, rows: [*rows], ":1: header .*; expected "),
        (lambda header, rows: [header, rows[0], with_last_value(rows[1], "nan")], ":3: .* is no finite number"),
        (lambda header, rows: [header, rows[0], with_last_value(rows[1], '"1,5"')], ":3: .* has a decimal comma"),
        (lambda header, rows: [header, rows[0], with_last_value(rows[1], "1,5")], ":3: .*not commas"),
        (lambda header, rows: [header, rows[0], with_last_value(rows[1], "")], ":3: .* is empty"),
        (lambda header, rows: [header, rows[0], with_last_value(rows[1], "9e7")], ":3: .* beyond .*another unit"),
    ],
    ids=["empty", "header_only", "no_header", "nan", "quoted_comma", "comma", "missing", "unit"],
)
def test_every_table_names_file_and_line(tmp_path: Path, kind: str, spoil, message: str) -> None:
    read, header, rows = TABLES[kind]
    read(written(tmp_path, header, *rows))
    with pytest.raises(InputError, match=f"runs.csv{message}"):
        read(written(tmp_path, *spoil(header, rows)))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("-100000,-20,30,20,1,2,3", r":2: axis X at -100000 mm is beyond its travel, -1400 to 0 mm: is it in another"),
        ("-100,20,30,20,1,2,3", r":2: axis Z at 20 mm is beyond its travel, -800 to 0 mm"),
        ("-100,-20,30,20,1,2,3000", r":2: dz_um 3000 is beyond ±1000: is it in another unit"),
    ],
)
def test_poses_that_the_machine_does_not_reach(tmp_path: Path, row: str, message: str) -> None:
    with pytest.raises(InputError, match=f"runs.csv{message}"):
        read_probed_poses(written(tmp_path, GRINDER_POSES, row), load_machine("grinder_zhou2023"), 1.5e-6)


def test_a_direction_that_is_none(tmp_path: Path) -> None:
    header = "X_mm,X_direction,Z_mm,Z_direction,Y_mm,Y_direction,temperature_degC,dx_um,dy_um,dz_um"
    path = written(tmp_path, header, "-100,1,-20,-1,30,0,20.5,1,2,3", "-100,1,-20,2,30,0,20.5,1,2,3")
    with pytest.raises(InputError, match=r"runs.csv:3: Z_direction 2; expected 1, -1, or 0 where unknown"):
        read_probed_poses(path, load_machine("grinder_zhou2023"), 1.5e-6)


def test_poses_table(tmp_path: Path) -> None:
    machine = load_machine("grinder_zhou2023")
    header = "X_mm,Z_mm,Y_mm,temperature_degC,dx_um,dy_um,dz_um"
    poses = read_probed_poses(written(tmp_path, header, "-100,-20,30,20.5,1,2,3"), machine, 1.5e-6)
    np.testing.assert_allclose(poses.positions, [[-0.1, -0.02, 0.03]])
    np.testing.assert_allclose(poses.deviations, [[1e-6, 2e-6, 3e-6]])
    np.testing.assert_array_equal(poses.direction, 0)
    assert poses.temperature.tolist() == [20.5]
    header = "X_mm,X_direction,Z_mm,Z_direction,Y_mm,Y_direction,temperature_degC,dx_um,dy_um,dz_um"
    poses = read_probed_poses(written(tmp_path, header, "-100,1,-20,-1,30,1,20.5,1,2,3"), machine, 1.5e-6)
    np.testing.assert_array_equal(poses.direction, [[1, -1, 1]])


def poses_bag(
    folder: Path,
    machine: MachineDescription,
    positions: np.ndarray,
    direction: np.ndarray,
    temperature: dict[int, float] | None = None,
) -> Path:
    """Poses along X: 1 µm more at each target, 3 µm more from below, 0.1 µm more in each cycle; some temperatures."""
    contents: dict[str, list[Content]] = {JOINT_STATES: [], TOOL_PROBE: []}
    for k, read in (temperature or {}).items():
        contents.setdefault(TEMPERATURE, []).append(Temperature((k + 1) * 1_000_000_000, read))
    for k, (row, way) in enumerate(zip(positions, direction, strict=True)):
        stamp = (k + 1) * 1_000_000_000
        point = np.array([1e-5 * row[0] + 1.5e-6 * way[0] + 1e-7 * (k // 6), 7e-6, 0.0])
        contents[JOINT_STATES].append(JointState(stamp, machine.letters, row, way, np.array([])))
        contents[TOOL_PROBE].append(PointStamped(stamp, point))
    bag = folder / "bag"
    write_messages(bag, contents)
    return bag


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        ({}, [20.0, 20.0, 20.0, 20.0]),
        ({0: 24.0, 3: 27.0}, [24.0, 25.0, 26.0, 27.0]),
        ({1: 24.0, 2: float("nan"), 3: 26.0}, [24.0, 24.0, 25.0, 26.0]),
        ({0: 24.0, 1: 85.0, 2: -127.0, 3: 27.0}, [24.0, 25.0, 26.0, 27.0]),
    ],
)
def test_a_pose_of_a_bag_without_a_temperature_has_that_between_its_neighbours(
    tmp_path: Path, read: dict[int, float], expected: list[float]
) -> None:
    """It had the reference temperature, degrees from that of the poses before and after it."""
    machine, rows = load_machine("pan2013"), np.zeros((4, 5))
    poses = read_probed_poses(poses_bag(tmp_path, machine, rows, np.ones((4, 5)), read), machine, 1.5e-6)
    assert poses.temperature.tolist() == pytest.approx(expected)
    beyond = "temperature: 2 of 4 readings are beyond 5 to 45 °C, the first is 85; not used"
    assert poses.remarks == ((beyond,) if 85.0 in read.values() else ())


def test_a_temperature_of_a_table_that_no_machine_has_is_not_used_either(tmp_path: Path) -> None:
    machine, header = load_machine("grinder_zhou2023"), "X_mm,Z_mm,Y_mm,temperature_degC,dx_um,dy_um,dz_um"
    rows = [f"-100,-20,30,{read},1,2,{read / 7:.3f}" for read in (20.5, 85.0, 21.5)]
    poses = read_probed_poses(written(tmp_path, header, *rows), machine, 1.5e-6)
    assert poses.temperature.tolist() == [20.5, 21.0, 21.5]
    assert len(poses.remarks) == 1


def test_positioning_from_a_bag(tmp_path: Path) -> None:
    machine = load_machine("pan2013")
    positions, direction = np.zeros((18, 5)), np.ones((18, 5))
    positions[:, 0] = np.tile([0.0, 0.1, 0.2, 0.2, 0.1, 0.0], 3)
    direction[:, 0] = np.tile([1, 1, 1, -1, -1, -1], 3)
    runs, _ = read_positioning_poses(poses_bag(tmp_path, machine, positions, direction), machine, "X")
    np.testing.assert_allclose(runs.targets, [0.0, 0.1, 0.2], atol=1e-12)
    expected = 1e-6 * np.array([[1.5, 1.6, 1.7], [2.5, 2.6, 2.7], [3.5, 3.6, 3.7]])
    np.testing.assert_allclose(runs.forward, expected, atol=1e-15)
    assert runs.backward is not None
    np.testing.assert_allclose(runs.backward, expected - 3e-6, atol=1e-15)
    with pytest.raises(InputError, match="other axes than Y move"):
        read_positioning_poses(tmp_path / "bag", machine, "Y")


def test_positioning_of_a_rotary_axis_from_a_bag(tmp_path: Path) -> None:
    """C over more than a turn, the head tilted by 90 degrees: the tip is 0.5 m from the axis and goes round with it."""
    machine = load_machine("pan2013")
    targets = np.deg2rad([-200.0, -95.0, 0.0, 80.0, 180.0, 270.0])
    positions, direction = np.zeros((24, 5)), np.ones((24, 5))
    positions[:, 4] = np.pi / 2
    positions[:, 3] = np.tile([*targets, *targets[::-1]], 2)
    direction[:, 3] = np.tile(np.repeat([1, -1], 6), 2)
    contents: dict[str, list[Content]] = {JOINT_STATES: [], TOOL_PROBE: []}
    for k, (row, way) in enumerate(zip(positions, direction, strict=True)):
        # Rz(C) Rx(90°) (0, 0, -0.5) is 0.5 (-sin C, cos C, 0): turned on by an angle it goes along (-cos C, -sin C, 0).
        angle = 1e-5 * row[3] + 4e-6 * way[3] + 1e-6 * (k // 12)
        along = np.array([-np.cos(row[3]), -np.sin(row[3]), 0.0])
        point = 0.5 * angle * along + 3e-6 * np.array([-np.sin(row[3]), np.cos(row[3]), 1.0])
        contents[JOINT_STATES].append(JointState((k + 1) * 10**9, machine.letters, row, way, np.array([])))
        contents[TOOL_PROBE].append(PointStamped((k + 1) * 10**9, point))
    write_messages(tmp_path / "bag", contents)
    runs, _ = read_positioning_poses(tmp_path / "bag", machine, "C")
    assert runs.rotary
    np.testing.assert_allclose(runs.targets, targets, atol=1e-6)
    expected = (1e-5 * targets + 4e-6)[:, None] + np.array([[0.0, 1e-6]])
    np.testing.assert_allclose(runs.forward, expected, atol=1e-12)
    assert runs.backward is not None
    np.testing.assert_allclose(runs.backward, expected - 8e-6, atol=1e-12)
    with pytest.raises(InputError, match="other axes than A move"):
        read_positioning_poses(tmp_path / "bag", machine, "A")


def test_a_tool_on_the_axis_shows_no_angle(tmp_path: Path) -> None:
    machine = load_machine("pan2013")
    positions = np.zeros((4, 5))
    positions[:, 3] = [0.0, 1.0, 0.0, 1.0]
    bag = poses_bag(tmp_path, machine, positions, np.ones((4, 5)))
    with pytest.raises(InputError, match=r"bag: the tool tip is 0.0 mm from axis C, too near"):
        read_positioning_poses(bag, machine, "C")


def test_a_bag_that_does_not_say_the_direction(tmp_path: Path) -> None:
    machine = load_machine("pan2013")
    bag = poses_bag(tmp_path, machine, np.zeros((2, 5)), np.zeros((2, 5)))
    with pytest.raises(InputError, match="pose 1 does not say from which side"):
        read_positioning_poses(bag, machine, "X")


def test_a_probe_without_joint_state_is_named(tmp_path: Path) -> None:
    machine = load_machine("pan2013")
    state = JointState(1, ("X", "Y"), np.zeros(2), np.zeros(2), np.zeros(2))
    for name, stamp, message in (
        ("late", 2, "no /machine/joint_states with the same stamp"),
        ("few", 1, "axis Z, C, A"),
        ("unit", 3, "beyond ±0.001 m: is it in m"),
    ):
        bag = tmp_path / name
        write_messages(bag, {JOINT_STATES: [state], TOOL_PROBE: [PointStamped(stamp, np.full(3, 5.0 * (stamp == 3)))]})
        with pytest.raises(InputError, match=message):
            read_probed_poses(bag, machine, 1.5e-6)


def test_a_bag_without_poses_says_what_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such bag"):
        read_probed_poses(tmp_path / "bag", load_machine("pan2013"), 1.5e-6)
