"""Voltages of instruments on the Linux industrial I/O subsystem, read through sysfs.

By the kernel's ABI (Documentation/ABI/testing/sysfs-bus-iio) a channel's voltage in mV is `(raw + offset) * scale`,
with `in_voltageN_raw` and, for the channel or for all voltages of the device, `_offset` (0 where missing) and `_scale`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.tilt import tilt_from_quadrants
from rotary_error_monitor.sources.device import POLL_RATE, Device, Instrument
from rotary_error_monitor.sources.source import Polled

_VOLT = 1e-3  # the subsystem counts in mV


class QuadrantDevice(Device):
    """An autocollimator's quadrant detector on a converter of the kernel."""

    name = "iio"
    meaning = "quadrant voltages on a Linux IIO device"
    serves = ("autocollimator",)
    settings = (
        POLL_RATE,
        Setting(
            "iio.device", "/sys/bus/iio/devices/iio:device0", "folder of the quadrant detector's converter in sysfs"
        ),
        Setting(
            "iio.channels", [0, 1, 2, 3], "voltage channels of the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y)"
        ),
        Setting("iio.dark", [0.0, 0.0, 0.0, 0.0], "voltages of the quadrants without light, V"),
        Setting("iio.sensitivity", 0.0005, "tilt per normalised difference of the voltages, rad", (1e-9, 1.0)),
    )

    def open(self, instrument: Instrument) -> Polled:
        """Source of the tilts."""
        setting = instrument.setting
        return Polled(
            instrument.fields,
            QuadrantDetector(
                Path(setting("iio.device")), setting("iio.channels"), setting("iio.sensitivity"), setting("iio.dark")
            ),
        )


class VoltageDevice(Device):
    """A displacement probe whose amplifier gives out a voltage."""

    name = "iio"
    meaning = "a probe's voltage on a Linux IIO device"
    serves = ("listed_sensor",)
    settings = (
        POLL_RATE,
        Setting("iio.device", "/sys/bus/iio/devices/iio:device0", "folder of the probe's converter in sysfs"),
        Setting("iio.channel", 0, "voltage channel of the probe", (0, 1023)),
        Setting("iio.sensitivity", 1e-5, "displacement per voltage, m/V", (1e-9, 1.0)),
    )

    def open(self, instrument: Instrument) -> Polled:
        """Source of the displacements.

        Raises:
            InputError: the sensor has several fields, or the channel cannot be read.
        """
        setting, fields = instrument.setting, instrument.fields
        if len(fields) > 1:
            raise InputError(
                f"source iio reads one voltage, but {instrument.stream} has the fields {', '.join(fields)}; "
                "expected the source of a driver that gives all of them, such as vector3"
            )
        probe = VoltageProbe(Path(setting("iio.device")), setting("iio.channel"), setting("iio.sensitivity"))
        return Polled(instrument.fields, probe)


class VoltageProbe:
    """Displacement as the voltage of one channel tells it; zero and direction are the stage description's."""

    def __init__(self, folder: Path, channel: int, sensitivity: float) -> None:
        """Open the device.

        Args:
            folder: of the device in sysfs, such as `/sys/bus/iio/devices/iio:device0`.
            channel: its number.
            sensitivity: displacement per voltage, m/V.

        Raises:
            InputError: the channel is missing or cannot be read.
        """
        self._channel, self._sensitivity = _Channel(folder, channel), sensitivity
        self._channel.read()

    def read(self) -> tuple[float]:
        """The present displacement, m.

        Raises:
            InputError: the channel cannot be read any more.
        """
        return (self._channel.read() * self._sensitivity,)


class QuadrantDetector:
    """Tilt seen by a quadrant detector on four voltage channels of one device."""

    def __init__(
        self, folder: Path, channels: Sequence[int], sensitivity: float, dark: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    ) -> None:
        """Open the device.

        Args:
            folder: of the device in sysfs, such as `/sys/bus/iio/devices/iio:device0`.
            channels: numbers of the four channels, quadrants in the order (+x, +y), (-x, +y), (-x, -y), (+x, -y).
            sensitivity: tilt per normalised difference, rad.
            dark: voltages without light, V, in the same order.

        Raises:
            InputError: a channel is missing or cannot be read, or there are not four of them.
        """
        if len(channels) != 4 or len(dark) != 4:
            raise InputError(
                f"quadrant channels {list(channels)} with dark voltages {list(dark)}: expected four of each"
            )
        self._sensitivity, self._dark = sensitivity, np.asarray(dark, dtype=np.float64)
        self._channels = [_Channel(folder, number) for number in channels]
        for channel in self._channels:
            channel.read()

    def read(self) -> tuple[float, float]:
        """The present tilt (x, y) as a rotation vector, rad.

        Raises:
            InputError: a channel cannot be read any more, or no light falls on the detector.
        """
        voltages = np.array([[channel.read() for channel in self._channels]])
        x, y = tilt_from_quadrants(voltages, self._sensitivity, self._dark)[0]
        return float(x), float(y)


class _Channel:
    def __init__(self, folder: Path, number: int) -> None:
        self._raw = folder / f"in_voltage{number}_raw"
        self._scale = self._constant(folder, number, "scale")
        self._offset = self._constant(folder, number, "offset", 0.0)

    def read(self) -> float:
        return (_number(self._raw) + self._offset) * self._scale * _VOLT

    @staticmethod
    def _constant(folder: Path, number: int, what: str, default: float | None = None) -> float:
        for path in (folder / f"in_voltage{number}_{what}", folder / f"in_voltage_{what}"):
            if path.is_file():
                return _number(path)
        if default is None:
            raise InputError(f"{folder}: neither in_voltage{number}_{what} nor in_voltage_{what}; is it an IIO device?")
        return default


def _number(path: Path) -> float:
    try:
        return float(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no voltage can be read ({error}); expected a file with a number") from error
