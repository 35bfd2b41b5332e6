"""Engineering units of OPC UA: common codes of UNECE Recommendation 20, and the numbers that OPC 10000-8 makes."""

from __future__ import annotations

from dataclasses import dataclass

NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"
"""Namespace of the codes (OPC 10000-8, 5.6.4.3)."""


@dataclass(frozen=True)
class Unit:
    """A unit: symbol, name in English, common code."""

    symbol: str
    name: str
    code: str

    @property
    def number(self) -> int:
        """`UnitId` of the code: its characters as bytes of a number, the first one highest (OPC 10000-8, 5.6.4.3)."""
        return int.from_bytes(self.code.encode("ascii"), "big")


ONE = Unit("1", "one", "C62")
UNITS = {
    unit.symbol: unit
    for unit in (
        ONE,
        Unit("µm", "micrometre", "4H"),
        Unit("µrad", "microradian", "B97"),
        Unit("mm/s", "millimetre per second", "C16"),
        Unit("rad/s", "radian per second", "2A"),
        Unit("°C", "degree Celsius", "CEL"),
        Unit("Hz", "hertz", "HTZ"),
        Unit("s", "second", "SEC"),
        Unit("ms", "millisecond", "C26"),
    )
}
"""The units of the address space by their symbols."""
