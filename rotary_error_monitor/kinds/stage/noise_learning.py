"""The noise of a stage's sensors, learnt from what causes leave of a recording, where that cannot hide a fault."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.gap.known_effects import KnownEffects
from rotary_error_monitor.gap.noise_level import LOUDEST, NOISIER, SAME_LEVEL, expected_level
from rotary_error_monitor.gap.normal import own_rest
from rotary_error_monitor.gap.problem import Columns, LateRows, Rows, SparseRows
from rotary_error_monitor.gap.slow_noise import Rivals, cosines, in_all, learn_slow_noise
from rotary_error_monitor.gap.structure import Track
from rotary_error_monitor.kinds.stage.instrument import InstrumentSums
from rotary_error_monitor.kinds.stage.jitter import SharedMotion, estimate_jitter
from rotary_error_monitor.kinds.stage.nuisances import Nuisances
from rotary_error_monitor.kinds.stage.rows import StageRows
from rotary_error_monitor.kinds.stage.search import StageSearch
from rotary_error_monitor.kinds.stage.signatures import KeptSignatures
from rotary_error_monitor.kinds.stage.speed_levels import noise_by_speed
from rotary_error_monitor.noise.jitter import Jitter
from rotary_error_monitor.noise.noise_by_speed import NoiseBySpeed
from rotary_error_monitor.sensors.library import instrument_of, is_listed
from rotary_error_monitor.twin.stage import Signals

SAME_SPECTRUM = 0.12
"""Mean difference of two spectra, as a logarithm, that is within the scatter of an estimate from 40 s."""

SAME_LINE = 0.25
"""Turns over the whole recording by which lines may differ and be one: a line takes up what is a little off."""

SAME_SLOW = 0.1
"""Part by which sizes of slow noise may differ and be the same: an estimate from forty orders scatters more."""

WAVES = 40
"""Half periods of the shortest wave over the recording that is looked for in the place of slow noise: most of the power
of that is in lower orders."""

ORBITS = 4
"""Orders of the rotation of which one may come and go in the place of slow noise: those above are faster than it."""

ENVELOPE = 16
"""Half periods over the recording of the fastest course by which that comes and goes: slower than the rotor turns."""

MOMENTS = 40
"""Parts of the recording at whose ends what turns may begin: nearer moments explain nearly the same."""

LEAST_SUMS = 200
"""Sums of neighbouring rows from which their squares tell a level: to 5 %."""

PARTS = 50
"""Parts of a recording between which squares scatter: each of more rows than rounding errors repeat in, as a rule."""


class NoiseLearning:
    """Learns the noise of a stage's sensors, and has what was made white with another noise made again.

    Args:
        problem: recording beside twin.
        signatures: that are kept.
        nuisances: likewise.
        search: for candidates.
        expected: squares of rows that are kept.
    """

    def __init__(
        self,
        problem: StageRows,
        signatures: KeptSignatures,
        nuisances: Nuisances,
        search: StageSearch,
        expected: Rows,
    ) -> None:
        self._problem, self._signatures, self._nuisances = problem, signatures, nuisances
        self._search, self._expected = search, expected
        self._slow: dict[str, Array] = {}
        self._jitter: tuple[bytes, float, tuple[Jitter, Array]] | None = None

    def begin(self, raw: Signals) -> None:
        """Jitter as it shows beside no cause, where heads show it."""
        noise = self._problem.noise
        if noise.grid.heads:
            noise.with_jitter(*self.estimate_jitter(raw))

    def learn_levels(self, causes: Sequence[Cause]) -> bool:
        """Noise other than the stage states: louder as neighbouring rows show it, which differ by little else.

        That is no more than what uncertain parameters leave shows, and no more than all does: a target off centre moves
        a probe on a fast stage, and a step bends what is fitted to it. Quieter it is as all that is left shows it. That
        holds what is slow in the noise, such as errors of rounding that repeat, and what is wrong with the twin, so no
        fault is larger beside it than beside what is stated.
        """
        noise = self._problem.noise
        left, raw = self._rows(causes)
        grown = self._learn_noise_by_speed(left, raw)
        if grown:
            left, raw = self._rows(causes)
        found = {}
        both = (_each_instrument(self._problem.tracks(rows)) for rows in (left, raw))
        for (name, own), (_, whole) in zip(*both, strict=True):
            found[name] = min(_as_stated_or_louder(noise.levels[name], tracks) for tracks in (own, whole))
            if found[name] <= 1.0:
                found[name] = _as_stated_or_quieter(noise.levels[name], own)
        changed = {name: level for name, level in found.items() if abs(level / noise.levels[name] - 1) > SAME_LEVEL}
        if not changed:
            return grown
        ratios = {name: np.array([level / noise.levels[name]]) for name, level in changed.items()}
        noise.with_levels(changed)
        self._follow(ratios)
        return True

    def _follow(self, louder: Mapping[str, Array]) -> None:
        """Make what is kept white with noise of some instruments that is so many times what it was."""
        self._expected.clear()
        self._nuisances.forget()
        self._signatures.follow_levels(self._problem.noise, louder)

    def _learn_noise_by_speed(self, left: Rows, raw: Rows) -> bool:
        """How the noise of each instrument grows with the rotor's speed, as far as both show it."""
        noise, ratios = self._problem.noise, {}
        both = (_each_instrument(self._problem.tracks(rows)) for rows in (left, raw))
        for (name, own), (_, whole) in zip(*both, strict=True):
            found = _lesser(noise_by_speed(own, noise), noise_by_speed(whole, noise))
            time = self._problem.times(own[0].channel)
            after = np.ones(len(time)) if found is None else found.at(noise.by_speed.speed(time))
            ratio = after / noise.by_speed.louder(name, time)
            if np.max(np.abs(ratio - 1)) > SAME_LEVEL:
                noise.with_noise_by_speed(name, found)
                ratios[name] = ratio
        if ratios:
            self._follow(ratios)
        return bool(ratios)

    def _rows(self, causes: Sequence[Cause]) -> tuple[Rows, Rows]:
        """White rows that uncertain parameters, of each channel alone, leave, of the variance of noise; and all."""
        raw, uncertain = self._problem.residual(causes), self._problem.own_nuisance(causes)
        rest, _ = own_rest(self._problem, raw, uncertain)
        for channel, own in uncertain.acting.items():
            count = int(np.count_nonzero(self._problem.expected(channel)))
            rest[channel] *= np.sqrt(count / max(count - len(own), 1))
        return rest, raw

    def learn_jitter(self, causes: Sequence[Cause]) -> bool:
        """Spectrum of the jitter, beside other causes than before: what was learnt beside fewer may have been one."""
        noise = self._problem.noise
        if not noise.grid.heads:
            return False
        jitter, lines = self.estimate_jitter(self._problem.raw_residual(causes))
        same = jitter.is_held == noise.jitter.is_held
        if same and _apart(jitter, noise.jitter, noise.command_floor) < SAME_SPECTRUM and self._are_known(lines):
            return False
        noise.with_jitter(jitter, lines)
        self._expected.clear()
        self._nuisances.forget(HEAD)
        self._signatures.follow_command(noise)
        return True

    def _are_known(self, lines: Array) -> bool:
        """Whether the lines are those that the noise has already; a turn between them shows from end to end."""
        known, time = np.sort(self._problem.noise.lines), self._problem.noise.grid.time
        return len(lines) == len(known) and bool(np.all(np.abs(np.sort(lines) - known) * np.ptp(time) < SAME_LINE))

    def estimate_jitter(self, raw: Signals) -> tuple[Jitter, Array]:
        """Jitter's spectrum from what the heads share, once anything that goes with the motion is taken out of it."""
        grid = self._problem.noise.grid
        mean, enough = self._problem.noise.shared({name: raw[name][:, :, None] for name in grid.heads})
        values, floor = mean[:, 0], self._problem.noise.command_floor
        # Beside no cause it is asked for twice, and beside the causes of a step again where one is left out. What it
        # was found from is known again by its digest: of a long recording the values of all stretches take much room.
        key = sha256(values.tobytes()).digest()
        if self._jitter is None or self._jitter[:2] != (key, floor):
            command = np.asarray(self._problem.twin.inputs.command(grid.time), np.float64)
            basis, noise = self._search.motion_basis(grid.time), self._problem.noise
            motion = SharedMotion(grid.time, command, values, enough, noise.moving, noise.row_weight, basis, floor)
            self._jitter = key, floor, estimate_jitter(motion)
        return self._jitter[2]

    def learn_slow_noise(self, causes: Sequence[Cause]) -> bool:
        """Slow noise of each instrument."""
        rest = self._problem.residual(causes)
        known = KnownEffects(self._problem, causes, rest)
        changed = [name for name in self._instruments() if self._learn_slow_noise_of(name, causes, rest, known)]
        for name in changed:
            self._nuisances.forget(name)
            self._signatures.follow_slow_noise(name)
        return bool(changed)

    def _learn_slow_noise_of(self, name: str, causes: Sequence[Cause], rest: Rows, known: KnownEffects) -> bool:
        problem = self._problem
        own = self._instrument(name)
        white = own.sums(rest)[:, :, 0]
        uncertain = np.hstack([own.stacked(problem.own_nuisance(causes)), *known.sizes(own.stacked)])
        seen = known.seen_by(own.stacked)
        found = learn_slow_noise(white, own.weight, own.passed, uncertain, self._rivals(own, rest), seen)
        before = self._slow.pop(name, None)
        if found is not None:
            self._slow[name] = found
        if (found is None and before is None) or (
            found is not None and before is not None and np.allclose(found, before, rtol=SAME_SLOW)
        ):
            return False
        problem.noise.with_slow_noise(name, None if found is None else cosines(own.passed) * (found / own.usual))
        return True

    def without_slow_noise(self, columns: Columns) -> Columns | None:
        """As `StageProblem.without_slow_noise`."""
        if isinstance(columns, LateRows):
            return None
        rows = self._problem.noise.without_slow_noise(columns.rows if isinstance(columns, SparseRows) else columns)
        return replace(columns, rows=rows) if rows is not None and isinstance(columns, SparseRows) else rows

    def _shown_elsewhere(self, own: InstrumentSums, rest: Rows) -> Rivals:
        """Slow courses of each other instrument: what both show alike is noise of neither."""
        found = []
        for name in self._instruments():
            if name != own.name:
                other = self._instrument(name)
                courses = _slow_courses(other.sums(rest)[:, :, 0], other.weight, other.passed)
                columns = np.stack([np.interp(own.time, other.time, course) for course in courses], axis=1)
                found.append(in_all(columns, own.weight))
        return _seen(found)

    def _instruments(self) -> tuple[str, ...]:
        heads = self._problem.noise.grid.heads
        none = (
            (COMMAND, *heads) if len(heads) == 1 else (COMMAND,)
        )  # one head shows all that it does against the command
        channels = (channel for channel in self._problem.channels if channel not in none)
        return tuple(dict.fromkeys(instrument_of(channel) for channel in channels))

    def _instrument(self, name: str) -> InstrumentSums:
        problem = self._problem
        first = next(channel for channel in problem.channels if instrument_of(channel) == name)
        return InstrumentSums(name, problem.channels, problem.noise, problem.times(first))

    def _rivals(self, own: InstrumentSums, rest: Rows) -> Iterator[Rivals]:
        """What else may be slow beside known effects: what others show, what goes with an input, and waves."""
        yield self._shown_elsewhere(own, rest)
        yield _seen([in_all(columns[:, None], own.weight) for columns in self._inputs(own.time).T])
        yield [in_all(columns, own.weight) for columns in _waves(own.passed)]
        angle = np.asarray(self._problem.twin.inputs.command(own.time), np.float64)
        for alike in _orbits(angle, own.passed):
            yield [in_all(columns, own.weight) for columns in alike]

    def _inputs(self, time: Array) -> Array:
        """(k, p) what the stage is exposed to: its commanded motion, temperature and force."""
        inputs = self._problem.twin.inputs
        motion = self._search.motion_basis(time)[:, 1:]
        outer = np.column_stack([inputs.warming(time), inputs.force(time)])
        return np.asarray(np.concatenate([motion, outer - outer.mean(axis=0)], axis=1), np.float64)


def _apart(jitter: Jitter, other: Jitter, floor: float) -> float:
    """Mean difference of the spectra of two jitters above a floor, as a logarithm: in that state where it is more."""
    frequency = np.linspace(0.5, 40.0, 80)
    pairs = ((jitter.in_motion, other.in_motion), (jitter.at_rest, other.at_rest))
    both = [
        (jitter.times(a).density(frequency) + floor) / (other.times(b).density(frequency) + floor) for a, b in pairs
    ]
    return max(float(np.mean(np.abs(np.log(ratio)))) for ratio in both)


def _lesser(one: NoiseBySpeed | None, other: NoiseBySpeed | None) -> NoiseBySpeed | None:
    """Of two that are told of the same noise the one that grows by less; None where one does not grow."""
    return None if one is None or other is None else min(one, other, key=lambda found: float(found.level[-1]))


def _each_instrument(tracks: Iterable[Track]) -> list[tuple[str, list[Track]]]:
    """Instruments with their tracks, in the order of their channels."""
    return sorted(_by_instrument(tracks).items())


def _by_instrument(tracks: Iterable[Track]) -> dict[str, list[Track]]:
    """Those of each instrument; what the heads share is none of theirs alone."""
    found: dict[str, list[Track]] = {}
    for track in tracks:
        if track.channel != COMMAND:
            found.setdefault(instrument_of(track.channel), []).append(track)
    return found


def _as_stated_or_louder(level: float, tracks: Sequence[Track]) -> float:
    """How many times the stated noise an instrument has by differences of neighbouring rows, where that is more.

    That of the parts of the recording in the middle is free of what happens in a few of them. Squares and not
    magnitudes count: of noise with heavy tails they are what sums of many rows scatter by, and so what tests go by.
    What is louder than an instrument is (`LOUDEST`) is something wrong with it, and no noise.

    Args:
        level: how many times the stated noise the rows are white with.
        tracks: of all channels of the instrument.
    """
    squares = [0.5 * np.square(_differences(track)) for track in tracks]
    parts = np.mean([[float(np.mean(part)) for part in np.array_split(own, PARTS)] for own in squares], axis=0)
    found = level * float(np.sqrt(min(np.median(parts), np.mean(parts))))
    least = 1 + max(NOISIER, 5 / np.sqrt(sum(map(len, squares))))
    return found if least < found <= LOUDEST else 1.0


def _as_stated_or_quieter(level: float, tracks: Sequence[Track]) -> float:
    """How many times the stated noise an instrument has at most by what is left, where that is less.

    It is as stated or quieter with the prior of all instruments (`expected_level`). Sums of neighbouring rows count
    where they are surely louder than single ones: errors of rounding are not independent, and a fault is told from such
    sums. The scatter of the estimate is that from part to part.
    """
    near = [0.5 * np.square(_differences(track)) for track in tracks]
    most = max([near, *_summed_squares([track.rows for track in tracks])], key=_surely)
    means = np.mean([[float(np.mean(part)) for part in np.array_split(own, PARTS)] for own in most], axis=0)
    # Where parts differ by more than chance it is that of the louder ones: no level holds for all of them.
    chance = 2 * float(np.mean(means)) ** 2 * PARTS / sum(map(len, most))
    mean = float(np.mean(means)) + 2 * float(np.sqrt(max(float(np.var(means, ddof=1)) - chance, 0.0)))
    if mean * level**2 >= 1.0 or mean == 0.0:
        return 1.0
    variance = float(np.var(means, ddof=1)) / PARTS / (2 * mean) ** 2
    return expected_level(level * float(np.sqrt(mean)), variance).value


def _summed_squares(channels: Sequence[Array]) -> Iterator[list[Array]]:
    """Squares of rows (m,) of each channel, then of sums of two neighbours, four, …, of the variance of one."""
    yield [np.square(rows) for rows in channels]
    while min(map(len, channels)) >= 2 * LEAST_SUMS:
        channels = [(rows[1::2] + rows[: len(rows) // 2 * 2 : 2]) / np.sqrt(2) for rows in channels]
        yield [np.square(rows) for rows in channels]


def _surely(parts: Sequence[Array]) -> float:
    """Mean of squares less three times its scatter, were they of independent normal numbers."""
    squares = np.concatenate(parts)
    return float(np.mean(squares)) * (1 - 3 * float(np.sqrt(2 / len(squares))))


def _differences(track: Track) -> Array:
    """(m,) differences of neighbouring white rows, of the variance of a plain one.

    A target off centre moves a probe by more between two samples than its noise is: third differences are free of it.
    """
    return np.diff(track.rows, 3) / np.sqrt(10) if is_listed(track.channel) else np.diff(track.rows)


def _seen(rivals: Rivals) -> Rivals:
    """Those that show in these channels at all."""
    return [columns for columns in rivals if columns.shape[1] and np.any(columns)]


def _orbits(angle: Array, passed: Array) -> Iterator[Rivals]:
    """What turns with the rotor from one moment on, or comes and goes on a slow course, in one of a few orders.

    Where the rotor turns slowly these are as slow as the noise, which then took what had slipped on it.
    """
    begins = np.arange(1, MOMENTS) / MOMENTS
    courses = np.cos(np.pi * passed[:, None] * np.arange(ENVELOPE + 1))
    orders = np.arange(1, ORBITS + 1)[:, None] * angle
    turning = np.stack([np.cos(orders), np.sin(orders)], axis=2)
    yield [each * (passed > begin)[:, None] for each in turning for begin in begins]
    yield [(each[:, :, None] * courses[:, None]).reshape(len(passed), -1) for each in turning]


def _slow_courses(white: Array, weight: Array, passed: Array) -> list[Array]:
    """(k,) course of each component by its sums (c, k), of waves as long as those that are looked for elsewhere."""
    basis = cosines(passed)[:, : WAVES + 1]
    found = []
    for sums, each in zip(white, weight, strict=True):
        columns = basis * each[:, None]
        found.append(basis @ np.linalg.lstsq(columns, sums, rcond=None)[0])
    return found


def _waves(passed: Array) -> Rivals:
    """What comes and goes: a wave with its second harmonic, of as many half periods as the slowest noise has."""
    turns = [[k * order * np.pi * passed for k in (1, 2)] for order in range(1, WAVES + 1)]
    return [np.stack([wave(angle) for angle in angles for wave in (np.cos, np.sin)], axis=1) for angles in turns]
