"""Quadrature encoder on the Linux counter subsystem, read through sysfs.

The kernel's ABI (Documentation/ABI/testing/sysfs-bus-counter) shows each count as a folder such as
`/sys/bus/counter/devices/counter0/count0` with the files `count`, `ceiling` (largest value, where the hardware has one)
and `enable`.
"""

from __future__ import annotations

import math
from pathlib import Path

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.device import POLL_RATE, Device, Instrument
from rotary_error_monitor.sources.source import Polled
from rotary_error_monitor.sources.unwrapping import unwrap_count

_WHOLE_WORD = 2**64 - 1


class CounterDevice(Device):
    """A read head on a counter of the kernel."""

    name = "counter"
    meaning = "a quadrature counter of the Linux counter subsystem"
    serves = ("encoder_head",)
    settings = (
        POLL_RATE,
        Setting("counter.device", "/sys/bus/counter/devices/counter0/count0", "folder of the count in sysfs"),
        Setting("counter.reverse", False, "whether the counter counts against the positive rotation"),
    )

    def open(self, instrument: Instrument) -> Polled:
        """Source of the counter's angles; its counts are those of the stage's ring."""
        encoder, setting = instrument.stage.ring, instrument.setting
        counts = encoder.lines_per_revolution * encoder.counts_per_line
        folder = Path(setting("counter.device"))
        return Polled(instrument.fields, Counter(folder, counts, reverse=setting("counter.reverse")))


class Counter:
    """Angle of a read head whose signals a hardware counter counts."""

    def __init__(self, folder: Path, counts_per_revolution: int, *, reverse: bool = False) -> None:
        """Open the count in `folder`.

        Raises:
            InputError: the folder holds no count, or the count is switched off.
        """
        self._count = folder / "count"
        enable = folder / "enable"
        if enable.is_file() and self._read(enable) == 0:
            raise InputError(f"{enable}: the counter is switched off; write 1 into this file")
        ceiling = folder / "ceiling"
        largest = self._read(ceiling) if ceiling.is_file() else _WHOLE_WORD
        if largest < 1:
            raise InputError(f"{ceiling}: the counter's largest value is {largest}; it must be at least 1")
        self._modulus = largest + 1
        self._unwrapped = self._read(self._count)
        self._step = (-1 if reverse else 1) * 2 * math.pi / counts_per_revolution

    def read(self) -> tuple[float]:
        """The present angle, rad, unwrapped since the first reading.

        Raises:
            InputError: the device cannot be read any more.
        """
        self._unwrapped = unwrap_count(self._read(self._count), self._unwrapped, self._modulus)
        return (self._unwrapped * self._step,)

    @staticmethod
    def _read(path: Path) -> int:
        try:
            return int(path.read_text())
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: no count can be read ({error}); expected a file with a whole number") from error
