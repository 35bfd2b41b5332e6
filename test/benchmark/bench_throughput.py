"""How much the cell carries, beside one message per sample. Figures are printed, none is a bound."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.messages import Decoder
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.testing import Cell, NodeProcess
from rotary_error_monitor.testing.domains import own_domain

DURATION = float(os.environ.get("BENCH_SECONDS", "60"))
RATE_SECONDS = float(os.environ.get("BENCH_RATE_SECONDS", "10"))
RATES = (50_000.0, 100_000.0, 200_000.0)
BLOCK_PERIODS = (0.005, 0.01, 0.02)
STREAMS = (*(f"/stage/head_{head}" for head in "abcd"), "/stage/autocollimator", "/stage/command")
FAST = tuple(f"{name}/samples" for name in (*STREAMS, "/stage/error_motion", "/machine/tool_offset"))
PER_SAMPLE = Path(__file__).with_name("per_sample.py")


def cpu_seconds(process: NodeProcess) -> float:
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass
class Carried:
    """What a cell carried of blocks of all instruments in `duration` s.

    Attributes:
        lost: samples that the recorder lacks, by stream; of `error_motion` and `tool_offset` ticks.
        published: age of the newest tick of each block of offsets as it was published, s.
        recorded: the same as it reached the recorder, s.
        used: part of a core that each process took, by its name.
    """

    duration: float
    lost: dict[str, int]
    published: NDArray[np.float64]
    recorded: NDArray[np.float64]
    used: dict[str, float]


def carried(rate: float, block_period: float, duration: float, bag: Path) -> Carried:
    """Four heads and autocollimator in processes of their own, through to the recorded tool offset."""
    with Cell() as cell:
        mock = {"mock.seed": 1, "mock.epoch": time.time_ns(), "rate": rate, "block_period": block_period}
        processes = [cell.start("recorder", folder=str(bag))]
        cell.wait_for_status("recorder: state", "active", 60)
        processes.append(cell.start("mock_controller", machine="xyzac_trt", **mock))
        processes.append(cell.start("autocollimator", **mock, source="mock"))
        processes += [
            cell.start("encoder_head", f"encoder_head_{head}", head=head, **mock, source="mock") for head in "abcd"
        ]
        processes += [cell.start("error_estimator"), cell.start("compensation", machine="xyzac_trt")]
        cell.wait_for_status("compensation: state", "active", 60)
        cell.wait_until(
            lambda: not cell.status("compensation: correction").message.startswith("held"), "the cell to correct", 60
        )
        published = listen_for_ages(cell)
        cell.spin_for(3)
        published.clear()
        begin, begin_ns = [cpu_seconds(process) for process in processes], time.time_ns()
        cell.spin_for(duration)
        used = [(cpu_seconds(p) - b) / duration for p, b in zip(processes, begin, strict=True)]
        end_ns = time.time_ns()
        ages = np.array(published)
        cell.spin_for(1)  # what was measured by then is recorded too
    reader = BagReader(bag)
    return Carried(
        (end_ns - begin_ns) * 1e-9,
        lost(reader, begin_ns, end_ns),
        ages,
        offset_ages(reader, begin_ns, end_ns),
        {process.name: share for process, share in zip(processes, used, strict=True)},
    )


def listen_for_ages(cell: Cell) -> list[float]:
    """Ages, s, of the newest tick of each block of offsets at its publication, as they come.

    The middleware says when a message was handed to it; a bag does not keep that.
    """
    topic, decoder, ages = cell.wire.topic("tool_offset_samples"), BlockDecoder(), []

    def note(data: bytes, about: dict[str, int]) -> None:
        ages.append((about["source_timestamp"] - int(decoder.decode(data).times_ns[-1])) * 1e-9)

    kind = messages.message_class(topic.type)
    cell.node.create_subscription(kind, topic.name, note, profile(topic), raw=True)
    return ages


def percentiles(ages: NDArray[np.float64]) -> str:
    return ", ".join(f"p{part} {np.percentile(ages, part) * 1e3:.1f} ms" for part in (50, 99))


@pytest.mark.parametrize("rate", [10_000.0, 50_000.0])
def test_blocks_from_heads_to_tool_offset(rate, tmp_path):
    found = carried(rate, 0.005, DURATION, tmp_path / "bag")
    print(f"\n{rate:.0f} samples a second from each of 5 instruments, blocks of 5 ms, {DURATION:.0f} s")
    missing = dict(found.lost)
    ticks = {name: missing.pop(name) for name in ("error_motion", "tool_offset")}
    print("  samples lost: " + ", ".join(f"{k} {v}" for k, v in missing.items()))
    print(f"  of {round(found.duration * 1e3)} ticks {ticks['error_motion']} have no estimate")
    print(f"  {ticks['tool_offset']} no offset: held where encoder and joint states part, as the mock stage reverses")
    print(f"  age of the newest offset of a block at its publication: {percentiles(found.published)}")
    print(f"  the same at the recorder: {percentiles(found.recorded)}; {len(found.recorded) / found.duration:.0f}/s")
    for name, share in found.used.items():
        print(f"  {name:<16} {100 * share:5.1f} % of a core")
    print(f"  {'all':<16} {100 * sum(found.used.values()):5.1f} % of a core")
    assert not any(missing.values()), f"samples lost: {missing}"


def test_the_highest_rate_without_loss(tmp_path):
    """Rates are tried upwards for each size of block, until samples are lost or the cell does not begin to correct."""
    print(f"\nhighest rate of each of 5 instruments that loses nothing in {RATE_SECONDS:.0f} s")
    carried_whole = []
    for block_period in BLOCK_PERIODS:
        highest = 0.0
        for rate in RATES:
            try:
                found = carried(rate, block_period, RATE_SECONDS, tmp_path / f"{block_period * 1e3:.0f}_{rate:.0f}")
            except TimeoutError as error:  # it never began to correct
                print(f"  {rate:8.0f}/s in blocks of {block_period * 1e3:3.0f} ms: {str(error).splitlines()[0]}")
                break
            missing = {name: count for name, count in found.lost.items() if count and name != "tool_offset"}
            node = {name: f"{100 * found.used[name]:.0f} %" for name in ("error_estimator", "compensation")}
            print(f"  {rate:8.0f}/s in blocks of {block_period * 1e3:3.0f} ms: lost {missing or 'nothing'}; age at "
                  f"publication {percentiles(found.published)}; of a core {node}")  # fmt: skip
            if missing:
                break
            highest = rate
        print(f"  blocks of {block_period * 1e3:.0f} ms: {5 * highest:.0f} samples a second in all")
        carried_whole.append(5 * highest)
    assert max(carried_whole) >= 1e6, "a million samples a second in all are carried whole"


def lost(reader, begin_ns, end_ns):
    """Samples missing in the bag, by stream: within it, and where it begins late, ends early or was never heard."""
    missing = {}
    for name in FAST:
        blocks = reader.read_blocks([name])[name]
        assert blocks, f"{name} is silent"
        times = np.concatenate([block.times_ns for block in blocks])
        times = times[(times >= begin_ns) & (times < end_ns)]
        steps = np.diff([begin_ns, *times, end_ns])
        period = np.median(np.diff(times))
        missing[name.split("/")[2]] = int(np.maximum(np.rint(steps / period - 1), 0).sum())
    return missing


def offset_ages(reader, begin_ns, end_ns):
    topic = "/machine/tool_offset/samples"
    decoder, ages = Decoder(reader.topics[topic].type), []
    for message in reader.messages([topic]):
        if begin_ns <= message.log_time_ns < end_ns:
            ages.append((message.log_time_ns - int(decoder.decode(message.data).times_ns[-1])) * 1e-9)
    return np.array(ages)


def test_one_message_per_sample():
    """The highest rate of single readings that loses nothing, and what it costs."""
    print("\none JointState per sample, one publisher and one subscriber process")
    duration = min(DURATION, 10.0)
    for rate in (1_000, 2_000, 5_000, 10_000, 20_000, 50_000):
        with own_domain() as domain:
            environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
            start = [sys.executable, str(PER_SAMPLE)]
            listening = subprocess.Popen(
                [*start, "subscribe", str(duration + 30)], env=environment, stdout=subprocess.PIPE, text=True
            )
            sending = subprocess.run(
                [*start, "publish", str(rate), str(duration)],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            received, _ = listening.communicate(timeout=60)
        (sent, sender), (got, receiver) = (
            map(float, re.search(r"(\d+) cpu ([\d.]+)", text).groups()) for text in (sending.stdout, received)
        )
        print(
            f"  asked {rate:>6}/s: sent {sent / duration:8.0f}/s, lost {sent - got:7.0f}, "
            f"publisher {100 * sender / duration:5.1f} %, subscriber {100 * receiver / duration:5.1f} % of a core"
        )
