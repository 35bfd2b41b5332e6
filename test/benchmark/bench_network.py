"""What the cell of a stage sends over a network, and takes of its computers: real processes on two computers. Printed.

The computers are network namespaces at one switch. Either the recorder alone is on the other one, as where one computer
records for many, or the instruments are, as where each machine has its own small computer and one estimates for all.
Bytes are those that the network devices count; to each frame come 24 bytes on the wire that no counter sees.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor

import pytest
from benchmark.two_computers import Measured, dies_with_its_parent, measured

from .switched_hosts import why_not

SECONDS = float(os.environ.get("BENCH_SECONDS", "10"))
RATES = tuple(map(float, os.environ.get("BENCH_NETWORK_RATES", "10000,50000").split(",")))
INSTRUMENTS = ("encoder_head", "autocollimator", "lvdt", "mock_controller")
FAR: Mapping[str, tuple[str, ...]] = {
    "the recorder on another computer": (*INSTRUMENTS, "error_estimator", "compensation"),
    "the instruments on another computer": INSTRUMENTS,
}
"""What is on the far computer; the rest is on the near one, with this process, which hears diagnostics alone."""

PER_FRAME = 24
"""Bytes of an Ethernet frame that a device does not count: preamble 8, checksum 4, gap 12 (IEEE 802.3)."""

UTILISED = 0.5
"""Part of a network that is reckoned with: blocks of all stages leave together, and what is lost is sent again."""

NETWORKS = {"1 Gbit/s": 1e9, "10 Gbit/s": 1e10}
pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")


def described(rate: float, where: str, seen: Measured) -> Iterator[str]:
    """Lines about it."""
    frames = (seen.far.sent_frames + seen.far.received_frames) / seen.seconds
    size = (seen.far.sent_bytes + seen.far.received_bytes) / seen.seconds + PER_FRAME * frames
    ways = (seen.far.sent_bytes, seen.far.sent_frames), (seen.far.received_bytes, seen.far.received_frames)
    one_way = max(counted + PER_FRAME * number for counted, number in ways) / seen.seconds
    inside = (seen.far.inside_bytes + seen.near.inside_bytes) / seen.seconds
    yield f"{rate:.0f} samples a second of each instrument, blocks of 5 ms; {where}, {seen.seconds:.0f} s"
    yield (
        f"  messages: {seen.messages / seen.seconds:.0f} a second on {seen.topics} topics, "
        f"{seen.message_bytes / seen.seconds / 1e6:.2f} MB/s serialised; lost {seen.lost}"
    )
    yield (
        f"  network: {size * 8e-6:.1f} Mbit/s both ways, {one_way * 8e-6:.1f} Mbit/s the busier way, {frames:.0f} "
        f"frames a second; inside of the computers {inside * 8e-6:.1f} Mbit/s"
    )
    for name, speed in NETWORKS.items():
        yield f"  {name}, {UTILISED:.0%} of it: {int(UTILISED * speed / (8 * one_way))} stages"
    for name, share in seen.used.items():
        yield f"    {name:<16} {100 * share:5.1f} % of a core, {seen.held[name]:4.0f} MB"
    yield f"    {'all':<16} {100 * sum(seen.used.values()):5.1f} % of a core, {sum(seen.held.values()):4.0f} MB"


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("where", FAR)
def test_what_a_cell_sends_over_a_network(where, rate, tmp_path, capsys):
    fresh = multiprocessing.get_context("spawn")  # it looks once which networks there are
    with ProcessPoolExecutor(1, mp_context=fresh, initializer=dies_with_its_parent) as process:
        seen = process.submit(measured, FAR[where], rate, SECONDS, tmp_path / "bag").result()
    with capsys.disabled():
        print()
        for line in described(rate, where, seen):
            print(line)
