"""Two machines in one domain, each cell in a namespace: neither hears the other, whatever becomes of it."""

from __future__ import annotations

import numpy as np

from faults.documenting import Row, shows
from faults.live.cell import NAMES, RIGHT_WITHIN, LiveCell
from faults.live.other_programs import check


@shows(
    Row(
        group="network",
        fault="two machines in one cell, told apart by namespace (`--ros-args -r __ns:=/left`), and one of them ends",
        seen="diagnostics of a node bear its namespace; `/diagnostics` is the one topic that all share",
        done="every topic and service of a cell lies in its namespace",
        published="by each what is right of its own machine",
        recovery="not needed: the other does not notice",
    )
)
def test_two_machines_do_not_hear_one_another(live, seed):
    left = LiveCell(live.cell, seed + 1, "/left")
    left.mock["block_period"] = 0.05  # sixteen processes are many for the cores of some computers
    begin_ns = live.clock()
    left.start_all()
    up_ns = live.clock()
    live.let_run(2.0)
    live.judge(begin_ns)
    left.judge(up_ns)
    now = np.array([up_ns])
    assert abs(live.truth.offset(now) - left.truth.offset(now)).max() > 1e-7, "the machines differ"
    said = {each.name for each in live.heard.said if each.stamp_ns > up_ns and each.level > 0}
    assert not {name for name in said if "publishers of" in name}
    states = {f"left.{name}: state" for name in NAMES}
    live.wait(lambda: states <= {each.name for each in live.heard.said}, "diagnostics of every node on the left")
    for name in NAMES:
        left.kill(name)
    with live.lost() as lost:
        end_ns = live.clock()
        check("all well", live.wait_until_all_is_well(end_ns) - end_ns, RIGHT_WITHIN, lost())
    live.let_run(1.0)
    live.judge(begin_ns)
    assert not [each for each in live.heard.said if not each.name.startswith("left.") and "left" in each.message]
