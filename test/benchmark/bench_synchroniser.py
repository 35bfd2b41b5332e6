"""What a user would write first, beside this package: joining the readings of five instruments. Printed, no bound.

The first way is one message a sample and an approximate-time synchroniser as ROS documents it (`synchroniser.py`); the
second the package's estimator, which hears blocks of 5 ms, or the package's nodes behind the same single messages. The
stage turns evenly and has no error motion: what was joined of several instants shows as one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.testing import Cell

from .drivers import driver_topic
from .even_stage import HEADS, RADIUS, STREAMS, radial_of_one_step, write_stage
from .feeding import Sent, fed, on_time

SECONDS = min(float(os.environ.get("BENCH_SECONDS", "10")), 20.0)
SYNCHRONISER = Path(__file__).with_name("synchroniser.py")

QUEUE = 10
"""Messages of a topic that the synchroniser keeps: `queue_size` of ROS's tutorials."""

TUTORIAL_SLOP = 0.05
"""Slop of ROS's tutorials, s."""

TICK_NS = 1_000_000
"""Distance of two estimates, ns."""

EDGE_NS = 100_000_000
"""Time at begin and end of the sending that is left out, ns: what a filter needs before it gives anything."""

LATE = 3.0
"""Periods that messages, or blocks, are late at most."""

APART = 0.8
"""Periods from the samples of the first instrument to those of the last, where each has a trigger of its own."""

FIRST_WAY = [
    *((rate, 0.0, 0.0, 0.5 / rate) for rate in (500.0, 1000.0, 2000.0, 5000.0)),
    *((500.0, LATE, apart, slop) for apart in (0.0, APART) for slop in (0.5 / 500.0, TUTORIAL_SLOP)),
]
"""Rate of each instrument, 1/s; periods that messages are late; periods that samples are apart; slop, s."""

BLOCKS = [(rate, late, APART if late else 0.0) for rate in (500.0, 10_000.0, 50_000.0) for late in (0.0, LATE)]
SINGLE = [(500.0, LATE, APART), (2000.0, 0.0, 0.0), (2000.0, LATE, APART)]


@dataclass(frozen=True)
class Joined:
    """What the estimator joined: ticks that passed, those with all streams, and those that show another instant."""

    ticks: int
    joined: int
    wrong: int
    worst: float


class Motions:
    """Error motion as it is published."""

    def __init__(self, cell: Cell) -> None:
        """Listen from now on."""
        self._found: list[ErrorMotion] = []
        decoder = BlockDecoder()
        kind = messages.message_class("sensor_msgs/msg/PointCloud2")
        topic = cell.wire.topic("error_motion_samples").name
        keep = lambda data: self._found.append(error_motion_from_block(decoder.decode(data)))  # noqa: E731
        cell.node.create_subscription(kind, topic, keep, 1000, raw=True)

    def any(self) -> bool:
        """Whether there is an estimate."""
        return bool(self._found)

    def joined(self, sent: Sent, seconds: float, rate: float) -> Joined:
        """What was joined of what was sent."""
        times = np.concatenate([motion.times_ns for motion in self._found])
        streams = np.concatenate([motion.streams for motion in self._found])
        radial = np.concatenate([np.hypot(*motion.components[:, :2].T) for motion in self._found])
        first, last = sent.epoch_ns + EDGE_NS, sent.epoch_ns + round(seconds * 1e9) - EDGE_NS
        inside = (times >= first) & (times < last)
        heard = np.bitwise_or.reduce(streams[inside].astype(np.int64))
        complete = inside & (streams.astype(np.int64) == heard)
        step = radial_of_one_step(rate)
        return Joined(
            (last - first) // TICK_NS,
            len(np.unique(times[complete])) if heard.bit_count() == len(STREAMS) else 0,
            int((radial[complete] > 0.25 * step).sum()),
            float(radial[complete].max(initial=0.0)),
        )


@pytest.mark.parametrize(("rate", "late", "apart", "slop"), FIRST_WAY)
def test_approximate_time_synchroniser(rate, late, apart, slop, capsys):
    with Cell() as cell:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(cell.node.context.get_domain_id())}
        command = [*on_time(), sys.executable, str(SYNCHRONISER), str(QUEUE), str(slop), str(RADIUS)]
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
            try:
                sent = fed(cell, "messages", rate, SECONDS, late, apart=apart)
                output = process.communicate(timeout=120)[0]
            finally:
                process.kill()
    told = json.loads(output)
    lost = sum(sent.samples - count for count in told["messages"].values())
    with capsys.disabled():
        print(
            f"\nsynchroniser ({told['how']}), {described(rate, late, apart)}, slop {slop:g} s: "
            f"{lost} messages lost, of {sent.samples} instants {told['sets']} joined, {told['of_one_instant']} of them "
            f"of one instant; worst radial error motion {told['worst'] * 1e6:.2f} µm; "
            f"{100 * told['processor']:.0f} % of a core; drivers {sent.behind_ms:.0f} ms behind"
        )


@pytest.mark.parametrize(("rate", "late", "apart"), BLOCKS)
def test_estimator_by_blocks(rate, late, apart, tmp_path, capsys):
    with Cell(parameters={"stage": str(write_stage(tmp_path / "even.yaml"))}) as cell:
        motions = Motions(cell)
        nodes = [cell.start("error_estimator", within=on_time())]
        cell.wait_for_status("error_estimator: state", "active")
        sent = fed(cell, "blocks", rate, SECONDS, late, nodes, motions.any, apart)
    tell(capsys, "estimator, blocks", (rate, late, apart), motions.joined(sent, SECONDS, rate), sent)


@pytest.mark.parametrize(("rate", "late", "apart"), SINGLE)
def test_estimator_behind_drivers(rate, late, apart, tmp_path, capsys):
    with Cell(parameters={"stage": str(write_stage(tmp_path / "even.yaml"))}) as cell:
        motions = Motions(cell)
        nodes = [
            cell.start("encoder_head", f"encoder_{stream}", within=on_time(),
                       source="joint_state", joint_state__topic=driver_topic(stream))
            for stream in HEADS
        ]  # fmt: skip
        nodes.append(
            cell.start("autocollimator", within=on_time(), source="vector3",
                       vector3__topic=driver_topic("autocollimator"))
        )  # fmt: skip
        nodes.append(cell.start("error_estimator", within=on_time()))
        for node in nodes:
            cell.wait_for_status(f"{node.name}: state", "active")
        sent = fed(cell, "messages", rate, SECONDS, late, nodes, motions.any, apart)
    tell(capsys, "estimator behind single messages", (rate, late, apart), motions.joined(sent, SECONDS, rate), sent)


def described(rate, late, apart):
    return f"{rate:.0f} samples a second of each of 5, late up to {late:g} periods, {apart:g} apart"


def tell(capsys, way, how, found, sent):
    with capsys.disabled():
        print(
            f"\n{way}, {described(*how)}: of {found.ticks} ticks {found.joined} joined, {found.wrong} of them wrong; "
            f"worst radial error motion {found.worst * 1e6:.3f} µm; "
            f"{100 * sum(sent.used):.0f} % of a core; drivers {sent.behind_ms:.0f} ms behind"
        )
    assert found.joined == found.ticks and found.wrong == 0, "every tick is joined, of one instant"
