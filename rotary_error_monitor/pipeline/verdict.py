"""What is believed of a stage's inputs, and what is doubted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rotary_error_monitor.description.stage_section import Mirror
from rotary_error_monitor.metrology.periodic_curves import steepest
from rotary_error_monitor.pipeline.evidence import EVERYWHERE, Reach

_ROOT = math.sqrt(2.0)

DOUBTS = ("heads", "ring", "autocollimator", "command", "redundancy", "unverified", "unverified_tilt")
"""Bits of the column `doubts`, the lowest first: heads that contradict one another and are not used; a description that
the radial error motion contradicts; autocollimator and command that are not used; redundancy that was lost, so that a
further fault of a head would not show; a description that has not been held against a turn of the ring yet, and against
one of the mirror, or not since the heads may have lost their zero."""


class InputVerdict(NamedTuple):
    """What is believed.

    Attributes:
        excluded: bit mask of the streams that are not used.
        doubts: bit mask, bits as in `DOUBTS`.
        head_scale: by which standard deviations from the heads are multiplied.
        tilt_scale: by which those of the tilt are multiplied.
        tilt, ecc, radial: where what the description does not predict of each can be next: middle (rad, m) and reach.
        most: contradiction of the heads that is borne, in standard deviations.
        settled: bit mask of the heads that have not been silent, or are where they were before; without redundancy a
            tick that rests on others is not verified.
        lag: what a delay of heads and command, or of some heads, against one another makes at the present speed, rad,
            and what heads may have lost alike; without heads the standard uncertainty of the rotation.
        unresolved: what mistakes in the description that are not told from the rotor's motion, and heads that are late,
            make of the radial error motion, m; `unresolved_tilt` of the tilt, rad.
    """

    excluded: int = 0
    doubts: int = 1 << DOUBTS.index("unverified") | 1 << DOUBTS.index("unverified_tilt")
    head_scale: float = 1.0
    tilt_scale: float = 1.0
    lag: float = 0.0
    unresolved: float = 0.0
    unresolved_tilt: float = 0.0
    most: float = math.inf
    settled: int = -1
    tilt: Reach = EVERYWHERE
    ecc: Reach = EVERYWHERE
    radial: Reach = EVERYWHERE

    def has(self, doubt: str) -> bool:
        """Whether there is that doubt."""
        return bool(self.doubts >> DOUBTS.index(doubt) & 1)


class Standing(NamedTuple):
    """What of a verdict changes only where something is doubted, believed again or measured.

    Attributes:
        excluded, doubts, settled: as in `InputVerdict`.
        unresolved: what mistakes in the description make of the radial error motion, m.
        unresolved_tilt: of the tilt, rad.
    """

    excluded: int
    doubts: int
    unresolved: float
    unresolved_tilt: float
    settled: int


class VerdictAssembly:
    """Makes verdicts of what the judges of a stage's inputs say."""

    def __init__(self, radius: float, mirror: Mirror | None) -> None:
        """Of a ring with a radius, m; without heads what is taken off of the `mirror` is as wrong as the rotation."""
        self._radius = radius
        self._figure_slope = 0.0 if mirror is None else slope_of(mirror)

    def verdict(
        self,
        standing: Standing,
        heads: tuple[float, float, float],
        late: float,
        tilt: tuple[float, Reach],
        command: tuple[float, Reach],
        radial: Reach = EVERYWHERE,
    ) -> InputVerdict:
        """Verdict by what stands and by what the judges say of one window, as they give it in `take_in`."""
        excluded, doubts, unresolved, unresolved_tilt, settled = standing
        lag = command[0]
        values = (  # in the order of `InputVerdict`
            excluded,
            doubts,
            heads[0],
            tilt[0],
            math.hypot(lag, late / self._radius, heads[2]),
            # a component may have all of what is late, but only half the square of what turns with the rotor
            math.hypot(unresolved, _ROOT * late),
            math.hypot(unresolved_tilt, _ROOT * self._figure_slope * lag),
            heads[1],
            settled,
            tilt[1],
            command[1],
            radial,
        )
        return InputVerdict._make(values)


def names_of(doubts: int) -> Sequence[str]:
    """Doubts of a mask by name."""
    return [name for bit, name in enumerate(DOUBTS) if doubts >> bit & 1]


def slope_of(mirror: Mirror) -> float:
    """Largest change of what a mirror shows of itself per rotation, rad/rad."""
    flatness = sum(row.order * math.hypot(*row.x, *row.y) for row in mirror.flatness)
    measured = 0.0 if mirror.flatness_table is None else steepest(mirror.flatness_table)
    return math.hypot(*mirror.tilt) + flatness + measured
