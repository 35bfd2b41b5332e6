"""An estimator over a recording of the independent world, and its output held against the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from described_stages import stage_of
from numpy.typing import NDArray
from world import Options, Recording, make_recording

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.sensors.library import is_listed

TURNING = ("both_directions", "s_curves", "steady", "indexing")
"""Motions that make whole turns: what turns with the rotor can then be told from what does not."""

TURN_OF_THE_NODE = 20_000_000
"""What arrives within this time, ns, is estimated together, as by a node that is busy."""

PERIOD = 1e-3
SIGMAS = 6.0


@dataclass(frozen=True)
class Judgement:
    """What an estimator made of a recording.

    Attributes:
        wrong: part of the ticks of the recording at which a component was published that is off by more than six of its
            standard deviations, by component.
        largest: largest error of a published component, m and rad.
        available: part of the ticks at which it was published.
        doubted: everything that was doubted at any time, and the reason given first.
        estimator: at the end.
    """

    wrong: Mapping[str, float]
    largest: Mapping[str, float]
    available: Mapping[str, float]
    doubted: Mapping[str, str]
    estimator: Estimator

    @property
    def worst(self) -> float:
        """The largest part of ticks at which a component was wrong."""
        return max(self.wrong.values())


def record(seed: int, section: Mapping[str, object], duration: float, **options: object) -> Recording:
    """Recording of a stage that makes whole turns, at rates that keep a test short."""
    motion = TURNING[seed % len(TURNING)]
    return make_recording(seed, duration=duration, stage=section, options=Options(motion=motion, **options))


def stream_of(topic: str) -> str | None:
    """Stream of the estimator by the topic of its samples; none for what it does not take."""
    name = topic.split("/")[2]
    taken = name.startswith("head_") or is_listed(name) or name in ("autocollimator", "command")
    return name if taken else None


def judge(
    recording: Recording,
    section: Mapping[str, object],
    true_times: Callable[[NDArray[np.int64]], NDArray[np.int64]] | None = None,
    bound: Callable[[StageDescription], Mapping[str, float]] | None = None,
    own_clock: Callable[[int], int] | None = None,
) -> Judgement:
    """Run an estimator in the order of arrival and hold what it publishes against the truth.

    Args:
        recording: what arrives.
        section: description of the stage that the estimator is given.
        true_times: the truth's times of the stamps, where a fault has set the clock.
        bound: what of the error of components (m, rad) cannot be told from the stage by its nature.
        own_clock: what the estimator's own clock shows (ns) at the time of an arrival, where it was set.
    """
    stage = stage_of(section)
    estimator = Estimator(stage)
    doubted: dict[str, str] = {}

    def note(_arrival: int) -> None:
        for what, why in estimator.reasons:
            doubted.setdefault(what, why)

    parts = estimated(recording, estimator, note, own_clock)
    doubted = dict(estimator.reasons) | doubted
    return _compare(recording, stage, estimator, parts, doubted, true_times, bound)


def estimated(
    recording: Recording,
    estimator: Estimator,
    look: Callable[[int], None],
    own_clock: Callable[[int], int] | None = None,
) -> list[ErrorMotion]:
    """Give an estimator what arrives, in turns as a node takes; `look` is called after each with its time (ns)."""
    parts: list[ErrorMotion] = []
    awake = 0
    for arrival, topic, block in recording.timeline():
        stream = stream_of(topic)
        if stream is None or len(block.rows) == 0:
            continue
        if abs(arrival - awake) > TURN_OF_THE_NODE:
            parts += estimator.advance()
            awake = arrival
            look(arrival)
        with suppress(InputError):  # refused and counted
            estimator.accept(stream, block, arrival if own_clock is None else own_clock(arrival))
    return parts + estimator.advance() + estimator.finish()


def _compare(
    recording: Recording,
    stage: StageDescription,
    estimator: Estimator,
    parts: list[ErrorMotion],
    doubted: dict[str, str],
    true_times: Callable[[NDArray[np.int64]], NDArray[np.int64]] | None,
    bound: Callable[[StageDescription], Mapping[str, float]] | None,
) -> Judgement:
    total = max(1, round(recording.duration / PERIOD))
    if not parts:
        nothing = dict.fromkeys(COMPONENTS, 0.0)
        return Judgement(nothing, nothing, nothing, doubted, estimator)
    motion = ErrorMotion.joined(parts)
    times, said = motion.times_ns, motion.observable
    deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
    truth = recording.truth(times if true_times is None else true_times(times))
    unseen = bound(stage) if bound is not None else {}
    margin = np.array([unseen.get(name, 0.0) for name in COMPONENTS])
    off = motion.components - np.column_stack([getattr(truth, name) for name in COMPONENTS])
    off[:, 5] -= 2 * np.pi * np.rint(off[:, 5] / (2 * np.pi))
    wrong: NDArray[np.bool_] = said & ~(np.abs(off) <= margin + SIGMAS * deviation)
    return Judgement(
        {name: float(wrong[:, i].sum()) / total for i, name in enumerate(COMPONENTS)},
        {name: float(np.abs(off[said[:, i], i]).max(initial=0.0)) for i, name in enumerate(COMPONENTS)},
        {name: float(said[:, i].sum()) / total for i, name in enumerate(COMPONENTS)},
        doubted,
        estimator,
    )
