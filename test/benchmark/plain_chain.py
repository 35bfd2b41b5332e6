"""The exact offset as one would write it in Python: pose by pose, lists of lists, straight from the description."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent

Matrix = list[list[float]]
Vector = Sequence[float]


def product(a: Matrix, b: Matrix) -> Matrix:
    """(4, 4) product of transforms."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def transform(shift: Vector, rotation: Vector) -> Matrix:
    """(4, 4) of a shift and a rotation vector (Rodrigues)."""
    angle = math.sqrt(sum(v * v for v in rotation))
    x, y, z = (v / angle for v in rotation) if angle else (0.0, 0.0, 1.0)
    s, c, d = math.sin(angle), math.cos(angle), 2.0 * math.sin(0.5 * angle) ** 2
    return [
        [c + x * x * d, x * y * d - z * s, x * z * d + y * s, shift[0]],
        [y * x * d + z * s, c + y * y * d, y * z * d - x * s, shift[1]],
        [z * x * d - y * s, z * y * d + x * s, c + z * z * d, shift[2]],
        [0.0, 0.0, 0.0, 1.0],
    ]


def inverse(t: Matrix) -> Matrix:
    """(4, 4) inverse of a transform."""
    turned = [[t[j][i] for j in range(3)] for i in range(3)]
    back = [-sum(turned[i][k] * t[k][3] for k in range(3)) for i in range(3)]
    return [[*turned[0], back[0]], [*turned[1], back[1]], [*turned[2], back[2]], [0.0, 0.0, 0.0, 1.0]]


def component(error: ErrorComponent, position: float, travel: tuple[float, float]) -> float:
    """One error component, the mean of both directions."""
    u = (2.0 * position - travel[0] - travel[1]) / (travel[1] - travel[0])
    value = sum(c * u**k for k, c in enumerate(error.poly))
    value += sum(w.cos * math.cos(w.order * position) + w.sin * math.sin(w.order * position) for w in error.harmonic)
    if error.table is not None:
        places = error.table.positions
        at = min(max(position, places[0]), places[-1])
        k = min(max(sum(place <= at for place in places), 1), len(places) - 1)
        part = (at - places[k - 1]) / (places[k] - places[k - 1])
        for values in (error.table.forward, error.table.backward):
            value += 0.5 * (values[k - 1] + part * (values[k] - values[k - 1]))
    return value


def place(machine: MachineDescription, name: str, positions: Mapping[str, float], actual: bool) -> Matrix:
    """(4, 4) of a body in the base."""
    standing = transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    bodies = {body.name: body for body in machine.bodies}
    while name in bodies:
        body = bodies[name]
        own = _transform_of(body.pose)
        if actual:
            own = product(own, _transform_of(body.location_error))
        if body.axis is not None:
            axis, q = machine.axis(body.axis), positions[body.axis]
            moved, still = [q * d for d in axis.direction], (0.0, 0.0, 0.0)
            own = product(own, transform(moved, still) if axis.kind == "linear" else transform(still, moved))
            if actual:
                found = [machine.errors.get(f"E{d}{axis.letter}", ErrorComponent()) for d in DIRECTIONS]
                small = [component(error, q, axis.travel) for error in found]
                own = product(own, transform(small[:3], small[3:]))
        standing = product(own, standing)
        name = body.parent
    return standing


def offset(machine: MachineDescription, positions: Vector) -> list[float]:
    """Shift (m) and rotation vector (rad) of the tool in the workpiece against the ideal machine's."""
    q = dict(zip(machine.letters, positions, strict=True))
    is_, should = (
        product(inverse(place(machine, machine.workpiece, q, actual)), place(machine, machine.tool, q, actual))
        for actual in (True, False)
    )
    r = product(_rotation_of(is_), inverse(_rotation_of(should)))
    v = [0.5 * (r[2][1] - r[1][2]), 0.5 * (r[0][2] - r[2][0]), 0.5 * (r[1][0] - r[0][1])]
    sine, cosine = math.hypot(*v), 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0)
    scale = math.atan2(sine, cosine) / sine if sine > 1e-8 else 1.0
    return [*(is_[i][3] - should[i][3] for i in range(3)), *(scale * each for each in v)]


def _transform_of(displacement: Displacement) -> Matrix:
    return transform(displacement.shift, displacement.rotation)


def _rotation_of(t: Matrix) -> Matrix:
    return [[*row[:3], 0.0] for row in t[:3]] + [[0.0, 0.0, 0.0, 1.0]]
