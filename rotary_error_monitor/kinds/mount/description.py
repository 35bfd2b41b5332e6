"""A two-axis mount as it is described: hour axis along the pole, declination axis on it, tube on that.

It is a machine of two stacked rotary axes, H and D, whose tool axis is the optical axis. The base is the ground: x to
the south, y to the east, z up. At H = D = 0 the tube points to the south and the equator; +H turns it west, +D north.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rotary_error_monitor.description import schema
from rotary_error_monitor.description.machine import Axis, Body, Displacement, ErrorComponent, MachineDescription

HOUR, DECLINATION = "H", "D"
POLAR_BODY, DECLINATION_BODY, TUBE, SKY = "polar_axis", "declination_axis", "tube", "sky"

_UNCERTAINTY = {"index": 0.2, "orthogonality": 0.02, "collimation": 0.02, "polar_tilt": 0.02}
"""Standard uncertainties, rad, of a mount set up by eye."""


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

    hour_index: float = 0.0
    declination_index: float = 0.0
    orthogonality: float = 0.0
    collimation: float = 0.0
    polar_tilt: tuple[float, float] = (0.0, 0.0)

    def as_tuple(self) -> tuple[float, ...]:
        """All six in order."""
        return self.hour_index, self.declination_index, self.orthogonality, self.collimation, *self.polar_tilt

    def plus(self, added: tuple[float, ...]) -> MountGeometry:
        """The geometry with six angles added, in the order of `as_tuple`."""
        h, d, n, c, x, y = (old + new for old, new in zip(self.as_tuple(), added, strict=True))
        return MountGeometry(h, d, n, c, (x, y))


@dataclass(frozen=True)
class MountDescription:
    """The twin of a mount: section `mount` of a file in `config/mounts/`.

    Attributes:
        noise: least standard deviation of one component of a pointing, rad.
        latitude: of the site, rad; None: as the recording says.
        refraction: whether refraction belongs to what is predicted.
        geometry: from which that of a recording is sought.
        uncertainty: standard uncertainties, rad, of index, orthogonality, collimation, polar_tilt.
    """

    name: str
    noise: float
    latitude: float | None = None
    refraction: bool = True
    geometry: MountGeometry = MountGeometry()
    uncertainty: Mapping[str, float] = field(default_factory=lambda: dict(_UNCERTAINTY))

    def geometry_uncertainty(self) -> tuple[float, ...]:
        """Standard uncertainty of each of the six angles, in the order of `MountGeometry.as_tuple`."""
        u = self.uncertainty
        return u["index"], u["index"], u["orthogonality"], u["collimation"], u["polar_tilt"], u["polar_tilt"]


def load_mount(path: Path) -> MountDescription:
    """Mount described in a YAML file.

    Raises:
        InputError: the file is missing or wrong; the message names file, line, value and what is expected.
    """
    section = schema.load(path, "mount")["mount"]
    geometry = dict(section.get("geometry", {}))
    x, y = geometry.pop("polar_tilt", (0.0, 0.0))
    latitude = section.get("latitude")
    return MountDescription(
        name=section["name"],
        noise=float(section["noise"]),
        latitude=None if latitude is None else float(latitude),
        refraction=bool(section.get("refraction", True)),
        geometry=MountGeometry(
            **{name: float(value) for name, value in geometry.items()}, polar_tilt=(float(x), float(y))
        ),
        uncertainty={**_UNCERTAINTY, **{k: float(v) for k, v in section.get("uncertainty", {}).items()}},
    )


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
