"""Residuals before and after, as a person wants to see them: one channel against what it may depend on."""

from __future__ import annotations

from dataclasses import dataclass

from rotary_error_monitor.arrays import Array


@dataclass(frozen=True)
class View:
    """One channel over one quantity.

    Attributes:
        channel: topic and field.
        quantity: what `x` is, with its unit.
        x: (n,) values of it.
        before: (n,) measured minus predicted without the causes, in `unit`.
        after: (n,) the same with the causes.
        unit: of the residuals.
    """

    channel: str
    quantity: str
    x: Array
    before: Array
    after: Array
    unit: str
