"""The figures of accuracy that the tests hold, printed."""

from __future__ import annotations

import time

import numpy as np
import pytest

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.machine.correction import remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.metrology.radial_comparison import compare_radial
from rotary_error_monitor.plant.machine import MachinePlant, make_poses
from rotary_error_monitor.recordings.replay import replay_bag


@pytest.mark.cases("open", "stage", "null")
def test_radial_error_motion_against_the_lvdt(case):
    stage = load_stage(case / "twin.yaml")
    begin = time.perf_counter()
    result = replay_bag(case / "bag", stage)
    elapsed = time.perf_counter() - begin
    (blocks,) = BagReader(case / "bag").read_blocks(["/stage/lvdt/samples"]).values()
    times = np.concatenate([block.times_ns for block in blocks])
    radial = np.concatenate([block.columns(("radial_x", "radial_y")) for block in blocks])
    found = compare_radial(result.stamp_ns, result.motion, stage.lvdt, times, radial, 1_000_000)
    span = (result.stamp_ns[-1] - result.stamp_ns[0]) * 1e-9
    print(
        f"\n{case.name}: RMS {found.rms * 1e6:.3f} µm, maximum {found.maximum * 1e6:.3f} µm, inside their 95 % bounds "
        f"{100 * found.inside:.1f} %; replayed {span / elapsed:.0f} times as fast as recorded"
    )


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt"])
def test_tool_offsets_and_corrections(name):
    machine = load_machine(name)
    model = arrange_machine(machine)
    generator = np.random.default_rng(1)
    low, high = np.array([axis.travel for axis in machine.axes]).T
    poses = generator.uniform(low, high, (1000, len(low)))
    true = MachinePlant(machine).tool_offset(make_poses(machine, poses))
    predicted = predict_tool_offset(model, poses, direction=np.ones_like(poses))
    solved = solve_axis_corrections(model, poses, direction=np.ones_like(poses))
    left = remaining_offset(model, poses, solved.corrections, direction=np.ones_like(poses))
    print(
        f"\n{name}: 1,000 poses, model against exact geometry {np.abs(predicted - true)[:, :3].max():.1e} m and "
        f"{np.abs(predicted - true)[:, 3:].max():.1e} rad; corrections leave {np.abs(left[:, :3]).max():.1e} m"
    )
    for count in (1, 10, 250):
        begin, rounds = time.perf_counter(), 0
        while time.perf_counter() - begin < 0.5:
            predict_tool_offset(model, poses[:count])
            rounds += 1
        print(f"  {count:>4} poses a call: {1e6 * 0.5 / rounds / count:8.1f} µs a pose")
