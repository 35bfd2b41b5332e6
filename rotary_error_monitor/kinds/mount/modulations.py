"""What the signature of a mount's effect may be modulated with: time, side of the pier, direction, place, its size."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.departures import Departures, over_time, percent
from rotary_error_monitor.gap.pose_modulations import Quantity, departures_at_poses, waves_around, with_direction
from rotary_error_monitor.gap.problem import Rows
from rotary_error_monitor.kinds.mount.twin import MountTwin


def mount_departures(twin: MountTwin, place: int, cause: Cause, rows: Rows, units: Mapping[str, float]) -> Departures:
    """Ways in which a cause may depart from its textbook form; arguments as of `departures_at_poses`."""
    return departures_at_poses(place, cause, rows, units, twin.recording.time, _quantities(twin, cause), {})


def _quantities(twin: MountTwin, cause: Cause) -> dict[str, Quantity]:
    recording, letters = twin.recording, twin.machine.letters
    quantities = {
        "time": Quantity("time", recording.time, partial(_with_time, float(np.ptp(recording.time)))),
        "side": Quantity("side of the pier", twin.side, _with_side),
    }
    own = [letter for letter in letters if letter == cause.location]
    for letter in own or letters:
        direction = recording.direction[:, letters.index(letter)]
        # Where the file does not tell it, it is 0 throughout, and none.
        quantities[f"direction {letter}"] = Quantity("direction", direction, with_direction(letter))
    for letter in own:
        for i, wave in enumerate(waves_around(recording.readings[:, letters.index(letter)])):
            quantities[f"order {i} of {letter}"] = Quantity("orders", wave, partial(_with_orders, letter))
    for name, values in _places(twin).items():
        for i, shape in enumerate((values, np.square(values - values.mean()))):
            quantities[f"{name} {i}"] = Quantity(name, shape, partial(_with_place, name))
    return quantities


def _places(twin: MountTwin) -> dict[str, Array]:
    """Where the tube points, in rad: altitude, on which gravity's pull depends, and the star's place."""
    hour, declination = twin.recording.stars.T
    # Hour angles are told from the meridian, whatever turn the file has them in.
    return {
        "altitude": np.arcsin(np.clip(twin.seen[2], -1.0, 1.0)),
        "hour angle": np.angle(np.exp(1j * hour)),
        "declination": declination,
    }


def _with_time(duration: float, change: float, unit: float) -> str:
    return over_time(change / unit * duration, duration)


def _with_side(change: float, unit: float) -> str:
    side = "below" if change > 0 else "beyond"
    return f"smaller on the side of the pier where declination reads {side} 90° by {percent(2 * change / unit)}"


def _with_orders(letter: str, change: float, unit: float) -> str:
    return f"neighbouring orders of {letter}"


def _with_place(name: str, change: float, unit: float) -> str:
    return f"differs with {name}"
