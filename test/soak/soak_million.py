"""The long soak: a million blocks through estimator and compensator, 10,000 turns, and nodes on simulated time.

make soak
"""

from __future__ import annotations

from rotary_error_monitor.testing import Cell

from .endurance import STREAMS, TURN, check_flat, endure, live

MILLION = 1_000_000
LIVE = 240_000
"""Blocks that go through nodes: three minutes of the cell. The middleware takes the first half to make room."""


def test_a_million_blocks():
    found = endure(-(-MILLION // len(STREAMS)), 9_000 * TURN)
    print(
        f"\n{found.blocks} blocks, {found.estimates} estimates, {found.offsets} offsets, {found.turns:.0f} turns, "
        f"at most {found.worst:.3f} counts off, {check_flat(found.memory):.2%} of memory more"
    )
    assert found.blocks >= MILLION and found.turns > 10_000
    assert found.estimates >= found.blocks / len(STREAMS) * 5 - 5
    assert found.worst < 0.5


def test_nodes_on_simulated_time():
    with Cell() as cell:
        found = live(cell, LIVE // len(STREAMS))
    growth = {name: f"{check_flat(memory, since=0.5):.2%}" for name, memory in found.memory.items()}
    print(f"\n{found.blocks} blocks, {found.estimates} estimates, {found.worst:.3f} counts off, memory more: {growth}")
    assert found.estimates >= 0.99 * found.blocks / len(STREAMS) * 5
    assert found.worst < 0.5
