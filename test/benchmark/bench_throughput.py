"""How much the cell carries, beside one message per sample. Figures are printed, none is a bound."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.messages import Decoder
from rotary_error_monitor.testing import Cell, NodeProcess
from rotary_error_monitor.testing.domains import own_domain

DURATION = float(os.environ.get("BENCH_SECONDS", "60"))
PER_SAMPLE = Path(__file__).with_name("per_sample.py")


def cpu_seconds(process: NodeProcess) -> float:
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("rate", [10_000.0, 50_000.0])
def test_blocks_from_heads_to_tool_offset(rate, tmp_path):
    """Four heads and autocollimator in processes of their own, blocks of 5 ms, through to the recorded tool offset."""
    bag = tmp_path / "bag"
    with Cell() as cell:
        mock = {"mock.seed": 1, "mock.epoch": time.time_ns(), "rate": rate, "block_period": 0.005}
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
        cell.spin_for(3)
        begin, begin_ns = [cpu_seconds(process) for process in processes], time.time_ns()
        cell.spin_for(DURATION)
        used = [(cpu_seconds(p) - b) / DURATION for p, b in zip(processes, begin, strict=True)]
        end_ns = time.time_ns()
    print(f"\n{rate:.0f} samples a second from each of 5 instruments, blocks of 5 ms, {DURATION:.0f} s")
    missing = lost(BagReader(bag), begin_ns, end_ns)
    ticks = {name: missing.pop(name) for name in ("error_motion", "tool_offset")}
    print("  samples lost: " + ", ".join(f"{k} {v}" for k, v in missing.items()))
    print(f"  of {round((end_ns - begin_ns) / 1e6)} ticks {ticks['error_motion']} have no estimate")
    print(f"  {ticks['tool_offset']} no offset: held where encoder and joint states part, as the mock stage reverses")
    ages = offset_ages(BagReader(bag), begin_ns, end_ns)
    print(f"  age of the newest offset of a block at the recorder: p50 {np.percentile(ages, 50) * 1e3:.1f} ms, "
          f"p99 {np.percentile(ages, 99) * 1e3:.1f} ms")  # fmt: skip
    for process, share in zip(processes, used, strict=True):
        print(f"  {process.name:<16} {100 * share:5.1f} % of a core")
    print(f"  {'all':<16} {100 * sum(used):5.1f} % of a core")


def lost(reader, begin_ns, end_ns):
    """Samples missing in the bag, by stream."""
    missing = {}
    for name, topic in reader.topics.items():
        if not name.endswith("/samples") or not topic.count or "temperature" in name or "lvdt" in name:
            continue
        times = np.concatenate([block.times_ns for block in reader.read_blocks([name])[name]])
        steps = np.diff(times[(times >= begin_ns) & (times < end_ns)])
        missing[name.split("/")[2]] = int(np.rint(steps / np.median(steps) - 1).sum())
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
