"""`calibrate straightness` with and without a mirror and against a direct one; guideways made by plain numpy."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
NOISE_UM = 0.06
MIRROR = ["--mirror-length-mm", 440, "--mirror-flatness-um", 0.08]
DIRECT = ["--direct-mirror-length-mm", 840, "--direct-flatness-um", 0.12]
SEEDS = range(4)


def truth(x: Array) -> Array:
    """Z of a grinder in Y, µm over mm: 6.6 µm about its line."""
    return np.asarray(2.9 * np.sin(0.009 * x) + 0.5 * np.cos(0.021 * x))


def level(x: Array, y: Array) -> Array:
    return np.asarray(y - np.polyval(np.polyfit(x, y, 1), x))


def rows(rng: np.random.Generator, start: int, stop: int, runs: int = 10, segment: int = 1) -> Iterable[str]:
    """Runs there and back at a placement of any height and slope, samples 2 mm apart."""
    slope, height = 0.02 * rng.normal(), 5 * rng.normal()
    for number in range(runs):
        way = -1 if number % 2 else 1
        x = np.arange(start, stop + 1, 2.0)[::way]
        y = truth(x) + slope * x + height + NOISE_UM * rng.normal(size=x.size)
        yield from (f"{segment},{number},{way},{p:g},{v:.5f}" for p, v in zip(x, y, strict=True))


def written(path: Path, lines: Iterable[str]) -> Path:
    path.write_text("\n".join(["segment,run,direction,position_mm,reading_um", *lines]), encoding="utf-8")
    return path


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "machine.yaml"))


def run(source: Path, machine: Path, *more: object) -> int:
    words = [source, "--machine", machine, "--component", "EYZ", "--noise-um", NOISE_UM, *more]
    return main(["calibrate", "straightness", *map(str, words)])


@pytest.mark.parametrize("seed", SEEDS)
def test_an_interferometer_has_no_mirror(tmp_path: Path, machine: Path, seed: int, capsys) -> None:
    source = written(tmp_path / "direct.csv", rows(np.random.default_rng(seed), -800, 0))
    assert run(source, machine) == 0
    said = capsys.readouterr().out
    assert "mirror" not in said
    assert "overlap" not in said
    table = load_machine(machine).errors["EYZ"].table
    assert table is not None
    x, fine = np.array(table.positions) * 1e3, np.linspace(-800, 0, 4001)
    error = np.array(table.forward) * 1e6 - np.interp(x, fine, level(fine, truth(fine)))
    # ten runs at each stop: 0.019 µm, of which four times is exceeded by one of 16,000 positions
    assert np.abs(error).max() < 4 * NOISE_UM / np.sqrt(10)
    text = machine.read_text(encoding="utf-8")
    assert "mirror" not in text[text.index("\ncalibration:") :] if "\ncalibration:" in text else True


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (["--mirror-length-mm", 440], "--mirror-length-mm 440 without --mirror-flatness-um: state its flatness in µm"),
        (["--mirror-flatness-um", 0.1], "--mirror-flatness-um without --mirror-length-mm: state the mirror's length"),
        (["--mirror-profile", "p.csv"], "--mirror-profile p.csv without --mirror-length-mm"),
        (["--mirror-form", "form.csv"], "--mirror-form form.csv without a mirror"),
        (DIRECT, "--direct-mirror-length-mm without --direct: give the file"),
        (["--figure", "nowhere/f.png"], "nowhere/f.png: cannot be written (no folder nowhere)"),
        (["--runs-figure", "nowhere/f.png"], "nowhere/f.png: cannot be written (no folder nowhere)"),
        ([], "2 segments, and no mirror: pieces are spliced along a mirror"),
    ],
)
def test_half_a_mirror_is_refused_and_nothing_written(
    tmp_path: Path, machine: Path, more: list[object], problem: str, capsys
) -> None:
    rng = np.random.default_rng(0)
    source = written(tmp_path / "z.csv", [*rows(rng, -800, -360), *rows(rng, -440, 0, segment=2)])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert run(source, machine, *more) == 2
    assert problem in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_turned_mirror_is_a_mirror(tmp_path: Path, machine: Path, capsys) -> None:
    path = written(tmp_path / "z.csv", rows(np.random.default_rng(1), -800, 0))
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([lines[0] + ",mirror", *(f"{line},-1" for line in lines[1:])]), encoding="utf-8")
    assert run(path, machine) == 2
    assert "a mirror turned over, and no mirror: its length and flatness are needed" in capsys.readouterr().err


def test_a_direct_measurement_as_an_interferometer_writes_it(tmp_path: Path, machine: Path, capsys) -> None:
    rng = np.random.default_rng(8)
    source = written(tmp_path / "z.csv", [*rows(rng, -800, -360), *rows(rng, -440, 0, segment=2)])
    direct = written(tmp_path / "direct.csv", rows(rng, -800, 0))
    other = tmp_path / "direct.txt"
    cells = [line.split(",") for line in direct.read_text(encoding="utf-8").splitlines()[1:]]
    lines = [f"{float(v) * 1e3:.2f};{float(p) / 1e3:.4f};{d};{n};1" for _, n, d, p, v in cells]
    other.write_text("\n".join(["Reading;At;Way;Run;Piece", *lines]), encoding="utf-8")
    words = ["segment=Piece", "run=Run", "direction=Way", "position=At,m", "reading=Reading,nm"]
    said = []
    for more in ([direct], [other, "--direct-columns", *words]):
        assert run(source, machine, *MIRROR, "-o", tmp_path / "out.yaml", "--direct", *more) == 0
        said.append(capsys.readouterr().out)
    assert "measured directly" in said[0]
    assert said[0] == said[1]
    assert run(source, machine, *MIRROR, "--direct-columns", *words) == 2
    assert "--direct-columns without --direct" in capsys.readouterr().err


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("how", ["interferometer", "long mirror"])
def test_spliced_against_directly_measured(tmp_path: Path, machine: Path, seed: int, how: str, capsys) -> None:
    """Zhou et al. 2023, Figures 9 to 11: 440 mm twice against 840 mm once; without mirror errors both are the truth."""
    rng = np.random.default_rng([seed, 11])
    source = written(tmp_path / "z.csv", [*rows(rng, -800, -360), *rows(rng, -440, 0, segment=2)])
    direct = written(tmp_path / "direct.csv", rows(rng, -800, 0))
    figures = [tmp_path / "curve.png", tmp_path / "runs.png"]
    words = ["--figure", figures[0], "--runs-figure", figures[1], "--monotone"] if seed == 0 else []
    assert run(source, machine, *MIRROR, "--direct", direct, *(DIRECT if how == "long mirror" else []), *words) == 0
    said = capsys.readouterr().out
    found = re.search(
        r"measured directly ([\d.]+) µm, spliced ([\d.]+) µm; largest difference ([\d.]+) µm, at \S+ mm\n"
        r" +\(both uncertainties explain ([\d.]+) µm, p-value ([\d.]+)\)",
        said,
    )
    assert found is not None, said
    measured, spliced, largest, bound, probability = map(float, found.groups())
    x = np.linspace(-800, 0, 101)
    exact = np.ptp(level(x, truth(x)))
    assert measured == pytest.approx(exact, abs=0.1)
    assert spliced == pytest.approx(exact, abs=0.3)
    assert 0 < largest < 0.3
    assert 0.02 < bound < 0.5
    assert probability > 1e-3
    if seed == 0:
        assert all(path.stat().st_size > 30_000 for path in figures)


def test_a_direct_measurement_of_another_curve_does_not_fit(tmp_path: Path, machine: Path, capsys) -> None:
    """The same guideway 60 mm further on: the difference is far beyond what mirror and noise explain."""
    rng = np.random.default_rng(5)
    source = written(tmp_path / "z.csv", [*rows(rng, -800, -360), *rows(rng, -440, 0, segment=2)])
    direct = tmp_path / "direct.csv"
    lines = [line.split(",") for line in rows(rng, -800, 0)]
    moved = [",".join([*cells[:3], f"{float(cells[3]) - 60:g}", cells[4]]) for cells in lines]
    written(direct, [line for line in moved if float(line.split(",")[3]) >= -800])
    before = machine.read_bytes()
    assert run(source, machine, *MIRROR, "--direct", direct) == 10
    assert re.search(r"does not fit: the direct measurement differs by up to [\d.]+ µm", capsys.readouterr().out)
    assert machine.read_bytes() == before


def test_a_direct_measurement_elsewhere_is_refused(tmp_path: Path, machine: Path, capsys) -> None:
    rng = np.random.default_rng(6)
    source = written(tmp_path / "z.csv", rows(rng, -800, 0))
    direct = written(tmp_path / "direct.csv", rows(rng, -200, 0))
    assert run(source, machine, "--direct", direct) == 2
    assert "direct.csv: the two profiles have 0.2 m in common, of 0.8 m" in capsys.readouterr().err


def test_the_form_of_the_mirror_can_be_used_as_its_profile(tmp_path: Path, machine: Path, capsys) -> None:
    """A mirror hollow by 0.5 µm with a wave, one placement both ways up: its form is found and goes back in."""

    def mirror(distance: Array) -> Array:
        u = distance / 220 - 1
        return np.asarray(0.5 * u**2 + 0.1 * np.sin(5 * u))

    lines = ["segment,run,direction,position_mm,reading_um,mirror"]
    rng = np.random.default_rng(7)
    for segment, (start, side) in enumerate(((-800, 1), (-440, 1), (-800, -1)), start=1):
        for row in rows(rng, start, start + 440, segment=segment):
            *head, position, reading = row.split(",")
            form = side * mirror(np.array(float(position) - start))
            lines.append(",".join([*head, position, f"{float(reading) + form:.5f}", str(side)]))
    source, form_file = tmp_path / "turned.csv", tmp_path / "form.csv"
    source.write_text("\n".join(lines), encoding="utf-8")
    words = ["--mirror-length-mm", 440, "--mirror-flatness-um", "unknown", "--mirror-form", form_file]
    assert run(source, machine, *words) == 0
    found = re.search(
        r"\(its curvature as well\): ([\d.]+) µm peak to valley, .* ([\d.]+) µm\n", capsys.readouterr().out
    )
    assert found is not None
    x = np.linspace(0, 440, 101)
    flatness, uncertainty = map(float, found.groups())
    assert flatness == pytest.approx(np.ptp(level(x, mirror(x))), abs=0.06)
    cells = [line.split(",") for line in form_file.read_text(encoding="utf-8").splitlines()[2:]]
    distance, height = np.array(cells, dtype=np.float64).T
    assert np.abs(height - level(distance, mirror(distance))).max() < max(4 * uncertainty, 0.02)
    source.write_text("\n".join(line for line in lines if not line.endswith(",-1")), encoding="utf-8")
    words = ["--mirror-length-mm", 440, "--mirror-flatness-um", 0.03, "--mirror-profile", form_file]
    assert run(source, machine, *words) == 0
    table = load_machine(machine).errors["EYZ"].table
    assert table is not None
    x = np.array(table.positions) * 1e3
    assert np.abs(np.array(table.forward) * 1e6 - level(x, truth(x))).max() < 0.15


def test_one_placement_of_a_mirror_shows_no_form(tmp_path: Path, machine: Path, capsys) -> None:
    source = written(tmp_path / "z.csv", rows(np.random.default_rng(8), -800, 0))
    before = machine.read_bytes()
    words = ["--mirror-length-mm", 840, "--mirror-flatness-um", 0.12, "--mirror-form", tmp_path / "form.csv"]
    assert run(source, machine, *words) == 2
    assert "the mirror's form is not shown: measure two placements or more" in capsys.readouterr().err
    assert machine.read_bytes() == before
    words[3] = "unknown"
    assert run(source, machine, *words[:4]) == 10
    assert "flatness is unknown: all of its form counts as the guideway's" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("scale", "code", "problem"),
    [
        (10, 2, "z.csv:2: position -8000 mm leaves the travel of Z, -800 to 0 mm: another axis, or another unit?"),
        (1e-3, 10, "cover 0.10% of the travel of Z: are they in another unit?"),
        (1 / 25.4, 10, "cover 3.94% of the travel of Z: are they in another unit?"),
    ],
)
def test_positions_in_another_unit(
    tmp_path: Path, machine: Path, scale: float, code: int, problem: str, capsys
) -> None:
    lines = [line.split(",") for line in rows(np.random.default_rng(9), -800, 0)]
    scaled = [",".join([*cells[:3], f"{float(cells[3]) * scale:.9g}", cells[4]]) for cells in lines]
    source, before = written(tmp_path / "z.csv", scaled), machine.read_bytes()
    assert run(source, machine) == code
    said = capsys.readouterr()
    assert problem in said.err + said.out
    assert machine.read_bytes() == before
