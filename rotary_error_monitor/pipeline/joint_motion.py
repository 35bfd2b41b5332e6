"""Positions and velocities of a joint state as drivers publish it: all that most nodes need of the axes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotary_error_monitor.errors import InputError, excerpt


def joint_motion_of(
    names: Sequence[str], positions: Sequence[float], velocities: Sequence[float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Positions (m, rad) and velocities (m/s, rad/s) by joint; without velocities the second is empty.

    Raises:
        InputError: there is not one position for each name, a name stands twice, or a number is not finite.
    """
    if len(positions) != len(names) or len(velocities) not in (0, len(names)):
        raise InputError(
            f"a joint state holds {len(names)} names, {len(positions)} positions, {len(velocities)} velocities; "
            "expected as many of each (velocities may be left out)"
        )
    positions, velocities = [float(each) for each in positions], [float(each) for each in velocities]
    if len(set(names)) != len(names):
        raise InputError(f"a joint state holds the names {excerpt(', '.join(names))}; each may stand once")
    if not all(map(math.isfinite, [*positions, *velocities])):
        numbers = f"positions {excerpt(positions)}, velocities {excerpt(velocities)}"
        raise InputError(f"a joint state holds {numbers}; all must be finite")
    return dict(zip(names, positions, strict=True)), dict(zip(names, velocities, strict=False))
