"""Noise with a slow part, such as that of the turbulence of air before an autocollimator, made white."""

from __future__ import annotations

from collections.abc import Mapping

from rotary_error_monitor.description.two_axis_section import Turbulence
from rotary_error_monitor.noise.whitening import Whitener, drift_predictor
from rotary_error_monitor.twin.recording import SignalStream


def drift_predictors(
    slow: Mapping[str, Turbulence | None], white: Mapping[str, float], streams: Mapping[str, SignalStream]
) -> dict[str, Whitener]:
    """Whitener of each stream whose noise has a slow part beside white noise of a standard deviation."""
    return {
        name: drift_predictor(part.std, part.correlation_time, white[name], streams[name].period)
        for name, part in slow.items()
        if part is not None and part.std > 0
    }
