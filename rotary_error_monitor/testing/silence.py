"""That nothing more comes, which takes a while to see: what was on its way by then may come late."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

_LONGEST_LOOK = 0.1
"""What counts of the time between two looks, s: five of those that a cell takes where nothing happens."""


def silence(received: Sequence[object], duration: float = 0.5) -> Callable[[], bool]:
    """Condition for `Cell.wait_until`: a list of `Cell.collect` has not grown for `duration` s.

    Only time in which it is asked again and again counts: of a test that had to wait for a processor nobody knows
    whether others could have sent anything meanwhile.
    """
    count, asked, quiet = -1, 0.0, 0.0

    def is_silent() -> bool:
        nonlocal count, asked, quiet
        now, before = time.monotonic(), asked
        asked = now
        if len(received) == count:
            quiet += min(now - before, _LONGEST_LOOK)
        else:
            count, quiet = len(received), 0.0
        return quiet >= duration

    return is_silent
