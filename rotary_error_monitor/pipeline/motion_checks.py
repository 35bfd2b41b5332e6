"""The one place where error motion is believed before corrections are made of it: tick by tick, whoever says it."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Mask
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.pipeline.motion_limits import MotionLimits
from rotary_error_monitor.pipeline.motion_stands import MotionStands

BEYOND = "more than the stage can have"
COVARIANCE = "a covariance that cannot be"
STANDS = "the same to the last bit while the rotor turns"

ROUNDING = 1e-9
"""How far below zero rounding may take an eigenvalue of correlations: far above 1e-15, and a correlation that is too
large by so little moves no uncertainty by a part in 1e4."""

_NO_DEVIATION = 1e-30
"""Stands for the deviation of what is known exactly: whatever varies together with it is out of all proportion."""

_IMPOSSIBLE = 2.0
"""Larger correlations are taken for this one: it is as impossible as they are, and finite."""


class MotionChecks:
    """Refuses ticks of error motion that cannot be: counted by reason, each tick once.

    Attributes:
        refused: ticks that are not used, by reason.
        reason: why the last tick is not used, in words; empty where it is.
    """

    def __init__(self, limits: StageLimits) -> None:
        """Of a stage with these limits."""
        self._limits, self._stands = MotionLimits(limits), MotionStands()
        self.refused: Counter[str] = Counter()
        self.reason = ""

    def judge(self, motion: ErrorMotion) -> Mask | None:
        """(m,) which ticks are refused; none where all are believed, which is nearly always."""
        self.reason = ""
        refused: Mask | None = None
        beyond = self._limits.beyond(motion)
        if beyond is not None:
            refused = self._refuse(BEYOND, np.logical_or.reduce(beyond, axis=1), refused)
            self.reason = self._limits.told(motion, beyond) if beyond[-1].any() else ""
        wrong = impossible(motion)
        if wrong is not None:
            refused = self._refuse(COVARIANCE, wrong, refused)
            self.reason = self.reason or (told_covariance(motion) if wrong[-1] else "")
        stands = self._stands.judge(motion)
        if stands is not None:
            refused = self._refuse(STANDS, stands, refused)
            self.reason = self.reason or (
                "error motion is the same to the last bit while the rotor turns: its estimate is stuck"
                if stands[-1]
                else ""
            )
        return refused

    def forget(self) -> None:
        """Forget what was before."""
        self._stands.forget()

    def _refuse(self, reason: str, wrong: Mask, before: Mask | None) -> Mask:
        """What is refused now with what was before."""
        new = wrong if before is None else wrong & ~before
        self.refused[reason] += int(new.sum())
        return wrong if before is None else wrong | before


def impossible(motion: ErrorMotion) -> Mask | None:
    """(m,) at which times the covariance is none: not positive semidefinite; none where all can be."""
    correlations = _correlations(motion)
    try:
        np.linalg.cholesky(correlations)  # of a few ticks in 20 µs; eigenvalues take four times as long
    except np.linalg.LinAlgError:
        wrong: Mask = np.linalg.eigvalsh(correlations)[:, 0] <= 0.0
        return wrong if wrong.any() else None
    return None


def told_covariance(motion: ErrorMotion) -> str:
    """What is wrong with the covariance of the last tick, in words."""
    correlations, matrix = _correlations(motion.at(slice(-1, None)))[0], motion.covariance[-1]
    place = int(np.argmin(np.diagonal(correlations)))
    if correlations[place, place] < 0.0:
        return f"error motion with a variance of {COMPONENTS[place]} of {matrix[place, place]:.4g}: none is negative"
    apart = np.abs(correlations - np.diag(np.diagonal(correlations)))
    first, second = sorted(divmod(int(np.argmax(apart)), len(COMPONENTS)))
    own = f"{matrix[first, first]:.4g} and {matrix[second, second]:.4g}"
    pair = f"{COMPONENTS[first]} and {COMPONENTS[second]}"
    shared = f"{matrix[first, second]:.4g}"
    return f"error motion with a covariance that cannot be: {shared} of {pair}, whose variances are {own}"


def _correlations(motion: ErrorMotion) -> NDArray[np.float64]:
    """(m, 6, 6) correlations, with room for rounding on the diagonal; what is not observable has none."""
    places = np.arange(len(COMPONENTS))
    variances = motion.covariance[:, places, places]
    deviations = np.sqrt(np.maximum(variances, _NO_DEVIATION**2))
    with np.errstate(over="ignore", invalid="ignore"):
        found = motion.covariance / deviations[:, :, None]
        found /= deviations[:, None, :]
    np.fmin(np.fmax(found, -_IMPOSSIBLE, out=found), _IMPOSSIBLE, out=found)  # NaN is as impossible
    found[:, places, places] += ROUNDING
    return np.asarray(found)
