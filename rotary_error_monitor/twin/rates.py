"""How many samples of a sensor are used."""

from __future__ import annotations

from rotary_error_monitor.errors import InputError

MOST_RATE = 1000.0
"""Samples a second of one sensor that are used by default: a rotor is slower than that, and all of 50,000 would take
gigabytes."""

LEAST_RATE = 100.0
"""Samples a second of a sensor below which the jitter of a rotor cannot be told from noise."""


def check_most_rate(rate: float, told: str) -> None:
    """Refuse a rate, Hz, that is too low; `told` says what was given and how, such as `--most-rate is 5.0`.

    Raises:
        InputError: it is below `LEAST_RATE`.
    """
    if not rate >= LEAST_RATE:
        raise InputError(f"{told} Hz; at least {LEAST_RATE:g} are needed to tell the rotor's jitter")
