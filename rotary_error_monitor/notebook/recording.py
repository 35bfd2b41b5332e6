"""A bag as a notebook has it: its streams as arrays, and what it says of itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotary_error_monitor.bags.metadata import SIMULATED
from rotary_error_monitor.bags.naming import Naming, read_naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.notebook.read_only import ReadOnly
from rotary_error_monitor.notebook.streams import JOINTS, OF_MACHINE, RecordedStream, read_recorded
from rotary_error_monitor.notebook.tables import table_of_rows
from rotary_error_monitor.report.page import table
from rotary_error_monitor.signals.blocks import NANOSECONDS

if TYPE_CHECKING:
    from pandas import DataFrame

    from rotary_error_monitor.report.plot import Plot
    from rotary_error_monitor.report.traces import Panel

Topics = Path | str | Mapping[str, str] | None
"""How a bag calls its topics: by those of the wire contract, or a YAML file of that, as `--topics` of the commands."""

_SMALL = 1e-2
"""m and rad below which a figure shows µm and µrad."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording:
    """What a bag holds.

    Attributes:
        path: the bag.
        naming: which of its cells is meant, and how it calls its topics.
        streams: by name, such as `head_a`, `autocollimator`, `command`, `machine_joint_states`.
        span_ns: timestamps (ns) of the first and the last sample.
        simulated: topics of which the bag says that simulated devices gave them; none of a bag that says nothing.
        remarks: what of the bag could not be read, and what its recorder noted.
    """

    path: Path
    naming: Naming
    streams: Mapping[str, RecordedStream]
    span_ns: tuple[int, int]
    simulated: tuple[str, ...]
    remarks: tuple[str, ...]

    def __getitem__(self, name: str) -> RecordedStream:
        """A stream.

        Raises:
            InputError: the bag has none of that name.
        """
        if name not in self.streams:
            raise InputError(f"{self.path}: no stream '{one_line(name)}'; the bag has {', '.join(self.streams)}")
        return self.streams[name]

    @property
    def start(self) -> datetime:
        """When the first sample was taken (UTC)."""
        return datetime.fromtimestamp(self.span_ns[0] / NANOSECONDS, UTC)

    @property
    def duration(self) -> float:
        """Time between the first and the last sample, s."""
        return (self.span_ns[1] - self.span_ns[0]) / NANOSECONDS

    @property
    def stage(self) -> tuple[str, ...]:
        """Streams of the stage: its instruments, its command, what acted on it."""
        return tuple(name for name, stream in self.streams.items() if stream.raw and name not in OF_MACHINE)

    @property
    def machine(self) -> tuple[str, ...]:
        """Letters of the machine's axes; none where the bag is of a stage alone."""
        joints = self.streams.get(JOINTS)
        return () if joints is None else joints.fields

    def to_dataframe(self) -> DataFrame:
        """Table with a row for each stream: `samples`, `rate` (Hz), `fields`, `units`, `lost`, `disordered`, `topic`.

        The samples of one stream: `recording["head_a"].to_dataframe()`.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        found = self.streams.values()
        columns: dict[str, list[object]] = {
            "stream": list(self.streams),
            "samples": [len(stream) for stream in found],
            "rate": [stream.rate for stream in found],
            "fields": [", ".join(stream.fields) for stream in found],
            "units": [", ".join(stream.units) for stream in found],
            "lost": [stream.lost for stream in found],
            "disordered": [stream.disordered for stream in found],
            "topic": [stream.topic for stream in found],
        }
        return table_of_rows(columns, {"rate": "Hz"}).set_index("stream")

    def figure(self, names: Sequence[str] | None = None) -> Plot:
        """Figure of streams over time, like ones together; by default all that were measured. It is not shown.

        Raises:
            InputError: the bag has no stream of one of the names, or there is no name.
        """
        from rotary_error_monitor.report.traces import figure_of_panels

        chosen = [name for name, stream in self.streams.items() if stream.raw] if names is None else names
        if not chosen:
            raise InputError(f"{self.path}: no streams to draw; name some of {', '.join(self.streams)}")
        return figure_of_panels(list(self._panels([self[name] for name in chosen])))

    def _panels(self, streams: Sequence[RecordedStream]) -> Iterator[Panel]:
        from rotary_error_monitor.report.traces import Panel, Trace

        found: dict[tuple[str, ...], list[Trace]] = {}
        for stream in streams:
            time = (stream.times_ns - self.span_ns[0]) / NANOSECONDS
            for field, unit in zip(stream.fields, stream.units, strict=True):
                label = field if field.startswith(stream.name) else f"{stream.name} {field}"
                found.setdefault((unit, *stream.fields), []).append(Trace(time, stream[field], label))
        for (unit, *_), traces in found.items():
            largest = max(float(np.abs(trace.values).max()) for trace in traces)
            factor, name = (1e6, f"µ{unit}") if unit in ("m", "rad") and largest < _SMALL else (1.0, unit)
            yield Panel(name, tuple(Trace(trace.time, trace.values * factor, trace.name) for trace in traces))

    def _said(self) -> list[tuple[str, str]]:
        """What the bag says of itself, a line each."""
        axes = ", ".join(self.machine)
        return [
            ("recorded", f"{self.start:%Y-%m-%d %H:%M:%S} UTC, {self.duration:.1f} s"),
            ("simulated", f"{len(self.simulated)} topics, says the bag" if self.simulated else "the bag does not say"),
            ("machine", f"axes {axes}" if axes else "none"),
        ]

    def __repr__(self) -> str:
        lines = [f"{name}: {text}" for name, text in self._said()]
        return "\n  ".join([f"Recording {self.path}", *lines, *map(repr, self.streams.values())])

    def _repr_html_(self) -> str:
        rows = [
            [stream.name, str(len(stream)), f"{stream.rate:.4g} Hz", ", ".join(stream.fields), ", ".join(stream.units)]
            for stream in self.streams.values()
        ]
        head = ["stream", "samples", "rate", "fields", "units"]
        return table((), [("recording", str(self.path)), *self._said()]) + table(head, rows)


def read_bag(path: Path | str, *, cell: str = "", topics: Topics = None) -> Recording:
    """Read all samples of a bag into memory.

    Args:
        path: folder of a rosbag2 bag, or an mcap file.
        cell: namespace of the cell that is meant, such as `/left`, where the bag holds several.
        topics: how the bag calls its topics, where that is not as in the wire contract.

    Raises:
        InputError: there is no such bag, nothing in it can be read, it holds several cells and none is named, or no
            samples of this package's topics.

    Example:
        >>> from rotary_error_monitor import read_bag
        >>> recording = read_bag(bag)
        >>> recording["head_a"].units
        ('rad',)
        >>> recording["head_a"].to_dataframe().index.name
        'time'
    """
    naming = naming_of(cell, topics)
    reader = BagReader(path, naming)
    streams, lacking = read_recorded(reader)
    if not streams:
        have = one_line(", ".join(reader.topics)) or "nothing"
        raise InputError(f"{path}: no samples on topics of the wire contract; the bag has {have}: name them by topics=")
    begin = min(int(stream.times_ns[0]) for stream in streams.values())
    end = max(int(stream.times_ns[-1]) for stream in streams.values())
    simulated = tuple(filter(None, (name.strip() for name in reader.notes.get(SIMULATED, "").split(","))))
    return Recording(Path(path), naming, ReadOnly(streams), (begin, end), simulated, (*reader.remarks, *lacking))


def naming_of(cell: str, topics: Topics) -> Naming:
    """Which cell of a bag is meant, and how it calls its topics.

    Raises:
        InputError: as `read_naming`.
    """
    return read_naming(cell or None, Path(topics) if isinstance(topics, str) else topics)


def bag_of(recording: Recording | Path | str, cell: str, topics: Topics) -> tuple[Path, Naming]:
    """Bag and naming of what somebody gives as a recording.

    Raises:
        InputError: as `read_naming`, or both are named although the recording has been read with others.
    """
    if not isinstance(recording, Recording):
        return Path(recording), naming_of(cell, topics)
    if cell or topics is not None:
        raise InputError(f"{recording.path}: cell and topics were chosen when it was read; give them to read_bag alone")
    return recording.path, recording.naming
