"""What every source of samples gives, and the two ways there: asked for a span of time, or gathered one by one."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.arrival import ArrivalCheck
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples


class Source(ABC):
    """Gives the samples of one signal, block by block."""

    @abstractmethod
    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of the samples from `since_ns` to before `until_ns`, timestamps (ns); None where there are none.

        Raises:
            InputError: what the device says cannot be used.
        """

    def close(self) -> None:  # noqa: B027 (most have nothing to put away)
        """Put away what was opened for it; nothing is taken any more."""


class Readable(Protocol):
    """Something that shows one sample at a time when it is asked."""

    def read(self) -> Sequence[float]:
        """The present sample, one number for each field, SI units.

        Raises:
            InputError: it cannot be read or shows nonsense.
        """


class Gathered(Source):
    """Source of samples that come one at a time, such as messages of a third-party driver."""

    def __init__(self, names: Sequence[str]) -> None:
        """Gather samples with the fields `names`."""
        self._names = tuple(names)
        self._times: list[int] = []
        self._values: list[Sequence[float]] = []
        self._newest_ns = -1
        self._arrival = ArrivalCheck()

    def add(self, time_ns: int, values: Sequence[float], arrival_ns: int | None = None) -> None:
        """Keep one sample, taken at `time_ns`, until its block is taken.

        Args:
            time_ns: when it was measured, timestamp (ns).
            values: one for each field.
            arrival_ns: when it arrived, timestamp (ns) of this computer's clock; None where that made the stamp.

        Raises:
            InputError: it is not finite, not as many numbers as fields, in the future or old at its arrival, or not
                newer than the sample before; after this clock was set back the next one may be.
        """
        if len(values) != len(self._names) or not all(map(math.isfinite, values)):
            raise InputError(f"a sample is {list(values)}; expected {len(self._names)} finite numbers")
        if arrival_ns is not None:
            if refusal := self._arrival.judge(time_ns, arrival_ns):
                raise InputError(f"a sample {refusal}")
            if self._arrival.was_set_back(self._newest_ns, arrival_ns):
                self._newest_ns = -1
                self.drop()
        if time_ns <= self._newest_ns:
            raise InputError(f"a sample is stamped {time_ns} ns, not after the one before ({self._newest_ns} ns)")
        self._newest_ns = time_ns
        self._times.append(time_ns)
        self._values.append(values)

    def drop(self) -> None:
        """Forget the samples that were not taken yet."""
        self._times.clear()
        self._values.clear()

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of all samples before `until_ns` that were not taken yet, those that came late included."""
        count = bisect_left(self._times, until_ns)
        if count == 0:
            return None
        times, values = self._times[:count], self._values[:count]
        del self._times[:count], self._values[:count]
        return block_from_samples(np.array(times, np.int64), self._names, np.array(values, np.float64))


class Heard(Gathered):
    """Source of what a third-party driver publishes, one sample a message.

    Attributes:
        topic: of the driver; it may be relative to the node's namespace.
        type: of its messages, such as `sensor_msgs/msg/JointState`.
        sample: makes the sample of a message, which has the attributes that its type says; raises `InputError` where
            it holds none.
    """

    def __init__(self, names: Sequence[str], topic: str, type: str, sample: Callable[[Any], Sequence[float]]) -> None:
        """Samples with the fields `names`; for the rest see the attributes."""
        super().__init__(names)
        self.topic, self.type, self.sample = topic, type, sample


class Polled(Gathered):
    """Source that asks a device at a steady rate."""

    def __init__(self, names: Sequence[str], device: Readable) -> None:
        """Ask `device`, whose samples have the fields `names`."""
        super().__init__(names)
        self._device = device

    def poll(self, now_ns: int) -> None:
        """Ask the device now.

        Raises:
            InputError: it cannot be read or shows nonsense.
        """
        self.add(now_ns, self._device.read(), now_ns)
