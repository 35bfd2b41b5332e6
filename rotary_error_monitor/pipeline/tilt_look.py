"""What a window shows of the tilt, and what chance makes of many of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.signals.described_path import DescribedPath


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


def missed_by(path: DescribedPath | None, last: Look | None, here: Look) -> float:
    """What interpolation misses at most of a described path, rad, at the speed up to this window; none without a path.

    While a rotor turns by a large part of a turn from one reading to the next, high orders go round by half a one.
    """
    if path is None or last is None or not here.samples > 0.0:
        return 0.0
    return path.missed((here.theta - last.theta) / ((here.number - last.number) * here.samples))


def mean_part(samples: float) -> float:
    """Part of the most that interpolation misses which the mean of a window of so many readings has.

    Between two readings it goes as x (1 - x): of its mean over the middle part r of that is left 1 - r²/3.
    """
    return 1.0 - min(samples, 1.0) ** 2 / 3.0


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
