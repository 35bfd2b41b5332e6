"""Readings that repeat better than any instrument, of errors that no axis has: they are in another unit than stated.

Either by itself may be: a simulation has no noise, and a stage in a metrology frame few errors. Both together are what
mm under a header in µm look like, or degrees under one in arcsec.
"""

from __future__ import annotations

from rotary_error_monitor.units import ARCSEC

FINEST_LENGTH = 1e-9
"""Standard deviation, m, below which no displacement sensor on a machine that moves repeats."""

AIR = 1e-8
"""Part of its path by which a length in air is unsure from run to run: that of air warmer by 0.01 K (Edlén)."""

TRUE = 1e-7
"""Part of its travel to which no axis is true: what steel expands by in 0.01 K; the best scales state five times it."""

FINEST_ANGLE = 1e-3 / ARCSEC
"""Standard deviation, rad, below which no angle repeats: a fifth of the resolution of the finest autocollimators."""

TRUE_ANGLE = 0.02 / ARCSEC
"""Largest error, rad, than which no rotary axis has less: a fifth of what the best encoders state."""


def quiet_length(scatter: float, errors: float, travel: float, *, in_air: bool = True) -> str | None:
    """What is wrong with a standard deviation, m, of readings, in words; None if nothing is.

    None at all, 0, is that of readings whose steps are coarse.

    Args:
        scatter: how readings repeat, m.
        errors: the largest that were read, m.
        travel: along which they were read, m.
        in_air: whether it was a length in air that was read, and not a gap.
    """
    finest = max(FINEST_LENGTH, AIR * travel if in_air else 0.0)
    if 0.0 < scatter < finest and errors < TRUE * travel:
        return _asked(f"{scatter * 1e6:.2g} µm", f"{finest * 1e6:.2g} µm")
    return None


def quiet_angle(scatter: float, errors: float) -> str | None:
    """The same of angles, rad."""
    if 0.0 < scatter < FINEST_ANGLE and errors < TRUE_ANGLE:
        return _asked(f"{scatter * ARCSEC:.2g} arcsec", f"{FINEST_ANGLE * ARCSEC:g} arcsec")
    return None


def _asked(scatter: str, finest: str) -> str:
    return (
        f"{scatter} at most, and no instrument repeats to {finest} over a travel, nor has an axis as small errors: are "
        "the readings in the unit of the header?"
    )
