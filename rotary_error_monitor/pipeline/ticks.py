"""Error motion from what the streams of a stage show at the ticks, and what the ticks say about the streams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.metrology.encoder_heads import HeadLayout, RingPose, estimate_ring_pose
from rotary_error_monitor.metrology.error_motion import (
    BEND,
    ErrorMotion,
    bend_variance,
    head_variance,
    remove_eccentricity,
    remove_graduation,
    remove_mirror,
    tilt_variance,
)
from rotary_error_monitor.metrology.harmonics import planar_sum
from rotary_error_monitor.metrology.periodic_curves import curve
from rotary_error_monitor.pipeline import evidence
from rotary_error_monitor.pipeline.kernel import CommandParts, RingParts, TiltParts, chosen_kernel
from rotary_error_monitor.pipeline.mixed_rotation import described_lead
from rotary_error_monitor.pipeline.standing_rotor import RotorReadings
from rotary_error_monitor.signals.resampling import Resampled

TURN = 2 * np.pi

HIGHEST_ORDER = 12
"""Harmonics of the graduation up to which it is told what the heads cannot see."""


@dataclass(frozen=True)
class Ticks:
    """What m ticks show.

    Attributes:
        motion: error motion, before anything is doubted.
        evidence: (m, l) what they say about their streams, columns as in `pipeline.evidence`.
        parity: (m, h) contradiction of the heads, rad.
        disagreement: (m,) of the heads, in standard deviations.
        layout: of the heads that were used; None where there was none. Of several the last one.
        redundancy: (m,) contradictions among the heads that were used which would show.
        readings: (m, P) what the instruments read, of a stage without heads; else (m, 0).
    """

    motion: ErrorMotion
    evidence: NDArray[np.float64]
    parity: NDArray[np.float64]
    disagreement: NDArray[np.float64]
    layout: HeadLayout | None
    redundancy: NDArray[np.int64]
    readings: NDArray[np.float64]

    @staticmethod
    def joined(parts: Sequence[Ticks], order: NDArray[np.int64]) -> Ticks:
        """Parts one after another, and of all of these ticks those that `order` names."""
        joined = (
            np.concatenate([getattr(part, name) for part in parts])[order]
            for name in ("evidence", "parity", "disagreement", "redundancy", "readings")
        )
        evidence, parity, disagreement, redundancy, readings = joined
        layout = next((part.layout for part in reversed(parts) if part.layout is not None), None)
        motion = ErrorMotion.joined([part.motion for part in parts]).at(order)
        return Ticks(motion, evidence, parity, disagreement, layout, redundancy, readings)


class TickMaker:
    """Makes error motion of samples for one stage."""

    def __init__(
        self, stage: StageDescription, heads: Mapping[str, float], bits: Mapping[str, int], period: float
    ) -> None:
        """For ticks that are `period` (s) apart.

        Args:
            stage: description of the stage.
            heads: azimuth (rad) by name of the stream.
            bits: of each stream in a mask, by name.
            period: s.
        """
        self._bits = dict(bits)
        self._names_of: dict[int, tuple[str, ...]] = {}
        self._stage = stage
        self._heads = dict(heads)
        self._period = period
        self._readings = None if self._heads else RotorReadings(stage)
        self._layouts: dict[tuple[float, ...], HeadLayout] = {}
        self._unseen_orders: dict[HeadLayout, tuple[int, ...]] = {}
        for table in (stage.encoder and stage.encoder.graduation_table, stage.mirror.flatness_table):
            if table is not None:
                curve(table)  # now, not when a sample waits

    @property
    def readings(self) -> int:
        """Number P of readings that `make` gives beside the error motion."""
        return self._readings.count if self._readings else 0

    def layout(self, heads: tuple[str, ...]) -> HeadLayout | None:
        """Layout of some heads; None for none."""
        azimuths = tuple(self._heads[name] for name in heads)
        if not azimuths:
            return None
        if azimuths not in self._layouts:
            self._layouts[azimuths] = HeadLayout(azimuths)
        return self._layouts[azimuths]

    def unseen_orders(self, layout: HeadLayout) -> tuple[int, ...]:
        """Harmonics of the graduation, up to `HIGHEST_ORDER`, that heads of a layout cannot contradict."""
        if layout not in self._unseen_orders:
            self._unseen_orders[layout] = layout.hidden_orders(HIGHEST_ORDER)
        return self._unseen_orders[layout]

    def make_each(
        self,
        sampled: Mapping[str, Resampled],
        there: NDArray[np.int64],
        used: NDArray[np.int64],
        rates: Mapping[str, float],
        described: Resampled | None = None,
    ) -> Ticks:
        """As `make`, where each of m ticks has streams of its own: (m,) masks of those that are there and used."""
        groups = set(zip(there.tolist(), used.tolist(), strict=True))
        if len(groups) == 1:
            (both,) = groups
            return self.make(sampled, self._names(both[0]), self._names(both[1]), rates, described)
        parts, places = [], []
        for both in groups:
            chosen = np.flatnonzero((there == both[0]) & (used == both[1]))
            some = {name: each.at(chosen) for name, each in sampled.items()}
            part = None if described is None else described.at(chosen)
            parts.append(self.make(some, self._names(both[0]), self._names(both[1]), rates, part))
            places.append(chosen)
        return Ticks.joined(parts, np.argsort(np.concatenate(places)))

    def _names(self, mask: int) -> tuple[str, ...]:
        """Streams of a bit mask."""
        if mask not in self._names_of:
            self._names_of[mask] = tuple(name for name, bit in self._bits.items() if mask & bit)
        return self._names_of[mask]

    def make(
        self,
        sampled: Mapping[str, Resampled],
        there: tuple[str, ...],
        used: tuple[str, ...],
        rates: Mapping[str, float],
        described: Resampled | None = None,
    ) -> Ticks:
        """Error motion at ticks at which the streams `there` have a value, from those of them that are `used`.

        Args:
            sampled: the streams at the ticks, by name.
            there: streams that have a value at all of these ticks.
            used: those of them that are believed, as far as heads are meant.
            rates: samples per s of each stream.
            described: where it is valid, what is described of the tilts that are read, interpolated as these are.
        """
        count = len(next(iter(sampled.values())).gain)
        motion, seen = ErrorMotion.unknown(count), np.zeros((count, len(evidence.COLUMNS)))
        parity, disagreement = np.zeros((count, len(self._heads))), np.zeros(count)
        if not self._heads and COMMAND in there:
            self._put_commanded(motion, seen, sampled[COMMAND].values)
            if AUTOCOLLIMATOR in there:
                parts = self._tilt_parts(motion.theta, sampled[AUTOCOLLIMATOR], described, rates[AUTOCOLLIMATOR])
                _put_tilt(motion, seen, parts)
        heads = tuple(name for name in self._heads if name in used)
        everyone = tuple(name for name in self._heads if name in there)
        layout, ring = self._ring(heads, sampled, rates)
        if layout is not None and ring is not None:
            disagreement = ring.disagreement
            parity[:, : layout.redundancy] = ring.parity
            bends = [sampled[name].bend for name in heads]
            seen_ring = self._ring_parts(layout, ring, bends, [rates[name] for name in heads])
            tilt: TiltParts | None = None
            command: CommandParts | None = None
            if AUTOCOLLIMATOR in there:
                tilt = self._tilt_parts(ring.theta, sampled[AUTOCOLLIMATOR], described, rates[AUTOCOLLIMATOR])
            if COMMAND in there:
                both = np.concatenate([*bends, sampled[COMMAND].bend], axis=1)
                command = CommandParts(sampled[COMMAND].values[:, 0], both)
            self._put(motion, seen, seen_ring, tilt, command)
            if not layout.tells_rotation:
                _put_part(motion, layout, seen_ring)
        whole = ring if everyone == heads else self._ring(everyone, sampled, rates)[1]
        if whole is not None:
            seen[:, evidence.INDEX["agreement"]] = whole.disagreement**2
        readings = self._readings.read(sampled, there, count) if self._readings else np.empty((count, 0))
        redundancy = np.full(count, 0 if layout is None else layout.redundancy)
        return Ticks(motion, seen, parity, disagreement, layout, redundancy, readings)

    def _ring(
        self, heads: tuple[str, ...], sampled: Mapping[str, Resampled], rates: Mapping[str, float]
    ) -> tuple[HeadLayout | None, RingPose | None]:
        """Layout and pose by some heads; none where there is none.

        Heads that do not tell the rotation free of displacement tell it as far as that is described.
        """
        layout = self.layout(heads)
        if layout is None:
            return None, None
        encoder = self._stage.ring
        readings = np.concatenate([sampled[name].values for name in heads], axis=1)
        readings = remove_graduation(readings, np.array(layout.azimuths), encoder)
        if not layout.tells_rotation:
            readings = readings - described_lead(self._stage, layout.azimuths, readings)
        gain = np.concatenate([sampled[name].gain[:, None] for name in heads], axis=1)
        travel, bend = (
            np.concatenate([getattr(sampled[name], each) for name in heads], axis=1) for each in ("travel", "bend")
        )
        # heads miss alike, but the samples of one around a tick may hide what those of another show
        bend = np.abs(bend).max(axis=1, keepdims=True)
        speed = (travel * [rates[name] / 3.0 for name in heads]).max(axis=1, keepdims=True)  # over three intervals
        variance = head_variance(encoder, gain, travel, bend, self._stage.timing("encoder") * speed)
        return layout, estimate_ring_pose(layout, encoder.disc_radius, readings, variance)

    def _ring_parts(
        self, layout: HeadLayout, ring: RingPose, bends: Sequence[NDArray[np.float64]], rates: Sequence[float]
    ) -> RingParts:
        """What heads show, by their third differences (m, 1) and the samples per s that each of them gives."""
        stage, slowest = self._stage, min(rates)
        # heads of one rate miss nearly alike; what one that is slower misses displaces the ring by twice its share
        alone = 2.0 if evidence.are_uneven(rates) else 1.0
        radial = remove_eccentricity(ring.centre, ring.theta, stage.ring)
        # what of the displacement is predicted, as far as these heads see it
        described = planar_sum(stage.spindle.radial, ring.theta) @ layout.view[1]
        predicted = (ring.centre - radial) @ layout.view[1] + described
        if not layout.tells_rotation:  # it is off the readings
            predicted = np.zeros_like(predicted)
        return RingParts(
            ring.theta,
            ring.centre,
            radial,
            described,
            predicted,
            ring.seen,
            ring.covariance,
            ring.disagreement,
            None if len(layout.observable) == 3 else self._radial_variance(layout, ring),
            np.asarray(alone * sum(bends[1:], bends[0])[:, 0] / len(bends)),
            "x" in layout.observable,
            "y" in layout.observable,
            min(1.0, slowest * self._period),
        )

    @staticmethod
    def _put(
        motion: ErrorMotion,
        seen: NDArray[np.float64],
        ring: RingParts,
        tilt: TiltParts | None,
        command: CommandParts | None,
    ) -> None:
        kernel = chosen_kernel()
        if kernel is not None:
            kernel.put(motion, seen, ring, tilt, command, BEND)
            return
        _put_ring(motion, seen, ring)
        if tilt is not None:
            _put_tilt(motion, seen, tilt)
        if command is not None:
            _put_command(motion, seen, command, ring)

    @staticmethod
    def _put_commanded(motion: ErrorMotion, seen: NDArray[np.float64], command: NDArray[np.float64]) -> None:
        """The rotation of a stage without heads; how far it is from the command is not observable."""
        motion.theta[:] = seen[:, evidence.INDEX["theta"]] = command[:, 0]
        seen[:, evidence.INDEX["velocity"]] = command[:, 1]
        seen[:, evidence.INDEX["commanded"]] = 1.0

    def _radial_variance(self, layout: HeadLayout, ring: RingPose) -> NDArray[np.float64]:
        """The larger variance of what heads see along x and y that do not see all, m²."""
        # theta is seen free of the displacement: its variance is that of the readings over the number of heads
        reading = ring.covariance[:, 0, 0] / (layout.weights[0] ** 2).sum()
        largest = (layout.view[0] ** 2).sum(axis=1).max() or 1.0  # of one head, which sees none, that of its reading
        return np.asarray(reading * self._stage.ring.disc_radius**2 * largest)

    def _tilt_parts(
        self, theta: NDArray[np.float64], sampled: Resampled, described: Resampled | None, rate: float
    ) -> TiltParts:
        """What the autocollimator shows that gives so many samples per s."""
        stage = self._stage
        motion, bend = planar_sum(stage.spindle.tilt, theta), sampled.bend
        tilt = remove_mirror(sampled.values, theta, stage.mirror)
        surplus = tilt - motion
        if described is not None:
            own = described.valid[:, None]
            surplus = np.where(own, sampled.values - described.values, surplus)
            tilt, bend = np.where(own, surplus + motion, tilt), np.where(own, bend - described.bend, bend)
        variance = tilt_variance(stage.tilt_instrument, sampled.gain[:, None], sampled.travel, bend)
        return TiltParts(sampled.values, tilt, surplus, variance, min(1.0, rate * self._period))


def _put_ring(motion: ErrorMotion, seen: NDArray[np.float64], ring: RingParts) -> None:
    index = evidence.INDEX
    motion.theta[:] = ring.theta
    for axis, (name, is_seen) in enumerate((("x", ring.sees_x), ("y", ring.sees_y))):
        if is_seen:
            motion.components[:, axis] = ring.radial[:, axis]
            motion.covariance[:, axis, axis] = ring.covariance[:, 1 + axis, 1 + axis]
            motion.observable[:, axis] = True
            seen[:, index[f"centre_{name}"]] = ring.centre[:, axis]
    seen[:, [index["surplus_x"], index["surplus_y"]]] = ring.seen - ring.predicted
    seen[:, [index["described_x"], index["described_y"]]] = ring.described
    motion.covariance[:, 0, 1] = motion.covariance[:, 1, 0] = ring.covariance[:, 1, 2]
    seen[:, index["theta"]] = ring.theta
    seen[:, index["heads"]] = 1.0
    seen[:, index["radial"]] = ring.sees_x and ring.sees_y
    seen[:, index["believed_agreement"]] = ring.disagreement**2
    both = ring.covariance[:, 1, 1], ring.covariance[:, 2, 2]
    seen[:, index["radial_variance"]] = np.maximum(*both) if ring.variance is None else ring.variance
    seen[:, index["head_samples"]] = ring.samples
    seen[:, index["head_bend"]] = ring.bend


def _put_part(motion: ErrorMotion, layout: HeadLayout, ring: RingParts) -> None:
    """Put what heads see of the displacement, where that is not all of it, until they are told apart."""
    if ring.variance is None or not layout.view[1].any():
        return
    motion.components[:, :2], motion.observable[:, :2] = ring.seen - ring.predicted + ring.described, True
    motion.covariance[:, 0, 0] = motion.covariance[:, 1, 1] = ring.variance


def _put_tilt(motion: ErrorMotion, seen: NDArray[np.float64], parts: TiltParts) -> None:
    index = evidence.INDEX
    for axis, name in enumerate(("x", "y")):
        motion.covariance[:, 3 + axis, 3 + axis] = parts.variance[:, axis]
        seen[:, index[f"tilt_{name}"]] = parts.read[:, axis]
        seen[:, index[f"tilt_surplus_{name}"]] = parts.surplus[:, axis]
    motion.components[:, 3:5], motion.observable[:, 3:5] = parts.tilt, True
    seen[:, index["tilt"]] = 1.0
    seen[:, index["tilt_samples"]] = parts.samples
    seen[:, index["tilt_variance"]] = motion.covariance[:, 3, 3]


def _put_command(motion: ErrorMotion, seen: NDArray[np.float64], command: CommandParts, ring: RingParts) -> None:
    index = evidence.INDEX
    distance = ring.theta - command.angle
    # whole turns are no positioning error: heads and command count from zeros of their own
    turns = np.rint(distance / TURN)
    if turns.any():
        distance = distance - TURN * turns
        motion.theta[:] -= TURN * turns
    motion.components[:, 5], motion.observable[:, 5] = distance, True
    motion.covariance[:, 5, 5] = ring.covariance[:, 0, 0] + bend_variance(command.bends)
    motion.covariance[:, :2, 5] = motion.covariance[:, 5, :2] = ring.covariance[:, 0, 1:]
    seen[:, index["command"]] = 1.0
    seen[:, index["ecc"]] = distance
    seen[:, index["command_bend"]] = command.bends[:, -1]
    seen[:, index["turns"]] = turns
