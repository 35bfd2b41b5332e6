"""A five-axis program on LinuxCNC: the whole loop, and its judgement without one."""

import dataclasses
import math
import re
import shutil
import time

import numpy as np
import pytest
from faults.live.other_programs import check, family, lost_time

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics
from rotary_error_monitor.linuxcnc_controller.protocol import End, Observation
from rotary_error_monitor.linuxcnc_demonstration import run as linuxcnc_run
from rotary_error_monitor.linuxcnc_demonstration.run import (
    LARGEST_LATE,
    LARGEST_SHARE,
    LinuxcncRun,
    ObservedCourse,
    Witness,
    evaluate,
    figures,
    travel_directions,
)
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.follower import followed_plant
from rotary_error_monitor.sources.mock import MockSettings

EPOCH_NS = 1_000_000_000_000
COUNT = 400
SHARE = "corrected in percent of uncorrected"
IN_TIME = "the same where corrections came in time"
LATE = "corrections late or held, in percent of the time"
TABLE = RotaryTableKinematics((0.0, 0.0, 0.0), (0.020, 0.010))
OPTIONS = LinuxcncRun()


@pytest.mark.linuxcnc
@pytest.mark.cell
def test_the_tool_error_along_a_program_falls_to_a_twentieth(capsys):
    if shutil.which("linuxcnc") is None:
        pytest.skip("LinuxCNC is not installed (apt-get install linuxcnc-uspace)")
    with lost_time(family) as lost:
        begin_ns = time.monotonic_ns()
        code = main(["run-linuxcnc"])
        took_ns = time.monotonic_ns() - begin_ns
    said = capsys.readouterr().out
    assert SHARE in said
    beyond = [line for line in said.splitlines() if "OUT OF BOUNDS" in line]
    # on a computer that others keep busy more may come late; it is said, and the error of what came in time is bounded
    assert all(LATE in line for line in beyond) and bool(code) == bool(beyond), said
    late = float(re.search(rf"{LATE} +([\d.]+)", said)[1]) / 100
    check(LATE, round(late * took_ns), LARGEST_LATE / 100 * took_ns / NANOSECONDS, lost())


@pytest.fixture(scope="module")
def machine():
    return load_machine("xyzac_trt")


def program(corrections):
    """What an observer sees of a tool that goes round on a turning and tilting table; `corrections` (n, 5)."""
    u = np.linspace(0, 1, COUNT)
    turn = 2 * math.pi * u
    axes = np.column_stack([
        0.06 * np.cos(turn), 0.06 * np.sin(turn), 0.04 + 0.01 * np.sin(2 * turn), 0.4 + 0.2 * np.sin(turn), 4.0 * u,
    ])  # fmt: skip
    joints = np.array([TABLE.to_joints(row) for row in axes])
    witness = Witness(EPOCH_NS)
    for index, row in enumerate(axes.tolist()):
        stamp_ns = EPOCH_NS + (index + 1) * 10_000_000
        witness.note(Observation(stamp_ns, tuple(row), tuple(joints[index] + corrections[index])))
    witness.note(End("not an observation"))
    return witness, joints


def ideal_corrections(machine, joints):
    """Corrections of the model that knows the true error motion at each time."""
    time = 0.01 * np.arange(1, COUNT + 1)
    settings = MockSettings(OPTIONS.seed, EPOCH_NS, (), forces=False, rate=OPTIONS.rate)
    truth = followed_plant(load_stage(), settings, ObservedCourse(time, joints[:, 4])).scene(time).error_motion
    truth[:, 2] = np.nan
    return solve_axis_corrections(
        arrange_machine(machine), joints, direction=travel_directions(joints),
        temperature=np.full(COUNT, machine.reference_temperature), monitored=truth,
    ).corrections  # fmt: skip


def share(machine, corrections):
    witness, _ = program(corrections)
    rows = figures(evaluate(witness, machine, load_stage(), OPTIONS), witness)
    return next(row for row in rows if row.name == SHARE)


def test_ideal_corrections_leave_nothing(machine):
    _, joints = program(np.zeros((COUNT, 5)))
    row = share(machine, ideal_corrections(machine, joints))
    assert row.value < 0.1
    assert row.ok


def test_without_corrections_the_error_stays_and_the_run_fails(machine):
    row = share(machine, np.zeros((COUNT, 5)))
    assert row.value == pytest.approx(100.0)
    assert not row.ok


def test_corrections_that_come_late_or_are_held_fail_the_run(machine):
    _, joints = program(np.zeros((COUNT, 5)))
    ideal = ideal_corrections(machine, joints)
    late = np.vstack([np.repeat(ideal[:1], 10, axis=0), ideal[:-10]])
    held = np.repeat(ideal[:1], COUNT, axis=0)
    assert share(machine, ideal).value < share(machine, late).value < share(machine, held).value
    assert not share(machine, held).ok


@pytest.mark.parametrize("slow", [False, True])
def test_a_computer_that_is_late_is_told_from_corrections_that_are_wrong(machine, slow):
    """Held for 0.2 s of 4 s: the rest is judged, and how much that was has a bound of its own."""
    _, joints = program(np.zeros((COUNT, 5)))
    corrections = ideal_corrections(machine, joints)
    corrections[100:120] = corrections[100]
    corrections[300:] *= 0.5 if slow else 1.0
    witness, _ = program(corrections)
    witness.looks = [(EPOCH_NS + k * 100_000_000, k in (11, 12)) for k in range(41)]
    rows = {row.name: row for row in figures(evaluate(witness, machine, load_stage(), OPTIONS), witness)}
    assert rows[LATE].value == pytest.approx(100 * 2 / 41)
    assert rows[LATE].ok
    assert rows[IN_TIME].ok == (not slow)
    # what came late, and a second around it, may be as without correction
    assert LARGEST_SHARE < rows[SHARE].bound < 100
    assert rows[SHARE].ok
    witness.looks = [(stamp, True) for stamp, _ in witness.looks]
    rows = {row.name: row for row in figures(evaluate(witness, machine, load_stage(), OPTIONS), witness)}
    assert not rows[LATE].ok and not rows[IN_TIME].ok


def test_a_process_that_ends_badly_fails_the_run(machine):
    witness, joints = program(np.zeros((COUNT, 5)))
    witness.failures = ["linuxcnc_bridge ended with exit code 1; it wrote:\n"]
    errors = evaluate(witness, machine, load_stage(), OPTIONS)
    assert not next(row for row in figures(errors, witness) if "ended badly" in row.name).ok


def test_the_exit_code_says_whether_the_error_fell(machine, monkeypatch, capsys):
    _, joints = program(np.zeros((COUNT, 5)))
    for corrections, code in ((ideal_corrections(machine, joints), 0), (np.zeros((COUNT, 5)), 1)):
        witness, _ = program(corrections)
        monkeypatch.setattr(linuxcnc_run, "execute", lambda *_, seen=witness: seen)
        assert linuxcnc_run.run(OPTIONS) == code
        assert ("OUT OF BOUNDS" in capsys.readouterr().out) == bool(code)


def test_directions_of_travel_are_those_of_the_latest_movement():
    positions = np.array([[0.0, 1.0], [0.1, 1.0], [0.1, 1.0], [0.05, 1.0], [0.05 + 1e-12, 1.0]])
    assert travel_directions(positions)[:, 0].tolist() == [0, 1, 1, -1, -1]
    assert travel_directions(positions)[:, 1].tolist() == [0] * 5


def test_wrong_input_is_named(machine, tmp_path):
    with pytest.raises(InputError, match=r"no G-code program .*part\.ngc"):
        linuxcnc_run.run(dataclasses.replace(OPTIONS, program=tmp_path / "part.ngc"))
    witness, _ = program(np.zeros((COUNT, 5)))
    with pytest.raises(InputError, match="is no tilting rotary table"):
        evaluate(witness, load_machine("pan2013"), load_stage(), OPTIONS)
    witness.observations = [witness.observations[0]] * 3
    with pytest.raises(InputError, match="does not move every axis"):
        evaluate(witness, machine, load_stage(), OPTIONS)
