"""Figures 7 to 11 and 13 to 14 of Lou et al. 2019 in the paper's form, from the recordings of a reproduction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.notebook.estimates import Estimate
from rotary_error_monitor.notebook.recording import read_bag
from rotary_error_monitor.report.drawing import WIDE, drawn, go_round, label, new_axes
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import colour
from rotary_error_monitor.reproduction.units import ARCSEC, DEGREE, UM

_HEIGHT = 2.7
"""Of a picture, inches."""

_CELLS = 360
"""Angles of a turn over which a figure shows means: a degree is hardly wider than its line."""


class Readings:
    """What heads and autocollimator of a recording show, over the angle while it turns forward.

    Attributes:
        angle: (k,) rad.
    """

    def __init__(self, bag: Path, stage: StageDescription) -> None:
        """Read a recording; values are means over the turns forward."""
        recording = read_bag(bag)
        command = recording["command"]
        first = recording["head_a"]
        self._times = first.times_ns
        self._theta = np.interp(self._times, command.times_ns, command["angle"])
        speed = np.interp(self._times, command.times_ns, command["velocity"])
        self._used = speed > 0.9 * speed.max()
        self._heads = {
            name.removeprefix("head_"): np.interp(self._times, stream.times_ns, stream["angle"])
            for name, stream in recording.streams.items()
            if name.startswith("head_")
        }
        collimator = recording["autocollimator"]
        tilt = stage.response("autocollimator").corrected(collimator.values)
        self._tilt = np.stack([np.interp(self._times, collimator.times_ns, each) for each in tilt.T], axis=1)
        self._radius = stage.ring.disc_radius
        self.angle: Array = np.asarray((np.arange(_CELLS) + 0.5) * (2 * np.pi / _CELLS), dtype=np.float64)

    def difference(self, one: str, other: str) -> Array:
        """(k,) indication of one head less that of another, rad, about its mean."""
        found = self._over_angle(self._heads[one] - self._heads[other])
        return np.asarray(found - found.mean(), dtype=np.float64)

    def displacement(self, one: str, other: str) -> Array:
        """(k,) displacement of the ring's centre across the line of two opposed heads, m (Equation 3)."""
        return np.asarray(self._radius * np.tan(self.difference(one, other) / 2), dtype=np.float64)

    def tilt(self, axis: int) -> Array:
        """(k,) tilt that the autocollimator shows, rad, about its mean."""
        found = self._over_angle(self._tilt[:, axis])
        return np.asarray(found - found.mean(), dtype=np.float64)

    def estimated(self, found: Estimate, component: int) -> Array:
        """(k,) component of the error motion of this recording, about its mean."""
        values = np.interp(self._times, found.stamp_ns, np.nan_to_num(found.error_motion[:, component]))
        mean = self._over_angle(values)
        return np.asarray(mean - mean.mean(), dtype=np.float64)

    def _over_angle(self, values: Array) -> Array:
        turned = np.mod(self._theta[self._used], 2 * np.pi)
        cells = np.minimum((turned * (_CELLS / (2 * np.pi))).astype(np.int64), _CELLS - 1)
        counts = np.bincount(cells, minlength=_CELLS)
        sums = np.bincount(cells, weights=values[self._used], minlength=_CELLS)
        return np.asarray(sums / np.maximum(counts, 1), dtype=np.float64)


def original_errors(between: Readings) -> tuple[Drawn, ...]:
    """Figures 7 and 8: heads A and B apart and the eccentricity in Y, tilt of the mirror."""
    apart = {"A - B": between.difference("a", "b") / ARCSEC}
    across = {"eccentricity in Y": between.displacement("a", "b") / UM}
    tilts = {f"{'XY'[k]}": between.tilt(k) / ARCSEC for k in range(2)}
    return (
        _over_angle(between.angle, "Figure 7: indications of A less B, between centres", "difference, arcsec", apart),
        _over_angle(between.angle, "Figure 7: eccentricity of the grid disc in Y", "displacement, µm", across),
        _over_angle(between.angle, "Figure 8: tilt of the mirror", "tilt, arcsec", tilts),
    )


def separated_errors(assembled: Readings, found: Estimate) -> tuple[Drawn, ...]:
    """Figures 9 to 11: heads apart, radial error motion of disc and shaft, tilt of mirror and shaft."""
    angle = assembled.angle
    pairs = {"A - B": assembled.difference("a", "b"), "C - D": assembled.difference("c", "d")}
    discs = assembled.displacement("d", "c"), assembled.displacement("a", "b")
    pictures = [
        _over_angle(
            angle,
            "Figure 9: indications of opposed heads",
            "difference, arcsec",
            {name: values / ARCSEC for name, values in pairs.items()},
        )
    ]
    for axis, name in enumerate("XY"):
        radial = {"grid disc": discs[axis] / UM, "shaft": assembled.estimated(found, axis) / UM}
        title = f"Figure 10 ({'ab'[axis]}): radial error motion, {name}"
        pictures.append(_over_angle(angle, title, "displacement, µm", radial))
    for axis, name in enumerate("XY"):
        tilt = {"mirror": assembled.tilt(axis) / ARCSEC, "shaft": assembled.estimated(found, 3 + axis) / ARCSEC}
        pictures.append(_over_angle(angle, f"Figure 11 ({'ab'[axis]}): tilt, {name}", "tilt, arcsec", tilt))
    return tuple(pictures)


def verified(number: int, comparison: Mapping[str, Any]) -> tuple[Drawn, ...]:
    """Figure 13 or 14, by axis: radial error motion predicted and measured at a height, and what is left; forward.

    Args:
        number: of the figure.
        comparison: of `compare --format json`.
    """
    shown: Mapping[str, Sequence[float]] = comparison["over_angle"][0]
    angle, height = np.array(shown["angle"]), comparison["height"] * 1e3
    pictures = []
    for place, axis in enumerate("xy"):
        predicted, measured = (np.array(shown[f"{who}_{axis}"]) / UM for who in ("estimate", "reference"))
        curves = {"predicted": predicted, "measured, LVDT": measured, "residual": measured - predicted}
        title = f"Figure {number} ({'ab'[place]}): radial error motion, {axis.upper()}, h = {height:g} mm"
        pictures.append(_over_angle(angle, title, "displacement, µm", curves))
    return tuple(pictures)


def _over_angle(angle: Array, title: str, y: str, curves: Mapping[str, Array]) -> Drawn:
    figure, ax = new_axes(WIDE, _HEIGHT, list(curves) if len(curves) > 1 else ())
    for number, (name, values) in enumerate(curves.items()):
        named = name if len(curves) > 1 else None
        ax.plot(angle / DEGREE, values, color=colour(number), lw=1.0, label=named)
    go_round(ax)
    label(figure, ax, title, "angle, °", y)
    ranges = ", ".join(f"{name} {np.ptp(values):.3g}" for name, values in curves.items())
    return drawn(figure, f"{title}, over the angle; range {ranges} {y.rpartition(', ')[2]}")
