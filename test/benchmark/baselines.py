"""What one would try before a diagnosis by physics: z-scores and sparse regression (`isolation.py` holds the third).

All are given what the diagnosis is given: the recording, the twin's prediction, the names of the effects. Their
thresholds come from recordings without a gap, made from seeds of their own, for one false alarm in a hundred.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import gumbel_r, norm
from sklearn.linear_model import Lasso

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Cause, Effect, Role, order_location
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import StageTwin, twin_of

FALSE_ALARMS = 0.01
PERIOD = 0.01  # s, of the common grid
JITTER = 2e-6  # rad, of the rotor about the command; no twin states it
HIGHEST = 12
DRIVE_ORDERS = range(20, 91)
COMMAND = "command"


@dataclass(frozen=True)
class Residuals:
    """Measured minus predicted on a common grid: heads, components of the other sensors, and what drives the stage."""

    sensors: Mapping[str, np.ndarray]  # head_a …, autocollimator_x …, lvdt_y
    noise: Mapping[str, float]
    angle: np.ndarray
    speed: np.ndarray
    time: np.ndarray
    force: np.ndarray
    warming: np.ndarray

    @property
    def heads(self) -> list[str]:
        return [name for name in self.sensors if name.startswith("head_")]

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """What the heads share, what each differs by, and the other sensors, over their noise."""
        shared = np.mean([self.sensors[name] for name in self.heads], axis=0)
        return {COMMAND: shared / JITTER} | {
            name: (values - shared if name.startswith("head_") else values) / self.noise[name]
            for name, values in self.sensors.items()
        }


def residuals_of(stage: StageDescription, recording: StageRecording) -> Residuals:
    """Residuals of the twin as it is."""
    twin = twin_of(stage, recording, ())
    return _on_grid(stage, recording, twin, {n: recording.streams[n].values - v for n, v in twin.predict(()).items()})


def _on_grid(stage: StageDescription, recording: StageRecording, twin: StageTwin, signals: Mapping) -> Residuals:
    begin = max(stream.time[0] for stream in (recording.streams[n] for n in signals))
    end = min(stream.time[-1] for stream in (recording.streams[n] for n in signals))
    grid = np.arange(begin, end, PERIOD)
    sensors, noise = {}, {}
    stated = {
        "head": np.hypot(stage.encoder.noise, stage.encoder.resolution / np.sqrt(12)),
        "autocollimator": np.hypot(stage.autocollimator.noise, stage.autocollimator.resolution / np.sqrt(12)),
        "lvdt": stage.lvdt.noise if stage.lvdt else np.inf,
    }
    for name, values in signals.items():
        names = [name] if values.shape[1] == 1 else [f"{name}_x", f"{name}_y"]
        for component, column in zip(names, values.T, strict=True):
            sensors[component] = np.interp(grid, recording.streams[name].time, column)
            noise[component] = float(stated[name.partition("_")[0]])
    inputs = twin.inputs
    return Residuals(
        sensors, noise, inputs.command(grid), inputs.omega(grid), grid, inputs.force(grid), inputs.warming(grid)
    )


def answer(verdict: str, keys: Sequence[tuple[str, str]] = (), alike: Sequence[tuple[str, str]] = ()) -> dict:
    """A verdict in the form of `diagnosis.json`."""
    groups = [{"effects": [{"effect": e, "location": p} for e, p in alike], "advice": ""}] if len(alike) > 1 else []
    return {
        "verdict": verdict,
        "causes": [{"effect": e, "location": p, "probability": 1.0, "parameters": {}} for e, p in keys],
        "indistinguishable": groups,
        "where": [],
        "gap": {"shrink": 0.0},
    }


def largest_order(values: np.ndarray, angle: np.ndarray, orders: Iterator[int]) -> int:
    """Order of the largest harmonic."""
    return max(orders, key=lambda k: abs(np.sum(values * np.exp(-1j * k * angle))))


def orders_of(effect: Effect) -> range:
    return (
        DRIVE_ORDERS if effect.name == "drive_cyclic_error" else range(effect.lowest, min(effect.orders, HIGHEST) + 1)
    )


@dataclass(frozen=True)
class Threshold:
    """Mean squares of channels over what recordings without a gap have, in standard deviations."""

    mean: Mapping[str, float]
    std: Mapping[str, float]
    level: float

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, np.ndarray]]) -> Threshold:
        squares = {name: [float(np.mean(row[name] ** 2)) for row in rows] for name in rows[0]}
        level = float(norm.isf(FALSE_ALARMS / len(squares)))
        mean = {name: float(np.mean(found)) for name, found in squares.items()}
        return cls(mean, {name: float(np.std(found, ddof=1)) for name, found in squares.items()}, level)

    def scores(self, row: Mapping[str, np.ndarray]) -> dict[str, float]:
        return {name: (float(np.mean(row[name] ** 2)) - self.mean[name]) / self.std[name] for name in row}


def signatures(
    stage: StageDescription, recording: StageRecording, effects: Sequence[StageEffect]
) -> dict[tuple[str, str], list[Residuals]]:
    """What each effect at each place does, for one usual size of each of its linear parameters."""
    twin = twin_of(stage, recording, ())
    base, found = twin.predict(()), {}
    for effect in effects:
        places = [order_location(k) for k in orders_of(effect)] if effect.orders else effect.locations(stage)
        for place in places:
            columns = []
            for index in effect.indices(Role.LINEAR):
                values = effect.start(place)
                for shape in effect.indices(Role.SHAPE):
                    values[shape] = effect.scales()[shape]
                values[index] = effect.scales()[index]
                moved = twin.predict((Cause(effect, place, values),))
                columns.append(_on_grid(stage, recording, twin, {n: moved[n] - base[n] for n in base}))
            found[effect.name, place] = columns
    return found


@dataclass(frozen=True)
class LargestScore:
    """The channel with the largest z-score, and the effects whose own channel it is, which it cannot tell apart."""

    threshold: Threshold
    owners: Mapping[str, list[tuple[str, str]]]  # of each channel, the effect most of whose power is there first
    families: Mapping[str, range]

    @classmethod
    def learn(cls, nulls: Sequence[Residuals], library: Mapping, effects: Sequence[StageEffect]) -> LargestScore:
        shares: dict[str, list[tuple[float, tuple[str, str]]]] = {}
        for key, columns in library.items():
            power: dict[str, float] = {}
            for column in columns:
                for name, values in column.channels.items():
                    power[name] = power.get(name, 0.0) + float(np.sum(values**2))
            top = max(power, key=lambda name: power[name])
            shares.setdefault(top, []).append((-power[top] / sum(power.values()), key))
        owners = {name: [key for _, key in sorted(rows)] for name, rows in shares.items()}
        return cls(
            Threshold.of([n.channels for n in nulls]), owners, {e.name: orders_of(e) for e in effects if e.orders}
        )

    def diagnose(self, data: Residuals, left_out: Sequence[str]) -> dict:
        scores = self.threshold.scores(data.channels)
        top = max(scores, key=lambda name: scores[name])
        if scores[top] < self.threshold.level:
            return answer("no_gap")
        known = [key for key in self.owners.get(top, []) if key[0] not in left_out]
        if not known:
            return answer("unknown")
        placed = list(dict.fromkeys(self._placed(key, data, top) for key in known))
        return answer("explained", placed[:1], placed)

    def _placed(self, key: tuple[str, str], data: Residuals, channel: str) -> tuple[str, str]:
        """With the order of the largest harmonic, where the effect is one of a family."""
        if key[0] not in self.families:
            return key
        orders = iter(self.families[key[0]])
        return key[0], order_location(largest_order(data.channels[channel], data.angle, orders))


def dictionary(data: Residuals, channel: str) -> np.ndarray:
    """(n, p) harmonics of the rotation, time, speed, direction, force and warming; columns of unit mean square."""
    orders = [*range(1, HIGHEST + 1), *(DRIVE_ORDERS if channel == COMMAND else ())]
    waves = [wave(k * data.angle) for k in orders for wave in (np.cos, np.sin)]
    direction = np.sign(np.where(np.abs(data.speed) > 1e-9, data.speed, 0.0))
    drivers = [np.ones_like(data.time), data.time, data.speed, data.speed**2, direction, *data.force.T, data.warming]
    table = np.stack([*waves, *drivers], axis=1)
    return table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-30)


@dataclass(frozen=True)
class SparseRegression:
    """Lasso of each channel on the dictionary; the effects whose own coefficients look most like what is found.

    The penalty of a channel is the largest correlation that one recording in a hundred without a gap would have, so
    that coefficients mean a gap.
    """

    alphas: Mapping[str, float]
    patterns: Mapping[tuple[str, str], np.ndarray]  # (p, q) orthonormal
    enough: float = 0.8  # share of the coefficients' power that causes must account for

    @classmethod
    def learn(cls, nulls: Sequence[Residuals], library: Mapping) -> SparseRegression:
        rate = FALSE_ALARMS / len(nulls[0].channels)
        alphas = {}
        for name in nulls[0].channels:
            tops = [np.abs(dictionary(n, name).T @ n.channels[name]).max() / len(n.time) for n in nulls]
            alphas[name] = float(gumbel_r.isf(rate, *gumbel_r.fit(tops)))
        patterns = {}
        for key, columns in library.items():
            table = np.stack([np.concatenate([_fit(c, name) for name in alphas]) for c in columns], axis=1)
            size = np.linalg.norm(table, axis=0)
            if len(size) and (size > 0).all():
                patterns[key] = np.linalg.qr(table / size)[0]
        return cls(alphas, patterns)

    def diagnose(self, data: Residuals, left_out: Sequence[str]) -> dict:
        parts = []
        for name, alpha in self.alphas.items():
            table = dictionary(data, name) if name in data.sensors or name == COMMAND else None
            if table is None:
                return answer("unknown")
            chosen = Lasso(alpha=alpha, fit_intercept=False, max_iter=5000).fit(table, data.channels[name]).coef_ != 0
            parts.append(np.where(chosen, _fit(data, name), 0.0))
        found = np.concatenate(parts)
        power = float(found @ found)
        if power == 0:
            return answer("no_gap")
        known = {key: basis for key, basis in self.patterns.items() if key[0] not in left_out}
        named: list[tuple[str, str]] = []
        rest = found
        while len(named) < 2:
            best = max(known, key=lambda key: float(np.sum((known[key].T @ rest) ** 2)))
            named.append(best)
            basis = np.linalg.qr(np.concatenate([known[key] for key in named], axis=1))[0]
            rest = found - basis @ (basis.T @ found)
            if rest @ rest < (1 - self.enough) * power:
                return answer("explained", named)
        return answer("unknown")


def _fit(data: Residuals, channel: str) -> np.ndarray:
    """Coefficients without a penalty."""
    return np.linalg.lstsq(dictionary(data, channel), data.channels[channel], rcond=None)[0]
