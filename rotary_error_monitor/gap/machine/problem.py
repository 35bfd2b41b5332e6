"""A machine tool as a problem of diagnosis: the rows are the probe's components at static poses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import Axis, MachineDescription
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, among
from rotary_error_monitor.effects.machine_effect import LINEAR, MachineEffect, positioning_error
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.machine.modulations import machine_departures
from rotary_error_monitor.gap.machine.where import machine_advice, machine_where
from rotary_error_monitor.gap.p_values import chi_square_median, log_chi_square_tail
from rotary_error_monitor.gap.problem import Array, Candidate, Conditions, Finding, Rows, Share
from rotary_error_monitor.gap.views import View
from rotary_error_monitor.twin.finite import UnpredictableError
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe, uncertain_shifts

PROBE_STD = 1.5e-6
"""Standard deviation of one component of the laser tracker's result, m, where nothing else is stated."""

CHANNELS = ("x", "y", "z")
FOLDS = 6
OUTLIER = 5.0
"""A pose further than this many standard deviations from every smooth machine is an outlier of the tracker."""

MOST_OUTLIERS = 0.1

SMALL = 1e-3
"""Departure, m, that any machine may have by the way in which it was set up."""

OTHERS = 10.0
"""A machine that departs from its twin by so many times what the twin describes may be another one."""

PERIODS = (2e-3, 0.5)
"""Shortest and longest period of a cyclic error that is searched, m."""

_LEVER = 1e-5
"""Size of an error component, m or rad, by which its lever at a pose is found: above rounding, below curvature."""

_STEP = 0.1
"""Step of numerical derivatives in usual sizes, µm or µrad: the machine is linear in its errors to one part in 10^5."""

MOST_STEPS, SETTLED = 12, 1e-3
"""Steps of a robust fit, and the change of a weight from which on another one changes nothing."""

_SHAPE_STEP = 1e-8
"""Relative step of derivatives with respect to a period: small beside one turn in all turns over the travel."""


class MachineProblem:
    """Poses of a machine beside its twin.

    Args:
        machine: the description that the twin has.
        recording: poses and probe.
        effects: the known effects.
        probe_std: standard deviation of one component of the probe, m.
    """

    channels = CHANNELS
    m_open = False

    def __init__(
        self,
        machine: MachineDescription,
        recording: MachineRecording,
        effects: Sequence[MachineEffect],
        probe_std: float = PROBE_STD,
    ) -> None:
        self.machine = machine
        self.recording = recording
        self.effects = tuple(effects)
        self.probe_std = probe_std
        self.index = np.arange(len(recording.probe), dtype=np.float64)
        self._shifts = uncertain_shifts(machine)
        self._starts: dict[tuple[str, str], Array] = {}
        self._plain: Array | None = None
        self._moved: Array | None = None
        self._structure_table = self._smooth_machine()
        self.kept: NDArray[np.bool_] = np.ones(len(self.index), bool)
        self.kept = self._find_outliers()
        edges = np.linspace(0, len(self.index), 4 * FOLDS + 1)
        labels = (np.arange(4 * FOLDS) // 4).astype(np.intp)
        self._conditions = Conditions(edges - 0.5, labels, tuple(f"poses {i + 1}/{FOLDS}" for i in range(FOLDS)))

    @property
    def conditions(self) -> Conditions:
        """Poses in the order of measuring; a sixth of them is held out together."""
        return self._conditions

    def times(self, channel: str) -> Array:
        """(n,) number of each pose."""
        return self.index

    def expected(self, channel: str) -> Array:
        """(n,) 1 for poses that count, 0 for outliers."""
        return self.kept.astype(np.float64)

    def residual(self, causes: Sequence[Cause]) -> Rows:
        """White rows (n, 1) of measured minus predicted."""
        return self._rows((self.recording.probe - self._prediction(causes))[:, :, None])

    def signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause] = ()) -> Rows:
        """White rows of the derivative of the prediction with respect to values of `cause`, beside `others`."""
        effect, columns = cause.effect, []
        base = self._prediction(among(cause, others))
        for index in indices:
            # A wave that is moved along bends at once: the step in its period is far smaller.
            shape = index in effect.indices(Role.SHAPE)
            step = _SHAPE_STEP * float(cause.values[index]) if shape else _STEP * effect.scales()[index]
            step = effect.inward(cause.values, index, step)
            values = cause.values.copy()
            values[index] += step
            columns.append((self._prediction(among(cause.with_values(values), others)) - base) / step)
        return self._rows(np.stack(columns, axis=2))

    def distortions(self, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> Sequence[float]:
        """None: errors this small add up, whatever else is wrong."""
        return [0.0] * len(candidates)

    def departures(self, causes: Sequence[Cause]) -> tuple[Departures, ...]:
        """Ways in which each cause may depart from its textbook form."""
        return tuple(machine_departures(self, i, causes) for i in range(len(causes)))

    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """White rows of one standard uncertainty of each uncertain parameter.

        Causes are micrometres on a machine of metres: what a parameter does beside them is the same.
        """
        if not self._shifts:
            return {}
        if self._moved is None:
            base = self._prediction(())
            moved = [predict_probe(shift.machine, self.recording) - base for shift in self._shifts]
            self._moved = np.stack(moved, axis=2)
        return self._rows(self._moved)

    def candidates(self, rest: Rows, causes: Sequence[Cause]) -> tuple[Candidate, ...]:
        """Every effect at every place; harmonics of rotary axes of every order, the best period of each linear axis."""
        found = [candidate for effect in self.effects for candidate in self._of(effect, rest)]
        self._starts |= {candidate.key: candidate.start for candidate in found}
        return tuple(found)

    def structure(self, rest: Rows) -> list[Finding]:
        """Tests of what is left: its power, and every smooth error that a machine's axes can have."""
        white = np.concatenate([rest[channel][:, 0] for channel in CHANNELS])
        count = 3 * int(self.kept.sum())
        power = float(white @ white)
        findings = [
            Finding("probe", "power", log_chi_square_tail(power, count), max(0.0, power - count), "pose: scatter")
        ]
        for axis, names, table in self._structure_table:
            kept = table * np.tile(self.kept, 3)[:, None]
            gains = np.square(kept.T @ white) / np.maximum(np.sum(np.square(kept), axis=0), 1e-300)
            best = int(np.argmax(gains))
            chance = min(0.0, log_chi_square_tail(float(gains[best]), 1) + float(np.log(len(names))))
            findings.append(Finding("probe", f"axis {axis}", chance, max(0.0, float(gains[best]) - 1), names[best]))
        return findings

    def learn_noise(self, causes: Sequence[Cause], findings: Sequence[Finding]) -> bool:
        """Look for outliers again with the causes taken out; whether the rows have changed by it."""
        return bool(causes) and self.learn_outliers(causes, {})

    def learn_outliers(self, causes: Sequence[Cause], departing: Rows) -> bool:
        """The same with what their departures take of the rows taken out as well.

        Of poses that were left out before that is not known: they come back if the causes alone explain them.
        """
        white = (self.recording.probe - self._prediction(causes)) / self.probe_std
        if departing:
            white -= np.concatenate([departing[channel] for channel in CHANNELS], axis=1)
        kept = self._inliers(white)
        if np.array_equal(kept, self.kept):
            return False
        self.kept = kept
        return True

    def check_plausible(self) -> None:
        """Refuse a twin that is off by more than the machine's errors and any known effect can make.

        Raises:
            InputError: the twin describes another machine.
        """
        predicted = self._prediction(())
        off = float(np.median(np.abs(self.recording.probe - predicted)))
        described = float(np.median(np.abs(predicted)))
        if off <= max(OTHERS * described, SMALL) or off <= (reach := self._reach()):
            return
        raise InputError(
            f"the twin is off by {off * 1e3:.3g} mm at the median; the errors that it describes are "
            f"{described * 1e6:.3g} µm, and known effects make {reach * 1e3:.3g} mm at most: "
            "it is of another machine; give the twin of this one, and the probe in m"
        )

    def _reach(self) -> float:
        """Largest median change of the probe by any known effect as large as it may be, m."""
        base, reach = self._prediction(()), 0.0
        for effect in self.effects:
            for place in effect.locations(self.machine):
                try:
                    moved = predict_probe(self.machine, self.recording, (Cause(effect, place, effect.largest(place)),))
                except UnpredictableError:
                    continue
                reach = max(reach, float(np.median(np.abs(moved - base))))
        return reach

    def where(self, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
        """Shares of the probe's components."""
        return machine_where(self, causes, rest, explained)

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """How wrong the causes make the tool's offset at the poses."""
        if not causes:
            return {}
        plain = predict_probe(self.machine, self.recording)
        moved = predict_probe(self.machine, self.recording, causes) - plain
        return {"tool_offset_error_um": 1e6 * float(np.sqrt(np.mean(np.sum(np.square(moved), axis=1))))}

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """Poses that would tell effects apart."""
        return machine_advice(self, keys, causes)

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """Outliers that were left out, and scatter beyond the probe's noise."""
        lost = int(np.count_nonzero(~self.kept))
        count = 3 * int(self.kept.sum())
        scatter = float(np.sqrt(sum(float(np.sum(rows**2)) for rows in rest.values()) / max(count, 1)))
        noisy = scatter > 1 + 5 / np.sqrt(2 * max(count, 1))
        return (
            *self.recording.remarks,
            *([f"{lost} poses are outliers of the probe and were left out"] if lost else []),
            *([f"probe: what is left scatters {scatter:.2f} times as much as the probe's noise"] if noisy else []),
        )

    def views(self, channels: Sequence[str], causes: Sequence[Cause]) -> list[View]:
        """Residuals of the probe's components over each axis, before and after the causes, in µm."""
        before = 1e6 * (self.recording.probe - self._prediction(()))
        after = 1e6 * (self.recording.probe - self._prediction(causes))
        found = []
        for channel in channels:
            component = CHANNELS.index(channel[-1])
            for column, axis in enumerate(self.machine.axes):
                words, scale = ("mm", 1e3) if axis.kind == LINEAR else ("°", 180 / np.pi)
                x = scale * self.recording.positions[:, column]
                quantity = f"{axis.letter}, {words}"
                found.append(View(channel, quantity, x, before[:, component], after[:, component], "µm"))
        return found

    def at_zero(self, key: tuple[str, str]) -> Cause:
        """An effect without size, its shape as it was proposed."""
        effect = next(e for e in self.effects if e.name == key[0])
        return Cause(effect, key[1], self._starts.get(key, effect.start(key[1])))

    def _prediction(self, causes: Sequence[Cause]) -> Array:
        """Prediction with these causes; that without any size is kept."""
        fitted = tuple(cause for cause in causes if np.any(cause.values[cause.effect.indices(Role.LINEAR)]))
        if fitted:
            return predict_probe(self.machine, self.recording, fitted)
        if self._plain is None:
            self._plain = predict_probe(self.machine, self.recording)
        return self._plain

    def _rows(self, values: Array) -> Rows:
        white = values / self.probe_std * self.kept[:, None, None]
        return {channel: white[:, i] for i, channel in enumerate(CHANNELS)}

    def _of(self, effect: MachineEffect, rest: Rows) -> Iterator[Candidate]:
        places = effect.locations(self.machine)
        most = int(getattr(effect, "harmonics", 0))
        for place in places:
            if most:
                yield from self._harmonics(effect, place, most, len(places))
            elif getattr(effect, "wave", None):
                start, trials = self._period(effect, place, rest)
                yield Candidate(effect, place, start, trials, -float(np.log(len(places) * trials)))
            else:
                yield Candidate(effect, place, effect.start(place), len(places), -float(np.log(len(places))))

    def _harmonics(self, effect: MachineEffect, place: str, most: int, places: int) -> Iterator[Candidate]:
        for order in range(1, most + 1):
            start = effect.start(place)
            start[effect.slices()["order"]] = order
            # Lower orders are likelier: eccentricity and oval shapes come before teeth.
            prior = -float(np.log(order * places * np.sum(1 / np.arange(1, most + 1))))
            yield Candidate(effect, place, start, most * places, prior)

    def _period(self, effect: AnyEffect, place: str, rest: Rows) -> tuple[Array, int]:
        """Period with the most power along the axis, from a Lomb-Scargle scan of the positions."""
        column = self.machine.letters.index(place)
        position = self.recording.positions[:, column]
        unit = effect.start(place)
        # Cosine and sine of the longest period, each times its own wave, add up to a constant: the direction in which
        # the axis's error shows.
        longest = float(effect.bounds()[1][effect.slices()["period"]][0])
        shown = np.zeros_like(self.recording.probe)
        for name, wave in (("cos", np.cos), ("sin", np.sin)):
            long, size = unit.copy(), effect.slices()[name]
            long[effect.slices()["period"]], long[size] = longest, effect.scales()[size]
            moved = self._prediction((Cause(effect, place, long),)) - self._prediction(())
            shown += wave(2 * np.pi * position / longest)[:, None] * moved
        along = shown / np.maximum(np.linalg.norm(shown, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        signal = np.sum(np.stack([rest[c][:, 0] for c in CHANNELS], axis=1) * along, axis=1)
        span = float(np.ptp(position))
        best = find_frequency(position, signal, 1 / PERIODS[1], 1 / PERIODS[0])
        start = unit.copy()
        start[effect.slices()["period"]] = 1 / best
        return start, max(int(span * (1 / PERIODS[0] - 1 / PERIODS[1])), 1)

    def _smooth_machine(self) -> list[tuple[str, list[str], Array]]:
        """For each axis, white columns (3 n, p) of smooth errors: powers, harmonics, reversal, warmth.

        To first order a component's effect is its value times where that axis stands at the pose: one prediction for
        each component gives that lever, and every shape is a multiple of it.
        """
        base = self._prediction(())
        warming = self.recording.temperature - self.machine.reference_temperature
        tables = []
        for column, axis in enumerate(self.machine.axes):
            position, direction = self.recording.positions[:, column], self.recording.direction[:, column]
            shapes = _shapes(position, axis)
            names, columns = [], []
            for about in "XYZABC":
                component = f"E{about}{axis.letter}"
                lever = predict_probe(self.machine.with_error(component, poly=(_LEVER,)), self.recording) - base
                own = component == positioning_error(self.machine, axis.letter)
                found = {**shapes, "direction": direction, "temperature": warming * position} if own else shapes
                for words, shape in found.items():
                    names.append(f"pose: {component}, {words} of {axis.letter}")
                    columns.append((lever * shape[:, None]).T.ravel() / self.probe_std)
            tables.append((axis.letter, names, np.stack(columns, axis=1)))
        return tables

    def _find_outliers(self) -> NDArray[np.bool_]:
        white = (self.recording.probe - self._prediction(())) / self.probe_std
        return self._inliers(white)

    def _inliers(self, white: Array) -> NDArray[np.bool_]:
        """Poses that a smooth machine can explain, by a fit that gives distant poses little weight.

        Every smooth error of every axis takes part, lightly held, so that an effect, however large, is no outlier.
        """
        table = np.concatenate([columns for _, _, columns in self._structure_table], axis=1)
        table = table / np.maximum(np.linalg.norm(table, axis=0), 1e-12) * np.sqrt(len(table))
        rows = white.T.ravel()
        weight = np.ones(len(self.index))
        for _ in range(MOST_STEPS):
            tripled = np.tile(weight, 3)
            gram = table.T @ (tripled[:, None] * table) + np.eye(table.shape[1])
            left = rows - table @ np.linalg.solve(gram, table.T @ (tripled * rows))
            distance = np.sqrt(np.mean(np.square(left.reshape(3, -1)), axis=0))
            spread = max(1.0, float(np.median(distance)) / np.sqrt(chi_square_median(3) / 3))
            # Weights of Student's t, three degrees of freedom: a distant pose counts with the inverse of its square.
            before, weight = weight, np.minimum(4.0 / (3.0 + np.square(distance / spread)), 1.0)
            if np.max(np.abs(weight - before)) < SETTLED:
                break
        outlying: NDArray[np.bool_] = np.asarray(distance > OUTLIER * spread, bool)
        if outlying.mean() > MOST_OUTLIERS:
            outlying &= distance >= np.quantile(distance, 1 - MOST_OUTLIERS)
        return ~outlying


def _shapes(position: Array, axis: Axis) -> dict[str, Array]:
    """Smooth functions of an axis's position, by their names: powers of a linear one, harmonics of a rotary one."""
    if axis.kind == LINEAR:
        scaled = (2 * position - sum(axis.travel)) / np.ptp(axis.travel)
        return {f"power {k}": scaled**k for k in range(6)}
    waves = {f"order {k}, {wave.__name__}": wave(k * position) for k in range(1, 5) for wave in (np.cos, np.sin)}
    return {"order 0": np.ones(len(position)), **waves}


def find_frequency(position: Array, signal: Array, lowest: float, highest: float) -> float:
    """Frequency, 1/m, of the wave with the most power in a signal at positions that are not evenly spaced.

    The signal is first summed into cells a twentieth of the shortest wave wide, so that one fast transform sees all
    frequencies a fifth of the resolution apart; near the best of them the positions count as they are.
    """
    span = float(np.ptp(position))
    width = 0.05 / highest
    sums = np.bincount(((position - position.min()) / width).astype(np.intp), signal)
    length = int(2 ** np.ceil(np.log2(5 * span / width)))
    power = np.square(np.abs(np.fft.rfft(sums, length)))
    frequencies = np.arange(len(power)) / (length * width)
    allowed = (frequencies >= lowest) & (frequencies <= highest)
    best = float(frequencies[int(np.argmax(np.where(allowed, power, -1.0)))])
    fine = np.clip(best + np.linspace(-0.2, 0.2, 41) / span, lowest, highest)
    exact = np.abs(np.exp(-2j * np.pi * np.outer(fine, position)) @ signal)
    return float(fine[int(np.argmax(exact))])
