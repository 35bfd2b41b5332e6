"""What is the same in all turns between a reference and an estimate, as far as it is stated how uncertain it is.

Each is a difference over time by one standard uncertainty of one number: of a coefficient of graduation, flatness or
form, of a gain, a direction, a height. How much of it a fit takes for eccentricity or for another height follows from
the fit itself (law of propagation of uncertainty, JCGM 100:2008, 5.1.2).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import rotate
from rotary_error_monitor.metrology.periodic_curves import doubted_orders
from rotary_error_monitor.pipeline.publication import AssemblyVariance
from rotary_error_monitor.pipeline.reference_readings import Reference


def stated_effects(
    stage: StageDescription,
    reference: Reference,
    height: float,
    theta: Array,
    motion: Array,
    lever: Array,
    eccentricity: Array,
) -> Iterator[Array]:
    """(n, p) differences along the reference's directions, m, each by one standard uncertainty, but of the height.

    Args:
        stage: as described.
        reference: what is compared with.
        height: at which, m.
        theta: (n,) rotation, rad.
        motion: (n, 2) radial error motion at the height, m.
        lever: (n, 2) growth of the radial error motion with the height, rad.
        eccentricity: (2,) of the target in the rotor's frame, m.
    """
    for vector in _of_estimate(stage, height, theta, lever):
        yield vector @ reference.directions.T
    seen = motion + rotate((eccentricity[0], eccentricity[1]), theta)
    if reference.gain:
        yield reference.gain * seen @ reference.directions.T
    if reference.roll:
        yield reference.roll * _across(seen) @ reference.directions.T
    if reference.lasting:
        std = np.sqrt(reference.lasting / len(reference.form))
        for row in reference.form:
            phase = row.order * (reference.azimuth - theta)
            for wave in (np.cos(phase), np.sin(phase)):
                yield np.repeat(std * wave[:, None], len(reference.axes), axis=1)


def _of_estimate(stage: StageDescription, height: float, theta: Array, lever: Array) -> Iterator[Array]:
    """(n, 2) errors of the radial error motion at a height, m."""
    if stage.encoder is not None:
        azimuths = stage.azimuths
        heads = stage.encoder.disc_radius * HeadLayout(tuple(azimuths.values())).weights[1:]
        at = np.array(list(azimuths.values())) - theta[:, None]
        for order, std in _orders(stage, "encoder.graduation"):
            yield std * np.cos(order * at) @ heads.T
            yield std * np.sin(order * at) @ heads.T
    if not height:
        return
    for order, std in _orders(stage, "mirror.flatness"):
        for wave in (np.cos(order * theta), np.sin(order * theta)):
            for axis in np.eye(2):
                yield height * std * wave[:, None] * axis
    tilt = stage.mirror.tilt
    read = height * (lever + rotate((tilt[1], -tilt[0]), theta))
    assembly = AssemblyVariance.of(stage)
    yield np.sqrt(assembly.gain) * read
    yield np.sqrt(assembly.roll) * _across(read)


def _orders(stage: StageDescription, name: str) -> Iterator[tuple[int, float]]:
    """Orders of graduation or flatness with the standard uncertainty of a coefficient, rad: of rows and of a curve."""
    ring = name == "encoder.graduation"
    rows = stage.ring.graduation if ring else stage.mirror.flatness
    table = stage.ring.graduation_table if ring else stage.mirror.flatness_table
    if stated := stage.uncertainty.get(name, 0.0):
        yield from ((row.order, stated) for row in rows)
    if table is not None and table.uncertainty:
        orders, std = doubted_orders(table)
        yield from ((order, std) for order in orders)


def _across(vectors: Array) -> Array:
    """(n, 2) vectors turned by 90 degrees."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)
