"""Whether what sensors show together is an error motion that the stage can make."""

from __future__ import annotations

import math

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.pipeline.evidence import AGREEMENT, SIGMAS

_SHOWN = dict(zip(COMPONENTS, ("radial", "radial", "axial", "tilt", "tilt"), strict=False))


class JointLimits:
    """Holds what listed sensors determine together, window by window, against the limits of the stage.

    Each of them may be within what it can show, and all of them one another's: exchanged, of the wrong sign or at
    another place than described they still determine something. What is wrong with them turns with the rotor, so that
    it is believed again after a whole turn within the limits.

    Attributes:
        doubt: what they show and the stage cannot do; empty while they are believed.
    """

    def __init__(self, limits: StageLimits) -> None:
        """Of a stage with these limits."""
        self._most = limits.components[: len(_SHOWN)]
        self.reset()

    def reset(self) -> None:
        """Believe them again."""
        self.doubt, self._wrong = "", 0
        self._theta: float | None = None
        self._turned = self._agreeing = 0.0

    def judge(self, duration: float, theta: float, shown: Mask, pose: Array, std: Array) -> None:
        """Take in a window.

        Args:
            duration: of it, s.
            theta: rotation, rad.
            shown: (6,) components that rest on listed sensors.
            pose: (6,) error motion, m and rad.
            std: (6,) standard deviation of it by what is stated.
        """
        moved = 0.0 if self._theta is None else abs(theta - self._theta)
        self._theta = theta
        for place, (name, most) in enumerate(zip(_SHOWN.values(), self._most, strict=True)):
            if shown[place] and abs(pose[place]) > most + SIGMAS * std[place]:
                unit = "µrad" if name == "tilt" else "µm"
                self.doubt = (
                    f"with others it shows {name} error motion of {abs(pose[place]) * 1e6:.3g} {unit}; the stage's is "
                    f"{most * 1e6:.3g} {unit} at most. Place, sign, zero or form of one may be another than described"
                )
                self._turned, self._agreeing, self._wrong = 0.0, 0.0, place
                return
        if not shown[self._wrong]:  # what is not shown is within no limits
            return
        self._turned, self._agreeing = self._turned + moved, self._agreeing + duration
        if self._turned >= 2 * math.pi and self._agreeing >= AGREEMENT:
            self.doubt = ""
