"""The measurement that would tell effects apart, found by predicting what each candidate measurement would show.

For two effects the squared distance between what one predicts (as fitted) and the nearest that the other can do, in
standard deviations, is the information that a recording holds about which of them it is (for Gaussian noise, twice the
expected log likelihood ratio). It is computed for variations of the recording that a person can carry out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE, REFERENCE_TITLE
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.effects.effect import Cause, Role, place_of
from rotary_error_monitor.gap.telling_apart import advise_best, distance
from rotary_error_monitor.kinds.stage.rows import StageRows
from rotary_error_monitor.sensors.library import instrument_of
from rotary_error_monitor.twin.stage import StageInputs, StageTwin

Key = tuple[str, str]

SAMPLES = 2000
"""Instants at which a planned measurement is predicted; distances are scaled to the recording's number of samples."""

PART_OF_A_TURN = 35
"""Degrees by which a probe is moved around the axis: no order below 72 looks the same from there."""

PROBE = RadialReference(height=0.1, noise=5e-8)
"""What a stage without a reference could be measured with."""


@dataclass(frozen=True)
class Experiment:
    """A variation of the recording, and the words that tell somebody to carry it out."""

    words: str
    inputs: StageInputs
    stage: StageDescription


def advise(problem: StageRows, keys: Sequence[Key], causes: Sequence[Cause]) -> str:
    """Words for the measurement that tells the first of these effects apart from the others best."""
    first = next(cause for cause in causes if cause.key == tuple(keys[0]))
    rivals = [_at_zero(problem, key) for key in keys[1:]]
    # a reference that took no part is left out
    stage = problem.stage if OWN_REFERENCE in problem.twin.times else problem.stage.with_reference(None)
    old = _Measurement(problem, problem.twin.inputs, stage)
    known = old.shown(first), [old.columns(rival) for rival in rivals]
    scored = []
    named = {place_of(place) for _, place in keys}
    moved = _with_probes_moved(problem, stage, (stream for stream in stage.sensors if stream in named))
    warmed = _with_places_warmed(problem, stage, (place for place in stage.thermometers if place in named))
    for experiment in (*_experiments(problem, stage), *moved, *warmed):
        new = _Measurement(problem, experiment.inputs, experiment.stage)
        wanted = np.concatenate([known[0], new.shown(first)])
        tables = [np.concatenate([seen, new.columns(r)]) for seen, r in zip(known[1], rivals, strict=True)]
        scored.append((min(distance(wanted, table) for table in tables), experiment.words))
    others = "no other speed, direction, load, temperature, sensor or head position that was tried tells them apart"
    return advise_best(scored, f"{others}: the best one")


def _experiments(problem: StageRows, stage: StageDescription) -> Iterable[Experiment]:
    described, plain = problem.stage, problem.twin.inputs
    duration = problem.recording.duration

    def turn(by: float) -> StageInputs:
        return replace(plain, command=_scaled(plain.command, by), omega=_scaled(plain.omega, by))

    yield Experiment("record again with the directions of rotation exchanged", turn(-1.0), stage)
    yield Experiment("record again at twice the speed", turn(2.0), stage)
    yield Experiment("record again at a third of the speed", turn(1 / 3), stage)
    loaded = replace(plain, force=_circling)
    yield Experiment("record again with a force of 100 N on the shaft from changing sides", loaded, stage)
    warming = replace(plain, warming=partial(_rising, duration))
    yield Experiment("record again while the stage warms by 5 K", warming, stage)
    if described.reference is None:
        probed = stage.with_reference(PROBE)
        words = f"add an {REFERENCE_TITLE} {PROBE.height * 1e3:.0f} mm above the ring and record again"
        yield Experiment(words, plain, probed)
    else:
        if stage.reference is None:
            yield Experiment(f"record again with the {REFERENCE_TITLE}", plain, described)
        moved = stage.with_reference(replace(described.reference, height=2 * described.reference.height + 0.05))
        yield Experiment(f"record again with the {REFERENCE_TITLE} at another height", plain, moved)
    for letter in sorted(stage.azimuths)[:1]:
        azimuths = {**stage.azimuths, letter: stage.azimuths[letter] + np.radians(20)}
        shifted = replace(stage, encoder=replace(stage.ring, azimuths=azimuths))
        yield Experiment(f"move head {letter} by 20° along the ring and record again", plain, shifted)


def _with_probes_moved(problem: StageRows, stage: StageDescription, streams: Iterable[str]) -> Iterator[Experiment]:
    """Listed sensors somewhere else around the axis: the form of a target comes later there, error motion does not."""
    for stream in streams:
        sensor = stage.sensors[stream]
        if len(sensor.fields) > 1:  # the form of its target is by orders of the rotation, wherever it stands
            continue
        azimuth = sensor.place.get("azimuth", 0.0) + np.radians(PART_OF_A_TURN)
        moved = replace(sensor, place={**sensor.place, "azimuth": azimuth})
        words = f"move {stream} by {PART_OF_A_TURN}° around the axis and record again"
        there = replace(stage, sensors={**stage.sensors, stream: moved})
        yield Experiment(words, problem.twin.inputs, there)


def _with_places_warmed(problem: StageRows, stage: StageDescription, places: Iterable[str]) -> Iterator[Experiment]:
    """Places of thermometers that warm as the others do not."""
    plain, duration = problem.twin.inputs, problem.recording.duration
    for place in places:
        warmings: dict[str, Callable[[Array], Array]] = {**plain.warmings, place: partial(_rising, duration)}
        words = f"record again while {place} warms by 5 K more than the other thermometers"
        yield Experiment(words, replace(plain, warmings=warmings), stage)


def _rising(duration: float, time: Array) -> Array:
    """(m,) K at times (m,) of what warms by 5 K throughout."""
    return 5.0 * np.asarray(time) / duration


def _scaled(of_time: Callable[[Array], Array], by: float) -> Callable[[Array], Array]:
    return lambda time: by * np.asarray(of_time(time))


def _circling(time: Array) -> Array:
    return 100.0 * np.stack([np.cos(2 * np.pi * time / 7.0), np.sin(2 * np.pi * time / 7.0)], axis=1)


def _at_zero(problem: StageRows, key: Key) -> Cause:
    effect = next(e for e in problem.effects if e.name == key[0])
    known = problem.known_start(key)
    return Cause(effect, key[1], effect.start(key[1]) if known is None else known)


class _Measurement:
    """What a measurement would show, in standard deviations of what a whole recording averages to.

    Args:
        problem: the recording that it varies.
        inputs: what drives the stage.
        stage: the stage as it stands then.
    """

    def __init__(self, problem: StageRows, inputs: StageInputs, stage: StageDescription) -> None:
        self._problem = problem
        time = np.linspace(0.0, problem.recording.duration, SAMPLES)
        streams, self._std = dict.fromkeys(problem.twin.times, time), dict(problem.noise.std)
        if stage.reference is not None:
            streams[OWN_REFERENCE] = time
            if problem.stage.reference is None:  # its noise is not among those of the recording
                self._std[OWN_REFERENCE] = stage.reference.noise
        self._twin = StageTwin(stage, inputs, streams)
        self._base = self._rows(())

    def shown(self, cause: Cause) -> Array:
        """(m,) what a cause adds."""
        return self._rows((cause,)) - self._base

    def columns(self, cause: Cause) -> Array:
        """(m, k) what one usual size of each linear value of a cause adds."""
        scales, found = cause.effect.scales(), []
        for index in cause.effect.indices(Role.LINEAR):
            values = cause.values.copy()
            values[index] += scales[index]
            found.append(self.shown(cause.with_values(values)))
        return np.stack(found, axis=1)

    def _rows(self, causes: Sequence[Cause]) -> Array:
        problem, signals = self._problem, self._twin.predict(causes)
        heads = [name for name in signals if name.startswith("head_")]
        gain = np.sqrt(problem.instants / SAMPLES)
        parts = self._of_heads([signals[name][:, 0] for name in heads], gain) if heads else []
        for name, values in signals.items():
            if name not in heads:
                parts.append(values.ravel() / (self._std[instrument_of(name)] or 1.0) * gain)
        return np.concatenate(parts)

    def _of_heads(self, angles: Sequence[Array], gain: float) -> list[Array]:
        """What the heads share, whose noise is the jitter, and what each has beyond that, in standard deviations."""
        shared, jitter = np.mean(angles, axis=0), self._problem.noise.jitter
        # The jitter is one independent value in each of its correlation times.
        independent = np.sqrt(min(1.0, 2 * jitter.bandwidth * self._problem.recording.duration / SAMPLES))
        white = self._std["head"] / np.sqrt(len(angles)) / gain
        parts = [shared / np.hypot(jitter.std / independent, white)]
        return parts + [(angle - shared) / self._std["head"] * gain for angle in angles]
