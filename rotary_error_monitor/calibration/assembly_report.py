"""What a recording between centres says of ring and mirror, in words, µm and arcsec."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotary_error_monitor.calibration.assembly import AssemblyResult, misfit_lines
from rotary_error_monitor.calibration.assembly_tables import MeasuredCurve, shown_orders, written_names
from rotary_error_monitor.calibration.head_comparison import AssemblyComparison, ComparedSignal, figures
from rotary_error_monitor.metrology.mirror_assembly import MirrorAssembly
from rotary_error_monitor.metrology.ring_assembly import RingAssembly
from rotary_error_monitor.units import ARCSEC

MOST_ORDERS = 8
"""Orders that a line names, the lowest first: as many as stand in it beside the words."""


def assembly_text(result: AssemblyResult, output: Path) -> str:
    """What was found, what was kept, and what does not fit."""
    curves = {curve.name: curve for curve in result.curves}
    lines = _ring_lines(result.ring, result.ticks, curves.get("graduation"))
    if result.mirror is None:
        lines.append(f"mirror: {result.remark}, left as it was")
    else:
        lines += _mirror_lines(result.mirror, curves.get("flatness"))
    lines += _comparison_lines(result.comparison)
    lines.append(
        f"between centres the shaft may itself go round by {result.centres.radial * 1e6:g} µm and lean by "
        f"{result.centres.lean * ARCSEC:g} arcsec (standard uncertainties, counted above), which looks the same"
    )
    if not result.fits:
        lines += ["the recording does not fit:", *(f"  {line}" for line in misfit_lines(result))]
    lines += [f"note: {remark}" for remark in result.remarks]
    if result.written:
        files = [str(path) for path in written_names(result.curves, output).values()]
        return "\n".join([*lines, f"written to {', '.join([str(output), *files])}"])
    return "\n".join([*lines, "not written; --force writes it with an uncertainty that covers what is left"])


def _comparison_lines(comparison: AssemblyComparison | None) -> list[str]:
    """What heads differ in and the mirror shows: half of the range before, root mean square after."""
    if comparison is None:
        return []
    lines = ["before, half of the range, and after, root mean square:"]
    for pair in comparison.pairs:
        before, left = figures(pair.before)[0], figures(pair.after)[1]
        lines.append(
            f"  {pair.name}, {'opposed' if pair.opposed else 'neighbours'}: {before * ARCSEC:.3f} arcsec "
            f"({comparison.displacement(pair, before) * 1e6:.3f} µm), {left * ARCSEC:.4f} arcsec "
            f"({comparison.displacement(pair, left) * 1e6:.4f} µm){_reversal(pair)}"
        )
    for axis in comparison.mirror:
        before, left = figures(axis.before)[0], figures(axis.after)[1]
        lines.append(f"  {axis.name}: {before * ARCSEC:.3f} arcsec, {left * ARCSEC:.4f} arcsec{_reversal(axis)}")
    return lines


def _reversal(signal: ComparedSignal) -> str:
    """What the means of both directions differ in, if both are there."""
    if signal.reversal is None:
        return "; one direction only"
    apart, noise = (value * ARCSEC for value in signal.reversal)
    return f"; forward and backward differ by {apart:.4f} (scatter alone {noise:.4f})"


def _curve_lines(curve: MeasuredCurve) -> list[str]:
    _, rms = figures(curve.values)
    return [
        f"  {curve.name} as a curve of {len(curve.angles)} angles: {rms * ARCSEC:.3f} arcsec (root mean square), "
        f"standard uncertainty {figures(curve.std)[1] * ARCSEC:.4f}; interpolation misses {curve.bound * ARCSEC:.2g} "
        "at most",
        f"  in it {shown_orders(curve.orders)}",
    ]


def _ring_lines(ring: RingAssembly, ticks: int, curve: MeasuredCurve | None) -> list[str]:
    (x, y), (std_x, std_y) = ring.eccentricity, ring.eccentricity_std
    lines = [
        f"ring: eccentricity ({x * 1e6:.3f}, {y * 1e6:.3f}) µm, standard uncertainty ({std_x * 1e6:.4f}, "
        f"{std_y * 1e6:.4f}) µm, from {ticks} times; residual {ring.fit.ratio:.2f} times the noise"
    ]
    lines += [] if curve is None else _curve_lines(curve)
    for row, std in zip(ring.graduation, ring.graduation_std, strict=True) if curve is None else ():
        lines.append(
            f"  graduation order {row.order}: {np.hypot(row.cos, row.sin) * ARCSEC:.3f} arcsec, standard uncertainty "
            f"{max(std) * ARCSEC:.4f}"
        )
    for row in ring.kept:
        lines.append(
            f"  graduation order {row.order}: {np.hypot(row.cos, row.sin) * ARCSEC:.3f} arcsec, kept from before: "
            f"{'these heads cannot see it' if row.order <= ring.highest else 'not told by this sampling'}"
        )
    lines.append(f"  orders up to {ring.highest} were looked for")
    if ring.hidden_orders:
        lines[-1] += f"; these heads cannot see {_listed(ring.hidden_orders)}"
    return lines


def _mirror_lines(mirror: MirrorAssembly, curve: MeasuredCurve | None) -> list[str]:
    tilt_x, tilt_y = (value * ARCSEC for value in mirror.tilt)
    lines = [
        f"mirror: tilt ({tilt_x:.3f}, {tilt_y:.3f}) arcsec, standard uncertainty ({mirror.tilt_std[0] * ARCSEC:.4f}, "
        f"{mirror.tilt_std[1] * ARCSEC:.4f}); residual {mirror.fit.ratio:.2f} times the noise",
        f"  autocollimator {mirror.delay * 1e3:.3f} ms old, standard uncertainty {mirror.delay_std * 1e3:.3f} ms",
    ]
    lines += [] if curve is None else _curve_lines(curve)
    for row, std in zip(mirror.flatness, mirror.flatness_std, strict=True) if curve is None else ():
        lines.append(
            f"  flatness order {row.order}: {_size(row.x, row.y):.3f} arcsec, standard uncertainty {std * ARCSEC:.4f}"
        )
    for row in mirror.kept:
        lines.append(
            f"  flatness order {row.order}: {_size(row.x, row.y):.3f} arcsec, kept from before: "
            "not told by this sampling"
        )
    return [*lines, f"  orders up to {mirror.highest} were looked for"]


def _size(x: Sequence[float], y: Sequence[float]) -> float:
    """Root mean square over the two directions of an order's amplitude, arcsec."""
    return float(np.sqrt(np.sum(np.square([*x, *y])) / 2) * ARCSEC)


def _listed(orders: Sequence[int]) -> str:
    """The orders, or the first of them."""
    shown = ", ".join(map(str, orders[:MOST_ORDERS]))
    return shown + (", …" if len(orders) > MOST_ORDERS else "")
