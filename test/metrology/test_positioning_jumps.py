"""Steps of the readings within a cycle, of drawn tests that scatter and drift."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.cli import main
from rotary_error_monitor.metrology.positioning import PositioningRuns, find_jumps, find_outliers
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
TARGETS = np.array([-0.238, -0.19, -0.144, -0.097, -0.051, -0.001, 0.047, 0.093, 0.141, 0.195, 0.241])


def drawn(seed: int, *, drift: float = 0.0, cycles: int = 5, jump: float = 0.0) -> tuple[PositioningRuns, int]:
    """Readings in the order of time with noise of 0.2 µm and a smooth drift; from one on, all later ones jump.

    Gives the cycle in which they do as well.
    """
    rng = np.random.default_rng(seed)
    count = 2 * len(TARGETS)
    time = np.arange(cycles * count) / (cycles * count)
    way = np.r_[TARGETS, TARGETS[::-1]]
    error = 4e-6 * np.sin(12 * way + rng.uniform(0, 6)) - np.repeat([5e-7, -5e-7], len(TARGETS))
    read = np.tile(error, cycles) + 2e-7 * rng.normal(size=time.size)
    read = read + drift * (np.sin(4 * time + rng.uniform(0, 6)) + rng.normal() * time)
    read = read + np.repeat(drift * rng.normal(size=cycles), count)
    at = int(rng.integers(0, cycles) * count + rng.integers(3, count - 2))
    read[at:] += jump * rng.choice([-1, 1])
    table = read.reshape(cycles, count).T
    return PositioningRuns(TARGETS, table[: len(TARGETS)], table[len(TARGETS) :][::-1]), at // count


@pytest.mark.parametrize("drift", [0.0, 2e-6, 20e-6])
@pytest.mark.parametrize("cycles", [3, 5, 10])
def test_clean_tests_hardly_ever_jump(drift: float, cycles: int) -> None:
    """Whatever they drift, and wherever a cycle begins."""
    found = 0
    for seed in range(150):
        runs, _ = drawn(seed, drift=drift, cycles=cycles)
        found += bool(find_jumps(runs, false_alarm=FALSE_ALARM))
    assert found <= 3


@pytest.mark.parametrize("drift", [0.0, 2e-6])
@pytest.mark.parametrize("jump", [3e-6, 15e-6, 60e-6])
def test_a_broken_beam_is_told_in_its_cycle(jump: float, drift: float) -> None:
    """Steps of fifteen standard deviations and more; one that is smaller makes less of the mean than that."""
    told = right = 0
    for seed in range(40):
        runs, cycle = drawn(seed, drift=drift, jump=jump)
        found = find_jumps(runs, false_alarm=FALSE_ALARM)
        told += bool(found)
        right += bool(found) and found[0].cycle == cycle and abs(abs(found[0].size) / jump - 1) < 0.3
    assert told >= 39 and right >= 39


@pytest.mark.parametrize("seed", range(6))
def test_a_reading_that_stands_off_alone_is_no_step(seed: int) -> None:
    runs, _ = drawn(seed)
    runs.forward[4, 2] += 30e-6
    runs.forward[0, 0] -= 20e-6
    assert len(find_outliers(runs)) == 2 and not find_jumps(runs, false_alarm=FALSE_ALARM)


def test_a_broken_beam_is_written_by_force_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine, source = tmp_path / "machine.yaml", tmp_path / "runs.csv"
    machine.write_bytes(config("machines/xyzac_trt.yaml").read_bytes())
    runs, cycle = drawn(3, jump=15e-6)
    assert runs.backward is not None
    lines = ["target_mm,direction,cycle,deviation_um"]
    for k in range(5):
        for way, block in ((1, runs.forward), (-1, runs.backward)):
            rows = [f"{1e3 * x:.0f},{way},{k + 1},{1e6 * e:.4f}" for x, e in zip(TARGETS, block[:, k], strict=True)]
            lines += rows[::way]
    source.write_text("\n".join(lines), encoding="utf-8")
    words, before = (
        ["calibrate", "positioning", str(source), "--machine", str(machine), "--axis", "X"],
        machine.read_bytes(),
    )
    assert main(words) == 10
    told = capsys.readouterr().out
    assert f"does not fit: cycle {cycle + 1}: readings step by " in told and "was the beam broken" in told
    assert machine.read_bytes() == before
    assert main([*words, "--force"]) == 0
