"""All that the analysis of a recording gives, and its figures one by one under stable names."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rotary_error_monitor.analysis.comparison import Stay
from rotary_error_monitor.analysis.course import Drift, Samples
from rotary_error_monitor.analysis.health import FallOut, StreamHealth
from rotary_error_monitor.analysis.motion import SegmentFigures
from rotary_error_monitor.analysis.positions import Positioning
from rotary_error_monitor.analysis.verdict import Conformity, Judged
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.metrology.spindle_figures import COVERAGE, ErrorMotionValue


@dataclass(frozen=True)
class ToolOffset:
    """Offset of the tool's tip, m, as root mean square and largest: as the machine is, and with the corrections."""

    before_rms: float
    before_largest: float
    after_rms: float
    after_largest: float


@dataclass(frozen=True)
class AnalysisResult:
    """What a recording says of its stage.

    Attributes:
        outcome: whether it keeps its limits.
        judged: each limit.
        segments: figures by direction and speed.
        drifts: by signal.
        positioning: of its stops.
        stays: comparison with the stage's own reference at each height.
        tool_offset: None without a machine.
        streams: health of each.
        fallen_out: instruments that were not used, and when.
        acting: what acted on the stage by name with unit, such as `force, N`.
        span_ns: first and last timestamp (ns) of the estimates.
        period: distance of two estimates, s; no more of them tells what is faster than half a wave in it.
        remarks: what a reader should know.
    """

    outcome: Conformity
    judged: tuple[Judged, ...]
    segments: tuple[SegmentFigures, ...]
    drifts: tuple[Drift, ...]
    positioning: Positioning
    stays: tuple[Stay, ...]
    tool_offset: ToolOffset | None
    streams: tuple[StreamHealth, ...]
    fallen_out: tuple[FallOut, ...]
    acting: Mapping[str, Samples]
    span_ns: tuple[int, int]
    period: float
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Figure:
    """One figure, as JSON and CSV hold it.

    Attributes:
        name: stable, such as `radial_rotating_at_16mm.synchronous`.
        segment: direction and speed that it is of; empty for the whole recording.
        value: in `unit`.
        expanded_uncertainty: of it, k = 2; None where it is not told.
        unit: SI.
        measured: the value by its definition, with what noise adds to it; None where nothing is taken off.
        turns: whole turns that count; None where it is not of turns.
        cut_off: of the filter over the angle, waves a turn.
        bandwidth: the same in Hz.
    """

    name: str
    segment: str
    value: float
    expanded_uncertainty: float | None
    unit: str
    measured: float | None = None
    turns: int | None = None
    cut_off: int | None = None
    bandwidth: float | None = None


def figures_of(analysis: AnalysisResult) -> Iterator[Figure]:
    """Every figure."""
    for segment in analysis.segments:
        yield from _of_segment(segment)
    for drift in analysis.drifts:
        yield _whole(f"{drift.signal}.drift", drift.range, drift.unit)
        for name, slope in drift.slopes.items():
            yield _whole(f"{drift.signal}.drift_per_kelvin.{name}", slope, f"{drift.unit}/K")
    found = analysis.positioning.figures
    if found is not None:
        for way, figures in (("forward", found.forward), ("backward", found.backward)):
            if figures is not None:
                for name in ("repeatability", "systematic_deviation", "accuracy"):
                    yield Figure(f"positioning.{way}.{name}", "", getattr(figures, name), None, "rad")
        if found.bidirectional is not None:
            for name in ("reversal_error", "repeatability", "systematic_deviation", "accuracy"):
                yield Figure(f"positioning.{name}", "", getattr(found.bidirectional, name), None, "rad")
    for stay in analysis.stays:
        place = f"{OWN_REFERENCE}_at_{stay.height * 1e3:.0f}mm"
        yield Figure(f"{place}.difference_rms", "", stay.comparison.rms, None, "m")
        yield Figure(f"{place}.difference_largest", "", stay.comparison.maximum, None, "m")
        yield Figure(f"{place}.inside_95_percent_bounds", "", stay.comparison.inside, None, "1")
    if analysis.tool_offset is not None:
        for name, value in asdict(analysis.tool_offset).items():
            yield Figure(f"tool_offset.{name}", "", value, None, "m")


def _of_segment(segment: SegmentFigures) -> Iterator[Figure]:
    for signal in segment.signals:
        common = (signal.turns, segment.cut_off, segment.bandwidth)
        for name, value in signal.values.items():
            whole = f"{signal.signal}.{name}"
            yield Figure(whole, segment.name, value.value, value.expanded, signal.unit, value.measured, *common)
        for name, centre in signal.centres.items():
            whole = f"{signal.signal}.synchronous_about_{name}"
            expanded = signal.values["synchronous"].expanded
            yield Figure(whole, segment.name, centre.value, expanded, signal.unit, centre.value, *common)


def _whole(name: str, value: ErrorMotionValue, unit: str) -> Figure:
    return Figure(name, "", value.value, value.expanded, unit)


def as_mapping(analysis: AnalysisResult, about: Mapping[str, str]) -> dict[str, Any]:
    """Content of the JSON file."""
    return {
        "about": dict(about),
        "verdict": analysis.outcome.value,
        "coverage_factor": COVERAGE,
        "limits": [
            row.as_mapping() | dict(zip(("segment", "signal"), row.where, strict=True)) for row in analysis.judged
        ],
        "segments": [_segment_mapping(segment) for segment in analysis.segments],
        "figures": [asdict(figure) for figure in figures_of(analysis)],
        "orders": list(_orders(analysis.segments)),
        "positioning_remarks": list(analysis.positioning.remarks),
        "streams": [_told(asdict(stream)) for stream in analysis.streams],
        "fallen_out": [asdict(each) for each in analysis.fallen_out],
        "remarks": list(analysis.remarks),
    }


def _segment_mapping(segment: SegmentFigures) -> dict[str, Any]:
    return {
        "name": segment.name,
        "speed": segment.speed,
        "steady": segment.steady,
        "turned": segment.turned,
        "estimates_per_turn": segment.samples,
        "cut_off": segment.cut_off,
        "bandwidth": segment.bandwidth,
        "remarks": list(segment.remarks),
    }


def _orders(segments: Sequence[SegmentFigures]) -> Iterator[dict[str, Any]]:
    for segment in segments:
        for signal in segment.signals:
            if signal.spectrum is not None:
                yield {
                    "segment": segment.name,
                    "signal": signal.signal,
                    "unit": signal.unit,
                    "amplitude": _list(signal.spectrum.amplitude),
                    "standard_uncertainty": _list(signal.spectrum.uncertainty),
                    "hidden_orders": list(signal.spectrum.hidden),
                }


def _list(values: Array) -> list[float]:
    found: list[float] = values.tolist()
    return found


def _told(mapping: dict[str, Any]) -> dict[str, Any]:
    """The same with null for what is not a number: JSON has none."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in mapping.items()}
