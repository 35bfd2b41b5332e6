"""Effects of the drive: the true rotation is not what was commanded."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import Parameter, Values, wave_of_order
from rotary_error_monitor.effects.rotor import RotorState, StageEffect


class ReversalBacklash(StageEffect):
    """The rotor lags the command by half of the play in the direction of travel."""

    name = "reversal_backlash"
    title = "backlash of the drive"
    remedy = "Preload the drive, or use the controller's backlash compensation; approach from one side meanwhile."
    source = "ISO 230-2, 3.9 (reversal error)"
    parameters = (Parameter("width", "rad", 2e-5, bound=1e-2),)

    def rotation(self, values: Values, state: RotorState) -> Array:
        """Half the width against the direction of travel."""
        return np.asarray(-0.5 * values[0] * state.direction, np.float64)


class FollowingError(StageEffect):
    """The rotor does what was commanded a moment ago."""

    name = "following_error"
    title = "following error of the drive"
    remedy = "Raise the position loop's gain or velocity feed-forward; state what stays as latency of the command."
    source = "velocity lag of a position loop"
    parameters = (Parameter("delay", "s", 1e-4, bound=1.0),)

    def rotation(self, values: Values, state: RotorState) -> Array:
        """Command of then minus command of now."""
        return state.command_at(state.time - state.age - values[0]) - state.command


class DriveCyclicError(StageEffect):
    """Worm, gear or motor poles push the rotor ahead and back at one order of the command."""

    name = "drive_cyclic_error"
    title = "cyclic error of the drive"
    remedy = "Look for a gear, pulley or motor with that many turns, pole pairs or teeth per turn of the stage."
    source = "ISO 230-2, Annex (periodic positioning error); gear mesh and cogging"
    parameters = wave_of_order("rad", 3e-6, bound=1e-2, highest=200)
    stands_out_in = (COMMAND,)
    orders = 200

    def rotation(self, values: Values, state: RotorState) -> Array:
        """One wave of the commanded angle."""
        angle = values[0] * state.command
        turned = np.zeros(len(angle))
        # A signature takes one of the two at a time.
        if values[1]:
            turned += values[1] * np.cos(angle)
        if values[2]:
            turned += values[2] * np.sin(angle)
        return turned
