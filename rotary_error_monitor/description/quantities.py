"""Quantities that several sections of files state: what they mean and their ranges."""

from __future__ import annotations

from typing import Annotated

from rotary_error_monitor.description.expected import Expected

REFERENCE_TEMPERATURE = 20.0
"""Temperature, °C, at which what a description states holds, where it names none (ISO 1)."""

TURN = 6.283185307179587
"""A whole turn, rad, rounded up."""

HALF_TURN = 3.141592653589794
"""Half a turn, rad, rounded up."""

Name = Annotated[str, Expected("a name in small letters, digits and _", pattern="^[a-z][a-z0-9_]*$")]
Short = Annotated[str, Expected("a name of small letters and digits, a letter first", pattern="^[a-z][a-z0-9]*$")]
Letter = Annotated[str, Expected("one capital letter that names an axis", pattern="^[A-Z]$")]
NotNegative = Annotated[float, Expected("a number from 0 to 1000", 0, 1000)]
Angle = Annotated[float, Expected("an angle in rad", -TURN, TURN)]
Temperature = Annotated[float, Expected("a temperature in °C", -50, 150)]
Height = Annotated[float, Expected("a height in m", -10, 10)]
Displacement = Annotated[float, Expected("a length in m of at most 10 mm", -0.01, 0.01)]
LARGEST_TILT = 0.01
Tilt = Annotated[float, Expected("an angle in rad of at most 10 mrad", -LARGEST_TILT, LARGEST_TILT)]
Deviation = Annotated[float, Expected("an error in m or rad, at most 10 mm or at most 10 mrad", -0.01, 0.01)]
DisplacementPair = Annotated[tuple[Displacement, Displacement], Expected("[x, y] in m, each at most 10 mm")]
Displacements = Annotated[
    tuple[Displacement, Displacement, Displacement], Expected("[x, y, z] in m, each at most 10 mm")
]
Tilts = Annotated[tuple[Tilt, Tilt, Tilt], Expected("a rotation vector in rad, each at most 10 mrad")]
TiltPair = Annotated[tuple[Tilt, Tilt], Expected("[x, y] in rad, each at most 10 mrad")]
Position = Annotated[float, Expected("a position in m or rad", -1000, 1000)]
Travel = Annotated[tuple[Position, Position], Expected("[lowest, highest] position in m or rad")]
Noise = Annotated[float, Expected("standard deviation of one reading in m or rad", 0, 0.001)]
Resolution = Annotated[float, Expected("step of a reading in m or rad", 0, 0.001)]
Range = Annotated[float, Expected("half of the measuring range in m or rad", above=0, most=0.1)]
Reading = Annotated[float, Expected("a reading of at most 100 mm or 0.1 rad", -0.1, 0.1)]
Roll = Annotated[float, Expected("angle about +z in rad by which what is shown is turned", -TURN, TURN)]
Latency = Annotated[float, Expected("how long after what they show samples are stamped, in s, from 0 to 1", 0, 1)]
# a gain next to 0 would make large numbers of the smallest readings
Gain = Annotated[
    float,
    Expected(
        "reading per shown value, at least 0.001 in size; negative for an instrument that counts the other way",
        -1000,
        1000,
        size=0.001,
    ),
]
GainDifference = Annotated[
    float, Expected("gain of the x axis less that of the y axis, as a part of the gain, at most 0.5", -0.5, 0.5)
]
CrossCoupling = Annotated[float, Expected("what either axis reads of the other, as a part, at most 0.3", -0.3, 0.3)]
Cubic = Annotated[float, Expected("a part by which a reading grows, per rad^2, at most 1e9", -1e9, 1e9)]
