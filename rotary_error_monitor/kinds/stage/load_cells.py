"""What is not known of the force on the shaft, as nuisances: how load cells scatter, round, and are as they are sold.

A force that is wrong by that moves what the twin predicts as a drift or another compliance of the stage would. How a
cell rounds nobody states: one that cuts its readings off is wrong by half a step in the mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.sensor_section import SHAFT_FORCE
from rotary_error_monitor.description.stage import OWN_LOAD_CELL
from rotary_error_monitor.description.streams import FORCE
from rotary_error_monitor.gap.problem import FIRST_ORDER
from rotary_error_monitor.kinds.stage.other_twin import Course, Late, OtherTwin, Pushed, Scaled
from rotary_error_monitor.metrology.forces import LoadCell, load_cell, shares
from rotary_error_monitor.metrology.reading_steps import step_of
from rotary_error_monitor.signals.reading_noise import noise_of
from rotary_error_monitor.twin.recording import SignalStream, StageRecording
from rotary_error_monitor.twin.stage import NEIGHBOURS, StageTwin

AS_SOLD = 0.01 / float(np.sqrt(3.0))
"""Standard uncertainty of zero and sensitivity of a load cell of which nobody states one, parts of its rated output.

Data sheets of strain-gauge load cells allow 1 % of each either way, anything within being as likely.
"""


def uncertain_forces(twin: StageTwin, recording: StageRecording) -> tuple[OtherTwin, ...]:
    """Twins with one standard uncertainty of the force on the shaft more.

    Of each axis of its load cells that is the zero of one that is listed, and half a step of a reading: less, which is
    a zero, or closer to 0. Of all it is a part of the force itself, see `_diluted`.
    """
    names = [name for name, sensor in twin.stage.inputs.items() if sensor.measures == SHAFT_FORCE]
    pushed: list[Pushed | Scaled] = []
    if names:
        sensors = [twin.stage.inputs[name] for name in names]
        cells = [load_cell(sensor) for sensor in sensors]
        for part in zip(names, sensors, cells, shares(cells), strict=True):
            pushed += _of_listed_cell(*part, recording)
        variances = [(each.noise**2 + each.resolution**2 / 4) / each.gain**2 for each in sensors]
    elif FORCE in recording.streams:
        read = recording.streams[FORCE]
        steps = [step_of(axis) for axis in read.values.T]
        seen = noise_of(read.values)
        for axis, (step, noise) in enumerate(zip(steps, seen, strict=True)):
            pushed += _of_own_cell(read, axis, step, float(noise))
        variances = [float(noise**2) + step**2 / 4 for noise, step in zip(seen, steps, strict=True)]
    if FORCE in recording.streams:
        pushed += _diluted(recording.streams[FORCE], max(variances))
    return tuple(OtherTwin(twin, push) for push in pushed)


def uncertain_load_cells(twin: StageTwin, recording: StageRecording) -> tuple[OtherTwin, ...]:
    """Twins with one standard uncertainty more of what a load cell is set to; none where no force acts.

    Its rated output is the most that it read, at least. What it reads is filtered below half the rate of its samples,
    which delays it by up to one of them.
    """
    if FORCE not in recording.streams or not np.any(twin.inputs.force(recording.streams[FORCE].time)):
        return ()
    return tuple(OtherTwin(twin, each) for each in _changes(twin, recording))


def _changes(twin: StageTwin, recording: StageRecording) -> Iterator[Pushed | Scaled | Late]:
    read, stated = recording.streams[FORCE], twin.stage.uncertainty
    if not any(sensor.measures == SHAFT_FORCE for sensor in twin.stage.inputs.values()):  # those state their own zero
        zero = stated.get(OWN_LOAD_CELL, AS_SOLD * float(np.abs(read.values).max()))
        # readings within the noise are no force, whatever the zero is
        yield from (Pushed(zero * axis, where_it_acts=True) for axis in np.eye(2))
    yield Scaled(stated.get(f"{OWN_LOAD_CELL}_gain", AS_SOLD))
    yield Late(twin.inputs.force, stated.get(f"{OWN_LOAD_CELL}_timing", read.period))


@dataclass(frozen=True)
class ForceNoise:
    """Noise of the load cells, which moves what the twin predicts as a force would.

    Attributes:
        pushed: twins with one standard deviation of it more where a force acts, along each axis.
        period: of the samples of the force, s: within it, readings of other sensors share it.
    """

    pushed: tuple[OtherTwin, ...] = ()
    period: float = 0.0

    @classmethod
    def of(cls, twin: StageTwin, recording: StageRecording) -> ForceNoise:
        """As the readings of the force show it."""
        if FORCE not in recording.streams:
            return cls()
        read = recording.streams[FORCE]
        pushes = (Pushed(force, where_it_acts=True) for force in np.diag(noise_of(read.values)))
        return cls(tuple(OtherTwin(twin, push) for push in pushes), read.period)

    def squares(self, twin: StageTwin, stream: str) -> Array:
        """(n, fields) of what it adds to the predictions of a stream; those that share it count as one."""
        base = twin.predict((), [stream])[stream]
        moved = [np.square(push.beside(twin).predict((), [stream])[stream] - base) for push in self.pushed]
        period = float(np.median(np.diff(twin.times[stream]))) if len(base) > 1 else np.inf
        return np.asarray(sum(moved, np.zeros_like(base)) * max(self.period / period, 1.0), np.float64)


def _diluted(read: SignalStream, variance: float) -> Iterator[Scaled]:
    """What noise of the readings hides of a compliance: regression dilution (Fuller 1987, Equation 1.1.6).

    Steps count as half of them, which is the most: a reading on the edge of one jumps between two values.
    """
    part = variance / max(float(np.mean(np.square(read.values))), variance)
    if part > FIRST_ORDER:
        yield Scaled(part)


def _of_listed_cell(
    name: str, sensor: ListedSensor, cell: LoadCell, share: Array, recording: StageRecording
) -> Iterator[Pushed]:
    directions = [share @ axis / abs(cell.gain) for axis in cell.directions]
    if sensor.uncertainty:
        yield from (Pushed(sensor.uncertainty * direction) for direction in directions)
    read = recording.streams[name]
    if _matters(sensor.resolution, read.values[:, : cell.axes] - np.array(sensor.zeros[: cell.axes])):
        width = float(np.hypot(sensor.noise, sensor.resolution))
        for axis, direction in enumerate(directions):
            yield from _cut_off(sensor.resolution * direction, _side(read, axis, width))


def _of_own_cell(read: SignalStream, axis: int, step: float, noise: float) -> Iterator[Pushed]:
    """How the load cell of a topic of its own rounds, whose steps it shows."""
    if _matters(step, read.values):
        yield from _cut_off(step * np.eye(2)[axis], _side(read, axis, float(np.hypot(noise, step))))


def _cut_off(step: Array, side: Course) -> Iterator[Pushed]:
    """Half a step (2,) less and half a step closer to 0, where a force acts."""
    yield Pushed(step / 2, where_it_acts=True)
    yield Pushed(step / 2, side, where_it_acts=True)


def _matters(step: float, force: Array) -> bool:
    """Whether half a step is more of a force (n, k), along the axes of a cell, than what a twin may be wrong by."""
    return step / 2 > FIRST_ORDER * float(np.abs(force).max())


def _side(read: SignalStream, axis: int, width: float) -> Course:
    """Which side of zero a cell is on: 1 or -1, in between where neighbours read less than `width` in the mean.

    A single reading is there by its noise, and one that is cut off towards zero is right in the mean around it.
    """
    mean = uniform_filter1d(read.values[:, axis], NEIGHBOURS, mode="mirror")
    side = np.clip(mean / max(width, np.finfo(np.float64).tiny), -1.0, 1.0)
    return lambda time: np.interp(time, read.time, side)
