"""Whether each sensor that a stage lists has a node in the cell, and each such node a sensor that the stage lists."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from rotary_error_monitor.description.listed_sensors import EXTERNAL_SENSORS, stream_of_sensor
from rotary_error_monitor.description.sections import place_named
from rotary_error_monitor.description.sensor_section import OWN_KINDS, READ_HEAD
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.wire import Topic, Wire, wire_of
from rotary_error_monitor.description.yaml_files import YamlContent, read_yaml
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.resources import config
from rotary_error_monitor.supervision.cell_file import CellNode, nodes_of, parameters_of, where_given

ASKED = {"encoder_head": "head", "listed_sensor": "sensor"}
"""Parameter that says which of several sensors a node is of; without it the end of the node's name does."""

_ESTIMATOR = "error_estimator"
_HELPFUL = ("head_samples", "autocollimator_samples")
"""Keys of the topics of sensors that a stage describes in sections of their own, and that a cell may lack."""


@dataclass(frozen=True)
class _Stage:
    """A stage file that nodes of the cell take: what it describes, and where it lists what."""

    path: Path

    @cached_property
    def described(self) -> StageDescription:
        return load_stage(self.path)

    @cached_property
    def wire(self) -> Wire:
        return wire_of(self.described)

    @cached_property
    def _file(self) -> YamlContent:
        return read_yaml(self.path)

    @cached_property
    def listed(self) -> Mapping[str, str]:
        """Streams of the sensors of the list, by their names there."""
        rows = self._file.content["stage"].get("sensors") or {}
        return {str(name): _stream(str(name), row["kind"]) for name, row in rows.items()}

    def where(self, name: str) -> str:
        """File and line of a sensor of the list."""
        return place_named(self._file, ("stage", "sensors", name))


@dataclass(frozen=True)
class _Cells:
    """What a cell's file starts.

    Attributes:
        nodes: in its order.
        readers: of each namespace and stage, nodes with their parameters.
        stages: by their files.
        publishers: of each namespace, who publishes the samples of a stream.
    """

    nodes: tuple[CellNode, ...]
    readers: Mapping[tuple[str, Path], Mapping[CellNode, Mapping[str, object]]]
    stages: Mapping[Path, _Stage]
    publishers: Mapping[str, Mapping[str, CellNode]]


def checked_nodes(path: Path, namespace: str = "") -> tuple[CellNode, ...]:
    """Nodes that a cell's file names, once they and the sensors that their stages list go together.

    A sensor has to have a node where one of the cell listens to it, by the wire contract; in each namespace by itself.

    Args:
        path: ROS parameter file.
        namespace: of the nodes whose section names none.

    Raises:
        InputError: as `nodes_of` and `load_stage`; a sensor that no node publishes, or two of them, or a node of a
            sensor that the stage does not list. The message names both files and lines, and what to write.
    """
    cells = _cells(path, namespace)
    for (space, stage_file), readers in cells.readers.items():
        _check_external(path, cells.stages[stage_file], readers, cells.publishers[space])
        _check_listed(path, cells.stages[stage_file], readers, cells.publishers[space])
    return cells.nodes


def unserved_sensors(path: Path, namespace: str = "") -> tuple[str, ...]:
    """Of each head or autocollimator that an estimator of a cell waits for and none publishes, what to say.

    That is no mistake by itself: another program may publish them, and an estimate goes without a head that is not
    there. Arguments and errors are those of `checked_nodes`.
    """
    cells, found = _cells(path, namespace), dict[str, None]()
    for (space, stage_file), readers in cells.readers.items():
        wire = cells.stages[stage_file].wire
        for topic in (topic for topic in wire if topic.key in _HELPFUL and topic.is_sample_block):
            listening = [node.name for node in readers if node.executable == _ESTIMATOR]
            if listening and topic.frame not in cells.publishers[space]:
                found[
                    f"no node of {path} publishes {space}{topic.name}, which {stage_file} describes; unless another "
                    f"program does, {' and '.join(listening)} will go without it"
                ] = None
    return tuple(found)


def _cells(path: Path, namespace: str) -> _Cells:
    """Nodes of a cell's file by namespace and stage, and who publishes what.

    Raises:
        InputError: as `nodes_of` and `load_stage`; two nodes publish the same, or a node is of a sensor that its stage
            does not have.
    """
    nodes = tuple(replace(node, namespace=node.namespace or namespace) for node in nodes_of(path))
    stages = dict[Path, _Stage]()
    cells: dict[tuple[str, Path], dict[CellNode, Mapping[str, object]]] = defaultdict(dict)
    for node, given in parameters_of(path, nodes).items():
        stage_file = Path(str(given.get("stage") or config("stage.yaml")))
        stages.setdefault(stage_file, _Stage(stage_file))
        cells[node.namespace, stage_file][node] = given
    publishers: dict[str, dict[str, CellNode]] = defaultdict(dict)
    for (space, stage_file), members in cells.items():
        for node, stated in members.items():
            for topic in topics_filled(node, stated, stages[stage_file].wire, stage_file):
                other = publishers[space].setdefault(topic.frame, node)
                if other is not node and topic.head is not None:
                    raise InputError(
                        f"{node.where}: {node.name} publishes {space}{topic.name}, as {other.name} does "
                        f"({other.where}); keep one of both"
                    )
    return _Cells(nodes, cells, stages, publishers)


def topics_filled(
    node: CellNode, given: Mapping[str, object], wire: Wire, stage_file: Path | None
) -> tuple[Topic, ...]:
    """Topics of samples that a node fills: of several of its kind that of its head or sensor.

    Args:
        node: of the cell.
        given: its parameters.
        wire: the contract for its stage.
        stage_file: that messages name; None for the embedded one.

    Raises:
        InputError: the stage has no such head or sensor.
    """
    found = tuple(topic for topic in wire.published_by(node.executable) if topic.is_sample_block)
    if node.executable not in ASKED:
        # the bridge is told to leave the command to another node
        silent = "command" if given.get("stage_command") is False else None
        return tuple(topic for topic in found if topic.frame != silent)
    asked = str(given.get(ASKED[node.executable]) or node.name.removeprefix(f"{node.executable}_"))
    fitting = tuple(topic for topic in found if asked == topic.frame) or tuple(t for t in found if asked == t.head)
    if len(fitting) != 1:
        raise InputError(
            f"{node.where}: {node.name} is of the {ASKED[node.executable]} '{excerpt(asked)}', of which the stage has "
            f"{'several' if fitting else 'none'}; {stage_file or 'stage.yaml'} has "
            f"{', '.join(topic.frame for topic in found) or 'no such sensors'}"
        )
    return fitting


def _stream(name: str, kind: str) -> str:
    """Stream of a sensor of the list; those with a section of their own are called as if they stood there."""
    if kind == READ_HEAD:
        return f"head_{name}"
    return kind if kind in OWN_KINDS else stream_of_sensor(name, kind)


def _check_external(
    cell: Path, stage: _Stage, readers: Mapping[CellNode, Mapping[str, object]], publishers: Mapping[str, CellNode]
) -> None:
    """Hold what is published from elsewhere against the list of a stage and against the nodes of the cell.

    Raises:
        InputError: as `checked_nodes`.
    """
    for node, given in readers.items():
        for name in _external(cell, node, given):
            where = where_given(cell, node, EXTERNAL_SENSORS)
            streams = [stream for listed, stream in stage.listed.items() if name in (listed, stream)]
            if not streams:
                raise InputError(
                    f"{where}: {stage.path} lists no sensor '{excerpt(name)}'; it lists "
                    f"{', '.join(stage.listed) or 'none'}"
                )
            if streams[0] in publishers:
                publisher = publishers[streams[0]]
                raise InputError(
                    f"{where}: '{excerpt(name)}' is published by {publisher.name} of this cell ({publisher.where}); "
                    "keep one of both"
                )


def _check_listed(
    cell: Path, stage: _Stage, readers: Mapping[CellNode, Mapping[str, object]], publishers: Mapping[str, CellNode]
) -> None:
    """Hold the list of a stage against who publishes in the namespace of the nodes that take this stage.

    Raises:
        InputError: as `checked_nodes`.
    """
    external = {name for node, given in readers.items() for name in _external(cell, node, given)}
    for name, stream in stage.listed.items():
        topic = stage.wire.of_stream(stream)
        listeners = [node for node in readers if node.executable in topic.subscribers]
        if listeners and stream not in publishers and not {name, stream} & external:
            raise InputError(
                f"{stage.where(name)}: no node of {cell} publishes {listeners[0].namespace}{topic.name}, to which "
                f"{' and '.join(node.name for node in listeners)} would listen; expected in {cell} a section "
                f"{_section(name, topic)}, or, where another program publishes it, '{EXTERNAL_SENSORS}: [{name}]' "
                "among the parameters of '/**'"
            )


def _external(cell: Path, node: CellNode, given: Mapping[str, object]) -> Iterator[str]:
    """What the parameter says.

    Raises:
        InputError: it is no list of names.
    """
    found = given.get(EXTERNAL_SENSORS) or []
    if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
        raise InputError(
            f"{where_given(cell, node, EXTERNAL_SENSORS)}: {excerpt(found)}; expected a list of names of sensors that "
            "the stage lists, such as [nose]"
        )
    yield from found


def _section(name: str, topic: Topic) -> str:
    """The section that would start a node of a sensor."""
    executable = topic.publishers[0]
    called = f"{executable}_{name}" if executable in ASKED else executable
    return f"'/**/{called}: {{ros__parameters: {{source: …}}}}'"
