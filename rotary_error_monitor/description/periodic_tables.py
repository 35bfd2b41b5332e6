"""Curves over a turn as they were measured: a value at each of many angles, in place of a sum of harmonics.

Between the angles a curve is the periodic cubic spline through the values. Of a curve f it misses at most
5/384 h⁴ max|f''''|, h the largest gap between angles (Hall and Meyer 1976): of a wave of order k 5/384 (k h)⁴ of its
amplitude, which is 0.5 % where eight angles stand to a wave.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Tilt
from rotary_error_monitor.description.sections import Place, Section
from rotary_error_monitor.units import TURN

FEWEST = 8
"""Angles of a table: with fewer not even a wave of order 1 is told to 0.5 %."""

MOST = 4096
"""Angles of a table: more than 8 to each wave of the highest order that a calibration looks for."""

WHOLE = 1e-6
"""How near to a whole turn after the first angle the last one stands that closes the table, rad: 0.2 arcsec."""

SEAM = 2.0
"""Times the largest gap between angles that is left from the last angle to the first."""

AGREE = 3.0
"""Standard uncertainties by which two readings of one place may differ."""

_DEGREES = "rising angles in rad over one turn, 0 to 6.28, not degrees (a CSV file may have them as angle_deg)"
Angles = Annotated[
    tuple[Annotated[float, Expected(_DEGREES, -TURN - WHOLE, TURN + WHOLE)], ...], Expected(count=(FEWEST, MOST + 1))
]
Values = Annotated[
    tuple[Annotated[Tilt, Expected("an angle in rad of at most 10 mrad, not in arcsec")], ...],
    Expected("a value in rad at each angle", count=(FEWEST, MOST + 1)),
]
Doubts = Annotated[
    tuple[Annotated[float, Expected("a standard uncertainty in rad, from 0 to 1 mrad", 0, 0.001)], ...],
    Expected("standard uncertainty in rad of the value at each angle", count=(FEWEST, MOST + 1)),
]


@dataclass(frozen=True, kw_only=True)
class PeriodicTable(Section, ABC):
    """What tables of one value and of two have in common.

    Attributes:
        angles: rising, rad, over one turn; the first may stand again at the end, a turn later, to close the table.
        uncertainties: standard uncertainty of each value, rad; a table without them is taken to be exact.
    """

    angles: Angles
    uncertainties: Doubts = ()

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # of thousands of numbers, which are the same at each look
        return hash((self.angles, self.uncertainties, *self.columns.values()))

    @property
    @abstractmethod
    def columns(self) -> dict[str, tuple[float, ...]]:
        """Values at the angles by what they are called."""

    @property
    def is_closed(self) -> bool:
        """Whether the first angle stands again at the end."""
        return self.angles[-1] - self.angles[0] >= TURN - WHOLE

    @cached_property
    def knots(self) -> tuple[Array, Array]:
        """(n + 1,) rising angles of a whole turn, rad, and (n + 1, c) values, the last equal to the first.

        A first angle that stands again at the end has the mean of both values.
        """
        angles, values = np.array(self.angles), np.array(list(self.columns.values())).T
        if self.is_closed:
            angles, seam = angles[:-1], (values[0] + values[-1]) / 2
            values = np.concatenate([seam[None], values[1:-1]])
        return np.append(angles, angles[0] + TURN), np.concatenate([values, values[:1]])

    @property
    def uncertainty(self) -> float:
        """Root mean square over the turn of the standard uncertainty of a value, rad; 0 where none is stated."""
        if not self.uncertainties:
            return 0.0
        squares = np.square(self.uncertainties[: len(self.knots[0]) - 1])
        around = np.append(squares, squares[0])
        gaps = np.diff(self.knots[0])
        return math.sqrt(float(((around[1:] + around[:-1]) / 2 * gaps).sum()) / TURN)

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """Not a value for each angle, angles that do not rise, and a table that does not close over the turn."""
        for name, column in {**self.columns, "uncertainties": self.uncertainties}.items():
            if len(column) != len(self.angles) and (column or name != "uncertainties"):
                yield (name,), f"{len(column)} values at {len(self.angles)} angles; expected one for each"
                return
        for at, problem in problems(self.angles, self.columns, self.uncertainties):
            yield ("angles", at), problem


@dataclass(frozen=True, kw_only=True)
class AngularTable(PeriodicTable):
    """A measured curve of one value over the angle, such as the error of a graduation over the ring.

    Attributes:
        values: at each angle, rad.
    """

    values: Values

    __hash__ = PeriodicTable.__hash__

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """The one column."""
        return {"values": self.values}


@dataclass(frozen=True, kw_only=True)
class PlanarTable(PeriodicTable):
    """A measured curve of a plane vector over the rotation, such as what a mirror shows that is not flat.

    Attributes:
        x: along x at each angle, rad.
        y: along y, rad; both are as uncertain as `uncertainties` says.
    """

    x: Values
    y: Values

    __hash__ = PeriodicTable.__hash__

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """Both columns."""
        return {"x": self.x, "y": self.y}


def problems(
    angles: Sequence[float], columns: dict[str, tuple[float, ...]], uncertainties: Sequence[float]
) -> Iterator[tuple[int, str]]:
    """Numbers of the angles, rad, at which a table is wrong, and why.

    The lengths of the columns are right.
    """
    for at, (before, after) in enumerate(itertools.pairwise(angles), start=1):
        if after <= before:
            what = "stands twice" if after == before else f"comes after {_shown(before)}"
            yield at, f"the angle {_shown(after)} {what}; expected rising angles, each once"
            return
    last, covered = len(angles) - 1, angles[-1] - angles[0]
    if covered > TURN + WHOLE:
        yield last, f"the angles cover {_shown(covered)}, more than a turn; give the mean over the turns"
        return
    closed = covered >= TURN - WHOLE
    gaps = [after - before for before, after in itertools.pairwise(angles)]
    widest = max(gaps)
    if not closed and TURN - covered > SEAM * widest + WHOLE:
        # 6.28 degrees are hardly ever measured by themselves
        hint = "; are they rad under the name of degrees?" if abs(math.degrees(covered) / TURN - 1) < 0.05 else ""
        yield (
            last,
            f"the table does not close over the turn: it ends at {_shown(angles[-1])} and begins at "
            f"{_shown(angles[0])}, with at most {_shown(widest)} between neighbours; measure the whole turn{hint}",
        )
    elif widest > TURN / FEWEST + WHOLE:
        at = gaps.index(widest) + 1
        yield at, f"no angle within {_shown(widest)} before {_shown(angles[at])}; expected {FEWEST} a turn at least"
    elif closed:
        yield from _seam(columns, uncertainties, last)


def _seam(
    columns: dict[str, tuple[float, ...]], uncertainties: Sequence[float], last: int
) -> Iterator[tuple[int, str]]:
    """Values a turn after the first that differ by more than they are uncertain, or than any neighbours do."""
    for name, column in columns.items():
        jump = abs(column[-1] - column[0])
        if uncertainties:
            allowed = AGREE * math.hypot(uncertainties[0], uncertainties[-1])
        else:
            allowed = max(abs(after - before) for before, after in itertools.pairwise(column))
        if jump > allowed:
            yield (
                last,
                f"the table does not close over the turn: {name} begins at {column[0]:.4g} rad and a turn later is "
                f"{column[-1]:.4g}, {allowed:.2g} apart at most; did it drift, or does it hold more than the curve?",
            )
            return


def _shown(angle: float) -> str:
    return f"{angle:.6g} rad ({math.degrees(angle):.6g}°)"
