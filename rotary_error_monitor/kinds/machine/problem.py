"""A machine tool as a problem of diagnosis: the rows are the probe's components at static poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.known_effects import KnownEffects
from rotary_error_monitor.gap.noise_level import LOUDEST, LOUDEST_UNSTATED, NOISIER, SAME_LEVEL
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.p_values import NORMAL_QUARTILE, log_f_tail
from rotary_error_monitor.gap.problem import Columns, Rows, Share, StructureTest
from rotary_error_monitor.gap.slow_noise import Rivals, cosines, learn_slow_noise
from rotary_error_monitor.kinds.machine.modulations import machine_departures
from rotary_error_monitor.kinds.machine.noise_level import AS_STATED, ProbeNoiseEstimator
from rotary_error_monitor.kinds.machine.periods import told_at_few_places
from rotary_error_monitor.kinds.machine.smooth import SmoothMachine
from rotary_error_monitor.kinds.machine.table import MachineTable
from rotary_error_monitor.kinds.machine.warming import moved_by_temperature, with_smooth_temperature
from rotary_error_monitor.kinds.machine.where import machine_advice, machine_where
from rotary_error_monitor.machine.uncertainty import uncertain_shifts
from rotary_error_monitor.noise.slow_noise import Cells, SlowNoise
from rotary_error_monitor.twin.finite import UnpredictableError
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

PROBE_STD = 1.5e-6
"""Standard deviation of one component of the laser tracker's result, m, where nothing else is stated."""

SMALL = 1e-3
"""Departure, m, that any machine may have by the way in which it was set up."""

OTHERS = 10.0
"""A machine that departs from its twin by so many times what the twin describes may be another one."""

SAME_DRIFT = 0.2
"""Part by which the size of a drift may be another: that of one learnt from a recording is no better known."""


class MachineProblem(MachineTable):
    """Poses of a machine beside its twin, with the noise of the probe and what the twin does not know for certain.

    Args:
        machine: the description that the twin has.
        recording: poses and probe.
        effects: the known effects.
        probe_std: stated standard deviation of one component of the probe, m.

    Attributes:
        stated_std: that of all components together (root mean square), m.
        probe_std: what it is taken to be beside the causes found, m.
    """

    def __init__(
        self,
        machine: MachineDescription,
        recording: MachineRecording,
        effects: Sequence[MachineEffect],
        probe_std: float | None = None,
    ) -> None:
        smooth, temperature_ways = with_smooth_temperature(machine, recording)
        stated = np.broadcast_to(probe_std or machine.probe_noise or PROBE_STD, 3)
        self.stated_std = self.probe_std = float(np.sqrt(np.mean(np.square(stated))))
        self._parts = stated / self.stated_std
        self._loudest = LOUDEST if machine.probe_noise else LOUDEST_UNSTATED
        super().__init__(machine, smooth, effects, np.array(stated))
        self._shifts = uncertain_shifts(machine)
        self._moved: Array | None = None
        self._warmed = moved_by_temperature(machine, self.recording, temperature_ways, self.std)
        self._smooth = SmoothMachine(machine, self.recording, self.std, self._warmed)
        self._estimator = ProbeNoiseEstimator(self._smooth.columns, self._smooth.factors)
        self._noise = AS_STATED
        self.drift: Array = np.zeros((len(self.index), 0))
        self._drifted = 0.0
        self.learn_outliers((), {})

    def white(self, values: Array) -> Rows:
        """White rows (n, p) of values (3, n, p): slow noise as well."""
        slow = self._slow_noise()
        return {channel: slow.whiten(rows) for channel, rows in super().white(values).items()}

    def departures(self, causes: Sequence[Cause]) -> tuple[Departures, ...]:
        """Ways in which each cause may depart from its textbook form."""
        return tuple(machine_departures(self, i, causes) for i in range(len(causes)))

    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """White rows of one standard uncertainty of each uncertain parameter.

        Causes are micrometres on a machine of metres: what a parameter does beside them is the same.
        """
        moved = self._moved_by_uncertainty()
        return self.white(moved) if moved.shape[2] else {}

    def _moved_by_uncertainty(self) -> Array:
        """(3, n, u) change of the prediction by one standard uncertainty of each parameter, m."""
        if self._moved is None:
            base = self.predict(None, ())
            moved = [(predict_probe(shift.machine, self.recording).T - base)[:, :, None] for shift in self._shifts]
            self._moved = np.concatenate([*moved, self._warmed], axis=2)
        return self._moved

    def structure(self, rest: Rows) -> list[StructureTest]:
        """Tests of what is left: its power, that of each component, and every smooth error of a machine's axes."""
        white, count = np.concatenate([rest[channel][:, 0] for channel in self.channels]), int(self.kept.sum())
        findings = [self._scatter("probe", white, 3 * count), *self._scatter_of_each(rest)]
        return [*findings, *self._smooth.findings(white, self.kept, self.noise_dof)]

    @property
    def noise_dof(self) -> float:
        """Degrees of freedom with which the level of the probe's noise is known."""
        return self._noise.level.dof

    def _scatter_of_each(self, rest: Rows) -> list[StructureTest]:
        """A component alone, which may be the louder one of all, is one of as many."""
        own, count = {channel: rest[channel][:, 0] for channel in self.channels}, int(self.kept.sum())
        return [self._scatter(channel, values, count, len(own)) for channel, values in own.items()]

    def _scatter(self, channel: str, white: Array, count: int, tests: int = 1) -> StructureTest:
        """Test of the power of `count` white values, one of so many tests."""
        power = float(white @ white)
        # both scatter as the squares of this noise do
        log_p_value = log_f_tail(power / count, count / self._noise.tails, self._noise.level.dof)
        chance = min(0.0, log_p_value + float(np.log(tests)))
        return StructureTest(channel, "power", chance, max(0.0, power - count), "pose: scatter")

    def learn_noise(self, causes: Sequence[Cause]) -> bool:
        """Look for outliers, and for level and drift of the probe's noise again; whether rows or noise have changed."""
        return bool(causes) and self.learn_outliers(causes, {})

    def learn_outliers(self, causes: Sequence[Cause], departing: Rows) -> bool:
        """The same with what departures of the causes take of the rows taken out as well.

        Of poses that were left out before that is not known: they come back if the causes alone explain them.
        """
        white = self.error(causes) / (self.stated_std * self._parts[:, None])
        if departing:
            taken = [self._slow_noise().plain(departing[channel])[:, 0] for channel in self.channels]
            white -= np.stack(taken) * (self.probe_std / self.stated_std)
        kept, quiet = self._smooth.inliers(white.T)
        before = self.kept, self.drift, self.probe_std
        self._learn_level(white, quiet)
        if departing:
            # What departures as they are fitted leave of a fault may look like slow noise: that is learnt without them.
            self.drift = self.drift * (before[2] / self.probe_std)
        else:
            self.drift = self._learn_drift(white * (self.stated_std / self.probe_std), quiet, causes)
        self._drifted = self._course(white * (self.stated_std / self.probe_std), quiet)
        if np.array_equal(kept, self.kept) and self.probe_std == before[2] and _alike(self.drift, before[1]):
            self.drift = before[1]
            return False
        self.kept = kept
        return True

    def _course(self, white: Array, kept: NDArray[np.bool_]) -> float:
        """Standard deviation of the drift of all components, as what is left (3, n) shows it, in those of the noise."""
        seen = self.drift * kept[:, None]
        moved = self.drift @ np.linalg.solve(np.eye(seen.shape[1]) + seen.T @ seen, seen.T @ white.T)
        return float(np.sqrt(np.sum(np.var(moved, axis=0))))

    def _learn_level(self, white: Array, kept: NDArray[np.bool_]) -> None:
        """Level of the noise; as it was where it hardly differs."""
        found = self._estimator.estimate(white, kept)
        self._noise = found if found.level.value <= self._loudest else AS_STATED
        std = self.stated_std * self._noise.level.value
        if abs(std / self.probe_std - 1) > SAME_LEVEL:
            self.probe_std, self.std = std, std * self._parts

    def _learn_drift(self, white: Array, kept: NDArray[np.bool_], causes: Sequence[Cause]) -> Array:
        """(n, q) one standard deviation of each slow course of a component of the probe, in those of its noise."""
        passed = (self.index + 0.5) / len(self.index)
        # Neighbours differ by noise, and by what goes with the pose, but hardly by what is slow.
        apart = np.abs(np.diff(white[:, kept], axis=1))
        level = max(1.0, float(np.median(apart)) / (np.sqrt(2) * NORMAL_QUARTILE))
        moved = self._moved_by_uncertainty()
        uncertain = (moved / (self.std[:, None, None] * level)).reshape(3 * len(kept), moved.shape[2])
        weight = np.tile(kept, (3, 1)).astype(np.float64)
        slow = self._slow_noise()

        def shown(columns: Columns) -> Array:
            assert isinstance(columns, dict)
            plain = [slow.plain(columns[channel]) for channel in self.channels]
            return np.asarray(np.concatenate(plain) / level, np.float64)

        known = KnownEffects(self, causes, self.residual(causes))
        uncertain = np.hstack([uncertain, *known.sizes(shown)])
        rivals = [self._smooth_errors()]
        std = learn_slow_noise(white / level, weight, passed, uncertain, rivals, known.seen_by(shown))
        return np.zeros((len(kept), 0)) if std is None else cosines(passed) * (level * std)

    def _smooth_errors(self) -> Rivals:
        """Smooth errors of the axes."""
        return np.split(self._smooth.columns, self._smooth.columns.shape[1], axis=1)

    def check_plausible(self) -> None:
        """Refuse a twin that is off by more than the machine's errors and any known effect can make.

        Raises:
            InputError: the twin describes another machine.
        """
        predicted = self.predict(None, ())
        off = float(np.median(np.abs(self.measured - predicted)))
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
        base, reach = self.predict(None, ()), 0.0
        for effect in self.effects:
            for place in effect.locations(self.machine):
                try:
                    moved = self.predict(None, (Cause(effect, place, effect.largest(place)),))
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
        moved = self.shown(causes)
        return {"tool_offset_error_um": 1e6 * float(np.sqrt(np.mean(np.sum(np.square(moved), axis=0))))}

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
            *self._otherwise(),
            *self._drifting(),
            *told_at_few_places(self.machine, self.recording.positions[self.kept]),
            *([f"{lost} poses are outliers of the probe and were left out"] if lost else []),
            *([f"probe: what is left scatters {scatter:.2f} times as much as the probe's noise"] if noisy else []),
            *self._uneven(rest),
        )

    def _uneven(self, rest: Rows) -> list[str]:
        """Components that scatter more than their noise, if not all do."""
        count = max(int(self.kept.sum()), 1)
        louder = {
            each.channel: float(np.sqrt(np.sum(np.square(rest[each.channel])) / count))
            for each in (self._scatter_of_each(rest) if rest else ())
            if each.log_p_value < np.log(FALSE_ALARMS)
        }
        if not 0 < len(louder) < len(self.channels):
            return []
        told = " and ".join(f"{channel} {times:.2f} times" for channel, times in louder.items())
        return [
            f"probe: {told} as much as its noise, the others do not; if it is noisier there, "
            "`machine.probe_noise: [x, y, z]` states it"
        ]

    def _otherwise(self) -> list[str]:
        level, std = self.probe_std / self.stated_std, f"{1e6 * self.stated_std:.2g} µm"
        told = abs(level - 1) > max(NOISIER, 2 * float(np.sqrt(self._noise.level.variance)))
        source = "stated" if self.machine.probe_noise else "assumed; `machine.probe_noise` states it"
        return [f"probe: noise is {level:.2f} times the {std} that are {source}"] if told else []

    def _drifting(self) -> list[str]:
        size = 1e6 * self.probe_std * self._drifted
        return [f"probe: drifts by {size:.2g} µm (root mean square) beside its noise"] if size else []

    def _slow_noise(self) -> SlowNoise:
        return SlowNoise(Cells(np.arange(len(self.index)), self.kept.astype(np.float64)), self.drift)


def _alike(drift: Array, other: Array) -> bool:
    """Whether two drifts are the same to a part that changes nothing."""
    return drift.shape == other.shape and np.allclose(drift, other, rtol=SAME_DRIFT, atol=0.0)
