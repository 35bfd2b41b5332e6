from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.machine_parts import Body
from rotary_error_monitor.machine.topology import branches, low_order_array

TABLE = Path(__file__).parents[1] / "reference" / "pan2013_table1.yaml"


def test_low_order_array_of_the_published_machine() -> None:
    table = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    np.testing.assert_array_equal(low_order_array(load_machine("pan2013")), table["rows"])
    # The header disagrees with the row L^0, which is the body itself by Equation 3: the misprint.
    assert table["header"] != table["rows"][0]


def test_low_order_array_of_a_branched_tree() -> None:
    machine = load_machine("xyzac_trt")
    # base, trunnion, table, workpiece | saddle, carriage, ram, tool
    np.testing.assert_array_equal(
        low_order_array(machine),
        [
            [0, 1, 2, 3, 4, 5, 6, 7],
            [0, 0, 1, 2, 0, 4, 5, 6],
            [0, 0, 0, 1, 0, 0, 4, 5],
            [0, 0, 0, 0, 0, 0, 0, 4],
            [0, 0, 0, 0, 0, 0, 0, 0],
        ],
    )


def test_branches_run_from_base_to_tool_and_workpiece() -> None:
    tool, workpiece = branches(load_machine("xyzac_trt"))
    assert [body.name for body in tool] == ["saddle", "carriage", "ram", "tool"]
    assert [body.name for body in workpiece] == ["trunnion", "table", "workpiece"]


def test_what_carries_both_is_left_out() -> None:
    machine = load_machine("xyzac_trt")
    bodies = (Body("bed", "base"), *(replace(b, parent=b.parent.replace("base", "bed")) for b in machine.bodies))
    assert branches(replace(machine, bodies=bodies)) == tuple(
        tuple(replace(b, parent=b.parent.replace("base", "bed")) for b in branch) for branch in branches(machine)
    )
