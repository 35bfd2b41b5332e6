"""What a file of `msg_defs/` states: topics with type, values, units, frame, QoS and who speaks; services."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from rotary_error_monitor.description.expected import Expected, Key
from rotary_error_monitor.description.quantities import Name
from rotary_error_monitor.description.sections import Place, Section
from rotary_error_monitor.errors import InputError

SAMPLE_BLOCK = "sensor_msgs/msg/PointCloud2"
SOME = (1, math.inf)

_SYMBOL = r"(m|kg|s|A|K|mol|cd|rad|Hz|N|Pa|J|W|C|V|F|Ω|S|Wb|T|H|lm|lx)(\^[1-9])?"
"""Units of the SI without prefix but kg (BIPM, SI Brochure, 9th edition, Tables 2 and 4), and powers of them."""

_UNIT = rf"(1|°C|µm|µrad|(1|{_SYMBOL}(\*{_SYMBOL})*)(/{_SYMBOL})?)"

Text = Annotated[str, Expected("a text", count=SOME)]
Nodes = Annotated[tuple[Name, ...], Expected("names of nodes", unique=True)]


@dataclass(frozen=True)
class Field:
    """One value in a message, or of a sample block."""

    name: Annotated[
        str, Expected("name of a field, dotted where it is nested", pattern=r"^[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*$")
    ]
    unit: Annotated[
        str,
        Expected(
            "an SI unit such as m^3/s, °C, µm or µrad for plotting, '1' for a number, '-' for text, several with ', ' "
            "between",
            pattern=rf"^(-|{_UNIT}(, {_UNIT})*)$",
        ),
    ]
    meaning: Text
    bits: Annotated[
        tuple[Annotated[str, Expected(pattern=r"^([a-z][a-z0-9_]*(\{head\})?|\{sensor\})$")], ...],
        Expected(
            "names of the bits of a mask, the lowest first; {head} stands for one bit of each head, {sensor} of each "
            "listed sensor",
            count=(1, 53),
            unique=True,
        ),
    ] = ()
    of_sensors: Annotated[bool, Expected("true where only a stage that lists sensors has the value")] = False

    def mask(self, names: Iterable[str]) -> int:
        """Bit mask with the bits of `names` set.

        Raises:
            InputError: the field has no bit of one of the names.
        """
        return sum(1 << self._bit(name) for name in set(names))

    def _bit(self, name: str) -> int:
        if name not in self.bits:
            raise InputError(f"'{self.name}' has the bits {', '.join(self.bits) or '(none)'}, but no '{name}'")
        return self.bits.index(name)


@dataclass(frozen=True)
class Qos:
    """Quality of service, words as in ROS 2; the history keeps the last `depth` messages."""

    reliability: Literal["reliable", "best_effort"]
    durability: Literal["volatile", "transient_local"]
    history: Literal["keep_last"]
    depth: Annotated[int, Expected("messages kept for a slow reader, a whole number from 1", 1, 100_000)]


@dataclass(frozen=True, kw_only=True)
class Channel:
    """What the contract says of a topic beside its values.

    Attributes:
        key: what code calls it; topics of one kind for several heads or sensors share a key.
    """

    key: Annotated[str, Key]
    name: Annotated[
        str,
        Expected(
            "an absolute topic name, {head} for the letter of a read head, {sensor} for the name of a listed sensor",
            pattern=r"^(/([a-z][a-z0-9_]*|[a-z][a-z0-9_]*\{(head|sensor)\}))+$",
        ),
    ]
    type: Annotated[
        str,
        Expected(
            "a message type such as sensor_msgs/msg/JointState", pattern="^[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$"
        ),
    ]
    frame: Annotated[
        str, Expected("a frame_id, empty where there is none", pattern=r"^([a-z][a-z0-9_]*(\{(head|sensor)\})?)?$")
    ]
    publishers: Annotated[Nodes, Expected("nodes that publish the topic, or 'external'", count=SOME)]
    subscribers: Annotated[Nodes, Expected("nodes of the package that listen to the topic")] = ()
    rate: Text
    qos: Qos
    meaning: Text

    @property
    def is_sample_block(self) -> bool:
        """Whether its messages are sample blocks."""
        return self.type == SAMPLE_BLOCK


@dataclass(frozen=True, kw_only=True)
class TopicSection(Channel, Section):
    """A topic as its file states it: sample blocks say their columns, every other message its fields."""

    fields: Annotated[
        tuple[Field, ...], Expected("rows {name, unit, meaning}, in the order of the message", count=SOME)
    ] = ()
    columns: Annotated[tuple[Field, ...], Expected("columns of the samples after t", count=SOME)] = ()

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """What its kind of message does not have, or lacks."""
        names = ("columns", "fields") if self.is_sample_block else ("fields", "columns")
        wanted, other = names
        values = {"fields": self.fields, "columns": self.columns}
        if not values[wanted]:
            yield (), f"'{wanted}' is a required property; expected rows {{name, unit, meaning}}"
        if values[other]:
            yield (other,), f"a topic of type {self.type} has {wanted}, no {other}"


@dataclass(frozen=True)
class Service:
    """One service of the contract, by the key that names it there."""

    key: Annotated[str, Key]
    name: Annotated[str, Expected("a name below that of the node, such as ~/reset", pattern="^~/[a-z][a-z0-9_]*$")]
    type: Annotated[
        str, Expected("a service type such as std_srvs/srv/Trigger", pattern="^[a-z][a-z0-9_]*/srv/[A-Z][A-Za-z0-9]*$")
    ]
    servers: Annotated[Nodes, Expected("nodes that answer it")]
    callers: Annotated[Nodes, Expected("who may call it: nodes, or 'operator' for a person")]
    meaning: Text


@dataclass(frozen=True)
class WireSection(Section):
    """A file of definitions: topics and services of one group by their keys."""

    topics: Annotated[
        Mapping[Name, TopicSection], Expected("topics by their key, such as head_samples", count=SOME)
    ] = field(default_factory=dict)
    services: Annotated[Mapping[Name, Service], Expected("services by their key, such as reset", count=SOME)] = field(
        default_factory=dict
    )

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """Neither of both."""
        if not (self.topics or self.services):
            yield (), "it defines nothing; expected 'topics' or 'services'"
