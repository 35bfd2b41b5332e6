"""A stage that turns for ever at exact whole counts, so that what is right at any time is known to the count."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples
from rotary_error_monitor.testing import Cell

START = 1_763_700_000_000_000_000
SAMPLE = 1_000_000
"""Distance of two samples, and of two estimates, ns."""

SAMPLES = 5
"""Samples of a block."""

FIRST = START + 200_000
"""Time of the first sample: between two ticks, where the stage stands at a whole count all the same."""

COUNTS = 5_000
"""Counts that the stage turns from sample to sample: 9.98 rad/s, just below what its description allows."""

TURN = 31_488 * 100
"""Counts of a turn."""

WARMTH = 20.0
"""Temperature of the machine, °C: without one the first corrections wait for it."""

STREAMS = ("head_a", "head_b", "head_c", "head_d", "autocollimator", "command")
JOINTS = 2
"""Groups of blocks from one joint state to the next: 10 ms."""


@dataclass
class Stage:
    """The stage that is described, without error motion: heads and command to whole counts, mirror and eccentricity.

    Attributes:
        counts: counts that it has turned before the first sample.
    """

    description: StageDescription = field(default_factory=load_stage)
    counts: int = 0

    @property
    def step(self) -> float:
        """Size of a count, rad."""
        return self.description.encoder.resolution

    def blocks(self, group: int) -> dict[str, SampleBlock]:
        """One block of each stream; the `group`-th since the start."""
        number = np.arange(group * SAMPLES, (group + 1) * SAMPLES)
        times = FIRST + number * SAMPLE
        counts = self.counts + number * COUNTS
        # within the turn, so that what is exact here does not hang on how far the stage has turned
        angle = (counts % round(2 * np.pi / self.step)) * self.step
        encoder, mirror = self.description.encoder, self.description.mirror
        cos, sin = np.cos(angle), np.sin(angle)
        x = encoder.eccentricity[0] * cos - encoder.eccentricity[1] * sin
        y = encoder.eccentricity[0] * sin + encoder.eccentricity[1] * cos
        made = {}
        for letter, azimuth in encoder.azimuths.items():
            psi = azimuth - angle
            error = (-x * np.sin(azimuth) + y * np.cos(azimuth)) / encoder.disc_radius
            for wave in encoder.graduation:
                error = error + wave.cos * np.cos(wave.order * psi) + wave.sin * np.sin(wave.order * psi)
            reading = (counts + np.rint(error / self.step).astype(np.int64)) * self.step
            made[f"head_{letter}"] = block_from_samples(times, ["angle"], reading[:, None])
        tilt = np.stack([mirror.tilt[0] * cos - mirror.tilt[1] * sin, mirror.tilt[0] * sin + mirror.tilt[1] * cos], 1)
        for wave in mirror.flatness:
            for axis, (c, s) in enumerate((wave.x, wave.y)):
                tilt[:, axis] += c * np.cos(wave.order * angle) + s * np.sin(wave.order * angle)
        made["autocollimator"] = block_from_samples(times, ["tilt_x", "tilt_y"], tilt)
        velocity = np.full(SAMPLES, COUNTS * self.step / (SAMPLE * 1e-9))
        made["command"] = block_from_samples(times, ["angle", "velocity"], np.stack([counts * self.step, velocity], 1))
        return made

    def off(self, motion: ErrorMotion) -> np.ndarray:
        """How far the rotation of error motion is off where command and all heads are in it, counts."""
        needed = sum(1 << place for place, name in enumerate(STREAMS) if name != "autocollimator")
        motion = motion.at(motion.streams & needed == needed)
        since = motion.times_ns - FIRST
        assert (since * COUNTS % SAMPLE == 0).all()
        true = self.counts + since * COUNTS // SAMPLE
        whole = np.rint(motion.theta / self.step)
        part = (motion.theta - whole * self.step) / self.step
        return (whole.astype(np.int64) - true) + part

    def joint_state(self, group: int, machine: MachineDescription) -> tuple[int, dict[str, float], dict[str, float]]:
        """Joint state at the first sample of a group: the stage turns, the other axes stand."""
        positions = {axis.letter: 0.5 * sum(axis.travel) for axis in machine.axes}
        assert machine.monitored is not None
        positions[machine.monitored] = (self.counts + group * SAMPLES * COUNTS) * self.step
        return FIRST + group * SAMPLES * SAMPLE, positions, dict.fromkeys(positions, 0.0)


@dataclass
class Endured:
    """What a run showed.

    Attributes:
        blocks: that went in.
        estimates: that came out, most from all streams.
        offsets: of the tool that came out.
        worst: most that a rotation was off, counts.
        turns: that the stage has turned, from the first count on.
        memory: (k,) bytes held at `MARKS` equal parts of the run.
    """

    blocks: int
    estimates: int
    offsets: int
    worst: float
    turns: float
    memory: list[int] = field(default_factory=list)


MARKS = 100
LEAD = 8
"""Groups of blocks that the harness may be ahead of the estimator: 40 ms, as on a computer that is busy."""

PATIENCE = 0.3
"""Time, s, that the harness waits for the first estimate: the estimator may wait itself, for a stream not found yet."""

BUSY = 5.0
"""The same for all others, s: a computer may have something else to do."""


def endure(groups: int, counts: int = 0) -> Endured:
    """So many groups of blocks through estimator and compensator, from `counts` on, as fast as it goes."""
    stage, machine = Stage(counts=counts), load_machine("xyzac_trt")
    estimator, compensator = Estimator(stage.description), Compensator(machine)
    estimates = offsets = blocks = 0
    worst, memory = 0.0, []
    compensator.push_temperature(WARMTH, FIRST)
    for group in range(groups):
        if group % JOINTS == 0:
            compensator.accept_joint_state(*stage.joint_state(group, machine))
        for name, block in stage.blocks(group).items():
            estimator.accept(name, block)
            blocks += 1
        for made in estimator.advance():
            estimates += len(made.theta)
            worst = max(worst, float(np.abs(stage.off(made)).max(initial=0.0)))
            compensator.accept_error_motion(made)
        offsets += sum(len(block.rows) for block in compensator.advance().offsets)
        if (group + 1) % (groups // MARKS) == 0:
            memory.append(resident())
    turned = counts + groups * SAMPLES * COUNTS
    return Endured(blocks, estimates, offsets, worst, turned * stage.step / (2 * np.pi), memory)


def check_flat(memory: list[int], since: float = 0.1) -> float:
    """How much more memory was held at any time than after the first part of the run; more than 1 % fails."""
    warm = memory[round(since * len(memory))]
    growth = max(memory[round(since * len(memory)) :]) / warm - 1
    assert growth < 0.01, f"{growth:.2%} of {warm} bytes"
    return growth


def resident(process: int | str = "self") -> int:
    """Bytes of memory that a process holds."""
    return int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


@dataclass
class Lived:
    """What a run of nodes showed.

    Attributes:
        blocks: that were published.
        estimates: that came back.
        newest_ns: time of the last of them.
        worst: most that a rotation was off, counts.
        memory: by node, bytes held at each hundredth of the run.
    """

    blocks: int
    estimates: int
    newest_ns: int
    worst: float
    memory: dict[str, list[int]]


def live(cell: Cell, groups: int, counts: int = 0) -> Lived:
    """The same through nodes in processes of their own, on simulated time that runs as fast as they follow."""
    stage, machine = Stage(counts=counts), load_machine("xyzac_trt")
    nodes = {
        "error_estimator": cell.start("error_estimator", use_sim_time=True),
        "compensation": cell.start("compensation", use_sim_time=True, machine="xyzac_trt"),
    }
    motion = cell.wire.topic("error_motion_samples")
    decoder, found = BlockDecoder(), Lived(0, 0, FIRST, 0.0, {name: [] for name in nodes})

    def receive(data: bytes) -> None:
        block = decoder.decode(data)
        found.estimates += len(block.rows)
        found.newest_ns = int(block.times_ns[-1])
        found.worst = max(found.worst, float(np.abs(stage.off(error_motion_from_block(block))).max(initial=0.0)))

    kind = messages.message_class(motion.type)
    cell.node.create_subscription(kind, motion.name, receive, profile(motion), raw=True)
    for name in nodes:
        cell.wait_for_status(f"{name}: state", "time stands still")
    topics = {name: cell.wire.topic("head_samples", name[-1]) for name in STREAMS if name.startswith("head_")}
    topics |= {name: cell.wire.topic(f"{name}_samples") for name in ("autocollimator", "command")}
    send = {name: cell.publish_blocks(topic) for name, topic in topics.items()}
    joints = cell.wire.topic("machine_joint_states")
    send_joints, set_time = cell.publish_on(joints), cell.clock()
    for group in range(groups):
        if group % JOINTS == 0:
            stamp, positions, velocities = stage.joint_state(group, machine)
            axes = [list(each.values()) for each in (positions, velocities)]
            send_joints(messages.joint_state_message(stamp, joints.frame, tuple(positions), *axes))
        for name, block in stage.blocks(group).items():
            send[name](block)
            found.blocks += 1
        set_time(FIRST + (group + 1) * SAMPLES * SAMPLE)
        if group % (LEAD // 2) == 0:
            due = FIRST + (group - LEAD) * SAMPLES * SAMPLE
            end = time.monotonic() + (BUSY if found.estimates else PATIENCE)
            cell.wait_until(
                lambda due=due, end=end: found.newest_ns >= due or time.monotonic() > end, "the estimator to follow"
            )
        if (group + 1) % (groups // MARKS) == 0:
            for name, process in nodes.items():
                found.memory[name].append(resident(process.pid))
    return found
