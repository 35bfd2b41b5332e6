"""What a recording between centres says of ring and mirror as measured curves, and the files that hold them.

A curve is the sum of all orders that the recording tells, whether they stand out or not: so its uncertainty, from the
covariance of all coefficients, holds at each angle for the whole curve.
"""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.table_files import COLUMNS, FLATNESS, GRADUATION
from rotary_error_monitor.metrology.mirror_assembly import MirrorAssembly
from rotary_error_monitor.metrology.periodic_curves import TO_A_WAVE, interpolation_bound
from rotary_error_monitor.metrology.ring_assembly import RingAssembly
from rotary_error_monitor.units import ARCSEC

DEGREES = 360
"""Angles of a table are a multiple of these, so that they are easy to read."""

DIGITS = 8
"""Hexadecimal digits of its content in the name of a file: another curve never has the name of an earlier one."""


MOST_NAMED = 8
"""Orders that a line names, the lowest first."""


@dataclass(frozen=True)
class MeasuredCurve:
    """A curve over a turn.

    Attributes:
        name: what it is of, as in the names of its columns.
        angles: (n,) rad, in even steps.
        values: (n, c) rad.
        std: (n,) standard uncertainty of a value, interpolation included, rad.
        bound: how far interpolation may miss, rad.
        orders: that are in it.
    """

    name: str
    angles: Array
    values: Array
    std: Array
    bound: float
    orders: tuple[int, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of values, without their units."""
        return tuple(COLUMNS[GRADUATION if self.values.shape[1] == 1 else FLATNESS])

    def file_name(self, stem: str) -> str:
        """Of its file beside a stage file of that stem."""
        return f"{stem}_{self.name}_{hashlib.sha256(self.rows()).hexdigest()[:DIGITS]}.csv"

    def content(self, source: str, digest: str, day: date) -> bytes:
        """Its file, which says where it is from."""
        head = f"# {self.name}: `calibrate assembly` of {day.isoformat()} from {source}, SHA-256 {digest}\n"
        return f"{head}# {shown_orders(self.orders)}\n".encode() + self.rows()

    def rows(self) -> bytes:
        """Header and rows of its file; angles with all digits, values to a part in a million."""
        text = io.StringIO()
        text.write(",".join(["angle_deg", *(f"{name}_arcsec" for name in self.columns), "uncertainty_arcsec"]) + "\n")
        for angle, values, std in zip(np.degrees(self.angles), self.values * ARCSEC, self.std * ARCSEC, strict=True):
            text.write(",".join([f"{angle:.9g}", *(f"{value:.6g}" for value in values), f"{std:.3g}"]) + "\n")
        return text.getvalue().encode()


def ring_curve(ring: RingAssembly) -> MeasuredCurve:
    """The graduation over the ring, eccentricity and what was kept not in it."""
    orders = [row.order for row in ring.graduation]
    angles = _angles(orders)
    design = _waves(orders, angles)
    found = np.array([[row.cos, row.sin] for row in ring.graduation]).ravel()
    doubts = np.square(ring.graduation_std).ravel() - np.diag(ring.graduation_covariance)
    spread = ring.graduation_covariance + np.diag(np.maximum(doubts, 0.0))
    bound = interpolation_bound(orders, np.hypot(found[::2], found[1::2]).tolist(), angles[1])
    return MeasuredCurve(
        "graduation", angles, (design @ found)[:, None], _std([design], spread, bound), bound, tuple(orders)
    )


def mirror_curve(mirror: MirrorAssembly) -> MeasuredCurve:
    """What a mirror shows over a turn, its tilt and what was kept not in it."""
    orders = [row.order for row in mirror.flatness]
    angles = _angles(orders)
    waves = _waves(orders, angles).reshape(len(angles), -1, 2)
    nothing = np.zeros_like(waves)
    x, y = (np.concatenate(pair, axis=2).reshape(len(angles), -1) for pair in ((waves, nothing), (nothing, waves)))
    found = np.array([[*row.x, *row.y] for row in mirror.flatness]).ravel()
    own = np.diag(mirror.flatness_covariance).reshape(-1, 4).max(axis=1, initial=0.0)
    doubts = np.maximum(np.square(mirror.flatness_std) - own, 0.0)
    spread = mirror.flatness_covariance + np.diag(np.repeat(doubts, 4))
    sizes = np.linalg.norm(found.reshape(-1, 4), axis=1)
    bound = interpolation_bound(orders, sizes.tolist(), angles[1])
    values = np.stack([x @ found, y @ found], axis=1)
    return MeasuredCurve("flatness", angles, values, _std([x, y], spread, bound), bound, tuple(orders))


def written_names(curves: Sequence[MeasuredCurve], output: Path) -> dict[str, Path]:
    """File of each curve beside the stage file that names it, by what the curve is of."""
    return {curve.name: output.with_name(curve.file_name(output.stem)) for curve in curves}


def shown_orders(orders: Sequence[int]) -> str:
    """Orders in words: from the lowest to the highest, and the first of those between them that are left out."""
    low, high = min(orders), max(orders)
    left = sorted(set(range(low, high + 1)) - set(orders))
    named = ", ".join(map(str, left[:MOST_NAMED])) + (", …" if len(left) > MOST_NAMED else "")
    return f"orders {low} to {high}" + (f" without {named}" if left else "")


def _angles(orders: Sequence[int]) -> Array:
    """Even steps round the turn, `TO_A_WAVE` to the shortest wave."""
    count = DEGREES * max(1, math.ceil(TO_A_WAVE * max(orders, default=1) / DEGREES))
    return np.asarray(np.arange(count) * (2 * np.pi / count), np.float64)


def _waves(orders: Sequence[int], angles: Array) -> Array:
    """(n, 2 k) cosine and sine of each order."""
    phase = angles[:, None] * np.asarray(orders, np.float64)
    return np.asarray(np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(angles), -1))


def _std(designs: Sequence[Array], spread: Array, bound: float) -> Array:
    """(n,) of one value, root mean square over the components; interpolation errs within a bound (JCGM 100, 4.3.7)."""
    squares = [np.einsum("ij,jk,ik->i", design, spread, design) for design in designs]
    return np.asarray(np.sqrt(np.maximum(np.mean(squares, axis=0), 0.0) + bound**2 / 3))
