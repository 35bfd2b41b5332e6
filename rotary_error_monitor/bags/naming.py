"""How a bag calls the topics of the wire contract: in the namespace of a cell, or by names of its own.

A bag may hold several cells, each in a namespace, as `ros2 bag record -a` leaves it. Whoever reads a bag means one of
them, and knows topics by their names in the contract.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from rotary_error_monitor.bags.bag_files import BagFiles, TopicContent
from rotary_error_monitor.bags.recorded_files import RawMessage
from rotary_error_monitor.description.topics import contract_topic, contract_topics, place_of
from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.errors import InputError, excerpt, one_line

ROOT = "/"
"""The cell in no namespace."""


@dataclass(frozen=True)
class Given:
    """The topic of a bag that somebody names for one of the contract, and where that is written."""

    topic: str
    where: str


@dataclass(frozen=True)
class Naming:
    """Which cell of a bag is meant, and which topics of it have names of their own.

    Attributes:
        cell: its namespace, such as `/left`, or `/` for none; None for the only one that the bag has.
        topics: topic of the bag by its name in the contract; all others are called as in the contract.
    """

    cell: str | None = None
    topics: Mapping[str, Given] = field(default_factory=dict)

    @property
    def is_given(self) -> bool:
        """Whether somebody has named anything."""
        return self.cell is not None or bool(self.topics)


THE_ONLY_CELL = Naming()
"""The one that the bag has, with the names of the contract."""


def read_naming(cell: str | None, topics: Path | Mapping[str, str] | None) -> Naming:
    """Naming by the namespace of a cell, and by topics of the bag by those of the contract: a mapping, or a file of it.

    Raises:
        InputError: the file cannot be read, is no such mapping, names a topic that is not in the contract, or one of
            the bag twice; the message names file and line.
    """
    namespace = None if cell is None else ROOT + cell.strip("/")
    rows = _rows_of(topics) if isinstance(topics, Path) else [("topics", *row) for row in (topics or {}).items()]
    return Naming(namespace, _given(rows))


def _rows_of(file: Path) -> list[tuple[str, str, str]]:
    """Where each line stands, with both topics."""
    node = read_yaml(file, "a YAML file of topics").node
    if not isinstance(node, yaml.MappingNode) or not node.value:
        raise InputError(
            f"{file}: names no topic; expected lines such as /stage/head_a/samples: /encoder_a/samples, that of the "
            "contract first"
        )
    return [
        (f"{file}:{key.start_mark.line + 1}", key.value, value.value if isinstance(value, yaml.ScalarNode) else "")
        for key, value in node.value
    ]


def _given(rows: Iterable[tuple[str, str, str]]) -> dict[str, Given]:
    """Topics of the bag by those of the contract, of rows of where they are named and both."""
    found: dict[str, Given] = {}
    for where, name, topic in rows:
        if contract_topic(name) is None:
            known = [each.name for each in contract_topics()]
            close = difflib.get_close_matches(name, known, n=3, cutoff=0.5) or known
            raise InputError(
                f"{where}: '{excerpt(name)}' is no topic of the wire contract; did you mean: {', '.join(close)}"
            )
        if not topic.startswith("/"):
            raise InputError(f"{where}: {excerpt(name)}: expected the name of a topic in the bag, such as /enc_a")
        if topic in (given.topic for given in found.values()):
            raise InputError(f"{where}: '{excerpt(topic)}' stands for two topics; one topic of the bag for each")
        found[name] = Given(topic, where)
    return found


class NamedFiles:
    """The files of a bag with the topics of one cell by their names in the contract, as `BagFiles` for the rest.

    Topics of other cells are left out; what belongs to none stays as it is called.

    Attributes:
        topics, sizes: as of `BagFiles`.
        cell: namespace of the cell, `/` for none.
    """

    def __init__(self, files: BagFiles, naming: Naming, path: Path) -> None:
        """Find the cell that is meant.

        Raises:
            InputError: the bag holds several cells and none is named, or not the one that is, or a topic that somebody
                names is not in the bag or of another type than in the contract.
        """
        self._files = files
        given = {row.topic: name for name, row in naming.topics.items()}
        cells = cells_in({name: each for name, each in files.topics.items() if name not in given})
        self.cell = _chosen(cells, naming, path)
        self._names = _names(files.topics, self.cell, given)
        for name, row in naming.topics.items():
            _check_given(name, row, files.topics, path)
        self.topics: dict[str, TopicContent] = {self._names[name]: files.topics[name] for name in self._names}
        self.sizes = Counter({self._names[name]: files.sizes[name] for name in self._names})

    def messages(self, names: Collection[str]) -> Iterator[RawMessage]:
        """Messages of these topics, in the order of their recording."""
        wanted = {there for there, name in self._names.items() if name in names}
        for message in self._files.messages(wanted):
            yield message._replace(topic=self._names[message.topic])


def cells_in(topics: Mapping[str, TopicContent]) -> list[str]:
    """Namespaces in which there are messages of the contract."""
    found = set()
    for name, content in topics.items():
        place = place_of(name)
        if place is not None and content.count and place.topic.type == content.type:
            found.add(place.namespace or ROOT)
    return sorted(found)


def _chosen(cells: list[str], naming: Naming, path: Path) -> str:
    listed = one_line(", ".join(cells))
    if naming.cell is not None:
        if naming.cell not in cells and not naming.topics:
            raise InputError(f"{path}: no cell {excerpt(naming.cell)}; the bag has {listed or 'none'}")
        return naming.cell
    if len(cells) > 1:
        raise InputError(f"{path}: the bag holds {len(cells)} cells: {listed}; name one with --cell")
    return cells[0] if cells else ROOT


def _names(topics: Mapping[str, TopicContent], cell: str, given: Mapping[str, str]) -> dict[str, str]:
    """Name by which each topic of the bag is known to those who read it."""
    found: dict[str, str] = {}
    for name in topics:
        place = place_of(name)
        if name in given:
            found[name] = given[name]
        elif place is None:
            found[name] = name
        elif (place.namespace or ROOT) == cell and place.name not in given.values():
            found[name] = place.name
    return found


def _check_given(name: str, given: Given, topics: Mapping[str, TopicContent], path: Path) -> None:
    there = topics.get(given.topic)
    if there is None:
        close = difflib.get_close_matches(given.topic, topics, n=3) or sorted(topics)
        raise InputError(
            f"{given.where}: no topic '{excerpt(given.topic)}' in {path}; the bag has {one_line(', '.join(close))}"
        )
    topic = contract_topic(name)
    if topic is not None and there.type != topic.type:
        raise InputError(
            f"{given.where}: '{excerpt(given.topic)}' is a {excerpt(there.type)}; {name} is expected as {topic.type}"
        )
