"""A stage file that states ring and mirror as measured curves is commissioned with them as they are stated."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from described_stages import stage_of
from draws import seeds
from world.newly_built import NewlyBuilt, build

from commissioning.bags import run, written
from commissioning.judging import Judged, judge
from commissioning.test_command import motion_error
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.periodic_curves import angular_values

SEEDS = seeds(10)
DURATION = 24.0


@cache
def stage(seed: int) -> NewlyBuilt:
    return build(seed, curves=True, known_tilt=seed % 2 == 1, duration=DURATION, rounding="round")


@cache
def judged(seed: int) -> Judged:
    return judge(stage(seed))


def test_all_that_is_wrong_is_named_and_nothing_else() -> None:
    wrong = {}
    for seed in SEEDS:
        found = judged(seed)
        named = {text for text in found.named if "autocollimator" not in text}
        if not found.listed or (found.told and (named != found.expected or found.falsely_loud)):
            wrong[seed] = named ^ found.expected, found.falsely_loud, found.listed
    assert not wrong


def test_parameters_are_within_three_of_their_standard_uncertainties() -> None:
    off = {(seed, name): value for seed in SEEDS for name, value in judged(seed).off.items()}
    assert len(off) > 10 * len(SEEDS)
    far = {key: value for key, value in off.items() if abs(value) > 3}
    assert len(far) <= 0.02 * len(off) and all(abs(value) < 5 for value in far.values()), far
    for name in ("zero", "azimuth", "eccentricity", "tilt zero"):
        values = np.array([value for (_, each), value in off.items() if name in each])
        assert 0.1 < np.sqrt(np.mean(values**2)) < 1.6, name


def test_azimuths_are_those_by_which_the_curve_is_counted() -> None:
    """Each as it is, not beside a turn common to all, which without a curve is a convention."""
    off = []
    for seed in SEEDS:
        found, built = judged(seed), stage(seed)
        heads = built.true["encoder"]["heads"]
        pairs = zip(found.result.found.heads.items(), heads.values(), strict=True) if found.off else ()
        off += [
            np.angle(np.exp(1j * (head.azimuth.value - true["azimuth"]))) / head.azimuth.std
            for (_, head), true in pairs
        ]
    assert len(off) > 2.5 * len(SEEDS)
    assert np.mean(np.abs(off) > 3) <= 0.02
    assert 0.1 < np.sqrt(np.mean(np.square(off))) < 1.6


@pytest.mark.parametrize("seed", [7, 12])
def test_the_estimator_is_right_by_the_file_that_is_written(seed: int, tmp_path: Path) -> None:
    """Within 0.1 µm, beside the noise that the same readings leave with a file that is exactly true."""
    built = build(
        seed, count=4 + seed % 2, even=False, swap=seed % 2 == 1, known_tilt=True, curves=True, duration=DURATION
    )
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 0
    found, before = load_stage(tmp_path / "stage.yaml"), load_stage(nominal)
    assert found.ring.graduation_table == before.ring.graduation_table and not found.ring.graduation
    assert found.mirror.flatness_table == before.mirror.flatness_table
    error = motion_error(built, bag, found)
    noise = motion_error(built, bag, stage_of(built.true))
    assert error < np.hypot(noise, 0.1e-6)


def changed(built: NewlyBuilt, tmp_path: Path, change) -> tuple[Path, Path]:
    """Bag and nominal file whose section `stage` went through `change`."""
    bag, nominal = written(built, tmp_path)
    content = yaml.safe_load(nominal.read_text(encoding="utf-8"))
    change(content["stage"])
    nominal.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return bag, nominal


def line_of(path: Path, key: str) -> int:
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(number for number, line in enumerate(lines, start=1) if f"{key}:" in line)


@pytest.mark.parametrize("seed", [5, 13])
def test_a_ring_that_is_not_as_it_was_measured_is_an_error_with_its_line(seed: int, tmp_path: Path, capsys) -> None:
    """Another curve, as of another ring; a mean of it, which no reading shows, is none."""

    def other(section: dict, size: float, order: int) -> None:
        table = section["encoder"]["graduation_table"]
        waves = size * np.cos(order * np.array(table["angles"]) + 0.3)
        table["values"] = (np.array(table["values"]) + waves).tolist()

    built = build(seed, count=5, even=False, swap=False, curves=True, duration=DURATION)
    bag, nominal = changed(built, tmp_path, lambda section: other(section, 4e-5, 6))
    assert run(bag, nominal, tmp_path / "stage.yaml") == 2
    said = capsys.readouterr().err
    place = f"{nominal}:{line_of(nominal, 'graduation_table')}: stage.encoder.graduation_table: order 6 of this curve"
    assert place in said and "calibrate assembly --as table" in said
    size = float(re.search(r"is ([\d.]+) arcsec off", said).group(1))
    assert size == pytest.approx(4e-5 * 206265, rel=0.3)
    assert not (tmp_path / "stage.yaml").exists()


def test_the_mean_of_a_curve_is_not_in_the_zeros(tmp_path: Path) -> None:
    """All heads show it alike: what is taken off with the curve must not be taken off with the zeros again."""
    level = 2e-4
    built = build(7, count=5, even=False, swap=False, curves=True, duration=DURATION)

    def raised(section: dict) -> None:
        table = section["encoder"]["graduation_table"]
        table["values"] = (np.array(table["values"]) + level).tolist()

    found = []
    for name, change in (("plain", lambda section: None), ("raised", raised)):
        (tmp_path / name).mkdir()
        bag, nominal = changed(built, tmp_path / name, change)
        assert run(bag, nominal, tmp_path / name / "stage.yaml") == 0
        found.append(load_stage(tmp_path / name / "stage.yaml"))
    plain, other = found
    for letter in plain.azimuths:
        before, after = (each.response(f"head_{letter}") for each in found)
        assert after.zero[0] - before.zero[0] == pytest.approx(-level * before.gain, abs=2e-8)
    at = np.array([0.4])
    assert angular_values(other.ring.graduation_table, at) - angular_values(plain.ring.graduation_table, at) == (
        pytest.approx(level)
    )


def test_a_mirror_that_is_not_as_it_was_measured_is_an_error_with_its_line(tmp_path: Path, capsys) -> None:
    def other(section: dict) -> None:
        table = section["mirror"]["flatness_table"]
        table["x"] = (np.array(table["x"]) + 8e-6 * np.cos(3 * np.array(table["angles"]))).tolist()

    built = build(11, count=5, even=False, swap=False, curves=True, known_tilt=True, tilt=8e-6, duration=DURATION)
    bag, nominal = changed(built, tmp_path, other)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 2
    said = capsys.readouterr().err
    place = f"{nominal}:{line_of(nominal, 'flatness_table')}: stage.mirror.flatness_table: this curve and spindle.tilt"
    assert place in said and "calibrate assembly --as table" in said


def test_a_curve_that_nothing_counts_is_an_error_with_its_line(tmp_path: Path, capsys) -> None:
    """Without a command and a stated zero the rotation begins anywhere, and the curve with it."""
    built = build(9, count=5, even=False, swap=False, curves=True, duration=DURATION)
    blocks = {topic: each for topic, each in built.recording.blocks.items() if "command" not in topic}
    left = built.recording.with_topics({})
    left.blocks.clear()
    left.blocks.update(blocks)
    bag, nominal = written(built, tmp_path, left)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 2
    said = capsys.readouterr().err
    assert f"{nominal}:{line_of(nominal, 'graduation_table')}: stage.encoder.graduation_table: a measured curve" in said
    assert "state the zero of a head" in said
