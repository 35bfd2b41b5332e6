"""Flatness before and after compensation, predicted from machine files, against scalar loops and the machine model."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.calibration.grinding import VerticalErrors, predict_flatness
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.metrology.guideway_compensation import predict_error_matrix, rotate_monotone
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
WORKPIECE = {"X": (-1.4, 0.0), "Z": (-0.65, -0.15)}
GRINDER = load_machine("grinder_zhou2023")
COMMAND = ["calibrate", "flatness", "grinder_zhou2023", "--vertical", "Y", "--workpiece", "X=-1400,0", "Z=-650,-150"]
SIZES = (0.0, 0.25e-6, 0.5e-6, 1e-6, 2e-6, 3e-6)


def errors(*reversal: float, positioning: float = 1.2e-6) -> VerticalErrors:
    return VerticalErrors(reversal, positioning, 20e-6)


def level(x: Array, y: Array) -> Array:
    return np.asarray(y - np.polyval(np.polyfit(x, y, 1), x))


def random_machine(folder: Path, seed: int, *, monotone: bool = False) -> Path:
    """The grinder with other guideways, written as `calibrate straightness` writes them."""
    rng = np.random.default_rng(seed)
    path = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), folder / f"machine_{seed}_{monotone}.yaml"))
    file = MachineFile(path)
    for name, length, size in (("EYX", 1.4, 5.5e-6), ("EYZ", 0.8, 5.8e-6)):
        x = np.linspace(-length, 0.0, 101)
        y = sum(rng.normal() / k * np.cos(np.pi * k * x / length + rng.uniform(0, 6.3)) for k in range(1, 6))
        y = level(x, np.asarray(y))
        y = y * size / np.ptp(y)
        file.set_table(name, x, y, None)
        slope = np.tan(rotate_monotone(x, y).angle) if monotone else 0.0
        file.set_slope(name, float(slope))
    file.save(path)
    return path


def test_the_shipped_grinder_has_the_flatness_of_the_paper() -> None:
    """7.54 µm before compensation, 2.98 µm after it by a vertical axis whose positioning error is 1.2 µm."""
    found = predict_flatness(GRINDER, "Y", WORKPIECE, errors(*SIZES))
    for each in found.comparisons:
        assert each.before.flatness == pytest.approx(7.54e-6, abs=0.005e-6)
        assert each.rotated.flatness < 2.98e-6
        assert each.rotated.reversals == 0
        assert each.unrotated.reversals > 0
    unrotated = [each.unrotated.flatness for each in found.comparisons]
    assert np.all(np.diff(unrotated) > 0)
    # without a reversal error the curves as measured do better: they move the axis, and show its error, less
    assert unrotated[0] < found.comparisons[0].rotated.flatness
    assert unrotated[-1] > 2 * found.comparisons[-1].rotated.flatness
    assert found.break_even is not None
    assert 0.25e-6 < found.break_even < 1e-6


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("reversal", [0.0, 0.7e-6, 4e-6])
def test_the_surface_against_scalar_loops(tmp_path: Path, seed: int, reversal: float) -> None:
    """Each pass ground point by point, by a vertical axis with play and no positioning error."""
    machine = load_machine(random_machine(tmp_path, seed))
    found = predict_flatness(machine, "Y", WORKPIECE, errors(reversal, positioning=0.0))
    x, z = np.linspace(-1.4, 0, 281), np.linspace(-0.65, -0.15, 281)
    curves = []
    for name, at in (("EYX", x), ("EYZ", z)):
        table = machine.errors[name].table
        assert table is not None
        nodes = np.unique([*table.positions, *np.linspace(table.positions[0], table.positions[-1], 281).round(9)])
        curve = np.interp(nodes, table.positions, table.forward)
        curves.append(np.interp(at, nodes, level(nodes, curve)))
    truth = curves[0][:, None] + curves[1][None, :]
    ground = np.empty_like(truth)
    falling = truth[-1, 0] < truth[0, 0]  # so the correction rises over a pass
    for k in range(0, 281, 28):
        wheel = -truth[0, k] + (-reversal / 2 if falling else reversal / 2)
        for i in range(281):
            target = -truth[i, k]
            wheel = max(wheel, target - reversal / 2) if target > wheel else min(wheel, target + reversal / 2)
            ground[i, k] = truth[i, k] + wheel
    kept = np.arange(0, 281, 28)
    grid = np.stack([np.ones((281, 11)), *np.meshgrid(x, z[kept], indexing="ij")], axis=-1).reshape(-1, 3)
    surfaces = found.comparisons[0]
    for heights, expected in ((surfaces.unrotated.heights, ground), (surfaces.before.heights, truth)):
        one, other = heights[:, kept].ravel(), expected[:, kept].ravel()
        rest = one - other
        np.testing.assert_allclose(rest, grid @ np.linalg.lstsq(grid, rest, rcond=None)[0], rtol=0, atol=1e-12)
    assert surfaces.rotated.flatness < 1e-11


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(4))
def test_prediction_file_and_node_rotate_alike(tmp_path: Path, seed: int) -> None:
    """The trajectory is what the compensation adds to Y on the file, and the same from a file without rotation."""
    rotated = predict_flatness(load_machine(random_machine(tmp_path, seed, monotone=True)), "Y", WORKPIECE, errors(0.0))
    plain = predict_flatness(load_machine(random_machine(tmp_path, seed)), "Y", WORKPIECE, errors(0.0))
    machine = load_machine(random_machine(tmp_path, seed, monotone=True))
    x, z = (curve.positions[::28] for curve in rotated.curves)
    grid = np.stack([*np.meshgrid(x, z, indexing="ij"), np.full((x.size, z.size), 0.1)], axis=-1)
    solved = solve_axis_corrections(arrange_machine(machine), grid.reshape(-1, 3)).corrections[:, 2]
    node = solved.reshape(x.size, z.size)
    for prediction in (rotated, plain):
        trajectory = prediction.trajectory[::28, ::28]
        np.testing.assert_allclose(trajectory - trajectory[0, 0], node - node[0, 0], rtol=0, atol=1e-9)


@pytest.mark.few(3)
@pytest.mark.parametrize("short", [1e-9, 0.02e-3, 0.5e-3, 10e-3])
@pytest.mark.parametrize("seed", range(3))
def test_a_table_that_ends_a_little_short_of_the_travel_counts_to_its_end(
    tmp_path: Path, seed: int, short: float
) -> None:
    """As the machine's model has it: the last value holds. More than a row of the table is refused."""
    path = random_machine(tmp_path, seed)
    file = MachineFile(path)
    table = file.machine.errors["EYX"].table
    assert table is not None
    x = np.linspace(-1.4 + short, -short, 101)
    y = np.interp(x, table.positions, table.forward)
    file.set_table("EYX", x, y, None)
    file.save(path)
    machine = load_machine(path)
    found = predict_flatness(machine, "Y", WORKPIECE, errors(0.0))
    at = np.linspace(-1.4, 0.0, 281)
    poses = np.stack([at, np.full(281, -0.4), np.full(281, 0.1)], axis=1)
    height = predict_tool_offset(arrange_machine(machine), poses)[:, 1]
    line = height - found.curves[0].errors
    # straight lines between nodes leave a thousandth of the curve between them
    np.testing.assert_allclose(level(at, line), 0.0, atol=5e-9)
    far = tmp_path / "far.yaml"
    shutil.copy(path, far)
    file = MachineFile(far)
    file.set_table("EYX", np.linspace(-1.4 + 0.03, 0.0, 101), y, None)
    file.save(far)
    with pytest.raises(InputError, match=r"reaches beyond the straightness measured from -137"):
        predict_flatness(load_machine(far), "Y", WORKPIECE, errors(0.0))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("under", ["", "x", "xz"])
def test_errors_of_axes_under_the_workpiece_count_the_other_way(tmp_path: Path, seed: int, under: str) -> None:
    """Against the machine's model: where the tool stands higher over the workpiece, the surface does."""
    path = random_machine(tmp_path, seed)
    text = path.read_text(encoding="utf-8")
    if "x" in under:
        text = text.replace("{name: workpiece, parent: base}", "{name: workpiece, parent: x_slide}")
        text = text.replace("{name: z_slide, parent: x_slide, axis: Z}", "{name: z_slide, parent: base, axis: Z}")
    if "z" in under:
        text = text.replace("{name: x_slide, parent: base", "{name: x_slide, parent: z_slide")
        text = text.replace("{name: y_slide, parent: z_slide", "{name: y_slide, parent: base")
        lines = text.splitlines()
        bodies = [k for k, line in enumerate(lines) if "{name: " in line and "parent" in line]
        order = ["z_slide", "x_slide", "workpiece", "y_slide", "wheel"]
        moved = sorted((lines[k] for k in bodies), key=lambda line: order.index(line.split("name: ")[1].split(",")[0]))
        for k, line in zip(bodies, moved, strict=True):
            lines[k] = line
        text = "\n".join(lines)
    elif "x" in under:
        lines = text.splitlines()
        bodies = [k for k, line in enumerate(lines) if "{name: " in line and "parent" in line]
        order = ["x_slide", "workpiece", "z_slide", "y_slide", "wheel"]
        moved = sorted((lines[k] for k in bodies), key=lambda line: order.index(line.split("name: ")[1].split(",")[0]))
        for k, line in zip(bodies, moved, strict=True):
            lines[k] = line
        text = "\n".join(lines)
    path.write_text(text, encoding="utf-8")
    machine = load_machine(path)
    found = predict_flatness(machine, "Y", WORKPIECE, errors(0.0))
    x, z = (curve.positions[::28] for curve in found.curves)
    poses = np.stack([*np.meshgrid(x, z, indexing="ij"), np.full((x.size, z.size), 0.1)], axis=-1).reshape(-1, 3)
    offset = predict_tool_offset(arrange_machine(machine), poses)[:, 1]
    plane = np.column_stack([np.ones(len(poses)), poses[:, :2]])
    rest = predict_error_matrix(*(curve.errors for curve in found.curves))[::28, ::28].ravel() - offset
    assert np.abs(rest - plane @ np.linalg.lstsq(plane, rest, rcond=None)[0]).max() < 1e-9


def grinding_csv(path: Path, heights: Array, x: Array, z: Array) -> Path:
    rows = [f"{a * 1e3:g},{b * 1e3:g},{h * 1e6:.5f}" for a, b, h in zip(x, z, heights, strict=True)]
    path.write_text("\n".join(["X_mm,Z_mm,height_um", *rows]), encoding="utf-8")
    return path


def ground(seed: int, waves: float = 0.3e-6) -> tuple[Array, Array, Array]:
    """A workpiece of the shipped grinder: its straightness, a tilt, and waves of another cause, m."""
    rng = np.random.default_rng(seed)
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.4, 0, 57), np.linspace(-0.65, -0.15, 21)))
    heights = 30e-6 * x - 20e-6 * z + 4e-6
    for name, at in (("EYX", x), ("EYZ", z)):
        table = GRINDER.errors[name].table
        assert table is not None
        heights = heights + np.interp(at, table.positions, table.forward)
    return x, z, heights + waves * np.sin(40 * x + rng.uniform(0, 6.3)) * np.cos(30 * z + rng.uniform(0, 6.3))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_measured_workpiece_beside_the_prediction(tmp_path: Path, seed: int, capsys) -> None:
    x, z, heights = ground(seed)
    before = grinding_csv(tmp_path / "before.csv", heights, x, z)
    after = grinding_csv(tmp_path / "after.csv", 0.4 * ground(seed + 10)[2], x, z)
    figure, trajectory = tmp_path / "flat.png", tmp_path / "wheel.csv"
    words = ["--positioning-um", 1.2, "--reversal-um", 0.5, 2, "--measured", before, "--measured-after", after]
    words += ["--figure", figure, "--trajectory", trajectory, "--step-mm", 25]
    assert main([*COMMAND, *map(str, words)]) == 0
    said = capsys.readouterr().out
    found = re.search(
        r"measured before compensation: flatness ([\d.]+) µm over 1197 points\n"
        r" +predicted there ([\d.]+) µm, what is left ([\d.]+) µm; straightness explains (\d+)%",
        said,
    )
    assert found is not None, said
    measured, predicted, left, explained = map(float, found.groups())
    plane = np.column_stack([np.ones_like(x), x, z])
    for found_um, shape in ((measured, heights), (predicted, ground(seed, 0.0)[2])):
        exact = np.ptp(shape - plane @ np.linalg.lstsq(plane, shape, rcond=None)[0]) * 1e6
        assert found_um == pytest.approx(exact, abs=2e-3)
    assert left == pytest.approx(0.6, abs=0.1)
    assert explained >= 98
    assert "measured after compensation: flatness" in said
    assert figure.stat().st_size > 50_000
    lines = trajectory.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "X_mm,Z_mm,error_um,Y_correction_um"
    assert len(lines) == 1 + 57 * 21
    cells = np.array([line.split(",") for line in lines[1:]], dtype=np.float64)
    grid = np.column_stack([cells[:, :2] / 1e3, np.full(len(cells), 0.1)])
    node = solve_axis_corrections(arrange_machine(GRINDER), grid).corrections[:, 2] * 1e6
    np.testing.assert_allclose(cells[:, 3] - cells[0, 3], node - node[0], rtol=0, atol=2e-3)


def test_a_trajectory_is_where_it_says(tmp_path: Path) -> None:
    """Also where its positions have more digits than a few: to 10 nm in a metre and more."""
    words = ["--positioning-um", 1.2, "--trajectory", tmp_path / "wheel.csv", "--step-mm", 0.3]
    start = COMMAND.index("--workpiece")
    command = [*COMMAND[: start + 1], "X=-1400,-1390", "Z=-650,-640", *COMMAND[start + 3 :]]
    assert main([*command, *map(str, words)]) == 0
    cells = np.loadtxt(tmp_path / "wheel.csv", delimiter=",", skiprows=1)
    for column, begin in ((cells[::35, 0], -1400), (cells[:35, 1], -650)):
        np.testing.assert_allclose(column, np.linspace(begin, begin + 10, 35), rtol=0, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_points_measured_more_than_once_count_by_their_means_and_tell_the_noise(
    tmp_path: Path, seed: int, capsys
) -> None:
    x, z, heights = (each[::3] for each in ground(seed, 0.0))
    rng = np.random.default_rng(seed)
    words, said = [*COMMAND, "--positioning-um", "1.2", "--reversal-um", "1", "--measured"], []
    seen = np.round(heights + 1e-7 * rng.normal(size=(2, heights.size)), 11)
    twice = grinding_csv(tmp_path / "twice.csv", seen.ravel(), np.tile(x, 2), np.tile(z, 2))
    means = grinding_csv(tmp_path / "means.csv", seen.mean(axis=0), x, z)
    scatter = 1e6 * np.sqrt(np.sum((seen[0] - seen[1]) ** 2 / 2) / heights.size)
    for words_more in ([twice], [means], [twice, "--height-noise-um", "0.02"]):
        assert main([*words, *map(str, words_more)]) == 0
        said.append(capsys.readouterr().out.partition("measured before compensation: ")[2])
    flatness = rf"flatness \d+\.\d+ µm over {heights.size} points\n"
    repeats = (
        rf"  {heights.size} of them measured more than once: the means count; readings scatter about them by "
        rf"{scatter:.3f} µm \(degrees of freedom {heights.size}\)\n"
    )
    assert re.match(rf"{flatness}{repeats}  (95 % interval without noise|no 95 % interval: it has more)", said[0])
    assert re.match(rf"{flatness}  predicted", said[1]) and said[1].split()[1] == said[0].split()[1]
    assert "no 95 % interval: noise of 0.02 µm does not explain how repeated readings scatter (p-value" in said[2]


def test_a_point_measured_twice_is_told(tmp_path: Path, capsys) -> None:
    x, z, heights = (np.append(each, each[5]) for each in ground(0))
    heights[-1] += 2e-6
    words = [*COMMAND, "--positioning-um", "1.2", "--reversal-um", "1", "--height-noise-um", "0.1", "--measured"]
    assert main([*words, str(grinding_csv(tmp_path / "x.csv", heights, x, z))]) == 0
    told = capsys.readouterr().out
    assert f"over {x.size - 1} points\n  1 of them measured more than once: the means count; readings scatter" in told
    assert "by 1.414 µm (degrees of freedom 1)" in told and "does not explain how repeated readings" in told


def test_a_measured_workpiece_as_an_instrument_writes_it(tmp_path: Path, capsys) -> None:
    x, z, heights = ground(5)
    own = grinding_csv(tmp_path / "own.csv", heights, x, z)
    other = tmp_path / "other.txt"
    rows = [f"{k};{b:.4f};{a:.4f};{h * 1e9:.2f}" for k, (a, b, h) in enumerate(zip(x, z, heights, strict=True))]
    other.write_text("\n".join(["n;across;along;nm", *rows]).replace(".", ","), encoding="utf-8")
    words, said = [*COMMAND, "--positioning-um", "1.2", "--reversal-um", "1", "--measured"], []
    for more in ([own], [other, "--columns", "X=along,m", "Z=across,m", "height=nm,nm"]):
        assert main([*words, *map(str, more)]) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    assert main([*words, str(other), "--columns", "X=along,m", "Z=across,m"]) == 2
    assert "--columns names X, Z; expected X, Z, height" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda x, z, h: (x / 1e3, z / 1e3, h), "the points span 1.4 mm of the workpiece's 1400 mm along X"),
        (lambda x, z, h: (x + 0.1, z, h), "before.csv:55: X 25 mm is beyond the workpiece, -1400 to 0 mm"),
        (lambda x, z, h: (x, z, h / 1e3), "are the heights in µm?"),
        (lambda x, z, h: (x[:8], z[:8], h[:8]), "before.csv:9: the surface ends here with 8 point(s); 9 are needed"),
        (lambda x, z, h: (x[:57], -0.65 - x[:57] / 2.8, h[:57]), "lie about one line"),
    ],
)
def test_a_workpiece_that_cannot_be(tmp_path: Path, change, problem: str, capsys) -> None:
    x, z, heights = change(*ground(0))
    before = grinding_csv(tmp_path / "before.csv", heights, x, z)
    figure = tmp_path / "flat.png"
    words = ["--positioning-um", "1.2", "--reversal-um", "1", "--measured", str(before), "--figure", str(figure)]
    assert main([*COMMAND, *words]) == 2
    assert problem in capsys.readouterr().err
    assert not figure.exists()


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (["--positioning-period-um", "0.01"], "waves of 0.01 µm; expected 0.1 µm or more"),
        (["--trajectory", "wheel.csv", "--step-mm", "0.1"], "a trajectory of 70019001 points, 0.1 mm apart"),
        (["--figure", "nowhere/flat.png"], "nowhere/flat.png: cannot be written (no folder nowhere)"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, more: list[str], problem: str, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*COMMAND, "--positioning-um", "1.2", "--reversal-um", "1", *more]) == 2
    assert problem in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("workpiece", "message"),
    [
        ({"X": (-1.4, 0.0)}, "expected two axes other than Y"),
        ({"X": (-1.4, 0.0), "Y": (0.0, 0.1)}, "expected two axes other than Y"),
        ({"X": (-1.4, 0.1), "Z": (-0.5, 0.0)}, "X -1400 to 100 mm is not within the travel of X, -1400 to 0 mm"),
        ({"X": (-1.4, 0.0), "Z": (-0.15, -0.65)}, "workpiece Z -150 to -650 mm: expected the lower end first"),
        ({"X": (-1.4e-3, 0.0), "Z": (-6.5e-4, -1.5e-4)}, r"covers 0\.10% of the travel of X and Z at most: .* in mm"),
    ],
)
def test_bad_workpieces_are_refused(workpiece: dict[str, tuple[float, float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        predict_flatness(GRINDER, "Y", workpiece, errors(0.0))


def test_a_workpiece_beyond_what_was_measured_is_refused(tmp_path: Path) -> None:
    path = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "machine.yaml"))
    file = MachineFile(path)
    x = np.linspace(-0.6, -0.2, 21)
    file.set_table("EYZ", x, 1e-6 * np.cos(20 * x), None)
    file.save(path)
    with pytest.raises(
        InputError, match=r"from -650 mm to -150 mm reaches beyond the straightness measured from -600 mm"
    ):
        predict_flatness(load_machine(path), "Y", WORKPIECE, errors(0.0))


def test_the_readme_shows_what_comes_out(capsys) -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    shown = re.search(
        r"```sh\nrotary_error_monitor (calibrate flatness [^\n]*)\n```\n\n```text\n(.*?)```", readme, re.DOTALL
    )
    assert shown is not None
    assert main(shown[1].split()) == 0
    assert capsys.readouterr().out == shown[2]


@pytest.mark.parametrize("option", ["--height-noise-um=0.1", "--columns=height=h,um"])
def test_what_is_said_of_a_surface_that_is_not_given_is_an_error(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "calibrate flatness grinder_zhou2023 --vertical Y --workpiece X=-1400,0 Z=-650,-150 --positioning-um 1.2"
    assert main([*words.split(), option]) == 2
    said = capsys.readouterr()
    assert option.partition("=")[0] in said.err and "give --measured or --measured-after" in said.err
    assert not said.out
