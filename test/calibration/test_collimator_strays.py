"""Single readings of a step that stand off from the others, of simulated instruments of two axes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from calibration.simulated_collimator import ARCSEC, Detector, Run, table, take, write_table

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.metrology.two_axis_fit import NAMES, numbers_of
from rotary_error_monitor.metrology.two_axis_steps import StepReadings, find_stray_readings
from rotary_error_monitor.resources import config

ROLLED = Detector((4 * ARCSEC, -2 * ARCSEC), (1.03, 0.99), (0.2, 0.21), (-1e5, 4e4))


def steps(seed: int) -> StepReadings:
    run = Run()
    taken = take(ROLLED, run, np.random.default_rng([seed, 3]))
    names = tuple(f"s{number}" for number in range(len(run.settings)))
    return StepReadings(names, run.settings * ARCSEC, taken.step, taken.readings, taken.time)


def test_clean_steps_hardly_ever_hold_a_stray() -> None:
    assert sum(bool(find_stray_readings(steps(seed), false_alarm=FALSE_ALARM)) for seed in range(200)) <= 2


@pytest.mark.parametrize("seed", range(10))
def test_a_stray_reading_is_the_one_that_was_changed(seed: int) -> None:
    taken, rng = steps(seed), np.random.default_rng(seed)
    rows, axis = rng.choice(len(taken.step), 3, replace=False), int(rng.integers(2))
    noise = taken.spread()[0][axis]
    taken.readings[rows, axis] += 12 * noise * rng.choice([-1, 1], 3)
    found = find_stray_readings(taken, false_alarm=FALSE_ALARM)
    assert {each.row for each in found} == set(rows.tolist()) and {each.axis for each in found} == {axis}
    assert len(taken.without([each.row for each in found]).step) == len(taken.step) - 3


def test_a_stray_reading_is_written_by_force_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One of five readings is 5 arcsec off, fifty standard deviations; it hid in the scatter that it made."""
    stage, rng = Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml")), np.random.default_rng([1, 77])
    taken, before = take(ROLLED, Run(), rng), stage.read_bytes()
    taken.readings[21, 0] += 5 * ARCSEC
    source = write_table(tmp_path / "steps.csv", table(taken))
    words = ["calibrate", "autocollimator", str(source), "--stage", str(stage), "--reference-arcsec", "0.115"]
    assert main(words) == 10
    said = capsys.readouterr().out
    assert "a reading (line 23) is +" in said and "--drop-outliers leaves it out" in said
    assert stage.read_bytes() == before
    assert main([*words, "--drop-outliers"]) == 0
    assert "(line 23)" in capsys.readouterr().out
    found = load_stage(stage)
    stds = [found.uncertainty[f"autocollimator.{name.partition('[')[0]}"] for name in NAMES]
    off = (numbers_of(found.response("autocollimator")) - [ROLLED.truth[name] for name in NAMES]) / stds
    assert (np.abs(off) < 3.5).all()
