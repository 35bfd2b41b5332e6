"""Tables as instruments write them: preambles, other columns, separators, decimal commas, other units and words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.calibration.collimator_steps import Quadrants, read_steps
from rotary_error_monitor.calibration.machine_poses import read_probed_poses
from rotary_error_monitor.calibration.measurements import read_positioning, read_straightness
from rotary_error_monitor.calibration.tracker_features import read_tracker
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError

TARGETS = [-100.0, 0.0, 100.0]
OWN = "target_mm,direction,cycle,deviation_um"
WORDS = ["target=Pos.", "direction=Dir", "cycle=Run No", "deviation=Error (um)"]


def own_rows() -> list[tuple[float, int, int, float]]:
    rng = np.random.default_rng(1)
    return [
        (target, sign, cycle, round(float(rng.normal()), 3))
        for cycle in (1, 2)
        for sign in (1, -1)
        for target in TARGETS[::sign]
    ]


def foreign(folder: Path, separator: str, decimal: str, scale: tuple[float, float], signs: tuple[str, str]) -> Path:
    """The same readings among other columns, below a preamble, with an empty line at the end."""
    headers = ["No", "Error (um)", "Pos.", "Dir", "Run No", "Remark"]
    lines = ["Linear measurement; 2026-11-26", 'operator, "N. N."', "", separator.join(headers)]
    for number, (target, sign, cycle, deviation) in enumerate(own_rows()):
        cells = [str(number), f"{deviation * scale[1]:.6f}", f"{target * scale[0]:.6f}"]
        cells = [cell.replace(".", decimal) for cell in cells]
        lines.append(separator.join([*cells, signs[0] if sign > 0 else signs[1], str(cycle), ""]))
    path = folder / "laser.txt"
    path.write_text("\ufeff" + "\n".join([*lines, ""]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_a_foreign_table_is_read_as_ones_own(tmp_path: Path, separator: str, decimal: str) -> None:
    own = tmp_path / "own.csv"
    own.write_text("\n".join([OWN, *(",".join(map(str, row)) for row in own_rows())]), encoding="utf-8")
    expected = read_positioning(own, rotary=False)
    for scale, units, signs in (
        ((1.0, 1.0), ("", ""), ("1", "-1")),
        ((1e-3, 1e3), (",m", ",nm"), ("+", "-")),
        ((1e3, 1e-3), (",um", ",mm"), ("Forward", "REV")),
    ):
        path = foreign(tmp_path, separator, decimal, scale, signs)
        words = [WORDS[0] + units[0], *WORDS[1:3], WORDS[3] + units[1]]
        found = read_positioning(path, rotary=False, layout=ColumnLayout.of(words))
        np.testing.assert_allclose(found.targets, expected.targets, atol=1e-12)
        np.testing.assert_allclose(found.forward, expected.forward, atol=1e-12)
        np.testing.assert_allclose(found.backward, expected.backward, atol=1e-12)


def test_readings_of_a_tracker_and_along_a_mirror(tmp_path: Path) -> None:
    path = tmp_path / "tracker.txt"
    path.write_text("Point;D;V;Hz\nX;1,5;0,1;0,2\nX;1,6;0,1;0,2\n", encoding="utf-8")
    layout = ColumnLayout.of(["feature=Point", "distance=D,m", "elevation=V,rad", "azimuth=Hz,rad"])
    seen = read_tracker(path, layout)["X"]
    np.testing.assert_allclose(seen.distance, [1.5, 1.6])
    np.testing.assert_allclose([seen.elevation[0], seen.azimuth[0]], [0.1, 0.2])
    rows = [f"a\t1\tfwd\t{x}\t{x / 1000:.3f}" for x in range(12)]
    path.write_text("Seg\tR\tD\tX\tG\n" + "\n".join(rows), encoding="utf-8")
    words = ["segment=Seg", "run=R", "direction=D", "position=X,mm", "reading=G,um"]
    placement = read_straightness(path, layout=ColumnLayout.of(words))["a"]
    assert len(placement.runs[0].positions) == 12


def test_steps_before_an_autocollimator(tmp_path: Path) -> None:
    """Tilts in µrad as one reads them, and voltages of channels by their names."""
    path = tmp_path / "steps.txt"
    path.write_text("S;RX;RY;X;Y\na;10;0;48,5;0,1\na;10;0;48,4;0\nb;0;10;0;48,6\n", encoding="utf-8")
    words = ["step=S", "reference_x=RX,arcsec", "reference_y=RY,arcsec", "tilt_x=X,urad", "tilt_y=Y,urad"]
    steps, voltages = read_steps(path, Quadrants(), ColumnLayout.of(words))
    assert not voltages and steps.names == ("a", "b") and steps.step.tolist() == [0, 0, 1]
    np.testing.assert_allclose(steps.readings, np.array([[48.5, 0.1], [48.4, 0], [0, 48.6]]) * 1e-6)
    np.testing.assert_allclose(steps.reference, np.array([[10, 0], [0, 10]]) * np.pi / 648000)
    path.write_text("RX,RY,Ch0,Ch1,Ch2,Ch3\n0,0,1,1,1,1\n10,0,1,1,1.1,1.1\n", encoding="utf-8")
    words = ["reference_x=RX,mrad", "reference_y=RY,mrad", *(f"q{k + 1}_V=Ch{k}" for k in range(4))]
    steps, voltages = read_steps(path, Quadrants(), ColumnLayout.of(words))
    assert voltages and steps.reference[1, 0] == pytest.approx(0.01) and steps.readings[0].tolist() == [0.0, 0.0]


def test_probed_poses(tmp_path: Path) -> None:
    machine = load_machine("xyzac_trt")
    names = [f"{letter}={letter.lower()}" for letter in machine.letters]
    ways = [f"{letter}_direction=way {letter}" for letter in machine.letters]
    words = [*names, *ways, "temperature=T", "dx=ex,mm", "dy=ey,mm", "dz=ez,mm"]
    headers = [word.partition("=")[2].partition(",")[0] for word in words]
    rows = [["1,5"] * 5 + ["+", "-", "0", "Forward", "rev"] + ["20,5", "0,001", "0,002", "-0,003"]]
    path = tmp_path / "poses.txt"
    path.write_text("\n".join("\t".join(row) for row in [headers, *rows]), encoding="utf-8")
    poses = read_probed_poses(path, machine, 1e-6, ColumnLayout.of(words))
    np.testing.assert_allclose(poses.positions[0, :3], 1.5e-3)
    np.testing.assert_allclose(poses.positions[0, 3:], np.radians(1.5))
    assert poses.direction.tolist() == [[1, -1, 0, 1, -1]] and poses.temperature.tolist() == [20.5]
    np.testing.assert_allclose(poses.deviations, [[1e-6, 2e-6, -3e-6]])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["target"], r"--columns: 'target'; expected what it is, =, the column's header and, after a comma, its unit"),
        (["target=Pos.", "target=X"], r"--columns: 'target=X': target or X stands twice"),
        (
            WORDS[:3],
            r"--columns names target, direction, cycle; expected target, direction, cycle, deviation or",
        ),
        (
            [WORDS[0] + ",deg", *WORDS[1:]],
            r"--columns: target is a length; its unit is not deg but one of m, mm, um",
        ),
        ([WORDS[0], WORDS[1] + ",mm", *WORDS[2:]], r"--columns: direction is a number without a unit; .* but none"),
        (["target=Position", *WORDS[1:]], r"laser\.txt: no line has the headers Position, .* that --columns names"),
        (
            [WORDS[0] + ",m", *WORDS[1:]],
            r"laser\.txt:5: target_m -100000\.000000 is beyond ±100: is it in",
        ),
    ],
)
def test_what_is_refused(tmp_path: Path, words: list[str], message: str) -> None:
    path = foreign(tmp_path, ";", ".", (1e3, 1.0), ("1", "-1"))
    with pytest.raises(InputError, match=message):
        read_positioning(path, rotary=False, layout=ColumnLayout.of(words))


def test_rows_that_are_wrong_have_their_line(tmp_path: Path) -> None:
    path = foreign(tmp_path, ";", ",", (1.0, 1.0), ("1", "sideways"))
    layout = ColumnLayout.of(WORDS)
    with pytest.raises(InputError, match=r"laser\.txt:8: direction 'sideways' is no number"):
        read_positioning(path, rotary=False, layout=layout)
    path.write_text("Pos.;Dir;Run No;Error (um)\n1;1;1;0,5\nmean;0,5\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"laser\.txt:3: 2 columns; expected one for each of Pos\., Dir, Run No, Err"):
        read_positioning(path, rotary=False, layout=layout)
    path.write_text("Pos.;Dir;Run No;Error (um);Dir\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"laser\.txt:1: two columns are called Dir; rename one"):
        read_positioning(path, rotary=False, layout=layout)
    path.write_text("Pos.;Dir;Run No;Error (um)\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"laser\.txt:1: a header and no row below it"):
        read_positioning(path, rotary=False, layout=layout)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
@pytest.mark.parametrize("header", ["Error (\N{MICRO SIGN}m)", "Error (\N{GREEK SMALL LETTER MU}m)"])
def test_micrometres_in_a_header_are_found_however_they_are_written(tmp_path: Path, encoding: str, header: str) -> None:
    """The micro sign and the Greek letter look alike; the older encodings have the first one alone."""
    stands = "Error (\N{MICRO SIGN}m)" if encoding == "cp1252" else "Error (\N{GREEK SMALL LETTER MU}m)"
    rows = [f"{target};{sign};{cycle};{deviation}" for target, sign, cycle, deviation in own_rows()]
    path = tmp_path / "laser.txt"
    path.write_bytes("\n".join([f"Pos.;Dir;Run No;{stands}", *rows]).encode(encoding))
    words = ["target=Pos.,mm", "direction=Dir", "cycle=Run No", f"deviation={header},um"]
    found = read_positioning(path, rotary=False, layout=ColumnLayout.of(words))
    assert found.forward[0, 0] == pytest.approx(1e-6 * own_rows()[0][3], abs=1e-15)
