"""Spans of a recording in which something is missing, and how signals are carried across them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.twin.recording import StageRecording, Stream

Array = NDArray[np.float64]


def input_gaps(recording: StageRecording) -> Array:
    """(n, 2) spans of time in which command or force were not recorded, so that nothing can be predicted."""
    spans: list[tuple[float, float]] = []
    for name in ("command", "force"):
        stream: Stream | None = recording.streams.get(name)
        if stream is not None:
            wide = np.flatnonzero(np.diff(stream.time) > 3.5 * stream.period)
            spans += [(float(stream.time[i]), float(stream.time[i + 1])) for i in wide]
    command = recording.streams["command"]
    spans += [(-np.inf, float(command.time[0])), (float(command.time[-1]), np.inf)]
    return np.asarray(spans)


def inside(time: Array, spans: Array) -> NDArray[np.bool_]:
    """(m,) whether times (m,) lie inside any of the spans (n, 2)."""
    found = np.zeros(len(time), bool)
    for start, stop in spans:
        found |= (time > start) & (time < stop)
    return found


def bridge(rows: Array, missing: NDArray[np.bool_]) -> Array:
    """Rows (n, p) with straight lines across the missing ones, for signal and signatures alike."""
    if not missing.any() or missing.all():
        return rows
    good, bad = np.flatnonzero(~missing), np.flatnonzero(missing)
    after = np.clip(np.searchsorted(good, bad), 1, len(good) - 1)
    left, right = good[after - 1], good[after]
    share = np.clip((bad - left) / (right - left), 0.0, 1.0)[:, None]
    bridged = rows.copy(order="K")
    bridged[bad] = (1 - share) * rows[left] + share * rows[right]
    return bridged
