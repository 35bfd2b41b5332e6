"""A device: one way to get the samples of an instrument, the choice of its node's parameter `source`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.source import Source


@dataclass(frozen=True)
class Instrument:
    """What a device gives the samples of.

    Attributes:
        stream: its name among the streams of the stage, such as `head_a`; its frame is called so as well.
        fields: of a sample, as `msg_defs/` names them.
        stage: that it is built into.
        setting: value of a setting by its name: of the device, or of the cell.
        now_ns: timestamp (ns) at which it is opened.
    """

    stream: str
    fields: tuple[str, ...]
    stage: StageDescription
    setting: Callable[[str], Any]
    now_ns: int


class Device(ABC):
    """Base of all devices. A concrete one has a `name`; a class without one is an abstract base.

    Attributes:
        name: value of the parameter `source`.
        serves: kinds of instrument that it can be, by the name of their node.
        settings: parameters that a node has because of it.
        meaning: what it is for, in a few words, for who has to choose one.
        simulated: whether its samples are those of a simulation, which the node then says wherever it speaks.
        hears: whether it opens nothing but a `Heard`, so that a bag of the driver's messages does as well.
    """

    name: ClassVar[str] = ""
    serves: ClassVar[tuple[str, ...]] = ()
    settings: ClassVar[tuple[Setting, ...]] = ()
    meaning: ClassVar[str] = ""
    simulated: ClassVar[bool] = False
    hears: ClassVar[bool] = False

    @abstractmethod
    def open(self, instrument: Instrument) -> Source:
        """The source of the instrument's samples.

        A `Polled` one is asked at the rate `poll_rate`, what is `Heard` comes in messages on its topic; any other is
        asked for each block.

        Raises:
            InputError: a setting is wrong, or the device is not there.
        """


POLL_RATE = Setting("poll_rate", 500.0, "how often a device that shows its present value is read, Hz", (1.0, 5000.0))


def opened(device: Device, instrument: Instrument) -> Source:
    """What a device opens for an instrument.

    Raises:
        InputError: as `Device.open`, or it gives no source.
    """
    source: object = device.open(instrument)
    if not isinstance(source, Source):
        raise InputError(f"open gives {type(source).__name__}; expected a source")
    return source


@contextmanager
def told_of(device: str) -> Iterator[None]:
    """Say of which device an error is; whatever a device raises is an input that cannot be used.

    Raises:
        InputError: in place of any other exception.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # an unplugged device, or a mistake in a class of a user's own
        raise InputError(f"device '{device}': {type(error).__name__}: {error}") from error
