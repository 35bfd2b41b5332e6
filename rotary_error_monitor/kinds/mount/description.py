"""A two-axis mount as it is described: hour axis along the pole, declination axis on it, tube on that.

It is a machine of two stacked rotary axes, H and D, whose tool axis is the optical axis. The base is the ground: x to
the south, y to the east, z up. At H = D = 0 the tube points to the south and the equator; +H turns it west, +D north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis, Body, Displacement, ErrorComponent
from rotary_error_monitor.description.quantities import HALF_TURN, Name
from rotary_error_monitor.description.sections import load

QUARTER_TURN = math.pi / 2
"""Latitude of a pole, rad."""

HOUR, DECLINATION = "H", "D"
POLAR_BODY, DECLINATION_BODY, TUBE, SKY = "polar_axis", "declination_axis", "tube", "sky"

Angle = Annotated[float, Expected("an angle in rad", -HALF_TURN, HALF_TURN)]
Tilt = Annotated[float, Expected("an angle in rad, at most 0.2", -0.2, 0.2)]
Uncertainty = Annotated[float, Expected("a standard uncertainty in rad", above=0, most=HALF_TURN)]


@dataclass(frozen=True)
class MountGeometry:
    """The six angles, rad, by which a rigid mount stands otherwise than ideally.

    In brackets their names in pointing models (Wallace 2002).

    Attributes:
        hour_index: added to the reading of the hour axis (IH).
        declination_index: added to that of the declination axis (ID).
        orthogonality: of the declination axis to the hour axis, less 90° (NP).
        collimation: of the tube to the declination axis, less 90° (CH).
        polar_tilt: of the hour axis against the pole, about the x and y axes that it carries at H = 0 (MA, ME).
    """

    hour_index: Angle = 0.0
    declination_index: Angle = 0.0
    orthogonality: Tilt = 0.0
    collimation: Tilt = 0.0
    polar_tilt: Annotated[tuple[Tilt, Tilt], Expected("[about south, about east] in rad")] = (0.0, 0.0)

    def as_tuple(self) -> tuple[float, ...]:
        """All six in order."""
        return self.hour_index, self.declination_index, self.orthogonality, self.collimation, *self.polar_tilt

    def plus(self, added: tuple[float, ...]) -> MountGeometry:
        """The geometry with six angles added, in the order of `as_tuple`."""
        h, d, n, c, x, y = (old + new for old, new in zip(self.as_tuple(), added, strict=True))
        return MountGeometry(h, d, n, c, (x, y))


@dataclass(frozen=True)
class MountUncertainty:
    """Standard uncertainties of the geometry, rad; by default those of a mount set up by eye."""

    index: Uncertainty = 0.2
    orthogonality: Uncertainty = 0.02
    collimation: Uncertainty = 0.02
    polar_tilt: Uncertainty = 0.02


@dataclass(frozen=True)
class MountDescription:
    """The twin of a mount: section `mount` of a file in `config/mounts/`."""

    name: Name
    noise: Annotated[
        float,
        Expected("least standard deviation in rad of one component of a pointing; such as 5.0e-06", above=0, most=0.01),
    ]
    latitude: Annotated[
        float | None, Expected("of the site in rad, if not that in the header of the file", -QUARTER_TURN, QUARTER_TURN)
    ] = None
    refraction: Annotated[
        bool, Expected("whether the air bends the light on its way to the mount (else the file has it taken out)")
    ] = True
    geometry: Annotated[MountGeometry, Expected("angles in rad from which the geometry of a recording is sought")] = (
        MountGeometry()
    )
    uncertainty: MountUncertainty = MountUncertainty()

    def geometry_uncertainty(self) -> tuple[float, ...]:
        """Standard uncertainty of each of the six angles, in the order of `MountGeometry.as_tuple`."""
        u = self.uncertainty
        return u.index, u.index, u.orthogonality, u.collimation, u.polar_tilt, u.polar_tilt


def load_mount(path: Path) -> MountDescription:
    """Mount described in a YAML file.

    Raises:
        InputError: the file is missing or wrong; the message names file, line, value and what is expected.
    """
    return load(path, "mount", MountDescription)


def mount_machine(latitude: float, geometry: MountGeometry) -> MachineDescription:
    """The mount as a machine of two rotary axes, its geometry as location errors and offsets of positioning.

    Indices are constants of the positioning errors, told about the body's own axes: their sign is that of the axis.
    """
    to_pole = Displacement(rotation=(0.0, latitude - np.pi / 2, 0.0))
    to_tube = Displacement(rotation=(0.0, np.pi / 2, 0.0))
    tilt = (*geometry.polar_tilt, 0.0)
    return MachineDescription(
        name="mount",
        bodies=(
            Body(SKY, "base"),
            Body(POLAR_BODY, "base", to_pole, Displacement(rotation=tilt), HOUR),
            Body(
                DECLINATION_BODY,
                POLAR_BODY,
                location_error=Displacement(rotation=(geometry.orthogonality, 0.0, 0.0)),
                axis=DECLINATION,
            ),
            Body(TUBE, DECLINATION_BODY, to_tube, Displacement(rotation=(-geometry.collimation, 0.0, 0.0))),
        ),
        axes=(
            Axis(HOUR, "rotary", (0.0, 0.0, -1.0), (-np.pi, np.pi)),
            Axis(DECLINATION, "rotary", (0.0, -1.0, 0.0), (-np.pi, np.pi)),
        ),
        errors={
            "ECH": ErrorComponent(poly=(-geometry.hour_index,)),
            "EBD": ErrorComponent(poly=(-geometry.declination_index,)),
        },
        tool=TUBE,
        workpiece=SKY,
    )
