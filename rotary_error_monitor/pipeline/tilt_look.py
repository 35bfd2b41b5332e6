"""What a window shows of the tilt, and what chance makes of many of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rotary_error_monitor.metrology.agreement import chi_square_bound


class Look(NamedTuple):
    """What a window shows of the tilt.

    Attributes:
        number: of the window.
        theta: mean rotation, rad.
        reading, surplus: what is read, and what of it is not described, rad.
        samples: independent ones in the window; of one reading in some windows a part of one.
        apart: windows from one that shows a reading of its own to the next.
        stated: standard deviation of a mean by the stated noise, rad.
        variance: of a tick, rad²; infinite where none is stated.
    """

    number: int
    theta: float
    reading: tuple[float, float]
    surplus: tuple[float, float]
    samples: float
    apart: int
    stated: float
    variance: float


def bounds_of(counts: Sequence[int], spans: int, each: float, apart: int) -> list[float]:
    """Bounds on means of so many squares: the first and those of so many `spans` among windows, the others within.

    Within windows, of which a straight line takes two, there are `each` independent readings; among them only one of
    so many that are `apart` shows a reading of its own, and neighbours share windows, which leaves about half.
    """
    among = [0.5 * count / apart for count in counts[: 1 + spans]]
    within = [max(1, round(each * count)) for count in counts[1 + spans :]]
    return [chi_square_bound(freedom) for freedom in (*among, *within)]


def mean_of(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Mean of pairs."""
    return sum(x for x, _ in pairs) / len(pairs), sum(y for _, y in pairs) / len(pairs)
