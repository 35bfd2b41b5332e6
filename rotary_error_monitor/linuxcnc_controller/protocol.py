"""What the programs beside LinuxCNC and whoever started them say to one another: one JSON object a line."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from typing import Any, get_args

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.shaping import CourseLimits

COUNTS_END = 2**31
"""Numbers on the counts pins are below this, and from minus this on."""

LINK_SILENCE = 0.3
"""After this long without a word, s, the link counts as hung; so it does for itself."""


@dataclass(frozen=True)
class LinkSettings:
    """How the link works.

    Attributes:
        period: time between two looks at the controller, s.
        count: size of one external offset count, m and rad.
        largest_linear: largest correction of a linear axis, m.
        largest_rotary: largest correction of a rotary axis, rad.
        speed_linear: how fast the correction of a linear axis may change, m/s.
        speed_rotary: the same of a rotary axis, rad/s.
        acceleration_linear: how fast that may change, m/s^2.
        acceleration_rotary: the same of a rotary axis, rad/s^2.
        pulse_timeout: how long the servo thread may stand still before the controller counts as gone, s.
    """

    period: float = 0.004
    count: float = 1e-10
    largest_linear: float = 5e-4
    largest_rotary: float = 5e-3
    speed_linear: float = 2e-3
    speed_rotary: float = 2e-2
    acceleration_linear: float = 0.05
    acceleration_rotary: float = 0.5
    pulse_timeout: float = 0.4

    def __post_init__(self) -> None:
        largest = max(self.largest_linear, self.largest_rotary)
        if self.count * COUNTS_END <= largest:
            raise InputError(
                f"count {self.count:g}; expected more than {largest / COUNTS_END:.4g}, so that the largest correction, "
                f"{largest:g} m or rad, has a number of 32 bits"
            )

    def course_limits(self, are_rotary: Iterable[bool]) -> CourseLimits:
        """Limits of the corrections of axes, each rotary or linear."""
        kinds = tuple(are_rotary)

        def of(linear: float, rotary: float) -> tuple[float, ...]:
            return tuple(rotary if is_rotary else linear for is_rotary in kinds)

        return CourseLimits(
            of(self.largest_linear, self.largest_rotary),
            of(self.speed_linear, self.speed_rotary),
            of(self.acceleration_linear, self.acceleration_rotary),
        )


@dataclass(frozen=True)
class ObserverSettings:
    """How the observer works: time between two observations, s."""

    period: float = 0.01


@dataclass(frozen=True)
class Hello:
    """The link stands: axes of the machine in the order of its joints."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class Absent:
    """No controller is there yet, and why; the program waits for it."""

    reason: str


@dataclass(frozen=True)
class State:
    """The machine at one time, m and rad.

    Attributes:
        stamp_ns: when, timestamp (ns).
        positions: joints as the program commands them, without corrections.
        velocities: their velocities, m/s and rad/s.
        is_exact: the stamp is when the servo thread told the drives what follows, to some hundredths of a millisecond;
            otherwise it is when that was seen.
        commands: what the drives of the joints are told, with corrections.
        speeds: how fast that changes, m/s and rad/s.
        valid: whether they say where the machine is: it is on, homed, and its kinematics are known.
        offsets: external offsets in effect, of the axes.
        effect: corrections in effect, of the joints: what the offsets move them by.
        to_go: what is still to come of the corrections that are followed, by the link's own limits.
        slowed: a correction changes as fast as it may.
        lag: largest part of an offset that the controller was asked for and has not brought about, m or rad.
        limited: soft limits clip the offsets.
        trouble: why corrections are not followed; empty while they are.
        takeovers: how often the controller's offsets were changed by another hand.
    """

    stamp_ns: int
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    is_exact: bool
    commands: tuple[float, ...]
    speeds: tuple[float, ...]
    valid: bool
    offsets: tuple[float, ...]
    effect: tuple[float, ...]
    to_go: tuple[float, ...]
    slowed: bool
    lag: float
    limited: bool
    trouble: str
    takeovers: int


@dataclass(frozen=True)
class Observation:
    """What the controller makes of program and offsets, m and rad.

    Attributes:
        stamp_ns: when, timestamp (ns).
        axes: axes as the program commands them, without offsets.
        joints: joints as the drives are commanded, with offsets.
    """

    stamp_ns: int
    axes: tuple[float, ...]
    joints: tuple[float, ...]


@dataclass(frozen=True)
class End:
    """The link ends, and why."""

    reason: str


@dataclass(frozen=True)
class CorrectionRequest:
    """Follow these corrections of the joints, m and rad, within the link's limits."""

    positions: tuple[float, ...]


@dataclass(frozen=True)
class HaltRequest:
    """Bring the corrections to rest, and follow none until the next comes."""


@dataclass(frozen=True)
class ClearRequest:
    """Take all external offsets back to zero and follow no correction until the next comes."""


Record = Hello | Absent | State | Observation | End | CorrectionRequest | HaltRequest | ClearRequest
_KINDS: dict[str, type[Record]] = {kind.__name__: kind for kind in get_args(Record)}


def encode(record: Record) -> bytes:
    """One line that carries the record; numbers come back bit for bit."""
    return json.dumps({"kind": type(record).__name__, **asdict(record)}).encode() + b"\n"


def decode(line: bytes) -> Record:
    """The record that a line carries.

    Raises:
        InputError: it is none.
    """
    try:
        values: dict[str, Any] = json.loads(line)
        kind = _KINDS[values.pop("kind")]
        return kind(**{field.name: _hashable(values[field.name]) for field in fields(kind)})
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"no record: {line[:200]!r} ({error!r})") from None


def _hashable(value: Any) -> Any:  # noqa: ANN401 (any JSON value)
    return tuple(value) if isinstance(value, list) else value
