"""What of an estimate goes out: nothing that is not believed, and uncertainties as large as they were seen to be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, cached_property
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.description.two_axis_section import DISTORTIONS
from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.metrology.periodic_curves import curve_in_radial
from rotary_error_monitor.metrology.responses import distortion_variance
from rotary_error_monitor.pipeline.evidence import EVERYWHERE, INDEX, SIGMAS, TILT, WINDOW_NS
from rotary_error_monitor.pipeline.kernel import StatedStructure, chosen_kernel
from rotary_error_monitor.pipeline.ring_belief import ABSENT
from rotary_error_monitor.pipeline.verdict import DOUBTS, InputVerdict

_UNCERTAIN = ("head_scale", "tilt_scale", "lag", "unresolved", "unresolved_tilt")
_REALS, _INTEGERS = (*_UNCERTAIN, "most"), ("excluded", "doubts", "settled")
_BY_HEADS = (0, 1, 5)
"""Places of the components that the heads show."""
_ROWS_BY_HEADS, _COLUMNS_BY_HEADS = np.transpose(list(product(_BY_HEADS, repeat=2)))


@dataclass(frozen=True)
class Decision:
    """What a live run decided for one tick.

    Attributes:
        streams: bit mask of the streams that were used.
        doubts, head_scale, tilt_scale, lag, unresolved, unresolved_tilt: as in `InputVerdict`; none where a run of an
            earlier version did not say.
        sensor_scale, sensor_conflict: by which standard deviations of the listed sensors were multiplied.
    """

    streams: int
    doubts: int | None = None
    head_scale: float = 1.0
    tilt_scale: float = 1.0
    lag: float = 0.0
    unresolved: float = 0.0
    unresolved_tilt: float = 0.0
    sensor_scale: float = 1.0
    sensor_conflict: float = 1.0


Decisions: TypeAlias = Mapping[int, Decision]
"""Decisions by the stamp (ns) of their tick."""


def decision_rows(motion: ErrorMotion) -> NDArray[np.float64]:
    """(m, 9) what the run decided that published it: a row for each tick, numbers in the order of `Decision`."""
    return np.column_stack([getattr(motion, each.name) for each in fields(Decision)]).astype(np.float64)


class Believed:
    """What is believed at m ticks, as arrays (m,) of what an `InputVerdict` holds for one.

    Attributes:
        reals, integers: (m, 15) and (m, 3) all of it, of which the others are views; columns as in
            compiled/publication.h.
    """

    def __init__(self, verdicts: Sequence[tuple[slice, InputVerdict]]) -> None:
        """What the verdicts say, each of some ticks, which follow one upon another from the first tick on."""
        counts = [where.stop - where.start for where, _ in verdicts]
        reals = [
            (*(getattr(each, name) for name in _REALS), *each.tilt, *each.ecc, *each.radial) for _, each in verdicts
        ]
        whole = [[getattr(each, name) for name in _INTEGERS] for _, each in verdicts]
        self.reals = np.repeat(np.array(reals, np.float64), counts, axis=0)
        self.integers = np.repeat(np.array(whole, np.int64), counts, axis=0)
        self.head_scale, self.tilt_scale, self.lag, self.unresolved, self.unresolved_tilt, self.most, *_ = self.reals.T
        self.excluded, self.doubts, self.settled = self.integers.T
        reaches = self.reals[:, len(_REALS) :]
        self.reach = {name: reaches[:, 3 * i : 3 * i + 3] for i, name in enumerate(("tilt", "ecc", "radial"))}

    def has(self, doubt: str) -> NDArray[np.bool_]:
        """(m,) whether there is that doubt."""
        return np.asarray(self.doubts >> DOUBTS.index(doubt) & 1 == 1)

    def within(self, name: str, x: NDArray[np.float64], y: NDArray[np.float64] | float = 0.0) -> NDArray[np.bool_]:
        """(m,) whether a vector is where it can be."""
        reach = self.reach[name]
        return np.asarray(np.maximum(np.abs(x - reach[:, 0]), np.abs(y - reach[:, 1])) <= reach[:, 2])

    def repeat(self, place: int, decision: Decision) -> None:
        """A live run decided at one tick: what it did not use is not used, what it found uncertain is as uncertain."""
        self.excluded[place] = ~decision.streams
        for name in ("tilt", "ecc"):  # what was out of its reach was not used
            self.reach[name][place] = EVERYWHERE
        if decision.doubts is None:
            return
        # which heads there were, and which of them might have lost counts, the live run knew
        self.doubts[place] = self.doubts[place] & ~(1 << DOUBTS.index("redundancy")) | decision.doubts
        self.settled[place] = -1
        for name in _UNCERTAIN:
            getattr(self, name)[place] = getattr(decision, name)


class Publication:
    """Turns a stage's error motion into what may be published."""

    def __init__(self, stage: StageDescription, bits: Mapping[str, int]) -> None:
        """Publication for `stage`, with the `bits` of its streams."""
        encoder = stage.encoder or ABSENT
        self._radius, self._most = encoder.disc_radius, stage.limits.radial
        self._bits, self._commanded = bits, stage.encoder is None
        others = (AUTOCOLLIMATOR, COMMAND, *stage.sensors)
        self._heads = sum(bit for name, bit in bits.items() if name not in others)
        self._assembly = AssemblyVariance.of(stage)
        # The smallest fault that shows is the internal reliability of geodesy (Baarda 1968): without redundancy a step
        # of one head shows only where no bearing makes it within a window. Its distribution is taken as rectangular,
        # as an unknown within bounds is (JCGM 100:2008, 4.3.7).
        # One of heads and command may round to the next count, the other down.
        self._rounding = encoder.resolution**2 / 12.0
        self._unseen = (stage.limits.radial_rate * WINDOW_NS * 1e-9) ** 2 / 3.0
        # What a description that was not held against a turn yet can be off by is bounded by what the stage can do.
        self._unproven = {"radial": stage.limits.radial**2 / 3.0, "tilt": stage.limits.tilt**2 / 3.0}
        self._stated = self._packed()

    def _packed(self) -> StatedStructure:
        """All of it as the library takes it."""
        return StatedStructure(
            most=self._most,
            sigmas=SIGMAS,
            unseen=self._unseen,
            radial=self._assembly.radial,
            tilt=self._assembly.tilt,
            along=self._assembly.gain,
            across=self._assembly.roll,
            radius_square=self._radius**2,
            rounding=self._rounding,
            autocollimator=self._bits["autocollimator"],
            command=self._bits["command"],
            heads=self._heads,
            commanded=self._commanded,
            **{f"unproven_{name}": variance for name, variance in self._unproven.items()},
            **{f"doubt_{name}": 1 << DOUBTS.index(name) for name in ("heads", "ring", "unverified", "unverified_tilt")},
        )

    def finish(
        self,
        ticks: NDArray[np.int64],
        motion: ErrorMotion,
        evidence: NDArray[np.float64],
        streams: NDArray[np.int64],
        disagreement: NDArray[np.float64],
        redundancy: NDArray[np.int64],
        believed: Believed,
        late: NDArray[np.float64] | None = None,
    ) -> tuple[ErrorMotion, NDArray[np.bool_]]:
        """Error motion at ticks (ns) completed, from the `streams` that are used, and which of it may go out (m,).

        Its four first arrays are those of `motion`, changed in place. `late` is the variance (m, 2) of the tilt, rad²,
        by when the autocollimator read it.
        """
        kernel, streams = chosen_kernel(), np.array(streams)
        publish, beside = None, self._assembly.by_distortion(*(evidence[:, place] for place in TILT))
        if late is not None:
            beside = late if beside is None else beside + late
        if kernel is not None:
            inputs = (evidence, disagreement, _bounds(int(redundancy.max(initial=0))), beside, redundancy)
            publish = kernel.publish(self._stated, motion, inputs, (believed.reals, believed.integers), streams)
        if publish is None:
            streams, publish = self._finish(motion, evidence, streams, disagreement, redundancy, believed, beside)
        said = {name: getattr(believed, name) for name in ("doubts", *_UNCERTAIN)}
        return motion.said_of(ticks, streams, said), publish

    def _finish(
        self,
        motion: ErrorMotion,
        evidence: NDArray[np.float64],
        streams: NDArray[np.int64],
        disagreement: NDArray[np.float64],
        redundancy: NDArray[np.int64],
        believed: Believed,
        beside: NDArray[np.float64] | None,
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Streams that are used, and which ticks may go out."""
        seen = {name: evidence[:, place] for name, place in INDEX.items()}
        far = ~believed.within("tilt", seen["tilt_surplus_x"], seen["tilt_surplus_y"]) & (seen["tilt"] > 0)
        streams = np.where(far, streams & ~self._bits["autocollimator"], streams)
        far = ~believed.within("ecc", seen["ecc"]) & (seen["command"] > 0)
        streams = np.where(far, streams & ~self._bits["command"], streams)
        unsettled = (redundancy == 0) & (streams & self._heads & ~believed.settled != 0)
        believed.doubts[unsettled] |= 1 << DOUBTS.index("unverified")
        near = believed.within("radial", seen["surplus_x"], seen["surplus_y"])
        self._raise_uncertainty(motion, seen, disagreement, redundancy, believed, beside)
        radial = np.hypot(seen["surplus_x"] + seen["described_x"], seen["surplus_y"] + seen["described_y"])
        ring = believed.has("ring") | (radial > self._most + SIGMAS * np.sqrt(seen["radial_variance"]))
        tilt = streams & self._bits["autocollimator"] == 0
        command = streams & self._bits["command"] == 0
        for which, places in ((ring, (0, 1)), (tilt, (3, 4)), (command, (5,))):
            if which.any():
                motion.hide(which, places)
        agree = (disagreement <= believed.most) & near & ~believed.has("heads")
        agree &= ~(command & self._commanded)  # without heads all is of the rotation that the command tells
        numbers = [motion.theta, *motion.components.T, *(getattr(believed, name) for name in _UNCERTAIN)]
        finite = np.isfinite(motion.covariance.reshape(-1, 36)).all(axis=1) & np.isfinite(numbers).all(axis=0)
        return streams, np.asarray(agree & finite)

    def _raise_uncertainty(
        self,
        motion: ErrorMotion,
        seen: Mapping[str, NDArray[np.float64]],
        disagreement: NDArray[np.float64],
        redundancy: NDArray[np.int64],
        believed: Believed,
        beside: NDArray[np.float64] | None,
    ) -> None:
        """What the heads contradict one another, at the tick or before, and what could go unseen, count as well."""
        bounds = _bounds(int(redundancy.max(initial=0)))
        heads = np.maximum(believed.head_scale**2, disagreement**2 / bounds[redundancy])
        motion.covariance[:, _ROWS_BY_HEADS, _COLUMNS_BY_HEADS] *= heads[:, None]
        unproven = np.where(believed.has("unverified"), self._unproven["radial"], 0.0)
        step = np.where(redundancy == 0, self._unseen, 0.0)
        # a head that is off shows as rotation as well as displacement where no other contradicts it
        head = np.where(redundancy == 0, unproven, 0.0)
        # Of a vector that turns with the rotor, each component has half of the square.
        radial = self._assembly.radial + 0.5 * believed.unresolved**2
        radial += unproven
        tilt = self._assembly.tilt + 0.5 * believed.unresolved_tilt**2
        tilt += np.where(believed.has("unverified_tilt"), self._unproven["tilt"], 0.0)
        x, y = seen["tilt_x"], seen["tilt_y"]
        about_x, about_y = self._assembly.linear(x, y), self._assembly.linear(y, x)
        if beside is not None:
            about_x, about_y = about_x + beside[:, 0], about_y + beside[:, 1]
        for place, added in (
            (0, step + radial),
            (1, step + radial),
            (3, tilt + about_x),
            (4, tilt + about_y),
            (5, (step + head) / self._radius**2 + believed.lag**2 + self._rounding),
        ):
            if place not in _BY_HEADS:
                motion.covariance[:, place, place] *= believed.tilt_scale**2
            motion.covariance[:, place, place] += np.where(motion.observable[:, place], added, 0.0)


@dataclass(frozen=True)
class AssemblyVariance:
    """Variance that the stated uncertainty of what is taken off adds to a component, m² and rad².

    A vector that turns with the rotor adds that of one of its components at each angle; so does each order, and a
    measured curve that of its values.

    Attributes:
        eccentricity, graduation: of the ring, to the radial error motion.
        mirror, flatness: of the mirror, to the tilt.
        gain, roll, zero: of the autocollimator, to the tilt; the first two for each rad² of what it reads, along the
            same axis and along the other.
        roll_angle, distortion: roll of the autocollimator, rad, and the standard uncertainties of its distortion.
    """

    eccentricity: float
    graduation: float
    mirror: float
    flatness: float
    gain: float = 0.0
    roll: float = 0.0
    zero: float = 0.0
    roll_angle: float = 0.0
    distortion: tuple[float, ...] = ()

    @staticmethod
    def of(stage: StageDescription) -> AssemblyVariance:
        """As a stage's description states it."""
        stated, encoder = stage.uncertainty, stage.encoder or ABSENT
        graduation = stated.get("encoder.graduation", 0.0) * math.sqrt(len(encoder.graduation))
        flatness = stated.get("mirror.flatness", 0.0) * math.sqrt(len(stage.mirror.flatness))
        flat = stage.mirror.flatness_table
        flatness = math.hypot(flatness, 0.0 if flat is None else flat.uncertainty)
        gain, roll = stage.response(AUTOCOLLIMATOR).gain, stage.response(AUTOCOLLIMATOR).roll
        return AssemblyVariance(
            stated.get("encoder.eccentricity", 0.0) ** 2,
            0.5 * (encoder.disc_radius * graduation) ** 2 + curve_in_radial(encoder),
            stated.get("mirror.tilt", 0.0) ** 2,
            flatness**2,
            (stated.get("autocollimator.gain", 0.0) / gain) ** 2,
            stated.get("autocollimator.roll", 0.0) ** 2,
            (stated.get("autocollimator.zero", 0.0) / gain) ** 2,
            roll_angle=roll,
            distortion=tuple(stated.get(f"autocollimator.{name}", 0.0) for name in DISTORTIONS),
        )

    @property
    def radial(self) -> float:
        """To the radial error motion, all in all."""
        return self.eccentricity + self.graduation

    @property
    def tilt(self) -> float:
        """To the tilt, all in all, beside what goes with the reading."""
        return self.mirror + self.flatness + self.zero

    def linear(self, along: NDArray[np.float64], across: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) what of `tilt_by_reading` is due to gain and roll."""
        return self.gain * along**2 + self.roll * across**2

    def tilt_by_reading(self, along: NDArray[np.float64], across: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) to the tilt about an axis, from what the autocollimator reads of it and of the other, rad.

        Of x and y the larger one.
        """
        linear = self.linear(along, across)
        if not self.is_distorted:
            return linear
        found = [
            distortion_variance(roll, self.distortion, along, across) for roll in (self.roll_angle, -self.roll_angle)
        ]
        return np.asarray(linear + np.max(found, axis=0))

    @cached_property
    def is_distorted(self) -> bool:
        """Whether the autocollimator's distortion is uncertain."""
        return any(self.distortion)

    def by_distortion(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(m, 2) what of `tilt_by_reading` is due to it, about x and y; None where there is none."""
        if not self.is_distorted:
            return None
        roll, stds = self.roll_angle, self.distortion
        return np.stack([distortion_variance(roll, stds, x, y), distortion_variance(-roll, stds, y, x)], axis=1)


@cache
def _bounds(redundancy: int) -> NDArray[np.float64]:
    """(redundancy + 1,) bound of chi-square over its degrees of freedom; 1 where there are none."""
    return np.array([1.0, *(chi_square_bound(float(freedom)) for freedom in range(1, redundancy + 1))])
