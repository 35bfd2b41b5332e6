"""Faults against recordings that another program made with the same effects, and against closed forms."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import CubicSpline

from rotary_error_monitor.cases.draws import draw_fault, draw_stage, machine_faults, stage_faults
from rotary_error_monitor.cases.faults import UNNAMED, VOCABULARY, make_fault
from rotary_error_monitor.cases.faults.named import SHAPES, unnamed
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.environment import intermittent_forces
from rotary_error_monitor.plant.machine import MachineFault, MachinePlant, make_poses
from rotary_error_monitor.plant.scene import Fault
from rotary_error_monitor.plant.stage import StagePlant

Array = NDArray[np.float64]
CASES = Path(__file__).parents[3] / "shared" / "cases" / "open"
ROWS = sorted(path.parent for path in CASES.glob("*/truth.yaml"))


def truth_of(case: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load((case / "truth.yaml").read_text(encoding="utf-8"))
    return content


KNOWN = [case for case in ROWS if truth_of(case)["kind"] != "unknown"]
STAGES = [case for case in KNOWN if truth_of(case)["family"] == "stage"]
MACHINES = [case for case in KNOWN if truth_of(case)["family"] == "machine"]
needs_cases = pytest.mark.skipif(not ROWS, reason=f"no recorded cases in {CASES}")


def messages(case: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with AnyReader([case / "bag"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found


def signals(case: Path) -> dict[str, Array]:
    """Rows (time after the epoch, fields) of each stream."""
    result = {}
    for topic, blocks in messages(case).items():
        rows = []
        for block in blocks:
            samples = np.frombuffer(block.data.tobytes(), "<f8").reshape(block.width, -1).copy()
            samples[:, 0] += (block.header.stamp.sec - 1_763_700_000) + 1e-9 * block.header.stamp.nanosec
            rows.append(samples)
        result[topic.split("/")[2]] = np.concatenate(rows)
    return result


@dataclass(frozen=True)
class Recorded:
    """Stands for motion, forces or temperature: what was recorded, between the samples."""

    curve: CubicSpline

    def at(self, time: Array) -> Any:
        return self.curve(time)


class RecordedMotion(Recorded):
    def at(self, time: Array) -> Any:
        return self.curve(time), np.where(np.abs(self.curve(time, 1)) < 1e-6, 0.0, self.curve(time, 1))


@needs_cases
@pytest.mark.parametrize("case", STAGES, ids=lambda case: case.name)
def test_stage_with_its_true_faults_leaves_the_noise_of_the_recording(case: Path) -> None:
    recorded = signals(case)
    time, command = recorded["command"][:, 0], recorded["command"][:, 1]
    force = recorded["force"]
    faults = tuple(make_fault(e["effect"], e["location"], **e["parameters"]) for e in truth_of(case)["effects"])
    stage = load_stage(case / "twin.yaml")
    temperature = recorded["temperature"]
    smooth = np.polynomial.Polynomial.fit(temperature[:, 0], temperature[:, 1], 7)
    plant = StagePlant(
        stage,
        0,
        motion=RecordedMotion(CubicSpline(time, command)),  # type: ignore[arg-type]
        forces=Recorded(CubicSpline(force[:, 0], force[:, 1] + 1j * force[:, 2])),  # type: ignore[arg-type]
        temperature=Recorded(smooth),  # type: ignore[arg-type]
        faults=tuple(fault for fault in faults if isinstance(fault, Fault)),
        jitter=0.0,
    )

    def residual(stream: str) -> Array:
        rows = recorded[stream]
        # the reversals and the ends are left out: there the recorded command is not smooth enough
        rows = rows[(rows[:, 0] > 1.2) & (rows[:, 0] < 36.8)]
        return np.asarray(rows[:, 1:] - plant.signal(stream, rows[:, 0]))

    heads = [residual(f"head_{name}")[:, 0] for name in "abcd"]
    rows = np.stack([head[: min(map(len, heads))] for head in heads])
    reading = np.hypot(stage.encoder.noise, stage.encoder.resolution / np.sqrt(12))
    own = (rows - rows.mean(axis=0)).std(axis=1) / np.sqrt(3 / 4)
    np.testing.assert_allclose(own, reading, rtol=0.06)
    assert np.sqrt((rows.mean(axis=0) ** 2).mean()) < 2.6e-6  # the jitter of the rotation
    collimator = stage.autocollimator
    tilt = np.hypot(collimator.noise, collimator.resolution / np.sqrt(12))
    np.testing.assert_allclose(np.sqrt((residual("autocollimator") ** 2).mean(axis=0)), tilt, rtol=0.05)
    assert stage.lvdt is not None
    np.testing.assert_allclose(np.sqrt((residual("lvdt") ** 2).mean(axis=0)), stage.lvdt.noise, rtol=0.1)


@needs_cases
@pytest.mark.parametrize("case", MACHINES, ids=lambda case: case.name)
def test_machine_with_its_true_faults_leaves_the_noise_of_the_tracker(case: Path) -> None:
    machine, found = load_machine(case / "twin.yaml"), messages(case)
    joints = found["/machine/joint_states"]
    columns = [[state.name.index(letter) for letter in machine.letters] for state in joints]
    positions = np.array([state.position[index] for state, index in zip(joints, columns, strict=True)])
    directions = np.array([state.velocity[index] for state, index in zip(joints, columns, strict=True)])
    warm = np.array([message.temperature for message in found["/machine/temperature"]])
    probe = np.array([[m.point.x, m.point.y, m.point.z] for m in found["/machine/tool_probe"]])
    effects = truth_of(case)["effects"]
    faults = tuple(make_fault(e["effect"], e["location"], **e["parameters"]) for e in effects)
    plant = MachinePlant(machine, tuple(fault for fault in faults if isinstance(fault, MachineFault)))
    residual = probe - plant.tool_offset(make_poses(machine, positions, directions, warm))[:, :3]
    assert np.sqrt((residual**2).mean()) == pytest.approx(1.5e-6, rel=0.12)


@pytest.mark.few(5)
@pytest.mark.parametrize("name", [*stage_faults(), *stage_faults(False)])
def test_every_stage_fault_moves_something_and_its_size_scales(name: str) -> None:
    draw = np.random.default_rng(4)
    plain = StagePlant(draw_stage(draw), 1, forces=intermittent_forces(2))
    fault = draw_fault(name, draw)
    assert isinstance(fault, Fault)
    time = np.linspace(1, 39, 3000)

    def moved(factor: float) -> float:
        changed = fault.scaled(factor)
        assert isinstance(changed, Fault)
        plant = replace(plain, faults=(changed,))
        streams = [stream for stream in plain.streams if stream not in ("command", "force", "temperature")]
        parts = [plant.signal(stream, time) - plain.signal(stream, time) for stream in streams]
        return float(np.sqrt(sum((part**2).sum() for part in parts))) * 1e6

    assert moved(0.0) == pytest.approx(0.0, abs=1e-6)
    factor = next(size for size in 10.0 ** np.arange(-3, 14) if moved(size) > 1)
    assert moved(2 * factor) / moved(factor) == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize("name", [*machine_faults(), *machine_faults(False)])
def test_every_machine_fault_moves_the_tool_and_its_size_scales(name: str) -> None:
    draw = np.random.default_rng(4)
    machine = load_machine("pan2013")
    low, high = zip(*(axis.travel for axis in machine.axes), strict=True)
    poses = make_poses(machine, draw.uniform(low, high, (40, 5)), draw.choice([-1.0, 1.0], (40, 5)), 23.0)
    fault = draw_fault(name, draw)

    def offset(factor: float) -> Array:
        changed = fault.scaled(factor)
        assert isinstance(changed, MachineFault)
        return MachinePlant(machine, (changed,)).tool_offset(poses)

    plain = MachinePlant(machine).tool_offset(poses)
    np.testing.assert_allclose(offset(0.0), plain, rtol=0, atol=1e-14)
    one, two = offset(1.0) - plain, offset(2.0) - plain
    assert np.abs(one).max() > 0
    np.testing.assert_allclose(two, 2 * one, rtol=0, atol=1e-3 * np.abs(two).max())


def test_faults_are_made_as_a_truth_file_tells_them() -> None:
    fault = make_fault("unbalance", radial=[1e-8, -2e-8])
    assert fault.parameters == {"radial": [1e-8, -2e-8]}
    assert make_fault(fault.name, fault.location, **fault.parameters) == fault
    with pytest.raises(InputError, match=r"no fault 'gremlin'; there are .*unbalance"):
        make_fault("gremlin")
    with pytest.raises(InputError, match=r"fault 'unbalance' has the parameters \['radial'\], not \['size'\]"):
        make_fault("unbalance", size=1.0)
    with pytest.raises(InputError, match="two faults are called 'oil_film'"):
        unnamed("oil_film")(type(fault))


def test_every_fault_has_a_size_and_no_name_stands_in_both_registers() -> None:
    assert not set(VOCABULARY) & set(UNNAMED)
    for kind in (VOCABULARY | UNNAMED).values():
        assert {row.name for row in fields(kind)} - SHAPES - {"location"}


def test_sizes_of_orbits_have_no_sign():
    """A negative size is half a turn of phase: as a truth it would be held against a diagnosis that says so."""
    drawn = [draw_fault("bearing_asynchronous", np.random.default_rng(seed)).parameters for seed in range(40)]
    assert min(parameters["radial"] for parameters in drawn) > 0
