"""An interface box of an encoder that sends each reading as one UDP datagram: timestamp (ns) and angle (rad)."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Gathered

READING = struct.Struct("<qd")


class UdpEncoder(Device):
    """One head; the box sends its readings to a port of its own."""

    name = "udp"
    meaning = "an interface box that sends UDP datagrams"
    serves = ("encoder_head",)
    settings = (Setting("udp.port", 5005, "port that the box sends to", (1024, 65535)),)

    def open(self, instrument: Instrument) -> Datagrams:
        """Source of what arrives on the port."""
        return Datagrams(instrument.fields, instrument.setting("udp.port"))


class Datagrams(Gathered):
    """Readings as they arrive, each with the box's own stamp."""

    def __init__(self, fields: Sequence[str], port: int) -> None:
        """Listen to `port`."""
        super().__init__(fields)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError as error:
            self._socket.close()
            raise InputError(f"udp.port is {port}: {error}; expected a port that is free") from error

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of all readings before `until_ns` that have arrived."""
        try:
            while True:
                reading = self._socket.recv(READING.size + 1)
                if len(reading) != READING.size:
                    raise InputError(f"a datagram has {len(reading)} bytes or more; expected {READING.size}")
                stamp_ns, angle = READING.unpack(reading)
                self.add(stamp_ns, (angle,), time.time_ns())
        except BlockingIOError:  # none is waiting any more
            return super().take(since_ns, until_ns)

    def close(self) -> None:
        """Free the port."""
        self._socket.close()
