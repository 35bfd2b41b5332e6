"""What form errors of a stage's ring, mirror and artefacts its sensors together take for error motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.metrology.encoder_heads import Waves
from rotary_error_monitor.metrology.form_orders import OrderView, view_order
from rotary_error_monitor.metrology.rigid_motion import LEAST_VARIANCE
from rotary_error_monitor.pipeline.mixed_rotation import head_row, is_mixed
from rotary_error_monitor.pipeline.observability import possible_components, unchecked_sensors
from rotary_error_monitor.pipeline.ticks import HIGHEST_ORDER
from rotary_error_monitor.sensors.library import ListedField, listed_fields, sensor_kinds
from rotary_error_monitor.sensors.listed import MIRROR

RING = "ring"


@dataclass(frozen=True)
class Surface:
    """Something of the rotor that sensors see.

    Attributes:
        name: in words, such as `ring` or `artefact at height 0.05 m`.
        streams: of the sensors that see it.
        orders: how its waves appear to all sensors of the stage, one order after another.
    """

    name: str
    streams: tuple[str, ...]
    orders: tuple[OrderView, ...]


@dataclass(frozen=True)
class _Field:
    """One field of a sensor: what it sees of the six components, its noise and its surface."""

    stream: str
    row: Array
    deviation: float
    surface: str
    azimuth: float = 0.0
    axis: int = 0
    listed: ListedField | None = None

    def waves(self, order: int) -> list[complex]:
        """What it sees of each of the shapes that a form of an order may be mixed of."""
        if self.listed is not None:
            return _listed_waves(self.listed, order)
        if self.surface == MIRROR:
            return [complex(self.axis == 0), complex(self.axis == 1)]
        return [complex(np.exp(1j * order * self.azimuth))]


def surfaces(stage: StageDescription, highest: int = HIGHEST_ORDER) -> tuple[Surface, ...]:
    """Surfaces that the sensors of a stage see, with orders from 1 to `highest` of each.

    Of the other surfaces nothing is wrong meanwhile. All sensors are held against one another by their noise, rounding
    included. Rotation that no command tells from positioning is `ecc`, as the heads see it.
    """
    fields = [*_own_fields(stage), *_listed(stage)]
    sensitivity = np.array([field.row for field in fields]).reshape(-1, 6)
    deviation = np.array([field.deviation for field in fields])
    return tuple(
        Surface(
            name,
            tuple(dict.fromkeys(field.stream for field in fields if field.surface == name)),
            tuple(
                view_order(order, sensitivity, deviation, _waves(fields, name, order))
                for order in range(1, highest + 1)
            ),
        )
        for name in dict.fromkeys(field.surface for field in fields if field.surface)
    )


def surfaces_text(stage: StageDescription) -> Iterator[str]:
    """What the sensors of a stage tell, and which form errors they take for error motion, a line for each thing."""
    possible = ", ".join(possible_components(stage))
    yield f"The sensors of the stage determine {possible or 'no component of error motion'}."
    if is_mixed(stage):
        radial, radius = stage.limits.radial, stage.ring.disc_radius
        yield (
            "Its heads see rotation and displacement of the ring as one number: where no listed sensor shows the "
            f"displacement, limits.radial of {radial * 1e6:.3g} µm is {radial / radius * 1e6:.3g} µrad in ecc. Two "
            "opposed heads, or three, tell them apart."
        )
    if unchecked := unchecked_sensors(stage):
        yield f"A fault of one of these would not show in what all others say: {', '.join(unchecked)}."
    yield f"Form errors that turn with the rotor, orders 1 to {HIGHEST_ORDER}:"
    for surface in surfaces(stage):
        yield f"  {surface.name} ({', '.join(surface.streams)}):"
        whole: dict[tuple[str, ...], list[int]] = {}
        for view in surface.orders:
            if view.is_hidden:
                whole.setdefault(view.components, []).append(view.order)
        for components, orders in whole.items():
            yield f"    pass for {', '.join(components)} and show nowhere else: {_told(orders)}"
        for view in surface.orders:
            if not (view.is_hidden or view.is_seen):
                yield f"    {view.order}: {view.passing:.1%} of its square passes for {', '.join(view.components)}"
        if seen := [view.order for view in surface.orders if view.is_seen]:
            yield f"    contradict every motion: {_told(seen)}"


def _told(orders: list[int]) -> str:
    """Orders that follow one another in short."""
    every = list(range(orders[0], orders[-1] + 1))
    return f"{orders[0]} to {orders[-1]}" if len(orders) > 2 and orders == every else ", ".join(map(str, orders))


def _own_fields(stage: StageDescription) -> Iterator[_Field]:
    """Of heads and autocollimator; the command tells where `ecc` counts from, and contradicts nothing."""
    kinds = sensor_kinds()
    for letter, azimuth in sorted(stage.azimuths.items()):
        radius, stream = stage.ring.disc_radius, f"head_{letter}"
        row = head_row(azimuth, radius)
        noise = kinds["head"].noise(stage, stream)
        yield _Field(stream, row, _deviation(noise), RING, azimuth)
    if stage.autocollimator is not None:
        noise = kinds[AUTOCOLLIMATOR].noise(stage, AUTOCOLLIMATOR)
        for axis in range(2):
            yield _Field(AUTOCOLLIMATOR, np.eye(6)[3 + axis], _deviation(noise), MIRROR, axis=axis)


def _listed(stage: StageDescription) -> Iterator[_Field]:
    """Of listed sensors; one of more than two fields states no form, so that no surface of it is known."""
    for field in listed_fields(stage):
        noise = field.kind.noise(stage, field.stream) / abs(field.sensor.gain)
        row = field.kind.rows(field.sensor)[field.place]
        surface = field.kind.surface(field.sensor) if field.sensor.may_have_form else ""
        surface = f"{field.sensor.target}, {surface}" if field.sensor.target and surface else surface
        yield _Field(field.stream, row, _deviation(noise), surface, listed=field)


def _deviation(noise: float) -> float:
    """A standard deviation that is not 0."""
    return max(noise, float(np.sqrt(LEAST_VARIANCE)))


def _waves(fields: list[_Field], name: str, order: int) -> Waves:
    """(p, q) what each field sees of the shapes of one surface."""
    own = [field.waves(order) if field.surface == name else [] for field in fields]
    count = max(map(len, own))
    return np.array([each or [0j] * count for each in own], np.complex128)


def _listed_waves(field: ListedField, order: int) -> list[complex]:
    """By the form that a sensor states in its kind: any phase of a shape is as good as another, so its cosine does."""
    first, ahead = field.kind.angle(field.sensor, np.array([0.0, 1.0]))
    turns = np.sign(ahead - first)  # of the angle that orders are of, with the rotation
    shapes: list[tuple[AngularHarmonic | PlanarHarmonic, ...]] = [(AngularHarmonic(order, 1.0, 0.0),)]
    if len(field.sensor.fields) > 1:
        nothing, one = (0.0, 0.0), (1.0, 0.0)
        shapes = [(PlanarHarmonic(order, one, nothing),), (PlanarHarmonic(order, nothing, one),)]
    rows = [field.kind.forms(replace(field.sensor, form=shape))[field.place][0] for shape in shapes]
    return [complex(row.cos, turns * row.sin) * complex(np.exp(-1j * order * turns * first)) for row in rows]
