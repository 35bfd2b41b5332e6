"""What the instruments of the true stage see: each looks at a scene with exact geometry, before its own noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import rotary_error_monitor.plant.listed as room
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.periodic_tables import PeriodicTable
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, OWN_REFERENCE
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant import geometry
from rotary_error_monitor.plant.clocks import HEAD
from rotary_error_monitor.plant.geometry import Plane, Turns, as_columns, waves
from rotary_error_monitor.plant.scene import Fault, Scene
from rotary_error_monitor.plugins import load_plugin, modules_in, origin_of, plugins_of

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Reals = NDArray[np.float64]

Geometry = Callable[[ListedSensor, Scene], Reals]

ENTRY_POINTS = "rotary_error_monitor.mock_sensors"
"""Group of functions of other packages: what a sensor of a kind of theirs sees, before its zero and gain."""


def seen(stream: str, scene: Scene, faults: Sequence[Fault]) -> Reals:
    """(n, fields) what an instrument without noise, limits and resolution shows of a scene.

    Args:
        stream: `head_<letter>`, `autocollimator`, the reference, or a sensor that the stage lists.
        scene: with the true stage in it.
        faults: of the stage, whose hooks for the instruments are asked.

    Raises:
        InputError: the listed sensor is of a kind whose geometry the plant does not know.
    """
    if stream.startswith(HEAD):
        return _angle(stream, scene, faults)[:, None]
    if stream == AUTOCOLLIMATOR:
        return as_columns(_tilt(scene, faults))
    if stream == OWN_REFERENCE:
        return as_columns(_touched(scene, faults))
    reading = _listed(stream, scene, faults)
    return reading if reading.ndim == 2 else reading[:, None]


def read_off(shown: Reals, response: Response | None) -> Reals:
    """(n, fields) what an instrument with a zero, a sign, a gain and axes of its own reads where (n, fields) is shown.

    A two-axis instrument has the plane turned before it, and may distort it; the latency is not of the values but of
    the stamps.
    """
    if response is None or response.changes_no_value:
        return shown
    zero = np.array(response.zero or (0.0,) * shown.shape[1])
    if shown.shape[1] == 1:
        return zero + response.gain * shown
    plane = np.exp(1j * response.roll) * (shown[:, 0] + 1j * shown[:, 1])
    if not response.is_distorted:
        return as_columns(complex(*zero) + response.gain * plane)
    # an ellipse: what goes round makes a part that goes round the other way
    plane = plane + complex(response.gain_difference / 2, response.cross_coupling) * plane.conj()
    x_bend, y_bend = response.cubic or (0.0, 0.0)
    bent = plane + x_bend * plane.real**3 + 1j * y_bend * plane.imag**3
    return as_columns(complex(*zero) + response.gain * bent)


def pushed(sensor: ListedSensor, force: Plane) -> Reals:
    """(n, 2) what a listed load cell shows of a force (n,) on the shaft, `x + 1j * y` in N."""
    own = force * np.exp(-1j * sensor.place["azimuth"])
    if sensor.place.get("axes") == 1:
        own = own.real + 0j
    return as_columns(complex(*sensor.zeros) + sensor.gain * own)


def planar(rows: Sequence[PlanarHarmonic], turns: Turns) -> Plane:
    """(n,) sum over the rows of the ellipses that their coefficients of cos and sin in x and y describe."""
    total = np.zeros_like(turns.once)
    for row in rows:
        cosine, sine = complex(row.x[0], row.y[0]), complex(row.x[1], row.y[1])
        phase = turns(row.order)
        total += cosine * phase.real + sine * phase.imag
    return total


@lru_cache(maxsize=16)
def _spline(table: PeriodicTable) -> BSpline:
    from scipy.interpolate import make_interp_spline  # takes as long to load as all else that a node needs

    return make_interp_spline(*table.knots, k=3, bc_type="periodic")


def measured(table: PeriodicTable, angle: Reals) -> Reals:
    """(n, c) the periodic cubic spline through a measured curve at angles (n,) rad."""
    first = table.angles[0]
    return np.asarray(_spline(table)(first + (angle - first) % (2 * np.pi)), np.float64)


def _angle(stream: str, scene: Scene, faults: Sequence[Fault]) -> Reals:
    encoder = scene.stage.ring
    azimuth = encoder.azimuths[stream.removeprefix(HEAD)]
    centre = np.array([complex(*encoder.eccentricity)])
    for fault in faults:
        centre = fault.centre(centre, scene)
    rotor, radius = scene.turns.once, encoder.disc_radius
    cut = geometry.cut_ring(rotor, azimuth, radius, centre, scene.radial, scene.axial, scene.tilt)
    shift = np.arctan2(cut.imag, cut.real)
    place = azimuth - scene.theta + shift
    error = waves(encoder.graduation, Turns(rotor.conj() * cut * complex(np.cos(azimuth), np.sin(azimuth))))
    if encoder.graduation_table is not None:
        error = error + measured(encoder.graduation_table, place)[:, 0]
    for fault in faults:
        error = fault.graduate(error, place, scene)
    angle = scene.theta - shift + error
    for fault in faults:
        angle = fault.read(angle, stream, scene)
    return angle


def _tilt(scene: Scene, faults: Sequence[Fault]) -> Plane:
    mirror = scene.stage.mirror
    flatness = planar(mirror.flatness, scene.turns)
    if mirror.flatness_table is not None:
        flatness = flatness + measured(mirror.flatness_table, scene.theta) @ np.array([1, 1j])
    tilt = geometry.reflect(scene.turns.once, complex(*mirror.tilt), scene.tilt, flatness)
    for fault in faults:
        tilt = fault.look(tilt, scene)
    return tilt


def _touched(scene: Scene, faults: Sequence[Fault]) -> Plane:
    reference = scene.stage.reference
    assert reference is not None  # there is no such stream otherwise
    centre = complex(*reference.artefact_eccentricity)
    radial = geometry.place_point(scene.turns.once, centre, reference.height, scene.radial, scene.tilt)
    for fault in faults:
        radial = fault.touch(radial, scene)
    return radial


def _listed(stream: str, scene: Scene, faults: Sequence[Fault]) -> Reals:
    """(n,) reading, or (n, fields) of a sensor of several fields."""
    sensor = scene.stage.listed[stream]
    known = geometries()
    if sensor.kind not in known:
        raise InputError(
            f"{stream}: the plant has no geometry of kind '{sensor.kind}', but {', '.join(known)}; that of a kind of "
            f"another package is an entry point of '{ENTRY_POINTS}'"
        )
    shown = known[sensor.kind](sensor, scene)
    expected = (len(scene.time),) if len(sensor.fields) == 1 else (len(scene.time), len(sensor.fields))
    if np.shape(shown) != expected:
        raise InputError(f"{stream}: the geometry of kind '{sensor.kind}' gives {np.shape(shown)}; expected {expected}")
    zero = np.array(sensor.zeros) if len(sensor.fields) > 1 else sensor.zeros[0]
    reading = zero + sensor.gain * shown
    for fault in faults:
        reading = fault.sense(reading, stream, scene)
    return np.asarray(reading, dtype=np.float64)


@cache
def geometries() -> Mapping[str, Geometry]:
    """What each kind of listed sensor sees, its target's form included: (n,), or (n, fields) of several fields.

    Those of the package are the functions `seen` of the files in `plant/listed/`, then come those that other packages
    register of kinds of their own, inputs among them.

    Raises:
        InputError: what a package registers cannot be loaded or called, or is of a kind that is known.
    """
    found = {module.__name__.rpartition(".")[2]: module.seen for module in modules_in(room)}
    for entry in plugins_of(ENTRY_POINTS):
        geometry = load_plugin(entry)
        if entry.name in found or not callable(geometry):
            raise InputError(
                f"{origin_of(entry)}: expected the function of a kind that is none of {', '.join(found)}: "
                "(sensor, scene) -> array"
            )
        found[entry.name] = geometry
    return found
