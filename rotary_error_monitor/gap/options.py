"""What is taken where a user chooses nothing else, and what may be chosen."""

from __future__ import annotations

from rotary_error_monitor.errors import InputError

FALSE_ALARMS = 0.01
"""Largest chance that anything at all is found in a recording without a gap."""

MOST_CAUSES = 2
"""Effects that are combined at most: three freely chosen ones resemble too much."""


def check_false_alarms(rate: float, told: str) -> None:
    """Refuse what is no chance; `told` says what was given and how, such as `--false-alarms is 2`.

    Raises:
        InputError: it is none.
    """
    if not 0 < rate < 1:
        raise InputError(f"{told}; it must lie between 0 and 1")


def check_most_causes(count: int, told: str) -> None:
    """Refuse a number of causes that leaves none; `told` as for false alarms.

    Raises:
        InputError: it is below 1.
    """
    if count < 1:
        raise InputError(f"{told}; it must be at least 1")
