"""What acts on the stage from outside: forces that come and go, and temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .noise import Smooth, drawn_log
from .options import Options, Seeds

Array = NDArray[np.float64]


class Environment:
    """Force in N and temperature in °C as functions of time; nothing acts where its stream is absent."""

    def __init__(self, seeds: Seeds, duration: float, stage: Mapping[str, Any], options: Options) -> None:
        described = "environment" in stage
        draws = seeds.generator("environment")
        drawn = {"force": draws.uniform() < 0.6, "temperature": draws.uniform() < 0.6}
        self.has_force = bool(drawn["force"] if options.force is None else options.force)
        wanted = bool(drawn["temperature"] if options.temperature is None else options.temperature)
        self.has_temperature = wanted and described
        self.reference = float(stage["environment"]["reference_temperature"]) if described else 20.0
        self._pushes = _pushes(seeds.generator("force"), duration)
        self._ripple = Smooth(seeds.generator("ripple"), duration, 8.0, 2)
        self._ripple_size = float(seeds.generator("ripple size").uniform(0.0, 0.5))
        rng = seeds.generator("temperature")
        self._offset, self._slope = rng.uniform(-3.0, 3.0), rng.uniform(-0.02, 0.02)
        self._swing, self._pulsation = rng.uniform(0.0, 0.2), 2.0 * np.pi / rng.uniform(20.0, 900.0)
        self._seeds = seeds

    def force(self, times: Array) -> Array:
        """(n, 2) force on the shaft in N."""
        if not self.has_force:
            return np.zeros((len(times), 2))
        pushes = np.asarray(self._pushes(times), float)
        acting = np.tanh(np.abs(pushes).sum(axis=1, keepdims=True))  # the shaft rings only while something pushes
        return np.asarray(pushes + self._ripple_size * acting * self._ripple(times), float)

    def warmth(self, times: Array) -> Array:
        """(n,) temperature in K above the reference."""
        if not self.has_temperature:
            return np.zeros(len(times))
        return self._offset + self._slope * times + self._swing * np.sin(self._pulsation * times)

    def warmth_of(self, place: str, times: Array) -> Array:
        """(n,) temperature of a place in K above the reference: it settles, and coolant or load make it swing."""
        rng = self._seeds.generator(f"warmth of {place}")
        start, rise, settling = rng.uniform(-0.5, 0.5), rng.uniform(1.0, 4.0), drawn_log(rng, 4.0, 100.0)
        swing, pulsation, phase = (
            rng.uniform(0.2, 0.6),
            2.0 * np.pi / rng.uniform(8.0, 40.0),
            rng.uniform(-np.pi, np.pi),
        )
        settled = -rise * np.expm1(-np.maximum(times, 0.0) / settling)
        return np.asarray(start + settled + swing * np.sin(pulsation * times + phase), float)


def _pushes(rng: np.random.Generator, duration: float) -> PchipInterpolator:
    """Pushes of 5 to 80 N that take 0.1 to 1 s to come and to go, with rests between them."""
    times, forces = [-1e3, 0.0], [np.zeros(2), np.zeros(2)]
    now = rng.uniform(0.02, 0.2) * duration
    while now < duration:
        angle, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(5.0, 80.0)
        push = size * np.array([np.cos(angle), np.sin(angle)])
        rise, fall = rng.uniform(0.1, 1.0, 2)
        hold = rng.uniform(0.5, 0.25 * duration + 0.6)
        times += [now, now + rise, now + rise + hold, now + rise + hold + fall]
        forces += [np.zeros(2), push, push * rng.uniform(0.8, 1.2), np.zeros(2)]
        now = times[-1] + rng.uniform(0.3, 0.25 * duration + 0.5)
    times.append(max(times[-1], duration) + 1e3)
    forces.append(np.zeros(2))
    return PchipInterpolator(np.array(times), np.array(forces), axis=0)
