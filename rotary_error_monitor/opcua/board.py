"""Latest values and statuses of a cell, and how far each may be trusted: by its age and by the level of its judge."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from rotary_error_monitor.opcua.model import LEVEL, MESSAGE, REPORT_STALE_AFTER, USABLE, Value, Variable
from rotary_error_monitor.signals.blocks import NANOSECONDS

OK, WARN, ERROR, STALE = range(4)
"""Levels of `/diagnostics` (REP 107)."""

T = TypeVar("T")


class Quality(Enum):
    """How far a value may be trusted, by OPC UA's names of status codes (OPC 10000-4, 7.39, and 10000-8, 6.3)."""

    GOOD = "Good"
    SUBNORMAL = "UncertainSubNormal"
    AWAITED = "BadWaitingForInitialData"
    SILENT = "BadNoCommunication"
    FAULTY = "BadDeviceFailure"
    OUT_OF_SERVICE = "BadOutOfService"
    NOT_OBSERVED = "BadSensorFailure"
    NO_SENSOR = "BadNotConnected"

    @property
    def is_bad(self) -> bool:
        """Whether the value is not to be used; OPC UA then shows none."""
        return self.value.startswith("Bad")


@dataclass(frozen=True)
class Point:
    """What a variable shows: value, None where it is bad; its quality; when it was measured, timestamp (ns)."""

    value: Value | None
    quality: Quality
    stamp_ns: int | None


@dataclass(frozen=True)
class Status:
    """A status of `/diagnostics`: name `<node>: <what>`, level, sentence, figures as text."""

    name: str
    level: int
    message: str
    figures: Mapping[str, str]


@dataclass(frozen=True)
class _Heard(Generic[T]):
    """What was heard: measured at `stamp_ns`, received at `received_ns`, and at `moment` (s) of a steady clock."""

    what: T
    stamp_ns: int
    received_ns: int
    moment: float

    def age(self, now_ns: int, moment: float) -> float:
        """Age, s; neither a stamp in the future nor a clock that halts or is set back makes young what is old."""
        return max((now_ns - min(self.stamp_ns, self.received_ns)) / NANOSECONDS, moment - self.moment)


class Board:
    """Latest values by the paths of variables, and latest statuses by their names.

    One thread may note while others read: each entry is replaced as a whole.
    """

    def __init__(self, now_ns: Callable[[], int], steady: Callable[[], float] = time.monotonic) -> None:
        """Keep the time of `now_ns` (ns), which may halt or jump, and of `steady` (s), which never does."""
        self._now_ns = now_ns
        self._steady = steady
        self._values: dict[str, _Heard[float]] = {}
        self._statuses: dict[str, _Heard[Status]] = {}

    def note(self, path: str, value: float, stamp_ns: int) -> None:
        """Take note of a value that was measured at `stamp_ns`; NaN says that no sensor tells it."""
        self._values[path] = self._heard(value, stamp_ns)

    def note_status(self, status: Status, stamp_ns: int) -> None:
        """Take note of a status."""
        self._statuses[status.name] = self._heard(status, stamp_ns)

    def statuses(self) -> dict[str, Status]:
        """Statuses that were ever heard, by name."""
        return {name: heard.what for name, heard in self._statuses.copy().items()}

    def read(self, variable: Variable) -> Point:
        """What a variable shows now: never good where it is stale, or where nobody vouches for it who should."""
        heard = self._statuses.get(variable.status) if variable.status else self._values.get(variable.path)
        if not variable.sensed:
            return Point(None, Quality.NO_SENSOR, None)
        if heard is None:
            return Point(None, Quality.AWAITED, None)
        told = heard.what
        value = _figure(told, variable) if isinstance(told, Status) else told
        quality = self._quality(variable, heard, value)
        return Point(None if quality.is_bad else value, quality, heard.stamp_ns)

    def _quality(self, variable: Variable, heard: _Heard[Status] | _Heard[float], value: Value | None) -> Quality:
        if self._age(heard) > variable.stale_after:
            return Quality.SILENT
        if isinstance(heard.what, Status) and heard.what.level >= STALE:
            return Quality.OUT_OF_SERVICE
        judged = self._judgement(variable.judge) if variable.judge else Quality.GOOD
        if judged.is_bad:
            return judged
        if value is None:
            return Quality.AWAITED
        return Quality.NOT_OBSERVED if isinstance(value, float) and not math.isfinite(value) else judged

    def _judgement(self, status: str) -> Quality:
        """What the level of a status makes of what it judges; unheard of, nobody vouches for that."""
        heard = self._statuses.get(status)
        if heard is None or self._age(heard) > REPORT_STALE_AFTER:
            return Quality.SUBNORMAL
        levels = {OK: Quality.GOOD, WARN: Quality.SUBNORMAL, ERROR: Quality.FAULTY}
        return levels.get(heard.what.level, Quality.OUT_OF_SERVICE)

    def _age(self, heard: _Heard[Status] | _Heard[float]) -> float:
        return heard.age(self._now_ns(), self._steady())

    def _heard(self, what: T, stamp_ns: int) -> _Heard[T]:
        return _Heard(what, stamp_ns, self._now_ns(), self._steady())


def _figure(status: Status, variable: Variable) -> Value | None:
    """The figure of a status that a variable shows; None where it has none, or none of that type."""
    said: dict[str, Value] = {LEVEL: float(status.level), MESSAGE: status.message, USABLE: status.level < ERROR}
    if variable.figure in said:
        return said[variable.figure]
    text = status.figures.get(variable.figure)
    if text is None or variable.type is str:
        return text
    if variable.type is bool:
        return {"true": True, "false": False}.get(text.lower())
    try:
        return float(text)
    except ValueError:
        return None
