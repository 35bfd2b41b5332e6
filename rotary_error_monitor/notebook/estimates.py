"""The error motion of a recording as a notebook has it: what the command `replay` gives, to the last bit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.signals import radial_at
from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.files import check_outputs
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.notebook.read_only import ReadOnly, sealed
from rotary_error_monitor.notebook.recording import Recording, Topics, bag_of
from rotary_error_monitor.notebook.tables import Units, table_over_time, units_in
from rotary_error_monitor.pipeline.estimator_settings import MAX_GAP, EstimatorSettings, max_gap_of
from rotary_error_monitor.pipeline.radial_heights import HIGHEST, check_height
from rotary_error_monitor.pipeline.verdict import DOUBTS
from rotary_error_monitor.recordings.replay import check_estimated, period_of, replay_bag
from rotary_error_monitor.recordings.replayed import Replay
from rotary_error_monitor.report.page import table
from rotary_error_monitor.signals.blocks import NANOSECONDS

if TYPE_CHECKING:
    from pandas import DataFrame

    from rotary_error_monitor.report.plot import Plot


_SI = ("m", "m", "m", "rad", "rad", "rad")
_OFFSET = ("x", "y", "z", "a", "b", "c")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Estimate:
    """Error motion at n times; arrays are read-only.

    Attributes:
        recording: the bag.
        replay: what estimator and compensation give, as the command `replay` writes it.
        used: (n,) whether the estimate rests on an input stream, by its name.
        doubts: (n,) whether there is a doubt, by its name as in `msg_defs/error_motion.yaml`.
    """

    recording: Path
    replay: Replay
    used: Mapping[str, Mask]
    doubts: Mapping[str, Mask]

    @property
    def stamp_ns(self) -> NDArray[np.int64]:
        """(n,) timestamps (ns since 1970, UTC)."""
        return self.replay.stamp_ns

    @property
    def time(self) -> Array:
        """(n,) time after the first estimate, s."""
        return sealed(_seconds(self.stamp_ns))

    @property
    def theta(self) -> Array:
        """(n,) rotation, rad."""
        return self.replay.theta

    @property
    def error_motion(self) -> Array:
        """(n, 6) exc eyc ezc (m) eac ebc ecc (rad), NaN where not observable; radial motion is that at the ring."""
        return sealed(self.replay.error_motion)

    @property
    def covariance(self) -> Array:
        """(n, 6, 6) of the error motion, NaN in rows and columns that are not observable."""
        return sealed(self.replay.covariance)

    @property
    def sigma(self) -> Array:
        """(n, 6) standard uncertainty of the error motion, m and rad, NaN where not observable."""
        return _deviations(self.covariance)

    @property
    def observable(self) -> Mask:
        """(n, 6) which components the readings determine."""
        return sealed(np.isfinite(self.error_motion))

    @property
    def tool_offset(self) -> Array | None:
        """(n, 6) x y z (m) a b c (rad) of the tool against the workpiece, NaN where held; None without a machine."""
        return self.replay.tool_offset

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader should know: what the bag lacks, and what was not believed."""
        return self.replay.remarks

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def at_height(self, height: float) -> RadialMotion:
        """Radial error motion at a height above the ring, m (Abbe; Lou et al. 2019, Equation 7).

        Raises:
            InputError: no stage is as high.
        """
        check_height(height, HIGHEST, "m", f"height is {height}")
        values, covariance = radial_at(self.error_motion, self.covariance, height)
        return sealed(RadialMotion(height, self.stamp_ns, self.theta, values, covariance))

    def to_dataframe(self, units: Units = "SI") -> DataFrame:
        """Table with a row for each time (index `time`, UTC), units of the columns in `attrs["units"]`.

        Columns: `theta` (rad), the components `exc` to `ecc`, their standard uncertainties `sigma_exc` to `sigma_ecc`,
        and with a machine `tool_x` to `tool_c`; NaN where not observable or held.

        Args:
            units: `SI` for m and rad, `um` for µm and µrad (theta stays in rad).

        Raises:
            InputError: there are no such units.
            MissingPackageError: pandas is not installed.
        """
        factor, names = units_in(units)
        columns, told = {"theta": self.theta}, {"theta": "rad"}
        parts = [("", COMPONENTS, self.error_motion), ("sigma_", COMPONENTS, self.sigma)]
        if self.tool_offset is not None:
            parts.append(("tool_", _OFFSET, self.tool_offset))
        for prefix, letters, values in parts:
            for i, letter in enumerate(letters):
                columns[prefix + letter] = values[:, i] * factor
                told[prefix + letter] = names.get(_SI[i], _SI[i])
        return table_over_time(self.stamp_ns, columns, told)

    def figure(self) -> Plot:
        """Polar plot of the radial error motion at the ring, and all that is observable over time. It is not shown."""
        from rotary_error_monitor.report.estimate_figure import draw_motion

        return draw_motion(self.time, self.theta, self.error_motion, self.sigma, self.tool_offset)

    def save(self, path: Path | str) -> None:
        """Write what the command `replay` writes, an .npz file.

        Raises:
            InputError: it cannot be written, or is a file of the recording.
        """
        check_outputs([Path(path)], [self.recording])
        self.replay.save(path)

    def _said(self) -> Iterator[tuple[str, str]]:
        """What a reader wants to know first, a line each."""
        yield "estimates", f"{len(self)} over {self.time[-1]:.1f} s"
        for name, unit, column, sigma in zip(COMPONENTS, _SI, self.error_motion.T, self.sigma.T, strict=True):
            seen = np.isfinite(column)
            if seen.any():
                size, spread = np.sqrt(np.mean(column[seen] ** 2)) * 1e6, np.median(sigma[seen]) * 1e6
                often = "" if seen.all() else f", observable {seen.mean():.1%} of the time"
                yield name, f"rms {size:.3g} µ{unit}, median sigma {spread:.2g} µ{unit}{often}"
        doubted = [name for name, mask in self.doubts.items() if mask.any()]
        yield "doubted at some time", ", ".join(doubted) or "nothing"

    def __repr__(self) -> str:
        lines = [f"{name}: {text}" for name, text in self._said()]
        return "\n  ".join([f"Estimate of {self.recording}", *lines])

    def _repr_html_(self) -> str:
        return table((), [("recording", str(self.recording)), *self._said()])


@dataclass(frozen=True, slots=True, eq=False)
class RadialMotion:
    """Radial error motion at one height over n times; arrays are read-only.

    Attributes:
        height: above the ring, m.
        stamp_ns: (n,) timestamps (ns since 1970, UTC).
        theta: (n,) rotation, rad.
        values: (n, 2) along x and y, m, NaN where not observable.
        covariance: (n, 2, 2) of it, m², without meaning where the values are NaN.
    """

    height: float
    stamp_ns: NDArray[np.int64]
    theta: Array
    values: Array
    covariance: Array

    @property
    def sigma(self) -> Array:
        """(n, 2) standard uncertainty, m, NaN where not observable."""
        return sealed(np.where(np.isfinite(self.values), _deviations(self.covariance), np.nan))

    def to_dataframe(self, units: Units = "SI") -> DataFrame:
        """Table with the columns `theta`, `x`, `y`, `sigma_x`, `sigma_y`; units and errors as of `Estimate`."""
        factor, names = units_in(units)
        columns = {
            "theta": self.theta,
            **{name: self.values[:, i] * factor for i, name in enumerate("xy")},
            **{f"sigma_{name}": self.sigma[:, i] * factor for i, name in enumerate("xy")},
        }
        told = {name: "rad" if name == "theta" else names.get("m", "m") for name in columns}
        return table_over_time(self.stamp_ns, columns, told)

    def figure(self) -> Plot:
        """Polar plot, and x and y over time. It is not shown."""
        from rotary_error_monitor.report.estimate_figure import draw_motion

        return draw_motion(_seconds(self.stamp_ns), self.theta, self.values, self.sigma, height=self.height)


def _deviations(covariance: Array) -> Array:
    """(n, k) standard deviations of covariances (n, k, k)."""
    return sealed(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))


def _seconds(stamp_ns: NDArray[np.int64]) -> Array:
    """(n,) time after the first of timestamps (n,), ns, in s."""
    return np.asarray((stamp_ns - stamp_ns[0]) / NANOSECONDS)


def estimate(
    recording: Recording | Path | str,
    stage: Path | str | None = None,
    machine: Path | str | None = None,
    *,
    period: float = 1e-3,
    max_gap: float = MAX_GAP,
    cell: str = "",
    topics: Topics = None,
) -> Estimate:
    """Error motion of a recording, and with a machine the tool offset: the numbers of the command `replay`.

    Args:
        recording: a bag, or what `read_bag` gave.
        stage: YAML with a section `stage`; None for the stage that the package ships.
        machine: YAML, or name of a machine that ships, such as `xyzac_trt`; None for the stage alone.
        period: distance of two estimates, s, where the bag does not hold those of a live run.
        max_gap: samples further apart are not joined, s, but for what the bag's live run joined.
        cell: of a bag that holds several, as for `read_bag`.
        topics: how the bag calls its topics, as for `read_bag`.

    Raises:
        InputError: there is no such bag or description, the bag lacks what tells the rotation, or a value is out of
            range; the message says which and what would be right.

    Example:
        >>> from rotary_error_monitor import estimate
        >>> found = estimate(bag, stage)
        >>> found.error_motion.shape == found.sigma.shape
        True
        >>> found.to_dataframe(units="um").attrs["units"]["eac"]
        'µrad'
        >>> found.at_height(0.06).values.shape == (len(found), 2)
        True
    """
    path, naming = bag_of(recording, cell, topics)
    described = load_stage(stage)
    settings = EstimatorSettings(
        period_ns=period_of(period, NANOSECONDS, f"period is {period} s"),
        max_gap_ns=max_gap_of(max_gap, NANOSECONDS, f"max_gap is {max_gap} s"),
    )
    replay = replay_bag(path, described, None if machine is None else load_machine(machine), settings, naming=naming)
    check_estimated(replay, path, described)
    streams = wire_of(described).used_streams
    used = {name: replay.motion.streams & streams.mask([name]) != 0 for name in streams.bits}
    doubts = {name: replay.motion.doubts >> bit & 1 != 0 for bit, name in enumerate(DOUBTS)}
    return sealed(Estimate(path, replay, ReadOnly(used), ReadOnly(doubts)))
