"""A machine in motion that the compensation is given, with faults in what it hears, held against the same without."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pushed_inputs import push_error_motion

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.correction import remaining_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.limits import CorrectionOutcome
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.corrections import Correction

MACHINE = load_machine("xyzac_trt")
MODEL = arrange_machine(MACHINE)
START = 1_763_700_000_000_000_000
MS = 1_000_000
DURATION = 8.0
RATES = np.array([2e-3, 2e-3, 2e-3, 2e-2, 2e-2])
"""Limits of the shipped settings, m/s and rad/s."""

SIGMAS = 6.0
"""Standard deviations within which what is stated is right."""

Time = TypeVar("Time", float, NDArray[np.float64])
JointState = tuple[dict[str, float], dict[str, float]]
Change = Callable[[float, dict[str, float], dict[str, float]], JointState | None]
"""What becomes of a joint state at a time (s): positions and velocities by axis, or none."""


@dataclass(frozen=True)
class Machine:
    """Axes that move smoothly within their limits, a rotor with error motion, a shop that warms.

    Attributes:
        seed: of everything that is drawn.
    """

    seed: int
    _waves: Mapping[str, tuple[float, float, float, float]] = field(init=False)
    _rotor: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        draw = np.random.default_rng(self.seed)
        waves = {}
        for axis in MACHINE.axes:
            low, high = axis.travel if axis.letter != "C" else (-100.0, 100.0)
            middle, size = 0.5 * (low + high), 0.3 * (high - low)
            angular = draw.uniform(0.2, 0.9) * min(0.5 * axis.fastest / size, np.sqrt(0.2 * axis.quickest / size), 4.0)
            waves[axis.letter] = (middle, size * draw.uniform(0.3, 1.0), angular, draw.uniform(0, 2 * np.pi))
        waves["C"] = (draw.uniform(-3, 3), draw.uniform(0.5, 4.0) * draw.choice([-1, 1]), 0.0, 0.0)
        object.__setattr__(self, "_waves", waves)
        object.__setattr__(self, "_rotor", draw.uniform(-1, 1, (6, 3)))

    def axis(self, letter: str, t: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Position and speed of an axis, m or rad and per s."""
        middle, size, angular, phase = self._waves[letter]
        t = np.asarray(t, float)
        if angular == 0.0:
            return middle + size * t, np.full_like(t, size)
        return middle + size * np.sin(angular * t + phase), size * angular * np.cos(angular * t + phase)

    def joint_state(self, t: float) -> JointState:
        """What a sound controller says."""
        found = {axis.letter: self.axis(axis.letter, t) for axis in MACHINE.axes}
        return {k: float(q) for k, (q, _) in found.items()}, {k: float(v) for k, (_, v) in found.items()}

    def temperature(self, t: Time) -> Time:
        """°C."""
        return 20.0 + 0.002 * t

    def error_motion(self, first_ms: int, count: int = 5) -> ErrorMotion:
        """What a sound estimator publishes."""
        times = START + (first_ms + np.arange(count)) * MS + MS // 2
        t = (times - START) * 1e-9
        command = self.axis("C", t)[0]
        motion = replace(ErrorMotion.unknown(count), times_ns=times)
        size = {0: 3e-6, 1: 3e-6, 3: 2e-5, 4: 2e-5, 5: 1e-5}
        for i, (place, largest) in enumerate(size.items()):
            a, b, c = self._rotor[i]
            wave = 0.4 * a * np.cos(command) + 0.3 * b * np.sin(2 * command) + 0.3 * c
            motion.components[:, place], motion.observable[:, place] = largest * wave, True
            motion.covariance[:, place, place] = (1e-8 if place in (0, 1) else 1e-7) ** 2
        motion.theta[:] = command + motion.components[:, 5]
        return motion


@dataclass
class Run:
    """What came out.

    Attributes:
        machine: that was corrected.
        corrections: by their stamps, ns.
        uncertain: standard uncertainty of the tool's position at each report, m, by stamp.
        held: why nothing came, by time (s) of a block of error motion after which it held.
        said: what else was said, each with its time (s): refused messages, and remarks while corrections went on.
    """

    machine: Machine
    corrections: dict[int, Correction] = field(default_factory=dict)
    uncertain: dict[int, float] = field(default_factory=dict)
    held: dict[float, str] = field(default_factory=dict)
    said: list[tuple[float, str]] = field(default_factory=list)

    def told(self, begin: float, end: float) -> set[str]:
        """What was said between two times, s."""
        return {text for t, text in [*self.held.items(), *self.said] if begin <= t < end}


def run(
    machine: Machine,
    change: Change = lambda _, positions, velocities: (positions, velocities),
    temperature: Callable[[float, float], float | None] = lambda _, value: value,
    description: MachineDescription = MACHINE,
    ahead: Callable[[float], float] = lambda _: 0.0,
    motion: Callable[[float, ErrorMotion], ErrorMotion] = lambda _, motion: motion,
) -> Run:
    """The compensation of a machine, its joint states, temperatures and error motion changed by a fault.

    Joint states are stamped ahead of their time (s) by `ahead`, s.
    """
    compensator, found = Compensator(description), Run(machine)
    for ms in range(0, round(DURATION * 1e3), 5):
        t = ms * 1e-3
        if ms % 500 == 0 and (value := temperature(t, machine.temperature(t))) is not None:
            compensator.push_temperature(value, START + ms * MS)
        if ms % 10 == 0 and (state := change(t, *machine.joint_state(t))) is not None:
            try:
                stamp_ns = START + ms * MS + round(ahead(t) * 1e9)
                if why := compensator.accept_joint_state(stamp_ns, *state):
                    found.said.append((t, why))
            except InputError as error:
                found.said.append((t, str(error)))
        result = push_error_motion(compensator, motion(t, machine.error_motion(ms)))
        for correction in result.corrections:
            found.corrections[correction.stamp_ns] = correction
            if correction.report is not None:
                found.uncertain[correction.stamp_ns] = float(np.sqrt(np.trace(correction.report.covariance[:3, :3])))
        if compensator.hold or compensator.joints.doubt:
            found.held[t] = compensator.hold or compensator.joints.doubt
        found.said += [(t, remark) for remark in compensator.remarks]
    return found


@dataclass(frozen=True)
class Verdict:
    """What of a run with a fault is not as it is without.

    Attributes:
        wrong: part of the corrections after the first 0.1 s of the fault that say that all is well and are off, by more
            than 6 standard deviations of the tool's position or tilt.
        largest: by how much they put the tool elsewhere at most, m.
        fastest: largest rate of a correction over its limit.
        recovered: time (s) after the end of the fault from which corrections are again those without it; NaN for never.
    """

    wrong: float
    largest: float
    fastest: float
    recovered: float


def compare(healthy: Run, found: Run, begin: float, end: float) -> Verdict:
    """Hold the corrections of a run with a fault from `begin` to `end` (s) against those without."""
    stamps = np.array(sorted(found.corrections))
    values = np.array([found.corrections[stamp].values for stamp in stamps])
    times = (stamps - START) * 1e-9
    comparable = np.isin(stamps, list(healthy.corrections))
    off, sigmas = np.full(len(stamps), np.nan), np.full(len(stamps), np.inf)
    off[comparable], sigmas[comparable] = moved_apart(healthy, found, stamps[comparable])
    sure = np.array([found.corrections[stamp].outcome != CorrectionOutcome.RATE_LIMITED for stamp in stamps.tolist()])
    sure &= ~np.array([found.corrections[stamp].described for stamp in stamps.tolist()])
    judged = sure & comparable & (times > begin + 0.1)
    wrong = judged & (sigmas > SIGMAS)
    passed = np.minimum(np.diff(stamps) * 1e-9, 0.1)[:, None]
    fastest = float((np.abs(np.diff(values, axis=0)) / passed / RATES).max())
    same = (times > end) & (sigmas <= SIGMAS)
    return Verdict(
        float(wrong.sum() / max(judged.sum(), 1)),
        float(off[wrong].max(initial=0.0)),
        fastest,
        float(times[same].min() - end) if same.any() else float("nan"),
    )


def moved_apart(healthy: Run, found: Run, stamps: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far two runs put the tool apart at each stamp, (n,) m, and (n,) standard deviations that the second states.

    These are of the direction in which it is furthest beyond them: of the tool's position or of its tilt. A covariance
    is told 20 times a second: of the one before a stamp and the one behind it the larger counts.
    """
    apart = tool_offsets(found.machine, found, stamps) - tool_offsets(found.machine, healthy, stamps)
    reported = np.array(sorted(found.uncertain))
    covariances = np.array([found.corrections[stamp].report.covariance for stamp in reported.tolist()])
    after = np.searchsorted(reported, stamps)
    sigmas = np.full(len(stamps), np.inf)
    for near in (np.clip(after + k, 0, len(reported) - 1) for k in (-1, 0)):
        parts = [
            np.einsum(
                "ni,ni->n", apart[:, part], np.linalg.solve(covariances[near, part, part], apart[:, part, None])[..., 0]
            )
            for part in (slice(0, 3), slice(3, 5))
        ]
        sigmas = np.minimum(sigmas, np.sqrt(np.maximum(*parts)))
    return np.asarray(np.linalg.norm(apart[:, :3], axis=1)), sigmas


def left_over(machine: Machine, found: Run, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n,) distance of the tool from where it should be, m, with the corrections of these stamps and the true rotor."""
    return np.asarray(np.linalg.norm(tool_offsets(machine, found, stamps)[:, :3], axis=1))


def tool_offsets(machine: Machine, found: Run, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 6) offset of the tool, m and rad, from where it should be with the corrections of these stamps."""
    t = (stamps - START) * 1e-9
    positions, speeds = np.moveaxis([machine.axis(axis.letter, t) for axis in MACHINE.axes], 0, 2)
    motion = ErrorMotion.joined([machine.error_motion((stamp - START) // MS, 1) for stamp in stamps.tolist()])
    return remaining_offset(
        MODEL,
        positions,
        np.array([found.corrections[stamp].values for stamp in stamps.tolist()]),
        direction=np.sign(speeds),
        temperature=machine.temperature(t),
        monitored=np.where(motion.observable, motion.components, np.nan),
    )
