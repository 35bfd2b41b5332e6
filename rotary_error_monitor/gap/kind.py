"""What a kind of thing that can be diagnosed gives: description, problem, and how causes are written to a twin."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.problem import DiagnosableProblem

ENTRY_POINTS = "rotary_error_monitor.kinds"
"""Group in which a kind is registered, by the name of the section that makes a YAML file a twin of it."""

Thing = TypeVar("Thing")
Own = TypeVar("Own", bound=AnyEffect)
Posed = TypeVar("Posed", bound=DiagnosableProblem)


@dataclass(frozen=True)
class TwinFile(Generic[Thing, Own]):
    """A twin as read from a file.

    Attributes:
        section: of the file that holds the description, which is the name of its kind.
        description: as the kind reads it.
        effects: the effects known in this run, of its kind.
        known: effects that the twin already has besides its parameters.
        naming: which cell of a bag is held against it, and how the bag calls its topics.
    """

    path: Path
    section: str
    kind: Kind[Thing, Own, Any]
    description: Thing
    effects: tuple[Own, ...]
    known: tuple[Cause, ...] = ()
    naming: Naming = THE_ONLY_CELL


class Kind(ABC, Generic[Thing, Own, Posed]):
    """A kind of thing that can be diagnosed; made without arguments.

    Attributes:
        effect: base of its effects.
        rank: of several kinds whose sections one file has it is a twin of that with the highest.
    """

    effect: type[Own]
    rank: ClassVar[int] = 0

    @abstractmethod
    def describe(self, path: Path) -> Thing:
        """The description in a twin's file.

        Raises:
            InputError: it is wrong; the message names file, line, value and what is expected.
        """

    @abstractmethod
    def problem(self, recording: Path, twin: TwinFile[Thing, Own], most_rate: float) -> Posed:
        """A recording beside a twin.

        Args:
            recording: its bag or file.
            twin: that is held against it.
            most_rate: samples a second (Hz) of one sensor that are used, for kinds that sample in time.

        Raises:
            InputError: the recording does not hold what the twin needs.
        """

    def acted_on(self, problem: Posed, description: Thing) -> object:
        """What the effects act on, and are asked with for their places: as a rule the description."""
        return description

    def attempt(self, problem: Posed, cause: Cause) -> None:
        """Predict with an effect that is not the package's own; whatever is raised is told with the effect's name."""
        columns = problem.signature(cause, cause.effect.indices(Role.LINEAR, Role.SHAPE))
        for channel, rows in columns.items() if isinstance(columns, dict) else ():
            check_signal(channel, rows, rows.shape)

    def amended(self, description: Thing, cause: Cause) -> Thing:
        """The description with a cause in its parameters; as it was where the cause has no place there."""
        return description

    def mapping(self, description: Thing) -> dict[str, Any] | None:
        """Content of the section, the inverse of `describe`; None where no cause has a place there."""
        return None


AnyKind = Kind[Any, Any, Any]


@contextmanager
def opened_bag(path: Path, naming: Naming = THE_ONLY_CELL) -> Iterator[BagReader]:
    """A bag; what is found wrong with what it holds is told with its remarks, such as that its end is missing.

    Raises:
        InputError: it cannot be read.
    """
    reader = BagReader(path, naming)
    try:
        yield reader
    except InputError as error:
        told = (remark for remark in reader.remarks if remark not in str(error))
        raise InputError("; ".join([str(error), *told])) from error


def check_amended(amended: object) -> None:
    """Refuse what is no description of a machine.

    Raises:
        TypeError: it is something else.
    """
    if not isinstance(amended, MachineDescription):
        raise TypeError(f"amend gives {type(amended).__name__}; expected the description of a machine")


def check_signal(name: str, given: object, shape: tuple[int, ...], *, is_complex: bool = False) -> None:
    """Refuse what is not one finite number for each sample, or is complex where real numbers are expected.

    Raises:
        ValueError: it has another shape, is not finite, or complex.
    """
    values = np.asarray(given)
    if values.shape != shape:
        raise ValueError(f"{name} gets shape {values.shape}; expected {shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} gets values that are not finite")
    if np.iscomplexobj(values) and not is_complex:
        raise ValueError(f"{name} gets complex numbers; expected real ones")
