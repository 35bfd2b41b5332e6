"""What analyses of any length find, of arrays that are in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.comparison import ArrayMotion, ArraySamples, Stay, stays_of
from rotary_error_monitor.analysis.health import FallOut, FallOuts
from rotary_error_monitor.analysis.positions import Positioning, positioning_of
from rotary_error_monitor.analysis.rotation import ArrayCourse
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.metrology.error_motion import ErrorMotion


def compare_stays(
    stamp_ns: Times, motion: ErrorMotion, lvdt: RadialReference, times_ns: Times, radial: Array
) -> tuple[Stay, ...]:
    """Comparison at each height, of what is in memory.

    Args:
        stamp_ns: (n,) times of the estimate.
        motion: error motion at these times.
        lvdt: as described.
        times_ns: (k,) times of the LVDT's samples.
        radial: (k, 2) the samples, m.
    """
    if len(stamp_ns) < 2 or len(times_ns) < 2:
        return ()
    estimates = ArrayMotion(stamp_ns, motion.theta, motion)
    return stays_of(estimates, int(np.diff(stamp_ns).min()), lvdt, ArraySamples(times_ns, radial))


def fall_outs(
    stamp_ns: Times, streams: NDArray[np.int64], bits: Mapping[str, int], period_ns: int
) -> tuple[FallOut, ...]:
    """What `FallOuts` finds in estimates that are in memory.

    Args:
        stamp_ns: (n,) timestamps (ns) of the estimates.
        streams: (n,) bit mask of what was used.
        bits: bit of each instrument.
        period_ns: distance of two estimates, ns.
    """
    found = FallOuts(bits, period_ns)
    found.add(stamp_ns, streams)
    return found.found


@dataclass(frozen=True)
class ArrayPositions(ArrayCourse):
    """The same in memory; `ecc` (n,) is rotation less command, rad."""

    ecc: Array

    def deviation(self, first: int, last: int) -> Array:
        """As `LongPositions.deviation`."""
        return self.ecc[first:last]


def estimate_stops(stamp_ns: NDArray[np.int64], theta: Array, ecc: Array) -> Positioning:
    """Positioning by the stops of a recording that is in memory.

    Args:
        stamp_ns: (n,) timestamps (ns).
        theta: (n,) rotation, rad.
        ecc: (n,) rotation less command, rad, NaN where not observable.
    """
    return positioning_of(ArrayPositions(stamp_ns, theta, ecc))
