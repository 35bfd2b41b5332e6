"""The information model: each variable of the address space with meaning, unit, range, and what its value follows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_limits import MachineLimits
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.opcua.units import ONE, UNITS, Unit
from rotary_error_monitor.pipeline.corrections import OFFSET, CorrectionSettings
from rotary_error_monitor.units import MICRO

NAMESPACE = "urn:rotary_error_monitor:cell"
"""Namespace of all nodes; their ids are texts, such as `ns=2;s=error_motion/exc`."""

Value = float | str | bool
Range = tuple[float, float]

STALE_AFTER = 1.0
"""Age of what comes at 20 Hz and more from which it is stale, s: as the estimator and the diagnosis count."""

REPORT_STALE_AFTER = 5.0
"""The same of what stands on `/diagnostics`, s: five reports that did not come."""

TEMPERATURE_STALE_AFTER = 10.0
"""The same of a temperature, s: as the diagnosis counts."""

LEVEL, MESSAGE, USABLE = "level", "message", "usable"
"""What each status has beside its figures: how bad it is, the sentence, and whether what it speaks of may be used."""

_UNITS = {
    "um": UNITS["µm"],
    "urad": UNITS["µrad"],
    "mm_s": UNITS["mm/s"],
    "rad_s": UNITS["rad/s"],
    "hz": UNITS["Hz"],
    "ms": UNITS["ms"],
    "s": UNITS["s"],
}
"""Units by the endings of the keys of figures."""


@dataclass(frozen=True)
class Variable:
    """One variable of the address space.

    Attributes:
        path: its node id; what stands behind the last `/` is its browse name.
        meaning: in a sentence.
        type: of its value: a number is an AnalogUnitType, a text or a truth value a BaseDataVariableType.
        unit: of a number.
        range: between which a number is expected (EURange).
        range_of: path of the variable that says how large it may be; its value then makes the range.
        stale_after: age of the value from which it is stale, s.
        judge: name of the status whose level says whether the value may be used; empty where none does.
        status: name of the status that it shows a figure of; empty where it shows a message of a topic.
        figure: which one: a key of its figures, `level` or `message`.
        source: where it comes from, for people.
        sensed: whether the stage has sensors that determine it.
    """

    path: str
    meaning: str
    type: type[float] | type[str] | type[bool] = float
    unit: Unit = ONE
    range: Range = (0.0, 1.0)
    range_of: str = ""
    stale_after: float = STALE_AFTER
    judge: str = ""
    status: str = ""
    figure: str = ""
    source: str = ""
    sensed: bool = True

    @property
    def name(self) -> str:
        """Browse name."""
        return self.path.rpartition("/")[2]

    @property
    def folder(self) -> str:
        """Path of the folder that holds it."""
        return self.path.rpartition("/")[0]


@dataclass(frozen=True)
class CellDescription:
    """What of a cell shapes its address space.

    Attributes:
        limits: of the stage: ranges of its error motion.
        components: of error motion that its sensors determine.
        machine: that carries it; none where nothing is corrected.
        status: name on `/diagnostics` of what (`estimate`) a node (`error_estimator`) of the cell says.
    """

    limits: StageLimits
    components: Sequence[str]
    machine: MachineDescription | None
    status: Callable[[str, str], str]


def information_model(cell: CellDescription) -> tuple[Variable, ...]:
    """The variables of a cell; those of `/diagnostics` (`health`) join as statuses are heard, by `health_variables`."""
    machine = cell.machine
    temperature = MachineLimits().temperature if machine is None else machine.limits.temperature
    found = [*_error_motion(cell), *_temperatures(temperature, machine is not None), *_verdict(cell)]
    if machine is not None:
        found += [*_offsets(cell), *_corrections(cell, machine), *_limits(cell)]
    return tuple(found)


def _error_motion(cell: CellDescription) -> Iterator[Variable]:
    sizes = cell.limits.components
    words = (
        "radial error motion along x at the ring",
        "radial error motion along y at the ring",
        "axial error motion",
        "tilt error motion about x",
        "tilt error motion about y",
        "angular positioning error motion, estimated rotation minus command",
    )
    for place, (name, size, meaning) in enumerate(zip(COMPONENTS, sizes, words, strict=True)):
        yield Variable(
            f"error_motion/{name}",
            meaning,
            unit=_unit(place),
            range=_both_ways(size * MICRO),
            judge=cell.status("error_estimator", "estimate"),
            source="error_motion_figures",
            sensed=name in cell.components,
        )


def _offsets(cell: CellDescription) -> Iterator[Variable]:
    folders = {
        "tool_offset": ("as the machine is", "tool_offset_figures"),
        "corrected_offset": ("that remains with the published corrections", "corrected_offset_pose"),
    }
    for folder, (which, source) in folders.items():
        for place, name in enumerate(OFFSET):
            what = f"tool tip along {name}" if place < 3 else f"tool about {'xyz'[place - 3]}"
            yield Variable(
                f"{folder}/{name}",
                f"offset of the {what} {which}",
                unit=_unit(place),
                range=_span("linear" if place < 3 else "rotary"),
                range_of=_limit("linear" if place < 3 else "rotary"),
                judge=cell.status("compensation", "correction"),
                source=source,
            )


def _corrections(cell: CellDescription, machine: MachineDescription) -> Iterator[Variable]:
    folders = {
        "axis_corrections": ("published", cell.status("compensation", "correction")),
        "applied_corrections": ("that the controller has in effect", ""),
    }
    for folder, (which, judge) in folders.items():
        for axis in machine.axes:
            yield Variable(
                f"{folder}/{axis.letter}",
                f"correction of the {axis.kind} axis {axis.letter} {which}",
                unit=_unit(0 if axis.kind == "linear" else 3),
                range=_span(axis.kind),
                range_of=_limit(axis.kind),
                judge=judge,
                source=folder,
            )


def _limits(cell: CellDescription) -> Iterator[Variable]:
    status = cell.status("compensation", "correction")
    settings = CorrectionSettings()
    yield _reported(
        "compensation/latched", "whether an error limit was passed and corrections hold until a reset", status, bool
    )
    for kind, (warning, error, rate) in (("linear", settings.linear_limits), ("rotary", settings.rotary_limits)):
        small, fast, scale = ("um", "mm_s", 1e3) if kind == "linear" else ("urad", "rad_s", 1.0)
        for name, words, suffix, most in (
            ("warning", "beyond which a warning is given", small, warning * MICRO),
            ("error", "beyond which corrections hold until a reset", small, error * MICRO),
            ("rate", "how fast it may change", fast, rate * scale),
        ):
            yield _reported(
                f"compensation/{kind}_{name}",
                f"limit of the correction of {kind} axes: {words}",
                status,
                figure=f"{kind}_{name}_{suffix}",
                unit=_UNITS[suffix],
                range=(0.0, most),
            )


def _temperatures(limits: Range, has_machine: bool) -> Iterator[Variable]:
    for of, source in (("stage", "stage_temperature"), ("machine", "machine_temperature")):
        if of == "stage" or has_machine:
            yield Variable(
                f"temperature/{of}",
                f"temperature of the {of}",
                unit=UNITS["°C"],
                range=limits,
                stale_after=TEMPERATURE_STALE_AFTER,
                source=source,
            )


def _verdict(cell: CellDescription) -> Iterator[Variable]:
    status = cell.status("gap_monitor", "verdict")
    texts = {
        "verdict": "what the last diagnosis concludes",
        "message": "the same in a sentence",
        "causes": "effects that explain the gap, with their probabilities",
        "where": "where the gap is largest",
    }
    for name, meaning in texts.items():
        yield _reported(f"gap/{name}", meaning, status, str)
    numbers = {
        "gap_before": "gap of twin and measurement, root mean square of white rows: 1 is noise as the twin states it",
        "gap_after": "the same with the causes in the twin",
        "noise_floor": "the same of noise alone",
        "shrink": "part of what exceeds the noise floor that the causes take away",
    }
    for name, meaning in numbers.items():
        yield _reported(f"gap/{name}", meaning, status, range=(-1.0, 1.0) if name == "shrink" else (0.0, 10.0))
    yield _reported(
        "gap/age", "age of what the verdict is about", status, figure="age_s", unit=UNITS["s"], range=(0.0, 3600.0)
    )


HEALTH = "health"
_STREAM_FIGURES: Mapping[str, tuple[str, str, Range]] = {
    "rate_hz": ("samples a second", "hz", (0.0, 10_000.0)),
    "age_ms": ("age of the last sample", "ms", (0.0, 1000.0)),
    "lost_samples": ("samples that were lost", "", (0.0, 1e6)),
    "late_blocks": ("blocks that came late", "", (0.0, 1e6)),
    "refused_messages": ("messages that were refused", "", (0.0, 1e6)),
}
"""Figures of a stream by their keys: meaning, unit, range."""


def health_variables(status: str, figures: Sequence[str]) -> tuple[Variable, ...]:
    """Variables of one status of `/diagnostics`.

    Args:
        status: its name, `<node>: <what>`.
        figures: keys of its figures; of these the address space has those that a stream of samples has.
    """
    folder = f"{HEALTH}/{status.replace('/', '.')}"
    found = [
        _reported(f"{folder}/level", "0 well, 1 warning, 2 error, 3 stale", status, range=(0.0, 3.0)),
        _reported(f"{folder}/message", "what degraded and why", status, str),
        _reported(f"{folder}/usable", "whether what it speaks of may be used", status, bool, judge=status),
    ]
    for figure in figures:
        if figure in _STREAM_FIGURES:
            meaning, unit, span = _STREAM_FIGURES[figure]
            found.append(
                _reported(
                    f"{folder}/{figure}",
                    meaning,
                    status,
                    unit=_UNITS.get(unit, ONE),
                    range=span,
                    judge=status,
                )
            )
    return tuple(found)


def _reported(
    path: str,
    meaning: str,
    status: str,
    type: type[float] | type[str] | type[bool] = float,
    *,
    figure: str = "",
    unit: Unit = ONE,
    range: Range = (0.0, 1.0),
    judge: str = "",
) -> Variable:
    """Variable that shows a figure of a status, by default the one of its own name."""
    name = figure or path.rpartition("/")[2]
    return Variable(
        path,
        meaning,
        type,
        unit,
        range,
        stale_after=REPORT_STALE_AFTER,
        judge=judge,
        status=status,
        figure=name,
        source="diagnostics",
    )


def _unit(place: int) -> Unit:
    """Unit of one of six components: three lengths, three angles."""
    return UNITS["µm"] if place < 3 else UNITS["µrad"]


def _both_ways(size: float) -> Range:
    return (-size, size)


def _span(kind: str) -> Range:
    """Range of a correction until the compensation has told its own limit."""
    settings = CorrectionSettings()
    return _both_ways((settings.linear_limits if kind == "linear" else settings.rotary_limits)[1] * MICRO)


def _limit(kind: str) -> str:
    return f"compensation/{kind}_error"
