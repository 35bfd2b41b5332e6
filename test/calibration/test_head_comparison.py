"""Heads against one another: by closed forms of a ring off centre, and as pictures of both directions."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import simulated_shaft
from PIL import Image
from shaft_bags import TRUTH, simulated

from rotary_error_monitor.calibration.head_comparison import AssemblyComparison, compare_assembly, order_amplitudes
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.mirror_assembly import estimate_mirror_assembly
from rotary_error_monitor.metrology.ring_assembly import estimate_ring_assembly
from rotary_error_monitor.metrology.shaft_recording import record_shaft
from rotary_error_monitor.resources import config

BOTH_WAYS = simulated_shaft.reversing((np.pi / 2, np.pi), 5.0)
ONE_WAY = simulated_shaft.one_way(2.0, 12.0)


def compared(seed: int, changes: Any = None, motion: Any = BOTH_WAYS) -> AssemblyComparison:
    shaft = simulated_shaft.Shaft(**{**TRUTH, **(changes or {})})
    stage = load_stage()
    recording = record_shaft(stage, *simulated_shaft.record(shaft, *motion, seed))
    ring, mirror = estimate_ring_assembly(stage, recording), estimate_mirror_assembly(stage, recording)
    return compare_assembly(stage, recording, ring, mirror)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_differences_are_those_of_a_ring_off_centre(seed: int) -> None:
    """A - B is 2 e / r in order 1 (Lou et al. 2019, Equation 3), neighbours √2 e / r; A - B has no even orders."""
    rng = np.random.default_rng(seed)
    eccentricity = tuple((1e-5 * rng.normal(size=2)).tolist())
    found = compared(seed, {"eccentricity": eccentricity})
    size = float(np.hypot(*eccentricity)) / 0.1
    assert [pair.name for pair in found.pairs] == ["A - B", "C - D", "A - C", "A - D", "B - C", "B - D"]
    for pair in found.pairs:
        before, after = pair.spectrum(20)
        noise = np.sqrt(2 * (3e-7**2 + (2 * np.pi / 3148800) ** 2 / 12))
        far = 5 * noise * np.sqrt(2 / len(pair.after))  # of each of two normal coefficients
        chord = 2.0 if pair.opposed else np.sqrt(2)
        assert pair.chord == pytest.approx(chord)
        assert before[0] == pytest.approx(chord * size, abs=far)
        assert found.displacement(pair, before[0]) == pytest.approx(float(np.hypot(*eccentricity)), abs=0.1 * far)
        for order, (cos, sin) in TRUTH["graduation"].items():
            # two heads a quarter or a half of the ring apart see a wave shifted by that part of order k
            part = 2 * abs(np.sin(order * (np.pi if pair.opposed else np.pi / 2) / 2))
            assert before[order - 1] == pytest.approx(part * np.hypot(cos, sin), abs=far)
        assert np.sqrt(np.mean(pair.after**2)) < 1.05 * noise
        assert after.max() < far
        apart, expected = pair.reversal or (0.0, 0.0)
        assert 0.75 * expected < apart < 1.25 * expected
    assert [signal.name for signal in found.mirror] == ["tilt about x", "tilt about y"]
    for axis, signal in enumerate(found.mirror):
        before, after = signal.spectrum(20)
        assert before[0] == pytest.approx(float(np.hypot(*TRUTH["tilt"])), abs=1e-7)
        assert before[1] == pytest.approx(float(np.hypot(*TRUTH["flatness"][2][2 * axis : 2 * axis + 2])), abs=1e-7)
        assert after.max() < 1e-7


def test_what_goes_with_the_direction_shows() -> None:
    """A shaft that moves by 0.5 µm to and fro with the direction: A and B stand along x and see y."""
    moved = {"radial": lambda angle, time, way: 0.5e-6j * way * np.ones_like(angle)}
    found = {pair.name: pair for pair in compared(4, moved).pairs}
    apart, noise = found["A - B"].reversal or (0.0, 0.0)
    assert apart == pytest.approx(2 * 2 * 0.5e-6 / 0.1, rel=0.1) and noise < 0.1 * apart
    apart, noise = found["C - D"].reversal or (0.0, 0.0)
    assert apart < 1.3 * noise
    one = compared(5, motion=ONE_WAY).pairs[0]
    assert one.reversal is None
    angles, forward, backward = one.by_direction(one.before)
    assert np.isfinite(forward).all() and np.isnan(backward).all() and len(angles) in (36, 72)


def test_amplitudes_of_orders_are_exact_without_noise() -> None:
    """Of uneven rotations that leave a hundredth of the turn out."""
    rng = np.random.default_rng(0)
    theta = rng.uniform(0.03, 2 * np.pi - 0.03, 60_000) + 2 * np.pi * rng.integers(-3, 3, 60_000)
    values = 5.0 + 2.0 * np.cos(theta - 1) + 0.5 * np.sin(30 * theta)
    found = order_amplitudes(theta, values[:, None], 40)[:, 0]
    expected = np.zeros(40)
    expected[[0, 29]] = 2.0, 0.5
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.long
def test_the_command_tells_and_draws_both_directions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With four heads and a mirror three rows of three pictures, with two opposed heads alone one row."""
    stage = Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml"))
    sizes = []
    two = {"azimuths": {"a": 0.0, "b": np.pi}}
    for name, changes, motion in (("four", {}, BOTH_WAYS), ("two", two, ONE_WAY)):
        picture = tmp_path / f"{name}.png"
        bag = simulated(tmp_path, changes, motion)
        words = ["--stage", str(stage), "-o", str(tmp_path / "out.yaml"), "--figure", str(picture)]
        assert main(["calibrate", "assembly", str(bag), *words]) == 0
        with Image.open(picture) as image:
            sizes.append(image.size)
            assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 100
        printed = capsys.readouterr().out
        row = re.search(r"A - B, opposed: ([\d.]+) arcsec \(([\d.]+) µm\), ([\d.]+) arcsec \(([\d.]+) µm\)", printed)
        assert row is not None
        before, micrometres, left, _ = map(float, row.groups())
        assert micrometres == pytest.approx(0.1 * before * np.pi / 648000 / 2 * 1e6, rel=1e-3)
        assert before == pytest.approx(2 * 25e-6 / 0.1 * 648000 / np.pi, rel=0.02) and left < 0.2
        assert ("one direction only" in printed) == (name == "two")
    assert sizes[0][1] > sizes[1][1]


def test_the_picture_does_not_take_the_place_of_an_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stage = Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml"))
    before, bag, linked = stage.read_bytes(), simulated(tmp_path), tmp_path / "stage.png"
    linked.hardlink_to(stage)
    assert main(["calibrate", "assembly", str(bag), "--stage", str(stage), "--figure", str(linked)]) == 2
    assert "not written, for it is the input" in capsys.readouterr().err and stage.read_bytes() == before
