"""How the nodes of a cell fare, as one line and as a list: the latest of `/diagnostics` in plain words, worst first."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import excerpt

SILENT_AFTER = 2.5
"""s without a word from which a node counts as silent: two of its reports, one a second, that did not come."""

_LONGEST_PAUSE = 60.0
"""s between two reports of a node of somebody else's that is taken for its usual pace at most."""

_FORGOTTEN_AFTER = 60.0
"""s of silence after which a node that measures and moves nothing is no longer shown: somebody has ended it."""

_MOST_NODES, _MOST_PARTS = 200, 100
"""That are kept, however many names come."""

_LONGEST_REASON = 180
"""Characters of a message that are shown."""

_CHAIN = (
    *("encoder_head", "autocollimator", "listed_sensor", "stage_command", "stage_follower"),
    *("mock_controller", "linuxcnc_bridge", "error_estimator", "compensation"),
)
"""Executables without which nothing is measured or corrected, in the way of a sample: a cause stands before what
follows from it."""

_BESIDE = (OWN_REFERENCE, "stage_force", "stage_temperature", "recorder", "gap_monitor")
"""Those that the measurement goes on without."""

_SHOWN = {"encoder_head": "head", "listed_sensor": "sensor", "error_estimator": "estimator"}
_STALE = re.compile(r"stale: the last sample is (.+? s) old")


class Severity(IntEnum):
    """What a person should make of it."""

    OK = 0
    ATTENTION = 1
    FAULT = 2


_STALE_LEVEL = 3
"""`DiagnosticStatus.STALE` (REP 107)."""

_SEVERITY = {0: Severity.OK, 1: Severity.ATTENTION, _STALE_LEVEL: Severity.ATTENTION}
"""By the level of REP 107; of error, and of one that it does not know, a fault."""


@dataclass(frozen=True)
class NodeStatus:
    """One status of `/diagnostics`.

    Attributes:
        node: name with its namespace, dotted, such as `left.recorder`.
        part: what of the node is judged; empty where the name tells none.
        level: 0 well, 1 warning, 2 error, 3 stale.
        message: one sentence.
        figures: texts by name.
    """

    node: str
    part: str
    level: int
    message: str
    figures: Mapping[str, str] = field(default_factory=dict)

    @property
    def severity(self) -> Severity:
        """What a person should make of it."""
        return _SEVERITY.get(self.level, Severity.FAULT)


@dataclass(frozen=True)
class HealthRow:
    """One line of the list.

    Attributes:
        severity: how bad.
        what: node and part in plain words.
        message: what is said of it.
        age: s since that was said.
        stale: whether it is old: the node is silent, or calls what it says old.
        reason: the same as a sentence for the line on top.
    """

    severity: Severity
    what: str
    message: str
    age: float
    stale: bool
    reason: str


@dataclass(frozen=True)
class Headline:
    """The line on top: how bad, why, and how many more reasons there are as bad."""

    severity: Severity
    reason: str
    more: int = 0


@dataclass
class _Node:
    heard: float
    pauses: tuple[float, ...] = ()
    parts: dict[str, tuple[float, NodeStatus]] = field(default_factory=dict)

    @property
    def patience(self) -> float:
        """Time, s, after which it is silent: by its usual pace, of which an interruption is no part."""
        return max(SILENT_AFTER, 2.5 * min((*self.pauses, _LONGEST_PAUSE)) if self.pauses else 0.0)

    def is_silent(self, now: float) -> bool:
        """Whether that has gone by."""
        return now - self.heard > self.patience


class Health:
    """The latest statuses of the nodes in one namespace and below, in bounded memory."""

    def __init__(self, namespace: str, labels: Mapping[str, str]) -> None:
        """Nothing is known yet.

        Args:
            namespace: of the cell, dotted; empty for the root.
            labels: plain words by what a part may be called: the topics, as `/diagnostics` writes them.
        """
        self._prefix = f"{namespace}." if namespace else ""
        self._labels = labels
        self._nodes: dict[str, _Node] = {}

    def note(self, statuses: Iterable[NodeStatus], now: float) -> None:
        """Take note of what came at a time (s) of a clock that never steps; other namespaces are left out."""
        for status in statuses:
            if not status.node.startswith(self._prefix):
                continue
            node = self._nodes.get(status.node)
            if node is None:
                self._make_room()
                node = self._nodes[status.node] = _Node(now)
            if now > node.heard:
                node.pauses, node.heard = (*node.pauses[-1:], now - node.heard), now
            node.parts[status.part] = now, status
            # what its node says no longer goes: a refusal is said once
            node.parts = {p: s for p, s in node.parts.items() if now - s[0] <= node.patience}
            while len(node.parts) > _MOST_PARTS:
                del node.parts[next(iter(node.parts))]

    def find(self, node: str, part: str, now: float) -> NodeStatus | None:
        """Latest status of a node of this namespace, by its name within it; None where it is silent or unknown."""
        found = self._nodes.get(self._prefix + node)
        if found is None or found.is_silent(now) or part not in found.parts:
            return None
        return found.parts[part][1]

    def figure(self, name: str, now: float) -> set[str]:
        """What the nodes that speak say under the name of a figure."""
        spoken = (node for node in self._nodes.values() if not node.is_silent(now))
        return {s.figures[name] for node in spoken for _, s in node.parts.values() if name in s.figures}

    def rows(self, now: float) -> tuple[HealthRow, ...]:
        """All that is known, worst first, then in the way of a sample; of a silent node one row."""
        for name in [name for name, node in self._nodes.items() if self._is_gone(name, node, now)]:
            del self._nodes[name]
        found = [
            ((_rank(name), name), row) for name, node in self._nodes.items() for row in self._of_node(name, node, now)
        ]
        return tuple(row for _, row in sorted(found, key=lambda pair: (-pair[1].severity, pair[0])))

    def _of_node(self, name: str, node: _Node, now: float) -> Iterator[HealthRow]:
        shown, age = plain_node(name.removeprefix(self._prefix)), now - node.heard
        if node.is_silent(now):
            severity = Severity.FAULT if _executable(name) in _CHAIN else Severity.ATTENTION
            text = f"silent for {age:.0f} s"
            yield HealthRow(severity, shown, text, age, True, f"{shown} is {text}")
            return
        for heard, status in node.parts.values():
            topic = self._labels.get(status.part, "")
            label = topic or status.part
            what = shown if not label or label == shown else f"{shown}: {label}"
            message = excerpt(status.message, _LONGEST_REASON)
            stale = status.level == _STALE_LEVEL
            yield HealthRow(status.severity, what, message, now - heard, stale, _reason(topic or shown, message))

    def _is_gone(self, name: str, node: _Node, now: float) -> bool:
        known = _executable(name) in (*_CHAIN, *_BESIDE)
        return not known and node.is_silent(now) and now - node.heard > _FORGOTTEN_AFTER

    def _make_room(self) -> None:
        if len(self._nodes) >= _MOST_NODES:
            del self._nodes[min(self._nodes, key=lambda name: self._nodes[name].heard)]


def verdict_of(rows: Iterable[HealthRow]) -> Headline:
    """The line on top, of rows that stand worst first."""
    rows = tuple(rows)
    if not rows:
        return Headline(Severity.FAULT, "no node of the cell is heard on /diagnostics")
    worst = rows[0]
    if worst.severity == Severity.OK:
        return Headline(Severity.OK, "all nodes that are heard are well")
    return Headline(worst.severity, worst.reason, sum(row.severity == worst.severity for row in rows) - 1)


def label_of(topic: Topic) -> str:
    """Plain words for a topic: the head or sensor that it is of, or what it holds."""
    return (topic.key if topic.head is None else topic.frame).removesuffix("_samples").replace("_", " ")


def plain_node(name: str) -> str:
    """Plain words for the name of a node: `encoder_head_a` is head a."""
    space, _, last = name.rpartition(".")
    executable = _executable(last)
    if executable in _SHOWN:
        last = _SHOWN[executable] + last.removeprefix(executable)
    words = last.replace("_", " ")
    return f"{space}: {words}" if space else words


def _reason(what: str, message: str) -> str:
    stale = _STALE.match(message)
    if stale:
        return f"{what} gives no samples: the last one is {stale[1]} old"
    if message.startswith("held: "):
        return f"corrections are held: {message.removeprefix('held: ')}"
    return f"{what}: {message}"


def _executable(name: str) -> str:
    """Executable of the package that a node is called after; empty where it is none of the cell's."""
    last = name.rpartition(".")[2]
    return next((each for each in (*_CHAIN, *_BESIDE) if last == each or last.startswith(f"{each}_")), "")


def _rank(name: str) -> int:
    executable = _executable(name)
    known = (*_CHAIN, *_BESIDE)
    return known.index(executable) if executable else len(known)
