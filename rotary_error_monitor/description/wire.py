"""The wire contract, read from `msg_defs/`: topics with type, fields, units, frame, QoS and who speaks; services."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rotary_error_monitor.description.definition_files import SENSOR, definitions
from rotary_error_monitor.description.listed_sensors import kind_of_stream, pose_streams, quantity
from rotary_error_monitor.description.sections import extended
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.wire_section import Channel, Field, Service
from rotary_error_monitor.errors import InputError

HEAD = "{head}"
EXTERNAL = "external"
"""Publisher or subscriber of the contract that is no node of the package."""

TIME_COLUMN = "t"
_EVERYONES = ("diagnostics",)
"""Keys of topics that all machines share: REP 107 puts the diagnostics of a whole system on one topic."""

_RECKONED = ("error_estimator", "compensation")
"""Publishers of what follows from the raw streams and from the descriptions."""


@dataclass(frozen=True, kw_only=True)
class Topic(Channel):
    """One topic of the contract.

    Attributes:
        head: letter of the read head, or name of the listed sensor; None where the topic is not one of several.
        fields: values of a message, for a sample block its columns after `t`.
    """

    head: str | None
    fields: tuple[Field, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of its sample blocks after `t`; none where its messages are no sample blocks."""
        return tuple(field.name for field in self.fields) if self.is_sample_block else ()

    @property
    def is_everyones(self) -> bool:
        """Whether all machines share it, whatever their namespaces."""
        return self.key in _EVERYONES

    @property
    def is_raw(self) -> bool:
        """Whether it carries samples as an instrument, the controller or a mock of them gives them."""
        return self.is_sample_block and not set(self.publishers) & set(_RECKONED)

    def field(self, name: str) -> Field:
        """The field or column of that name.

        Raises:
            InputError: there is none.
        """
        found = next((field for field in self.fields if field.name == name), None)
        if found is None:
            raise InputError(f"{self.name} holds {', '.join(f.name for f in self.fields)}, but no '{name}'")
        return found


@dataclass(frozen=True)
class Wire:
    """Every topic of the contract, for the read heads and listed sensors of one stage."""

    topics: tuple[Topic, ...]

    def __iter__(self) -> Iterator[Topic]:
        return iter(self.topics)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every topic."""
        return tuple(topic.name for topic in self.topics)

    def topic(self, key: str, head: str | None = None) -> Topic:
        """Topic by its key, and by the head's letter where each head has one.

        Raises:
            InputError: the contract has no such topic.
        """
        found = next((topic for topic in self.topics if (topic.key, topic.head) == (key, head)), None)
        if found is None:
            heads = [topic.head for topic in self.topics if topic.key == key]
            have = f"heads {heads}" if heads else f"keys {sorted({topic.key for topic in self.topics})}"
            raise InputError(f"the wire contract has no topic '{key}' for head {head!r}; it has the {have}")
        return found

    def of_stream(self, stream: str) -> Topic:
        """Topic of the samples of a stream: of the sensor that its frame is called after, such as `head_a`.

        Raises:
            InputError: the contract has none.
        """
        found = next((topic for topic in self if topic.is_sample_block and topic.frame == stream), None)
        if found is None:
            frames = sorted({topic.frame for topic in self if topic.is_sample_block})
            raise InputError(f"the wire contract has no samples of '{stream}'; it has those of {', '.join(frames)}")
        return found

    def named(self, name: str) -> Topic:
        """Topic by its name on the wire.

        Raises:
            InputError: the contract has no such topic.
        """
        found = next((topic for topic in self.topics if topic.name == name), None)
        if found is None:
            raise InputError(f"the wire contract has no topic '{name}'; it has {', '.join(self.names)}")
        return found

    @property
    def used_streams(self) -> Field:
        """Column of an estimate with the mask of the streams that it used."""
        return self.topic("error_motion_samples").field("streams")

    def within(self, namespace: str) -> Wire:
        """The contract of a cell in a namespace, such as `/left`; what all machines share stays where it is."""
        prefix = namespace.rstrip("/")
        return Wire(tuple(topic if topic.is_everyones else replace(topic, name=prefix + topic.name) for topic in self))

    def published_by(self, node: str) -> tuple[Topic, ...]:
        """Topics that a node publishes, by the name of its executable."""
        return tuple(topic for topic in self.topics if node in topic.publishers)

    def read_by(self, node: str) -> tuple[Topic, ...]:
        """Topics that a node listens to, by the name of its executable."""
        return tuple(topic for topic in self.topics if node in topic.subscribers)


def wire_of(stage: StageDescription) -> Wire:
    """The contract for a stage.

    Raises:
        InputError: a file breaks the schema, or a head's letter makes no topic name.
    """
    return load_wire(tuple(stage.azimuths), sensors=tuple(stage.listed))


def load_wire(
    heads: Sequence[str] | None = ("a", "b", "c", "d"), folder: Path | None = None, sensors: Sequence[str] = ()
) -> Wire:
    """The contract for a stage with these read heads and listed sensors.

    Args:
        heads: letters of the read heads, as in the stage description; with None, `{head}` and `{sensor}` stay in the
            names, as in a table for people.
        folder: folder of the definitions, by default the package's `msg_defs/`.
        sensors: streams of the sensors that the stage lists, such as `axial_probe_top`.

    Raises:
        InputError: a file breaks the schema, two topics share a key or a name, or a head's letter makes no topic name.
    """
    for head in heads or ():
        if not re.fullmatch(r"[a-z][a-z0-9]*", head):
            raise InputError(f"head '{head}' makes no topic name; name heads by small letters and digits, such as 'a'")
    if heads is not None and len(set(heads)) != len(heads):
        raise InputError(f"heads {list(heads)}: one stands twice; name each head once")
    templates: dict[str, tuple[Topic, Path]] = {}
    for path, section in definitions(folder):
        for key, topic in section.topics.items():
            if key in templates:
                raise InputError(f"{path}: topic '{key}' is already defined in {templates[key][1].name}; keep one")
            made = extended(Topic, topic, head=None, fields=topic.columns or topic.fields)
            templates[key] = made, path
    found = (template for template, _ in templates.values())
    if heads is None:
        return Wire(tuple(found))
    topics = tuple(topic for template in found for topic in _expand(template, heads, sensors))
    names = [topic.name for topic in topics]
    for name in names:
        if names.count(name) > 1:
            files = {str(path) for template, path in templates.values() if template.name == name}
            raise InputError(f"{' and '.join(sorted(files))}: several topics have the name {name}; give each its own")
    for stream in sensors:
        _check_sensor(stream, [topic for topic in topics if topic.frame == stream])
    return Wire(topics)


def load_services() -> tuple[Service, ...]:
    """The services of the contract.

    Raises:
        InputError: a file breaks the schema, two services share a key, or a node answers two by one name.
    """
    found: dict[str, Service] = {}
    answered: set[tuple[str, str]] = set()
    for path, section in definitions(None):
        for key, service in section.services.items():
            again = {(node, service.name) for node in service.servers} & answered
            if key in found or again:
                raise InputError(f"{path}: service '{key}' ({service.name}) is already defined; keep one")
            found[key] = service
            answered |= {(node, service.name) for node in service.servers}
    return tuple(found.values())


def markdown_table(wire: Iterable[Topic]) -> str:
    """The contract as a Markdown table, a row a topic."""
    rows = [
        "| topic | type | holds | published by | rate | QoS | frame |",
        "|---|---|---|---|---|---|---|",
    ]
    for topic in wire:
        values = ", ".join(f"`{field.name}`{_unit(field)}" for field in topic.fields)
        values = f"`{TIME_COLUMN}` s, {values}" if topic.is_sample_block else values
        cells = (
            f"`{topic.name}`",
            f"`{topic.type}`",
            f"{topic.meaning} {values}",
            ", ".join(topic.publishers),
            topic.rate,
            f"{topic.qos.reliability}, {topic.qos.durability}, last {topic.qos.depth}",
            f"`{topic.frame}`" if topic.frame else "",
        )
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _unit(field: Field) -> str:
    if field.bits:
        return " (bits " + ", ".join(field.bits) + ")"
    unit = f" {field.unit}" if field.unit not in ("-", "1") else ""
    return f"{unit} (with listed sensors)" if field.of_sensors else unit


def _check_sensor(stream: str, topics: Sequence[Topic]) -> None:
    """Hold the topics of a listed sensor against its kind: what files of one package say together, two may not.

    Raises:
        InputError: its samples, or what people are shown, have no topic or several, or other fields or another unit.
    """
    kind = kind_of_stream(stream)
    if kind is None:
        return
    fields, unit = quantity(kind)
    samples = [topic for topic in topics if topic.is_sample_block]
    if len(samples) != 1 or len(topics) != 2:
        raise InputError(
            f"the wire contract has {len(samples)} topics with samples of sensor kind '{kind}' and "
            f"{len(topics) - len(samples)} for people; expected one of each, of frame {kind}_{SENSOR}"
        )
    found = [(field.name, field.unit) for field in samples[0].fields]
    if found != [(name, unit) for name in fields]:
        told = ", ".join(f"{name} in {of}" for name, of in found)
        raise InputError(
            f"the wire contract has {told} for {samples[0].name}; the section of kind '{kind}' states "
            f"{', '.join(fields)} in {unit}"
        )


def _expand(template: Topic, heads: Sequence[str], sensors: Sequence[str]) -> Iterator[Topic]:
    """The topic itself, or where its name holds `{head}` or `{sensor}` one for each."""
    poses = pose_streams(sensors)  # an estimate takes no others
    kept = (field for field in template.fields if poses or not field.of_sensors)
    fields = tuple(replace(f, bits=tuple(n for bit in f.bits for n in _names(bit, heads, poses))) for f in kept)
    template = replace(template, fields=fields)
    several = next((mark for mark in (HEAD, SENSOR) if mark in template.frame), None)
    if several is None:
        yield template
        return
    for frame in _names(template.frame, heads, sensors):
        name = frame.removeprefix(template.frame.removesuffix(several))
        yield replace(
            template,
            head=name,
            name=template.name.replace(several, name),
            frame=frame,
            meaning=template.meaning.replace(several, name),
            fields=tuple(replace(f, meaning=f.meaning.replace(several, name)) for f in template.fields),
        )


def _names(pattern: str, heads: Sequence[str], sensors: Sequence[str]) -> Iterator[str]:
    """What a name with `{head}` or `{sensor}` at its end stands for: sensors are those that begin like it."""
    if HEAD in pattern:
        yield from (pattern.replace(HEAD, head) for head in heads)
    elif SENSOR in pattern:
        yield from (stream for stream in sensors if stream.startswith(pattern.removesuffix(SENSOR)))
    else:
        yield pattern
