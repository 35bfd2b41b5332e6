"""Third-party drivers with one message a sample: what the package's nodes lose, and what they cost. Printed, no bound.

Five instruments (joint states of four heads, vectors of an autocollimator) send a message a sample; the package's nodes
hear them, and send the samples on in blocks. Rates are of all five together.
"""

from __future__ import annotations

import os

import pytest

from rotary_error_monitor.testing import Cell

from .drivers import driver_topic
from .even_stage import HEADS, STREAMS, write_stage
from .feeding import Counted, fed, on_time

SECONDS = min(float(os.environ.get("BENCH_SECONDS", "20")), 20.0)
RATES = tuple(map(float, os.environ.get("BENCH_DRIVER_RATES", "1000,5000,10000,20000").split(",")))

CARRIED = 10_000.0
"""Messages a second in all up to which none is lost."""


@pytest.mark.parametrize("rate", RATES)
def test_one_message_a_sample(rate, tmp_path, capsys):
    with Cell(parameters={"stage": str(write_stage(tmp_path / "even.yaml"))}) as cell:
        received = {stream: Counted(cell, stream) for stream in STREAMS}
        heard = {
            stream: {"source": "joint_state", "joint_state__topic": driver_topic(stream)}
            if stream in HEADS
            else {"source": "vector3", "vector3__topic": driver_topic(stream)}
            for stream in STREAMS
        }
        nodes = [cell.start("encoder_head", f"encoder_{stream}", within=on_time(), **heard[stream]) for stream in HEADS]
        nodes.append(cell.start("autocollimator", within=on_time(), **heard["autocollimator"]))
        for name in (*(f"encoder_{head}" for head in HEADS), "autocollimator"):
            cell.wait_for_status(f"{name}: state", "active")
        seen = received["head_a"]
        sent = fed(cell, "messages", rate / len(STREAMS), SECONDS, watched=nodes, begun=lambda: seen.samples > 0)
    lost = {stream: sent.samples - counted.samples for stream, counted in received.items()}
    with capsys.disabled():
        print(f"\n{rate:.0f} messages a second from 5 drivers, {SECONDS:.0f} s: lost {sum(lost.values())}")
        for node, share in zip(nodes, sent.used, strict=True):
            print(f"  {node.name:<16} {100 * share:5.1f} % of a core")
        each = sum(sent.used) / rate * 1e6
        print(f"  {'all':<16} {100 * sum(sent.used):5.1f} % of a core, {each:.0f} µs a message")
        print(f"  the drivers      {100 * sent.processor:5.1f} %, at most {sent.behind_ms:.0f} ms late")
    assert not any(lost.values()) or rate > CARRIED, f"messages lost: {lost}"
