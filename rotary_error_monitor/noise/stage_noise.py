"""The noise of a stage's recording, and the linear map that makes it white: the common currency of all comparisons.

Three kinds of noise, each from what the description says:

* Heads: reading noise and rounding, `noise^2 + resolution^2 / 12`, independent. The rotor's jitter about the command is
  seen by all heads alike, so what a head has beyond the mean of all heads is free of it, once each head is taken to the
  same instant: a head that samples a moment later sees the jitter's rate times that moment. These are the rows
  `/stage/head_i`. What the heads share stands in the rows `/stage/command`, whose noise is the jitter (coloured, its
  spectrum estimated from the recording) plus the mean of the readings' noise.
  A stage without heads has no such rows: its rotation is the command, and the jitter a part of the probes' rows.
* Autocollimator: noise and rounding, plus turbulence: an Ornstein-Uhlenbeck process of known size and correlation time.
* reference: white.
* Sensors that a stage lists by name: white, each with the noise that is stated of it.

An instrument may have slow noise besides, each of its channels a course of its own.

Readings of a sensor that moves by less than a step weigh as one where noise does not break up its steps. Single samples
far out and short bursts of them (spikes) and samples around lost blocks take no part, but those that come again at one
place of the turn do: something is there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.noise.channels import channels_of, noise_std
from rotary_error_monitor.noise.head_grid import HeadRows, align_heads, rate_of, weight_of_rows
from rotary_error_monitor.noise.jitter import Jitter, JitterFilter
from rotary_error_monitor.noise.lost_samples import (
    apart_between_samples,
    between_samples,
    bridge,
    in_motion,
    input_gaps,
    inside,
    turning_points,
)
from rotary_error_monitor.noise.noise_by_speed import NoiseBySpeed, SpeedDependence
from rotary_error_monitor.noise.sensor_rows import SensorRows
from rotary_error_monitor.noise.slow_noise import Cells, SlowNoise, cells_of
from rotary_error_monitor.noise.spikes import find_head_spikes, find_spikes
from rotary_error_monitor.noise.turbulence import drift_predictors
from rotary_error_monitor.noise.whitening import Whitener, few_at_once, segments_of
from rotary_error_monitor.sensors.library import instrument_of, sensor_of
from rotary_error_monitor.twin.recording import SignalStream, StageRecording

CELLS = 480
"""Cells of a recording in which slow noise is the same: eight to a wave of its highest order, 120 half periods."""


class StageNoise:
    """Map from signals of a recording to white rows.

    Args:
        stage: states the noise of each sensor.
        recording: its sample times, gaps and spikes.
        residual: measured minus predicted (n, k) of each stream, from which spikes are told.
        weights: (n, fields) of the samples of sensors whose rounding errors repeat.

    Attributes:
        std: standard deviation of one sample of each instrument, rounding included: see `noise_std`.
        levels: how many times what the stage states that is.
        lines: (k,) frequencies, Hz, of the jitter's own lines.
        moving: (m,) instants of the heads at which the rotor is commanded to turn.
        row_weight: (m,) weight of the heads' rows.
        by_speed: how noise depends on the rotor's speed.
        uncommanded: (m,) instants of the heads at which the command is not known to the noise of their mean.
    """

    def __init__(
        self,
        stage: StageDescription,
        recording: StageRecording,
        residual: Mapping[str, Array],
        weights: Mapping[str, Array] | None = None,
    ) -> None:
        self.jitter = Jitter()
        self.grid = align_heads(recording)
        self.std = noise_std(stage)
        self.levels = dict.fromkeys(self.std, 1.0)
        self.lines, self._weights = np.zeros(0), weights or {}
        self._slow: dict[str, Array] = {}
        self.by_speed = SpeedDependence(recording.streams[COMMAND])
        self._sensors = [name for name in residual if not name.startswith("head_")]
        self._streams = {name: recording.streams[name] for name in residual}
        lost, turning = input_gaps(recording), turning_points(recording.streams[COMMAND])
        spans = {name: lost if name in self.grid.heads else np.concatenate([lost, turning]) for name in residual}
        self._kept = {name: ~inside(recording.streams[name].time, own) for name, own in spans.items()}
        command, least = recording.streams[COMMAND], self.std[HEAD] / np.sqrt(max(len(self.grid.heads), 1))
        apart = apart_between_samples(command, self.grid, self._head_times, least)
        self.spikes = self._find_spikes(stage, residual, command, apart)
        self._present = self.grid.present_of(self._kept)
        self.uncommanded = between_samples(command, self.grid.time, least) | apart
        self.row_weight = np.where(apart, 0.0, weight_of_rows(self.grid, self._weights))
        for name in self.grid.heads:  # filters go on over turning points, as over a command that is not known
            rows = self.grid.rows_of(name, inside(recording.streams[name].time, turning))
            self.row_weight[rows], self.uncommanded[rows] = 0.0, True
        self._turbulence = {name: sensor_of(name).turbulence(stage) for name in self._sensors}
        self._kept_heads: HeadRows | None = None
        self._kept_filter: JitterFilter | None = None
        self._kept_line_basis: Array | None = None
        self._kept_cells: dict[str, Cells] = {}
        self._kept_slow: dict[str, SlowNoise] = {}
        self._whiteners = self._turbulence_filters()
        self.moving = in_motion(command, self.grid.time)

    def with_levels(self, levels: Mapping[str, float]) -> None:
        """Take the noise of instruments for so many times what the stage states."""
        for instrument, level in levels.items():
            self.std[instrument] *= level / self.levels[instrument]
            self.levels[instrument] = level
        self._whiteners = self._turbulence_filters()
        self.with_jitter(self.jitter, self.lines)

    def with_noise_by_speed(self, instrument: str, noise: NoiseBySpeed | None) -> None:
        """Take the noise of an instrument for louder the faster the rotor turns; None for as loud at all speeds."""
        self.by_speed.take(instrument, noise)
        self.with_jitter(self.jitter, self.lines)

    def with_jitter(self, jitter: Jitter, lines: Array | None = None) -> None:
        """Take another spectrum of the jitter, and frequencies (k,) in Hz at which it holds lines of its own."""
        self.jitter = jitter
        self._kept_filter = None
        self.lines = np.zeros(0) if lines is None else lines
        self.forget()

    def with_slow_noise(self, instrument: str, courses: Array | None) -> None:
        """Take slow noise of an instrument for known: one standard deviation of each course (`CELLS` or fewer, q).

        Courses are cosines of orders from 0 on over the recording, in standard deviations of a sample's white noise;
        None for no such noise. What each head has of its own their mean has as well.
        """
        self._slow.pop(instrument, None)
        if courses is not None:
            self._slow[instrument] = courses
        self._kept_slow.clear()

    @property
    def has_slow_noise(self) -> bool:
        """Whether any instrument has."""
        return bool(self._slow)

    def slow_sizes(self) -> dict[str, float]:
        """Root mean square of the slow noise of each instrument that has any, in its unit."""
        return {
            name: self.std[name] * float(np.sqrt(np.mean(np.sum(np.square(courses), axis=1))))
            for name, courses in self._slow.items()
        }

    def cells(self, channel: str) -> Cells:
        """Rows of a channel in `CELLS` cells, each row with the root of its expected square for its weight."""
        if not self._kept_cells:
            self._kept_cells = {name: cells_of(np.sqrt(rows), CELLS) for name, rows in self.expected().items()}
        return self._kept_cells[channel]

    def plain_sums(self, channel: str, rows: Array) -> Array:
        """(k, p) sums over the cells of a channel's white rows (m, p), as they would be without slow noise."""
        if instrument_of(channel) in self._slow:
            return self._slow_noise(channel).plain_sums(rows)
        return self.cells(channel).sums(rows)

    def share_time(self, time: Array) -> None:
        """Have times (m,) of the heads' rows, the same as before, in memory that others use as well."""
        self.grid = replace(self.grid, time=time)

    def forget(self) -> None:
        """Give back the memory of what can be computed again."""
        self._kept_line_basis = None
        self._kept_heads = None
        self._kept_cells.clear()
        self._kept_slow.clear()

    @property
    def _line_basis(self) -> Array | None:
        """(m, 4 k) orthonormal rows of the lines: what they span takes no part in the command's channel.

        Beside each wave stands the wave times time, which takes up a frequency that is a little off.
        """
        if self._kept_line_basis is None and len(self.lines):
            self._kept_line_basis = self._whitened_lines(self.lines)
        return self._kept_line_basis

    def _whitened_lines(self, lines: Array) -> Array:
        turns = 2 * np.pi * np.outer(self.grid.time, lines)
        middle = self.grid.time - self.grid.time.mean()
        waves = np.hstack([np.cos(turns), np.sin(turns)])
        table = self._shared_rows(np.hstack([waves, waves * middle[:, None] / np.ptp(middle)]))
        basis, triangle = np.linalg.qr(table)
        size = np.abs(np.diag(triangle))
        return np.asarray(basis[:, size > 1e-8 * float(size.max())], np.float64)

    def command_rows(self, mean: Array) -> Array:
        """White rows (m, p) of the command's channel from what the heads share (m, p), as `shared` gives it."""
        rows, basis = self._shared_rows(mean), self._line_basis
        rows = rows if basis is None else rows - ((rows.T @ basis) @ basis.T).T
        return self._slow_noise(COMMAND).whiten(rows) if HEAD in self._slow else rows

    def _shared_rows(self, mean: Array) -> Array:
        """Whitened rows (m, p) of what the heads share (m, p)."""
        enough = segments_of(self._enough)
        rows = self._command_filter.apply(bridge(mean, self.uncommanded), enough)
        weight = self._heads.weight * ~self.uncommanded
        if HEAD in self.by_speed:
            louder = np.square(self.by_speed.louder(HEAD, self.grid.time))
            weight = weight / np.sqrt(1 + self._command_filter.part_of_floor * (louder / np.mean(louder) - 1))
        rows *= weight[:, None]
        return self._command_filter.without_holds(rows, weight)

    @property
    def command_floor(self) -> float:
        """One-sided density of the readings' noise in the mean of all heads, rad^2/Hz.

        Heads may be quieter than stated against one another and no quieter in their mean: the jitter, which nobody
        knows exactly, leaves errors of rounding that all of them share.
        """
        std = self.std[HEAD] * max(1.0, 1 / self.levels[HEAD])
        variance = std**2 * self.by_speed.mean_square(HEAD, self.grid.time)
        return 2 * self.grid.period * variance / len(self.grid.heads)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the groups of rows."""
        names = [COMMAND, *self.grid.heads] if self.grid.heads else []
        for sensor in self._sensors:
            names += channels_of(sensor)
        return tuple(names)

    def times(self, channel: str) -> Array:
        """(n,) time of each row of a channel, s."""
        if channel == COMMAND or channel in self.grid.heads:
            return self.grid.time
        return self._streams[channel.partition(".")[0]].time

    def whiten(self, signals: Mapping[str, Array]) -> dict[str, Array]:
        """White rows (m, p) of each channel from signals (n, k, p) of some streams.

        Streams that are not given count as zero; channels on which none of the given streams acts are left out.
        """
        rows: dict[str, Array] = {}
        if any(name in signals for name in self.grid.heads):
            rows |= self._of_heads(signals)
        for sensor in self._sensors:
            if sensor in signals:
                rows |= self._sensor(sensor, signals[sensor])
        for channel, white in rows.items():
            if channel != COMMAND and instrument_of(channel) in self.by_speed:
                white /= self.by_speed.louder(instrument_of(channel), self.times(channel))[:, None]
        return {
            channel: self._slow_noise(channel).whiten(white) if instrument_of(channel) in self._slow else white
            for channel, white in rows.items()
        }

    def without_slow_noise(self, rows: Mapping[str, Array]) -> dict[str, Array] | None:
        """White rows (m, p) by channel as they would be without slow noise; None where there is none."""
        slow = {channel for channel in rows if (HEAD if channel == COMMAND else instrument_of(channel)) in self._slow}
        if not slow:
            return None
        return {c: self._slow_noise(c).plain(white) if c in slow else white for c, white in rows.items()}

    def _slow_noise(self, channel: str) -> SlowNoise:
        if channel not in self._kept_slow:
            courses = self._shared_courses() if channel == COMMAND else self._slow[instrument_of(channel)]
            self._kept_slow[channel] = SlowNoise(self.cells(channel), courses)
        return self._kept_slow[channel]

    def _shared_courses(self) -> Array:
        """Those of the heads' mean, which is as much less noisy at all frequencies; the jitter hides part of them."""
        courses, floor = self._slow[HEAD], self.command_floor
        frequency = np.arange(courses.shape[1]) / (2 * np.ptp(self.grid.time))
        return np.asarray(courses * np.sqrt(floor / (floor + self.jitter.density(frequency))), np.float64)

    def expected(self) -> dict[str, Array]:
        """(m,) expected square of each white row of each channel under noise alone."""
        expected = self._expected_of_heads() if self.grid.heads else {}
        for name in self._sensors:
            ones = np.ones((len(self._streams[name].time), len(channels_of(name)), 1))
            for i, (channel, rows) in enumerate(self._sensor(name, ones).items()):
                weight = self._weights[name][:, i] if name in self._weights else 1.0
                expected[channel] = (rows[:, 0] != 0) * np.square(weight)
        return expected

    def _expected_of_heads(self) -> dict[str, Array]:
        present, count = self._present, self._heads.count
        weight = np.square(self._heads.weight)
        share = (1 - 1 / np.maximum(count, 1)) * weight
        expected = {name: present[:, i] * share for i, name in enumerate(self.grid.heads)}
        ones = np.ones((len(self.grid.time), 1))
        enough = segments_of(self._enough)
        seen = (self._command_filter.apply(ones, enough)[:, 0] != 0) & ~self.uncommanded
        expected[COMMAND] = seen * weight
        basis = self._line_basis
        if basis is not None:
            expected[COMMAND] = expected[COMMAND] * (1 - np.sum(np.square(basis), axis=1))
        return expected

    def shared(self, signals: Mapping[str, Array]) -> tuple[Array, NDArray[np.bool_]]:
        """Mean over the heads (m, p) that are present, and where at least half of them are and the command is known."""
        width, count = self.grid.width(signals), len(self.grid.time)
        mean = np.empty((width, count))
        for columns in few_at_once(width, count):
            table = np.empty((len(self.grid.heads), columns.stop - columns.start, count))
            self.grid.lay_out(table, signals, self._kept, columns)
            mean[columns] = self._mean(table)
        return mean.T, self._enough & ~self.uncommanded

    def jitter_of(self, residual: Mapping[str, Array]) -> Array:
        """(m,) rotation about the command at the heads' instants: the least-squares estimate for the jitter's spectrum.

        Wiener, Extrapolation, Interpolation, and Smoothing of Stationary Time Series, 1949.

        Args:
            residual: measured minus predicted (n, 1) of each head.
        """
        mean, seen = self.shared({name: residual[name][:, :, None] for name in self.grid.heads})
        course = bridge(mean, ~seen)[:, 0]
        both = np.concatenate([course, course[::-1]])  # ends as it begins
        density = self.jitter.density(np.asarray(np.fft.rfftfreq(len(both), self.grid.period), np.float64))
        spectrum = np.fft.rfft(both) * (density / (density + self.command_floor))
        return np.asarray(np.fft.irfft(spectrum, len(both))[: len(course)], np.float64)

    @property
    def _head_times(self) -> dict[str, Array]:
        """(n,) s of the samples of each head."""
        return {name: self._streams[name].time for name in self.grid.heads}

    def _find_spikes(
        self, stage: StageDescription, residual: Mapping[str, Array], command: SignalStream, apart: Mask
    ) -> dict[str, NDArray[np.bool_]]:
        """(n, k) which samples of each stream are spikes; those of heads are as good as lost.

        In rows (m,) in which heads are `apart` only by what is not known of the command there is none.
        """
        found = {}
        if self.grid.heads:
            azimuths = {f"{HEAD}_{letter}": azimuth for letter, azimuth in stage.azimuths.items()}
            found = find_head_spikes(self.grid, residual, self.std[HEAD], azimuths, command)
        for name, spikes in found.items():
            spikes[:, 0] &= ~apart[self.grid.rows[name]]
            self._kept[name] &= ~spikes[:, 0]
        for name in self._sensors:
            std = self.std[instrument_of(name)]
            found[name] = find_spikes(residual[name], std, self._streams[name], command)
        return found

    @property
    def _heads(self) -> HeadRows:
        if self._kept_heads is None:
            self._kept_heads = HeadRows.of(self.grid, self._present, self.row_weight, self._head_times)
        return self._kept_heads

    @property
    def _enough(self) -> NDArray[np.bool_]:
        """(m,) whether at least half of the heads were read."""
        return np.asarray(self._heads.count * 2 >= len(self.grid.heads), bool)

    def _mean(self, table: Array) -> Array:
        """(p, m) mean over the heads that are present."""
        return np.asarray(table.sum(axis=0) / np.maximum(self._heads.count, 1), np.float64)

    def _of_heads(self, signals: Mapping[str, Array]) -> dict[str, Array]:
        several, width, count = self._heads.count > 1, self.grid.width(signals), len(self.grid.time)
        weight = self._heads.weight * several / self.std[HEAD]
        weights, late = self._present.T * weight, self._heads.late
        table, mean = np.empty((len(self.grid.heads), width, count)), np.empty((width, count))
        for columns in few_at_once(width, count):
            part = table[:, columns]
            self.grid.lay_out(part, signals, self._kept, columns)
            mean[columns] = self._mean(part)
            rate = rate_of(mean[columns], several, self.grid.period)
            for i, head in enumerate(part):
                head -= mean[columns]
                head -= late[i] * rate
                head *= weights[i]
        rows = {name: head.T for name, head in zip(self.grid.heads, table, strict=True)}
        return {**rows, COMMAND: self.command_rows(mean.T)}

    def _sensor(self, name: str, values: Array) -> dict[str, Array]:
        own = SensorRows(name, self._streams[name], self._kept[name], self.spikes[name], self._weights.get(name))
        return own.white(values, self.std[instrument_of(name)], self._whiteners.get(name))

    def _turbulence_filters(self) -> dict[str, Whitener]:
        """Of the sensors whose noise has a slow part."""
        white = {name: self.std[instrument_of(name)] for name in self._sensors}
        return drift_predictors(self._turbulence, white, self._streams)

    @property
    def _command_filter(self) -> JitterFilter:
        if self._kept_filter is None:
            self._kept_filter = JitterFilter(self.jitter, self.command_floor, self.grid.period, self.moving)
        return self._kept_filter
