"""Exact geometry of the stage: where a sight line cuts a ring, where a mirror sends a ray, where a point stands.

Nothing here is expanded to first order. The base has z along the nominal axis. A vector in the plane is the complex
number `x + 1j * y`: turning it about z by an angle is multiplying it with `exp(1j * angle)`. A tilt is a rotation
vector in the plane, rad.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.description.harmonics import AngularHarmonic

Plane = Complex


@dataclass(frozen=True)
class Turns:
    """Integer powers of `exp(1j * angle)`, each by one multiplication of two that are already there.

    Attributes:
        once: (n,) `exp(1j * angle)`.
    """

    once: Plane

    def __post_init__(self) -> None:
        object.__setattr__(self, "_powers", {0: np.ones_like(self.once), 1: self.once})

    def __call__(self, order: int) -> Plane:
        """(n,) `exp(1j * order * angle)`, `order` not negative."""
        powers: dict[int, Plane] = self._powers  # type: ignore[attr-defined]
        if order not in powers:
            powers[order] = self(order // 2) * self(order - order // 2)
        return powers[order]


def waves(rows: Sequence[AngularHarmonic], turns: Turns) -> Array:
    """(n,) sum over the rows of the waves that their coefficients of cos and sin describe."""
    total = np.zeros(len(turns.once))
    for row in rows:
        total += (complex(row.cos, -row.sin) * turns(row.order)).real
    return total


def as_columns(plane: Plane) -> Array:
    """Vectors (n, 2) of complex numbers (n,)."""
    return np.ascontiguousarray(plane).view(np.float64).reshape(-1, 2)


class Tilting:
    """Rotation by the tilts (n,), by Rodrigues' formula for rotation vectors without z component."""

    def __init__(self, tilt: Plane) -> None:
        half = np.abs(tilt) / 2
        sinc = np.divide(np.sin(half), half, out=np.ones_like(half), where=half > 0)
        self._tilt = tilt
        self._versine = 0.5 * sinc * sinc  # (1 - cos(angle)) / angle²
        self._sine = sinc * np.cos(half)  # sin(angle) / angle
        self._cosine = 1 - 4 * self._versine * half * half

    def in_plane(self, plane: Plane) -> Plane:
        """Plane components (n,) of points of the plane z = 0 after the rotation."""
        return plane - 1j * (self._versine * (self._tilt.conj() * plane).imag) * self._tilt

    def in_space(self, plane: Plane, z: Array) -> tuple[Plane, Array]:
        """Plane components (n,) and z (n,) of points in space after the rotation."""
        lift = (self._tilt.conj() * plane).imag
        turned = plane - 1j * (self._sine * z + self._versine * lift) * self._tilt
        return turned, self._cosine * z + self._sine * lift


def cut_ring(
    rotor: Plane, azimuth: float, radius: float, eccentricity: Plane | complex, radial: Plane, axial: Array, tilt: Plane
) -> Plane:
    """Where the sight line of a read head cuts the graduated ring.

    The sight line starts on the nominal axis, at the height of the ring, towards `azimuth`, fixed in the base. The ring
    is a cylinder of `radius` about an axis parallel to the rotor's, off by `eccentricity`; the rotor is turned, tilted
    by `tilt` and displaced by `radial` and `axial`.

    Args:
        rotor: (n,) `exp(1j * theta)` of the rotation.
        azimuth: of the head about +z, rad.
        radius: of the ring, m.
        eccentricity: ring centre in the rotor, m.
        radial: (n,) displacement of the rotor in the base, m.
        axial: (n,) the same along z, m.
        tilt: (n,) tilt of the rotor in the base, rad.

    Returns:
        (n,) `exp(1j * shift)` of the angle on the ring from the graduation that a perfect stage would show there,
        `azimuth - theta`, to the cut.
    """
    untilt = Tilting(-tilt)
    towards = complex(np.cos(azimuth), np.sin(azimuth))
    start = untilt.in_space(-radial, -axial)[0] - eccentricity * rotor
    sight = untilt.in_plane(np.full_like(rotor, towards))
    return (start + _way_out(start, sight, radius) * sight) * (towards.conjugate() / radius)


def _way_out(start: Plane, sight: Plane, radius: float) -> Array:
    """(n,) how many times `sight` it is from `start` to the farther of the two cuts with a circle about the origin."""
    square = sight.real**2 + sight.imag**2
    along = (sight.conj() * start).real
    return np.asarray(
        (np.sqrt(along * along - square * (start.real**2 + start.imag**2 - radius**2)) - along) / square, np.float64
    )


def cut_artefact(
    azimuth: float, height: float, radius: float, radial: Plane, axial: Array, tilt: Plane
) -> tuple[Array, Plane]:
    """Where the line of a radial probe leaves a round artefact.

    The line starts on the nominal axis at `height` above the ring, towards `azimuth`, fixed in the base. The artefact
    is a cylinder of `radius` about the rotor's axis, which is tilted and displaced as for `cut_ring`.

    Returns:
        (n,) distance from the start to the cut, m, and the cut (n,) from the rotor's axis, m, before its tilt.
    """
    untilt = Tilting(-tilt)
    start, _ = untilt.in_space(-radial, height - axial)
    sight = untilt.in_plane(np.full_like(tilt, complex(np.cos(azimuth), np.sin(azimuth))))
    distance = _way_out(start, sight, radius)
    return distance, start + distance * sight


def pierce_face(place: complex, radial: Plane, axial: Array, tilt: Plane) -> tuple[Array, Plane]:
    """Where a line along z pierces the face of the rotor, the plane at the height of the ring.

    Args:
        place: of the line in the base, m.
        radial: (n,) displacement of the rotor in the base, m.
        axial: (n,) the same along z, m.
        tilt: (n,) tilt of the rotor in the base, rad.

    Returns:
        (n,) height of the cut above the ring of a perfect stage, m, and the cut (n,) from the rotor's axis, m, before
        its tilt.
    """
    normal, upwards = Tilting(tilt).in_space(np.zeros_like(tilt), np.ones(len(tilt)))
    away = place - radial
    rise = -(normal.conj() * away).real / upwards  # what lies in the face is at right angles to its normal
    cut, _ = Tilting(-tilt).in_space(away, rise)
    return axial + rise, cut


def reflect(rotor: Plane, mirror: Plane | complex, tilt: Plane, flatness: Plane) -> Plane:
    """What an autocollimator above the rotor makes of the ray that its mirror sends back.

    The ray comes down along -z and leaves by the law of reflection; the instrument halves the angles to its axis.

    Args:
        rotor: (n,) `exp(1j * theta)` of the rotation.
        mirror: tilt of the mirror on the rotor, rad.
        tilt: (n,) tilt of the rotor in the base, rad.
        flatness: (n,) tilt of the spot of the mirror that is looked at, in the base, rad.

    Returns:
        (n,) tilt in the base, rad.
    """
    fixed = mirror * rotor  # Rz(theta) Rot(mirror) z = Rot(Rz(theta) mirror) z
    plane, z = np.zeros_like(rotor), np.ones(len(rotor))
    for rotation in (fixed, tilt, flatness):
        plane, z = Tilting(rotation).in_space(plane, z)
    upwards = 2 * z * z - 1
    return 0.5 * (1j * np.arctan2(2 * z * plane.real, upwards) - np.arctan2(2 * z * plane.imag, upwards))


def place_point(rotor: Plane, eccentricity: Plane | complex, height: float, radial: Plane, tilt: Plane) -> Plane:
    """Position (n,) in the base, m, of a point of the rotor at `eccentricity` and `height` above the ring.

    Arguments as for `cut_ring`.
    """
    plane, _ = Tilting(tilt).in_space(eccentricity * rotor, np.full(len(rotor), height))
    return plane + radial
