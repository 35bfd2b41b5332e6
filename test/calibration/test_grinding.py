"""Flatness before and after compensation, predicted from the shipped grinder's file."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from rotary_error_monitor.calibration.grinding import predict_flatness
from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError

WORKPIECE = {"X": (-1.4, 0.0), "Z": (-0.65, -0.15)}


def test_the_shipped_grinder_reaches_the_goal() -> None:
    """The paper went from 7.54 µm to 2.98 µm; at most a quarter is left with the vertical axis as it is."""
    found = predict_flatness(load_machine("grinder_zhou2023"), "Y", WORKPIECE, 5.8e-6, 1.2e-6).comparison
    assert 6e-6 < found.before.flatness < 12e-6
    assert found.rotated.flatness <= found.before.flatness / 4
    assert found.rotated.reversals == 0
    assert found.unrotated.flatness > 2 * found.rotated.flatness
    assert found.unrotated.reversals > 0


def test_a_reversal_error_alone_leaves_nothing_where_nothing_reverses() -> None:
    found = predict_flatness(load_machine("grinder_zhou2023"), "Y", WORKPIECE, 5.8e-6, 0.0).comparison
    assert found.rotated.flatness < 1e-11
    assert found.unrotated.flatness > 3e-6


def test_the_command_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    calibrate.add(parser.add_subparsers())
    figure = tmp_path / "flatness.png"
    words = ["--workpiece", "X=-1400,0", "Z=-650,-150", "--reversal-um", "5.8", "--positioning-um", "1.2"]
    words = ["calibrate", "flatness", "grinder_zhou2023", "--vertical", "Y", *words, "--figure", str(figure)]
    arguments = parser.parse_args(words)
    assert arguments.run(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[3].startswith("after, curves rotated to be monotone")
    assert lines[3].split()[-1] == "0"
    assert figure.stat().st_size > 20_000


@pytest.mark.parametrize(
    ("workpiece", "message"),
    [
        ({"X": (-1.4, 0.0)}, "expected two axes other than Y"),
        ({"X": (-1.4, 0.0), "Y": (0.0, 0.1)}, "expected two axes other than Y"),
        ({"X": (-1.4, 0.1), "Z": (-0.5, 0.0)}, "not within -1.4 to 0 m of travel"),
    ],
)
def test_bad_workpieces_are_refused(workpiece: dict[str, tuple[float, float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        predict_flatness(load_machine("grinder_zhou2023"), "Y", workpiece, 0.0, 0.0)
