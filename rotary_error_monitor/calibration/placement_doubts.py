"""Whether readings fit another placement of the mirror far better than the one that is stated.

Overlaps see the mirror twice, at two places of it: they tell a profile from its negative, from one that lies end for
end, and a placement that begins inside the mirror from one that begins at its end. Its curvature alone they do not see.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.reference_mirror import PlacementReadings, ReferenceMirror
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.metrology.splicing import SplicedProfile, splice_segments

STEPS = 4
"""Places within the room that a placement has on the mirror which are looked at."""

MOST_NODES = 1000
"""Of the splines that are compared."""

LEAST_ROOM = 0.02
"""Part of the mirror that a placement leaves, from which it may lie elsewhere."""


def placement_doubts(
    segments: Sequence[PlacementReadings], mirror: ReferenceMirror | None, spliced: SplicedProfile
) -> tuple[str, ...]:
    """Another placement that makes the readings a thousand times as probable for each that is tried, in words.

    `spliced` is what they make as stated.
    """
    if mirror is None or len(segments) < 2:
        return ()
    # the same nodes for all, and not so near that they follow what does not fit
    steps = [float(np.median(np.diff(np.sort(each.positions)))) for each in segments]
    spacing = max(2 * max(steps), float(np.ptp(spliced.positions)) / MOST_NODES)
    tried = [(words, _square(placed, other, spacing)) for words, placed, other in _others(segments, mirror)]
    stated = _square(segments, mirror, spacing)
    if not tried or not math.isfinite(stated):
        return ()
    words, best = min(tried, key=lambda pair: pair[1])
    if stated - best < 2 * math.log(len(tried) / FALSE_ALARM):
        return ()
    return (
        f"the readings fit far better {words} (their squares over noise add up to {best:.0f} instead of {stated:.0f})",
    )


def _others(
    segments: Sequence[PlacementReadings], mirror: ReferenceMirror
) -> Iterator[tuple[str, Sequence[PlacementReadings], ReferenceMirror]]:
    if mirror.profile is not None:
        turned = mirror.profile[::-1] * [-1.0, 1.0] + [mirror.length, 0.0]
        inside = turned[0, 0] <= 1e-9 and turned[-1, 0] >= mirror.length - 1e-9
        for words, profile in (
            ("with the mirror's profile negated: do heights add to the readings?", mirror.profile * [1.0, -1.0]),
            *([("with the mirror's profile end for end", turned)] if inside else []),
            *([("with the profile negated and end for end", turned * [1.0, -1.0])] if inside else []),
        ):
            yield words, segments, replace(mirror, profile=profile)
    for number, segment in enumerate(segments):
        start = float(segment.positions.min()) if segment.start is None else segment.start
        room = mirror.length - (float(segment.positions.max()) - start)
        if room > LEAST_ROOM * mirror.length:
            for part in np.linspace(0, room, STEPS + 1)[1:]:
                moved = [replace(segment, start=start - part) if each is segment else each for each in segments]
                yield f"where segment {number + 1} begins {part * 1e3:.3g} mm inside the mirror", moved, mirror


def _square(segments: Sequence[PlacementReadings], mirror: ReferenceMirror, spacing: float) -> float:
    """What is left of the readings there, in squares; infinite where they cannot lie so."""
    try:
        return splice_segments(segments, mirror, spacing=spacing).square
    except InputError:
        return math.inf
