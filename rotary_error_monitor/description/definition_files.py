"""The files of the wire contract: those of `msg_defs/`, and those of other packages of their kinds of sensors."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rotary_error_monitor.description.wire_section import WireSection
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plugins import load_plugin, origin_of, plugins_of
from rotary_error_monitor.resources import share

ENTRY_POINTS = "rotary_error_monitor.msg_defs"
"""Group of packages in whose folders such files (*.yaml) lie."""

SENSOR = "{sensor}"
LISTED = "listed_sensor"
"""The node that publishes what a listed sensor shows."""

_LISTENERS = {"error_estimator", "gap_monitor", "recorder"}
"""Nodes that take the samples of any listed sensor."""


def own_files(folder: Path | None = None) -> tuple[Path, ...]:
    """Files in a folder, by default the package's `msg_defs/`.

    Raises:
        InputError: there is none.
    """
    folder = folder or share() / "msg_defs"
    found = tuple(sorted(folder.glob("*.yaml")))
    if not found:
        raise InputError(f"{folder}: no wire contract (*.yaml) in this folder")
    return found


@cache
def plugged_files() -> tuple[Path, ...]:
    """Files of other packages, in the order of the names of their entry points.

    Raises:
        InputError: an entry point cannot be loaded, is no package, or has no such file in its folder.
    """
    found: list[Path] = []
    for entry in plugins_of(ENTRY_POINTS):
        folders = getattr(load_plugin(entry), "__path__", ())
        files = [path for folder in folders for path in sorted(Path(folder).glob("*.yaml"))]
        if not files:
            raise InputError(
                f"{origin_of(entry)}: {entry.value} is no package with a wire contract (*.yaml) in its folder; name "
                "one, and the files among its package data"
            )
        found += files
    return tuple(found)


def check_plugged(section: WireSection, path: Path) -> None:
    """Hold a file of another package against what it may define: topics of a kind of sensor that a stage lists.

    Raises:
        InputError: it defines something else; the message says what is expected.
    """
    for key, topic in section.topics.items():
        for what, found, wanted in (
            ("frame", topic.frame, topic.frame.endswith(f"_{SENSOR}")),
            ("name", topic.name, f"/{topic.frame}/" in topic.name),
            ("publishers", topic.publishers, topic.publishers == (LISTED,)),
            ("subscribers", topic.subscribers, set(topic.subscribers) <= _LISTENERS),
        ):
            if not wanted:
                raise InputError(
                    f"{path}: topic '{key}': {what} {found!r}; expected a topic /stage/KIND_{SENSOR}/… of frame "
                    f"KIND_{SENSOR}, published by {LISTED}, read by none but {', '.join(sorted(_LISTENERS))}"
                )
    if section.services:
        raise InputError(f"{path}: defines services; expected topics of a kind of listed sensor alone")
