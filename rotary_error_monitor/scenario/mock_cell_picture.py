"""The picture of a run: radial error motion against the LVDT while a force comes and goes, tool offset corrected."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotary_error_monitor.report.traces import Panel, Trace, draw_panels
from rotary_error_monitor.scenario.mock_cell import seconds
from rotary_error_monitor.scenario.mock_cell_figures import CellResult

SHOWN = 0.016
"""Height of the LVDT whose comparison is shown, m: that of Lou et al. 2019, Figure 15."""


def draw_cell(result: CellResult, epoch_ns: int, path: Path) -> None:
    """Write the picture (PNG) of a run."""
    found = result.comparisons.get(SHOWN) or next(iter(result.comparisons.values()))
    time = seconds(found.stamp_ns, epoch_ns)
    inside = (result.force[:, 0] >= time[0]) & (result.force[:, 0] <= time[-1])
    offset_time = seconds(result.offsets.stamp_ns, epoch_ns)
    before, after = (np.linalg.norm(o[:, :3], axis=1) * 1e6 for o in (result.offsets.before, result.offsets.after))
    draw_panels(
        path,
        [
            Panel("external force, N", (Trace(result.force[inside, 0], result.force[inside, 2], "force y"),)),
            Panel(
                f"radial error motion y at {SHOWN * 1e3:.0f} mm, µm",
                (
                    Trace(time, found.reference[:, 1] * 1e6, "LVDT"),
                    Trace(time, found.estimate[:, 1] * 1e6, "estimated from heads and autocollimator"),
                ),
            ),
            Panel(
                "difference, µm",
                (Trace(time, (found.estimate - found.reference)[:, 1] * 1e6, "estimate minus LVDT"),),
            ),
            Panel(
                "tool offset, µm",
                (Trace(offset_time, before, "as the machine is"), Trace(offset_time, after, "corrected")),
                log=True,
                own_time=True,
            ),
        ],
    )
