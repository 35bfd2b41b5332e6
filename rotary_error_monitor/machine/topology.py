"""The tree of bodies: low-order body array, and the way from the base to tool and workpiece."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Body


def low_order_array(machine: MachineDescription) -> NDArray[np.int64]:
    """(k, n) low-order body array of the base, body 0, and the n - 1 bodies in the order of the description.

    Row k holds the body k steps below each body on the way to the base; the last row is all base. Pan et al. 2013,
    Equations 2-4: `L^0(j) = j`, `L^k(j) = L(L^(k-1)(j))`. Their Table 1 prints the numbers of the bodies one column
    off: its row L^0 is what the columns are, so it holds for the bodies 0-9.
    """
    numbers = {body.name: number for number, body in enumerate(machine.bodies, start=1)}
    below = np.array([0, *(numbers.get(body.parent, 0) for body in machine.bodies)], dtype=np.int64)
    rows = [np.arange(len(below), dtype=np.int64)]
    while rows[-1].any():
        rows.append(below[rows[-1]])
    return np.stack(rows)


def branches(machine: MachineDescription) -> tuple[tuple[Body, ...], tuple[Body, ...]]:
    """Bodies from where the ways to tool and workpiece part: (branch of the tool, branch of the workpiece).

    What carries both moves neither against the other and is left out.
    """
    tool, workpiece = way(machine, machine.tool), way(machine, machine.workpiece)
    common = 0
    while common < min(len(tool), len(workpiece)) and tool[common] is workpiece[common]:
        common += 1
    return tuple(tool[common:]), tuple(workpiece[common:])


def way(machine: MachineDescription, name: str) -> list[Body]:
    """Bodies from the one that stands on the base to that of this name."""
    bodies = {body.name: body for body in machine.bodies}
    found: list[Body] = []
    while name in bodies:
        found.append(bodies[name])
        name = bodies[name].parent
    return found[::-1]
