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
        samples: independent ones in the window, one at least.
        stated: standard deviation of a mean by the stated noise, rad.
        variance: of a tick, rad²; infinite where none is stated.
    """

    number: int
    theta: float
    reading: tuple[float, float]
    surplus: tuple[float, float]
    samples: float
    stated: float
    variance: float


def bounds_of(counts: Sequence[int], each: float) -> list[float]:
    """Bounds on the mean of so many squares: three times among windows, then within them, with `each` independent."""
    # neighbours share windows, which leaves about half of them independent
    among = [0.5 * count for count in counts[:3]]
    # as many independent ones as there are samples, of which a straight line takes two
    return [chi_square_bound(freedom) for freedom in (*among, *(max(1, round(each * count)) for count in counts[3:]))]


def mean_of(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Mean of pairs."""
    return sum(x for x, _ in pairs) / len(pairs), sum(y for _, y in pairs) / len(pairs)
