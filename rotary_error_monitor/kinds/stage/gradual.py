"""What a textbook's step at one moment is in a real instrument: it takes some time, before that moment or after it."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause

SPANS = tuple(2.0**k for k in range(-3, 3))
"""s that a step takes, from an eighth of a second to four, in two-fold steps.

What takes longer is as well a drift. A straight course between two of them is a sum of theirs to 6 % of the step.
"""


def moment_of(cause: Cause) -> float:
    """Moment, s, of a step."""
    return float(cause.values[cause.effect.slices()["time"]].item())


def begun_before(cause: Cause) -> Cause:
    """The same step as long before as one takes at most."""
    return begun_at(cause, moment_of(cause) - SPANS[-1])


def begun_at(cause: Cause, moment: float) -> Cause:
    """The same step at another moment, s."""
    values = cause.values.copy()
    values[cause.effect.slices()["time"]] = moment
    return cause.with_values(values)


def ramps(moment: float, time: Array) -> Array:
    """(n, r) even courses from 0 to 1 that end at a moment or begin there, less the step at that moment."""
    columns = [np.clip((time - begin) / span, 0, 1) for span in SPANS for begin in (moment - span, moment)]
    return np.column_stack(columns) - (time >= moment)[:, None]


def takes_time(change: float) -> str:
    """Words for what is no step but comes little by little."""
    return "comes little by little"
