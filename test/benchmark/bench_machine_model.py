"""Speed of the machine model: compiled, numpy, plain Python, and Pinocchio's kinematics of the ideal machine.

Times are those of the processor, the fastest of several tries, so that ratios hold where others use the same cores.
BENCH_POSES (100000) poses make a batch; Pinocchio is left out, and that is said, where it is not installed
(`pip install pin`).
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmark import plain_chain
from kernels import FORMS, computing_by, is_built
from numpy.typing import NDArray
from pipeline.test_compensation import MACHINE, motion_block, run

from rotary_error_monitor.calibration.volume import estimate_uncertain_offsets, sample_volume
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine, stand
from rotary_error_monitor.pipeline.compensation import Compensator

Array = NDArray[np.float64]
POSES = int(os.environ.get("BENCH_POSES", "100000"))
MACHINES = ("xyzac_trt", "pan2013", "grinder_zhou2023")
PRESENT = [form for form in FORMS if form != "compiled" or is_built()]


def seconds(work: Callable[[], object], tries: int = 5, least: float = 0.05) -> float:
    """Processor time of one call, the fastest of several tries that each take at least `least` s."""
    found, count = np.inf, 1
    while tries:
        begin = time.process_time()
        for _ in range(count):
            work()
        took = time.process_time() - begin
        if took < least:
            count *= 2
            continue
        found, tries = min(found, took / count), tries - 1
    return float(found)


def poses(machine: MachineDescription, count: int) -> tuple[Array, dict[str, Array]]:
    rng = np.random.default_rng(1)
    positions = sample_volume(machine, count)
    known = {"direction": rng.choice([-1.0, 1.0], positions.shape), "temperature": rng.uniform(15.0, 30.0, count)}
    if machine.monitored:
        known["monitored"] = rng.normal(size=(count, 6)) * 1e-6
    return positions, known


def row(name: str, each: float, one: float) -> None:
    print(f"  {name:58} {each * 1e6:9.3f} µs   {each / one:9.2f}")


@pytest.mark.parametrize("name", MACHINES)
def test_poses(name: str) -> None:
    machine = load_machine(name)
    model = arrange_machine(machine)
    q, known = poses(machine, POSES)
    print(f"\n{name}: time a pose, and beside the first row")
    one = 0.0
    for form in PRESENT:
        with computing_by(form):
            for what, solve in (("offset, exact", predict_tool_offset), ("corrections", solve_axis_corrections)):
                for count in (POSES, 5, 1):
                    some = {key: value[:count] for key, value in known.items()}
                    took = seconds(lambda n=count, s=some, f=solve: f(model, q[:n], **s)) / count
                    one = one or took
                    row(f"{what}, {form}, {count} pose{'s' * (count > 1)} at once", took, one)
    few = q[:200]
    np.testing.assert_allclose(
        [plain_chain.offset(machine, each) for each in few.tolist()],
        predict_tool_offset(model, few),
        rtol=0.0,
        atol=1e-12,
    )
    took = seconds(lambda: [plain_chain.offset(machine, each) for each in few.tolist()], tries=3) / len(few)
    row("offset, exact, plain Python", took, one)
    if importlib.util.find_spec("pinocchio") is None:
        print("  Pinocchio is not installed (pip install pin): left out")
    else:
        row("ideal machine alone, Pinocchio from Python", pinocchio_time(machine, q[:2000]), one)


def pinocchio_time(machine: MachineDescription, positions: Array) -> float:
    """Time a pose for where the ideal machine's tool is in its workpiece; it must be where this package has it."""
    pin: Any = importlib.import_module("pinocchio")
    model, frames = pin.Model(), {"base": (0, pin.SE3.Identity())}
    for body in machine.bodies:
        joint, standing = frames[body.parent]
        own = standing * pin.SE3(pin.exp3(np.array(body.pose.rotation)), np.array(body.pose.shift))
        if body.axis is None:
            frames[body.name] = joint, own
            continue
        axis = machine.axis(body.axis)
        kind = pin.JointModelPrismaticUnaligned if axis.kind == "linear" else pin.JointModelRevoluteUnaligned
        frames[body.name] = model.addJoint(joint, kind(np.array(axis.direction)), own, axis.letter), pin.SE3.Identity()
    data = model.createData()
    order = [machine.letters.index(name) for name in list(model.names)[1:]]
    (tool, at_tool), (work, at_work) = frames[machine.tool], frames[machine.workpiece]

    def solve() -> list[Array]:
        found = []
        for q in positions[:, order]:
            pin.forwardKinematics(model, data, q)
            found.append(((data.oMi[work] * at_work).actInv(data.oMi[tool] * at_tool)).translation)
        return found

    ours = stand(arrange_machine(machine), np.ascontiguousarray(positions.T), None).tool_in_workpiece()[:, 3].T
    np.testing.assert_allclose(solve(), ours, rtol=0.0, atol=1e-12)
    return seconds(solve, tries=3) / len(positions)


def test_uncertainty_of_a_volume() -> None:
    stated = {"errors.linear": 5e-7, "errors.angular": 2e-6, "location.linear": 2e-6, "location.angular": 5e-6}
    machine = replace(load_machine("pan2013"), uncertainty=stated)
    print(f"\nMonte Carlo over {POSES} poses of pan2013, 20 draws")
    q = sample_volume(machine, POSES)
    one = 0.0
    for form in PRESENT:
        with computing_by(form):
            took = seconds(lambda: estimate_uncertain_offsets(machine, q, draws=20), tries=2) / POSES / 20
        one = one or took
        row(f"a pose and draw, {form}", took, one)


def test_the_live_path() -> None:
    """All that the compensation node does with a block between receiving and publishing it."""
    until_ms = 2_000
    blocks = {ms: motion_block(ms) for ms in range(0, until_ms, 5)}
    print("\na block of 5 poses through the compensator: checks, offsets, corrections at 100 Hz, reports at 20 Hz")
    one = 0.0
    for form in PRESENT:
        with computing_by(form):
            took = seconds(lambda: run(Compensator(MACHINE), until_ms, blocks=blocks.__getitem__)) / len(blocks)
        one = one or took
        row(f"a block, {form}", took, one)


FIRST = """
import resource, time
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine
model = arrange_machine(load_machine("xyzac_trt"))
before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
solve_axis_corrections(model, [[0.0] * 5])
print((time.process_time() - begin) * 1e3, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def test_the_first_call_of_a_process() -> None:
    print("\nthe first corrections of a process, with all that is loaded for them")
    for form in PRESENT:
        environment = {**os.environ, "ROTARY_ERROR_MONITOR_KERNEL": form}
        found = [
            subprocess.run(
                [sys.executable, "-c", FIRST], env=environment, check=True, capture_output=True, text=True
            ).stdout.split()
            for _ in range(3)
        ]
        took, memory = np.array(found, dtype=float).min(axis=0)
        print(f"  {form:10} {took:6.2f} ms, {memory:5.1f} MB more")
