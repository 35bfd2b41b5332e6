"""What a run of the mock cell shows: accuracy against the true stage and machine, samples lost, latencies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.codec.contents import JointState
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE, REFERENCE_TITLE
from rotary_error_monitor.description.wire import Topic, Wire, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.radial_comparison import RadialComparison, compare_radial
from rotary_error_monitor.mock_cell.recorded import RecordedTopics
from rotary_error_monitor.mock_cell.run import FORCE_CYCLE, SPEEDS, MockCell, RunOutcome, seconds
from rotary_error_monitor.pipeline.corrections import OFFSET
from rotary_error_monitor.plant.machine import MachinePlant, make_poses
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.recordings.replayed import Replay
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion

SETTLING_NS = 500_000_000
"""Left out after the start and each setting of the reference: processes find one another, the probe comes to rest."""

_LARGEST = 5e-7
"""Difference of estimate and reference that no single pair of them shall exceed, m: ten times its noise."""


_CORRECTIONS = "axis_corrections"


@dataclass(frozen=True)
class BoundedFigure:
    """One figure and its bound.

    Attributes:
        name: what was measured, with its unit.
        value: the figure.
        bound: largest value that is right; None where there is none.
        digits: digits after the point.
        place: where it comes from, told where it is not right.
    """

    name: str
    value: float
    bound: float | None = None
    digits: int = 3
    place: str = ""

    @property
    def ok(self) -> bool:
        """Whether the figure is finite and within its bound."""
        return bool(np.isfinite(self.value)) and (self.bound is None or self.value <= self.bound)


@dataclass(frozen=True)
class TrueOffsets:
    """Tool offset of the true machine at n times.

    Attributes:
        stamp_ns: (n,) timestamp (ns).
        before: (n, 6) without correction: shift of the tip (m), change of the tool axis (rad).
        after: the same with the correction of that time.
        delayed: the same with the correction that had arrived by then, `age` (n,) s old.
    """

    stamp_ns: NDArray[np.int64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    delayed: NDArray[np.float64]
    age: NDArray[np.float64]


@dataclass(frozen=True)
class CellResult:
    """What a run showed.

    Attributes:
        rows: figures with their bounds.
        comparisons: with the reference, by its height (m).
        offsets: of the tool.
        force: (k, 3) time after the mock stage's start (s) and external force x, y (N).
    """

    rows: list[BoundedFigure]
    comparisons: dict[float, RadialComparison]
    offsets: TrueOffsets
    force: NDArray[np.float64]

    @property
    def ok(self) -> bool:
        """Whether every figure is within its bound."""
        return all(row.ok for row in self.rows)


def figures(cell: MockCell, recording: RunOutcome, stage: StageDescription, machine: MachineDescription) -> CellResult:
    """All figures of a run.

    Raises:
        InputError: the bag lacks a topic that every cell has.
    """
    wire = wire_of(stage)
    recorded = RecordedTopics(
        recording.bag, [topic for topic in wire if topic.is_sample_block or topic.key == _CORRECTIONS]
    )
    replayed = replay_bag(recording.bag, stage, machine)
    plant = mock_stage(stage, MockSettings(cell.seed, recording.epoch_ns, SPEEDS, True, cell.rate, FORCE_CYCLE))
    comparisons = dict(reference_comparisons(recording, recorded, wire, stage, replayed))
    offsets = true_offsets(recording, recorded, wire, machine, plant)
    rows = [
        *_accuracy(comparisons, recording, recorded, wire),
        *_offset_rows(offsets),
        *_repetition(recorded, wire, replayed, recording.heights[0][1]),
        *_losses(recorded, wire, recording.heights[0][1]),
        *_latencies(recorded, wire, recording.heights[0][1]),
        BoundedFigure("processes that did not end with exit code 0", len(recording.failures), 0, 0),
    ]
    times, force = recorded.samples(wire.topic("force_samples"))
    return CellResult(rows, comparisons, offsets, np.column_stack([seconds(times, recording.epoch_ns), force]))


def reference_comparisons(
    recording: RunOutcome, recorded: RecordedTopics, wire: Wire, stage: StageDescription, replayed: Replay
) -> Iterator[tuple[float, RadialComparison]]:
    """Comparison with the reference at each height at which it stood.

    Raises:
        InputError: the stage has no reference of its own, or the bag lacks its samples.
    """
    if stage.reference is None:
        raise InputError(f"the stage has no section '{OWN_REFERENCE}'")
    times, radial = recorded.samples(wire.of_stream(OWN_REFERENCE), response=stage.responses.get(OWN_REFERENCE))
    period = int(np.diff(replayed.stamp_ns).min())
    motion = replayed.motion
    for height, begin_ns, end_ns in recording.heights:
        there = (times >= begin_ns + SETTLING_NS) & (times < end_ns)
        when = (replayed.stamp_ns >= begin_ns + SETTLING_NS) & (replayed.stamp_ns < end_ns)
        part = motion.at(when)
        set_so = replace(stage.reference, height=height)
        yield height, compare_radial(replayed.stamp_ns[when], part, set_so, times[there], radial[there], period)


def _accuracy(
    comparisons: dict[float, RadialComparison], recording: RunOutcome, recorded: RecordedTopics, wire: Wire
) -> Iterator[BoundedFigure]:
    times, force = recorded.samples(wire.topic("force_samples"))
    for (height, found), (_, begin_ns, end_ns) in zip(comparisons.items(), recording.heights, strict=True):
        name = f"radial error motion at h = {height * 1e3:.0f} mm"
        there = (times >= begin_ns + SETTLING_NS) & (times < end_ns)
        yield BoundedFigure(
            f"{name}: external force on the shaft, N", float(np.linalg.norm(force[there], axis=1).max()), digits=0
        )
        yield BoundedFigure(f"{name}: peak to peak, µm", float(np.ptp(found.reference, axis=0).max()) * 1e6)
        yield BoundedFigure(f"{name}: RMS against {REFERENCE_TITLE}, µm", found.rms * 1e6, 0.10)
        yield _maximum(name, found, recording.epoch_ns)
        yield BoundedFigure(f"{name}: outside their 95 % bounds, %", 100 * (1 - found.inside), 7.0, 1)


def _maximum(name: str, found: RadialComparison, epoch_ns: int) -> BoundedFigure:
    """The largest difference, when it was, and what stood beside it."""
    differences = np.abs(found.estimate - found.reference)
    tick, axis = divmod(int(np.argmax(differences)), differences.shape[1])
    beside = slice(max(0, tick - 2), tick + 3)
    estimate, reference = (np.round(values[beside, axis] * 1e6, 3) for values in (found.estimate, found.reference))
    std = found.std[tick, axis] * 1e6
    place = (
        f"{seconds(found.stamp_ns[tick], epoch_ns):.3f} s after the start, stamp {found.stamp_ns[tick]}, along "
        f"{'xy'[axis]}: estimate {estimate} µm, {REFERENCE_TITLE} {reference} µm, standard deviation {std:.3f} µm; "
        f"{np.count_nonzero(differences > _LARGEST)} differences are beyond {_LARGEST * 1e6:g} µm"
    )
    told = f"{name}: maximum against {REFERENCE_TITLE}, µm"
    return BoundedFigure(told, found.maximum * 1e6, _LARGEST * 1e6, place=place)


def true_offsets(
    recording: RunOutcome, recorded: RecordedTopics, wire: Wire, machine: MachineDescription, plant: StagePlant
) -> TrueOffsets:
    """True tool offset without correction, and with the correction that was in force at each time."""
    stamps, arrived, values = _corrections(recorded, wire.topic(_CORRECTIONS), machine)
    late = stamps > stamps[0] + SETTLING_NS
    in_force = np.maximum(np.searchsorted(arrived, stamps[late], side="right") - 1, 0)
    motion = MachineMotion(machine, plant)
    states = [motion.at(int(stamp)) for stamp in stamps[late]]
    positions = np.array([[axis.position for axis in state] for state in states])
    directions = np.sign([[axis.velocity for axis in state] for state in states])
    scene = plant.scene(seconds(stamps[late], recording.epoch_ns))
    live = scene.error_motion.copy()
    live[:, 2] = np.nan  # no sensor sees axial motion: true is what the description says
    true = MachinePlant(machine)
    poses = make_poses(machine, positions, directions, scene.warming + machine.reference_temperature)
    axis = true.tool_axis(poses)
    before, after, delayed = (
        _tip_and_axis(true.tool_offset(poses, corrections, live), axis)
        for corrections in (None, values[late], values[in_force])
    )
    return TrueOffsets(stamps[late], before, after, delayed, (stamps[late] - stamps[in_force]) * 1e-9)


def _tip_and_axis(offset: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 6) shift of the tool tip, and change of the tool axis: the spin about it is nobody's error."""
    return np.hstack([offset[:, :3], np.cross(offset[:, 3:], axis)])


def _offset_rows(offsets: TrueOffsets) -> Iterator[BoundedFigure]:
    # the tool axis is corrected where the rotary axes reach it: not while the table lies level
    for name, part, unit, share in (("position", slice(0, 3), "µm", 0.05), ("tool axis", slice(3, 6), "µrad", 0.5)):
        before, after, delayed = (_rms(o[:, part]) * 1e6 for o in (offsets.before, offsets.after, offsets.delayed))
        yield BoundedFigure(f"tool offset, {name}, before correction: RMS, {unit}", before)
        yield BoundedFigure(f"tool offset, {name}, after correction: RMS, {unit}", after, share * before)
        age = f"{np.median(offsets.age) * 1e3:.0f} ms"
        yield BoundedFigure(f"tool offset, {name}, the axes moving on for {age}: RMS, {unit}", delayed)


def _rms(vectors: NDArray[np.float64]) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def _repetition(recorded: RecordedTopics, wire: Wire, replayed: Replay, since_ns: int) -> Iterator[BoundedFigure]:
    """Published numbers that the replay does not give again bit for bit, from when the recorder had found everyone."""
    assert replayed.tool_offset is not None
    for key, columns, again in (
        ("error_motion_samples", ("theta",), replayed.theta[:, None]),
        ("tool_offset_samples", OFFSET, replayed.tool_offset),
    ):
        topic = wire.topic(key)
        times, values = recorded.samples(topic, columns)
        times, values = times[times >= since_ns], values[times >= since_ns]
        index = np.clip(np.searchsorted(replayed.stamp_ns, times), 0, len(replayed.stamp_ns) - 1)
        same = (replayed.stamp_ns[index] == times) & (again[index] == values).all(axis=1)
        yield BoundedFigure(
            f"{topic.name}: published numbers that a replay does not repeat", float((~same).sum()), 0, 0
        )


_BESIDE = (f"{OWN_REFERENCE}_samples", "error_motion_heights_samples")
"""What stands still at times, and what has several rows for each tick of the estimate."""


def _losses(recorded: RecordedTopics, wire: Wire, since_ns: int) -> Iterator[BoundedFigure]:
    """Samples of the sensors that are missing, and ticks without estimate or offset: held, or too late to be true."""
    lost, without, ticks = 0, 0, 0
    for topic in wire:
        if not topic.is_sample_block or topic.key in _BESIDE or topic not in recorded:
            continue
        times, _ = recorded.samples(topic)
        steps = np.diff(times[times >= since_ns])
        if len(steps) < 2:
            continue
        missing = int(np.rint(steps / np.median(steps) - 1).sum())
        if topic.key in ("error_motion_samples", "tool_offset_samples"):
            without, ticks = without + missing, ticks + missing + len(steps)
        else:
            lost += missing
    yield BoundedFigure("samples lost", lost, 0, 0)
    yield BoundedFigure("ticks without estimate or offset, %", 100 * without / max(ticks, 1), 5.0, 2)


def _latencies(recorded: RecordedTopics, wire: Wire, since_ns: int) -> Iterator[BoundedFigure]:
    """Age of the latest sample in a block when the recorder had it."""
    for key, bound in (("error_motion_samples", None), ("tool_offset_samples", None)):
        topic = wire.topic(key)
        ages = np.array(list(_ages(recorded, topic, since_ns)))
        if len(ages) == 0:
            raise InputError(f"no message on {topic.name} once the cell corrects")
        for part in (50, 99):
            yield BoundedFigure(
                f"{topic.name}: age at the recorder, p{part}, ms", float(np.percentile(ages, part)) * 1e3, bound, 1
            )


def _ages(recorded: RecordedTopics, topic: Topic, since_ns: int) -> Iterator[float]:
    for block, arrival_ns in recorded.arrivals(topic):
        assert isinstance(block, SampleBlock)
        if block.stamp_ns >= since_ns:
            yield (arrival_ns - int(block.times_ns[-1])) * 1e-9


def _corrections(
    recorded: RecordedTopics, topic: Topic, machine: MachineDescription
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Stamp, time of arrival at the recorder, and values in the order of the machine's axes."""
    stamps, arrived, values = [], [], []
    for state, arrival_ns in recorded.arrivals(topic):
        assert isinstance(state, JointState)
        told = dict(zip(state.names, state.position.tolist(), strict=True))
        stamps.append(state.stamp_ns)
        arrived.append(arrival_ns)
        values.append([told[letter] for letter in machine.letters])
    return np.array(stamps), np.array(arrived), np.array(values)


def table(rows: list[BoundedFigure]) -> str:
    """The figures as text, a line each."""
    width = max(len(row.name) for row in rows)
    lines = []
    for row in rows:
        bound = (
            "" if row.bound is None else f"  at most {row.bound:.{row.digits}f}  {'ok' if row.ok else 'OUT OF BOUNDS'}"
        )
        place = "" if row.ok or not row.place else f": {row.place}"
        lines.append(f"{row.name:<{width}}  {row.value:>10.{row.digits}f}{bound}{place}")
    return "\n".join(lines)
