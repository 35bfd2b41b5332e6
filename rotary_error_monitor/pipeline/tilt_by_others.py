"""Whether the autocollimator is wrong, where listed sensors contradict it, or one of these."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.agreement import FAR, LEAST_RATIO, ODDS
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.pipeline.evidence import AGREEMENT, SIGMAS

TILT = slice(COMPONENTS.index("eac"), COMPONENTS.index("ebc") + 1)

OTHERWISE = "; or the autocollimator is wrong, which it is held against"


class TiltByOthers:
    """Keeps whether the tilt of the autocollimator is taken, and tells who is to blame for a contradiction.

    A fault of one sensor is in what it shows alone. One of the autocollimator is in what is not predicted of all that
    see tilt, each in its own proportion.

    Attributes:
        doubt: why the autocollimator is not believed; empty while it is.
    """

    def __init__(self) -> None:
        """Believe it."""
        self.reset()

    def reset(self) -> None:
        """Believe it until it is contradicted anew."""
        self.doubt = ""
        self._agreeing = 0.0

    def blame(self, sensitivity: Array, owner: NDArray[np.intp], changes: Mapping[int, tuple[float, float]]) -> str:
        """Doubt the autocollimator if it is to blame for what a sensor contradicts; give what is said where it may be.

        Args:
            sensitivity: (p, 6) what each field of the sensors sees of the components.
            owner: (p,) number of the sensor that each field is of.
            changes: of what is not predicted, by the field, and standard deviation of that.
        """
        fields = np.array(sorted(changes), np.intp)
        seen = sensitivity[fields, TILT]
        if not seen.any():
            return ""
        change, std = np.array([changes[each] for each in fields.tolist()]).T
        made, ratio = seen / std[:, None], change / std
        tilt = -np.linalg.pinv(made) @ ratio
        left = float(np.sum(np.square(ratio + made @ tilt)))
        freedom = len(fields) - int(np.linalg.matrix_rank(made))
        alone = min(float(np.sum(np.square(ratio[owner[fields] != each]))) for each in set(owner[fields].tolist()))
        if left >= FAR**2 * max(freedom, 1):
            return ""
        if freedom and 0.5 * (alone - left) >= ODDS and alone >= LEAST_RATIO * max(left, freedom):
            size = float(np.abs(tilt).max())
            self.doubt = f"{size * 1e6:.3g} µrad from what the listed sensors show, which agree with one another"
            self._agreeing = 0.0
            return ""
        return "" if 0.5 * (left - alone) >= ODDS else OTHERWISE

    def follow(self, duration: float, off: Array, std: Array) -> None:
        """Believe the autocollimator again once it has agreed with the others long enough.

        Args:
            duration: of the window, s.
            off: (2,) its tilt less that of the others, rad.
            std: (2,) standard deviation of that.
        """
        agrees = bool(np.all(np.abs(off) <= SIGMAS * std))
        self._agreeing = self._agreeing + duration if agrees else 0.0
        if self._agreeing >= AGREEMENT:
            self.reset()
