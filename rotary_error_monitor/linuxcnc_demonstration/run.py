"""A five-axis program on a real controller: tool error along it, with and without correction.

LinuxCNC runs headless with the shipped configuration. The true machine has exact geometry and shares no formula with
what corrects it; its table turns on a true stage that is where LinuxCNC sends the table's drive, and whose read heads
and autocollimator are simulated. The command is LinuxCNC's own, by the bridge. Instruments, estimator, compensation and
bridge are processes of their own on real DDS; an observer beside LinuxCNC, which they do not know, sees what the drives
are told.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.connection import Connection
from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics
from rotary_error_monitor.linuxcnc_controller.modules import system_program
from rotary_error_monitor.linuxcnc_controller.protocol import Observation, ObserverSettings, Record
from rotary_error_monitor.mock_cell.figures import BoundedFigure, table
from rotary_error_monitor.plant.machine import MachinePlant, make_poses
from rotary_error_monitor.plant.play import play
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.follower import followed_plant
from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.testing import Cell

LARGEST_SHARE = 5.0
"""Corrected tool error in percent of the uncorrected that is still right."""

LARGEST_LATE = 10.0
"""Part of the time, percent, in which corrections may be held or late: beyond, the computer is too slow."""

STARTING = 60.0
_TICK = 0.1
_SAYING = ("compensation: correction", "linuxcnc_bridge: corrections")
_RETURN = 1.2
"""How long around a moment in which corrections were held or late they may not be in effect, s: a state is said within
a second, and corrections come back at their rate limit."""

_AXIAL = 2
_STANDSTILL = 1e-9
_PACE = {"block_period": 0.04, "period": 0.01, "correction_period": 0.01, "rate": 100.0}
"""Periods (s) of instruments, estimator and corrections, rate (1/s) of joint states: slower than usual, for a table
turns slowly and everything shares a computer with the controller."""

_COMMAND_PERIOD = 0.02
"""Time covered by one block of the command, s: the simulated stage is where it is commanded only once it knows that."""

_LONGEST_GAP = 0.05
"""Samples further apart are not joined, s: a few looks at the controller, some of which a busy computer leaves out."""

_JOINT_LAG = 0.0
"""How long an estimate waits for joint states of its time, s: not at all, for it comes after them here, by a block of
the heads. What waits uses an older joint state, and with it the direction from before a reversal."""

_OLDEST = 0.2
"""Oldest correction that is applied, s: what a computer that is not real-time makes late is nearer than what holds."""


@dataclass(frozen=True)
class LinuxcncRun:
    """What is run.

    Attributes:
        machine: name or file of the machine that the configuration describes.
        stage: file of the stage under its table; None for the embedded one.
        ini: LinuxCNC's configuration; None for the shipped one.
        program: G-code to run; None for the shipped one.
        seed: of all that is random.
        rate: samples a second of heads and autocollimator.
        deadline: how long the program may take, s.
        quiet: no progress line.
    """

    machine: str = "xyzac_trt"
    stage: Path | None = None
    ini: Path | None = None
    program: Path | None = None
    seed: int = 1
    rate: float = 500.0
    deadline: float = 300.0
    quiet: bool = False


@dataclass
class Witness:
    """What was seen of the controller, and when the cell began.

    Attributes:
        epoch_ns: time 0 of the true stage, timestamp (ns).
        observations: what the controller made of program and offsets.
        failures: of each process that did not end with exit code 0, how it ended and what it wrote.
        corrections: what the bridge said of the corrections at the end.
        looks: one for each tenth of a second of the program: its timestamp (ns), and whether corrections were held, or
            came too late.
    """

    epoch_ns: int
    observations: list[Observation] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    corrections: str = ""
    looks: list[tuple[int, bool]] = field(default_factory=list)

    def note(self, record: Record) -> None:
        """Keep an observation."""
        if isinstance(record, Observation):
            self.observations.append(record)


@dataclass(frozen=True)
class ToolErrors:
    """Tool error of the true machine along the program, at n times.

    Attributes:
        stamp_ns: (n,) timestamp (ns).
        before: (n, 6) without correction: x y z of the tool tip in the workpiece frame (m), rotation vector (rad).
        after: (n, 6) with the corrections that the drives got.
    """

    stamp_ns: NDArray[np.int64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]


@dataclass(frozen=True)
class ObservedCourse:
    """Course of a stage's axis as observed: between two observations it turns evenly."""

    time: NDArray[np.float64]
    angle: NDArray[np.float64]

    def at(self, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angle (n,) rad and velocity (n,) rad/s at `time` (n,) s."""
        angle = np.interp(time, self.time, self.angle)
        return angle, np.interp(time, self.time, np.gradient(self.angle, self.time))


def run(options: LinuxcncRun) -> int:
    """Run the program, print what it showed; 0 if the tool error fell as far as it must, else 1.

    Raises:
        InputError: LinuxCNC is not installed or does not start, or a file is wrong.
        RuntimeError: a process ended before its time; the message holds what it wrote.
        TimeoutError: the cell does not come to correct; the message says how its nodes fare.
    """
    machine, stage = load_machine(options.machine), load_stage(options.stage)
    if stage.encoder is None:
        raise InputError(f"{options.stage}: the stage has no section 'encoder', whose heads this run shows")
    ini = options.ini or config("linuxcnc/xyzac_trt.ini")
    program = options.program or ini.with_name("five_axis.ngc")
    if not program.is_file():
        raise InputError(f"no G-code program {program}")
    witness = execute(options, ini, program)
    errors = evaluate(witness, machine, stage, options)
    rows = figures(errors, witness)
    print(f"Tool error of the true machine along {program.name}, {len(errors.stamp_ns)} points:")
    print(table(rows))
    print(f"the bridge said of the corrections: {witness.corrections}", *witness.failures, sep="\n")
    return 0 if all(row.ok for row in rows) else 1


def execute(options: LinuxcncRun, ini: Path, program: Path) -> Witness:
    """Run the program with everything that corrects it, and watch.

    Raises:
        InputError: LinuxCNC does not start, or does not run the program.
        RuntimeError: a process ended before its time.
        TimeoutError: the cell does not come to correct.
    """
    witness = Witness(time.time_ns())
    letters = tuple(load_stage(options.stage).azimuths)
    shared: dict[str, object] = {"stage": str(options.stage)} if options.stage else {}
    named: Any = {"machine": options.machine}
    mock: Any = {"mock.seed": options.seed, "mock.epoch": witness.epoch_ns, "rate": options.rate}
    mock["block_period"] = _PACE["block_period"]
    with Instance(ini) as cnc, Cell(letters, shared) as cell:
        _operate(cnc, ["--prepare"])
        where: Any = {"enter": " ".join(cnc.enter), "home": cnc.environment["HOME"]}
        processes = [
            cell.start(
                "linuxcnc_bridge", rate=_PACE["rate"], max_age=_OLDEST, block_period=_COMMAND_PERIOD, **named, **where
            ),
            cell.start("stage_follower", **mock),
            # the table stands until corrections flow: there is no turn to hold the stage's description against
            cell.start("error_estimator", period=_PACE["period"], max_gap=_LONGEST_GAP, check_turns=0.0),
            cell.start("compensation", correction_period=_PACE["correction_period"], joint_lag=_JOINT_LAG, **named),
        ]
        cell.wait_for_status("linuxcnc_bridge: corrections", "applied", STARTING)
        observer = Connection(ObserverSettings(), witness.note, enter=cnc.enter, environment=cnc.environment)
        try:
            _watch(cell, cnc, program, options, witness)
        finally:
            observer.close()
        witness.corrections = cell.status("linuxcnc_bridge: corrections").message
        for process in reversed(processes):
            if process.stop() != 0:
                witness.failures.append(process.ending)
    return witness


def evaluate(
    witness: Witness, machine: MachineDescription, stage: StageDescription, options: LinuxcncRun
) -> ToolErrors:
    """Tool error of the true machine with and without what the offsets added to the joints.

    Points count from when each axis has moved: before, nobody knows from which side it came. From there on what the
    drives are told, corrections included, has to cross their play.
    """
    stamp_ns = np.array([each.stamp_ns for each in witness.observations])
    joints = np.array([each.joints for each in witness.observations])
    kinematics = _ideal(machine)
    nominal = np.array([kinematics.to_joints(each.axes) for each in witness.observations])
    travelled = travel_directions(nominal)
    counted = (travelled != 0).all(axis=1)
    if not counted.any():
        raise InputError("the program does not move every axis: nothing can be said of it")
    time_s = (stamp_ns - witness.epoch_ns) / NANOSECONDS
    settings = MockSettings(options.seed, witness.epoch_ns, (), forces=False, rate=options.rate)
    seen = ObservedCourse(time_s, nominal[:, machine.letters.index(str(machine.monitored))])
    truth = followed_plant(stage, settings, seen).scene(time_s).error_motion[counted]
    truth[:, _AXIAL] = np.nan  # a stage says nothing along its axis: there the machine's own holds
    widths = np.array([axis.reversal for axis in machine.axes])
    plant = MachinePlant(machine)

    def tool_error(drives: NDArray[np.float64]) -> NDArray[np.float64]:
        directions = play(drives, widths, travelled[counted][0])
        poses = make_poses(machine, nominal[counted], directions)
        return plant.tool_offset(poses, drives - nominal[counted], monitored=truth)

    return ToolErrors(stamp_ns[counted], tool_error(nominal[counted]), tool_error(joints[counted]))


def figures(errors: ToolErrors, witness: Witness) -> list[BoundedFigure]:
    """What the run showed, with the bounds that it must keep."""
    rows = []
    total = {}
    for name, offsets in (("without", errors.before), ("with", errors.after)):
        length = np.linalg.norm(offsets[:, :3], axis=1)
        total[name] = float(np.sqrt(np.mean(length**2)))
        rows.append(BoundedFigure(f"{name} correction: RMS of the tool error (um)", total[name] * 1e6))
        rows.append(BoundedFigure(f"{name} correction: largest tool error (um)", float(length.max()) * 1e6))
        for index, axis in enumerate("xyz"):
            rms = float(np.sqrt(np.mean(offsets[:, index] ** 2)))
            rows.append(BoundedFigure(f"{name} correction: RMS in {axis} of the workpiece (um)", rms * 1e6))
    in_time = _in_time(errors.stamp_ns, witness.looks)
    before, after = (np.sum(each[in_time, :3] ** 2) for each in (errors.before, errors.after))
    share = 100 * float(np.sqrt(after / before)) if in_time.any() else np.inf
    # where corrections were held or late, the error may be what it is without them
    uncorrected = float(np.sum(errors.before[~in_time, :3] ** 2) / np.sum(errors.before[:, :3] ** 2))
    most = float(np.hypot(LARGEST_SHARE, 100 * np.sqrt(uncorrected)))
    rows.append(BoundedFigure("corrected in percent of uncorrected", 100 * total["with"] / total["without"], most, 2))
    rows.append(BoundedFigure("the same where corrections came in time", share, LARGEST_SHARE, 2))
    late = 100.0 * float(np.mean([late for _, late in witness.looks])) if witness.looks else 0.0
    rows.append(BoundedFigure("corrections late or held, in percent of the time", late, LARGEST_LATE, 1))
    rows.append(BoundedFigure("processes that ended badly", len(witness.failures), 0, 0))
    return rows


def _in_time(stamp_ns: NDArray[np.int64], looks: Sequence[tuple[int, bool]]) -> NDArray[np.bool_]:
    """(n,) whether corrections were in effect: they were neither held nor late `_RETURN` before and after."""
    apart = round(_RETURN * NANOSECONDS)
    late = np.sort(np.array([stamp for stamp, is_late in looks if is_late], np.int64))
    return np.asarray(np.searchsorted(late, stamp_ns - apart) == np.searchsorted(late, stamp_ns + apart))


def travel_directions(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, axes) sign of each axis's latest movement, from positions (n, axes); 0 before its first."""
    step = np.diff(positions, axis=0, prepend=positions[:1])
    moved = np.abs(step) > _STANDSTILL
    latest = np.maximum.accumulate(np.where(moved, np.arange(len(positions))[:, None], -1), axis=0)
    signs = np.take_along_axis(np.sign(step), np.maximum(latest, 0), axis=0)
    return np.where(latest >= 0, signs, 0.0)


def _ideal(machine: MachineDescription) -> RotaryTableKinematics:
    """The controller's kinematics as the machine file describes them.

    Raises:
        InputError: it describes another kind of machine.
    """
    bodies = {body.name: body for body in machine.bodies}
    if machine.letters != ("X", "Y", "Z", "A", "C") or not {"trunnion", "workpiece"} <= set(bodies):
        raise InputError(f"machine {machine.name} is no tilting rotary table with the axes X Y Z A C")
    point = -np.asarray(bodies["workpiece"].pose.shift)
    offset = np.asarray(bodies["trunnion"].pose.shift) - point
    return RotaryTableKinematics(
        (float(point[0]), float(point[1]), float(point[2])), (float(offset[1]), float(offset[2]))
    )


def _operate(cnc: Instance, arguments: Sequence[str]) -> None:
    done = cnc.run(_operation(arguments))
    if done.returncode != 0:
        raise InputError(f"LinuxCNC: {done.stderr.strip()}")


def _operation(arguments: Sequence[str]) -> list[str]:
    return [*system_program("rotary_error_monitor.linuxcnc_controller.operation"), *arguments]


def _refused(cell: Cell) -> int:
    """How many corrections the bridge has refused so far."""
    found = re.search(r"(\d+) refused so far", cell.status("linuxcnc_bridge: corrections").message)
    return int(found[1]) if found else 0


def _watch(cell: Cell, cnc: Instance, program: Path, options: LinuxcncRun, witness: Witness) -> None:
    """Run the program, and let the harness run beside it."""
    copy = cnc.folder / program.name  # an isolated LinuxCNC does not see every folder
    shutil.copyfile(program, copy)
    arguments = ["--program", str(copy), "--deadline", str(options.deadline)]
    command = [*cnc.enter, *_operation(arguments)]
    begin = time.monotonic()
    with (
        subprocess.Popen(command, env=cnc.environment, stderr=subprocess.PIPE, text=True) as operation,
        tqdm(desc=program.name, bar_format="{desc}: {n:.0f} s", disable=options.quiet or None) as progress,
    ):
        refused = _refused(cell)
        while operation.poll() is None:
            cell.spin_for(_TICK)
            before, refused = refused, _refused(cell)
            held = any(cell.status(name).message.startswith("held") for name in _SAYING)
            witness.looks.append((time.time_ns(), held or refused > before))
            progress.update(time.monotonic() - begin - progress.n)
        said = operation.stderr.read() if operation.stderr is not None else ""
    if operation.returncode != 0:
        raise InputError(f"LinuxCNC: {said.strip()}")
