"""The picture of a run: radial error motion beside the reference as a force comes and goes, tool offset corrected."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.streams import REFERENCE_TITLE
from rotary_error_monitor.metrology.radial_comparison import RadialComparison
from rotary_error_monitor.mock_cell.figures import CellResult
from rotary_error_monitor.mock_cell.run import seconds
from rotary_error_monitor.report.traces import Panel, Trace, draw_panels


def _shown(result: CellResult, epoch_ns: int) -> Iterator[tuple[float, RadialComparison, NDArray[np.bool_]]]:
    """Each height of the reference with its comparison and the samples of the force meanwhile."""
    for height, found in result.comparisons.items():
        begin, end = seconds(found.stamp_ns[[0, -1]], epoch_ns)
        yield height, found, (result.force[:, 0] >= begin) & (result.force[:, 0] <= end)


def draw_cell(result: CellResult, epoch_ns: int, path: Path) -> None:
    """Write the picture (PNG) of a run: the height and the direction in which the force changed most."""

    def change(shown: tuple[float, RadialComparison, NDArray[np.bool_]]) -> NDArray[np.float64]:
        return np.asarray(np.ptp(result.force[shown[2], 1:], axis=0))

    chosen = max(_shown(result, epoch_ns), key=lambda each: float(change(each).max()))
    height, found, inside = chosen
    axis = int(np.argmax(change(chosen)))
    letter = "xy"[axis]
    force = Trace(result.force[inside, 0], result.force[inside, 1 + axis], f"force {letter}")
    time = seconds(found.stamp_ns, epoch_ns)
    offset_time = seconds(result.offsets.stamp_ns, epoch_ns)
    before, after = (np.linalg.norm(o[:, :3], axis=1) * 1e6 for o in (result.offsets.before, result.offsets.after))
    draw_panels(
        path,
        [
            Panel("external force, N", (force,)),
            Panel(
                f"radial error motion {letter} at {height * 1e3:.0f} mm, µm",
                (
                    Trace(time, found.reference[:, axis] * 1e6, REFERENCE_TITLE),
                    Trace(time, found.estimate[:, axis] * 1e6, "estimated from heads and autocollimator"),
                ),
            ),
            Panel(
                "difference, µm",
                (Trace(time, (found.estimate - found.reference)[:, axis] * 1e6, f"estimate minus {REFERENCE_TITLE}"),),
            ),
            Panel(
                "tool offset, µm",
                (Trace(offset_time, before, "as the machine is"), Trace(offset_time, after, "corrected")),
                log=True,
                own_time=True,
            ),
        ],
    )
