"""What a shop floor adds: parameters that are not quite known, spikes, lost blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.cases.faults import make_fault
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import ErrorComponent
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.plant.machine import MachineFault
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.signals.blocks import SampleBlock

STAGE_UNCERTAINTY: Mapping[str, float] = {
    "encoder.eccentricity": 5e-8,
    "encoder.graduation": 1e-7,
    "encoder.disc_radius": 2e-5,
    "encoder.azimuth": 1e-3,
    "mirror.tilt": 2.4e-7,
    "mirror.flatness": 2.4e-7,
    "spindle.radial": 3e-8,
    "spindle.tilt": 1.45e-7,
    "spindle.radial_compliance": 4e-10,
    "spindle.tilt_compliance": 1e-9,
    "spindle.radial_thermal": 3e-8,
    f"{OWN_REFERENCE}.height": 1e-4,
    f"{OWN_REFERENCE}.artefact_eccentricity": 5e-8,
}
"""Standard uncertainty of the parameters of a stage after a usual calibration: m, rad, m/N, rad/N, m/K."""

MACHINE_UNCERTAINTY: Mapping[str, float] = {
    "errors.linear": 8e-7,
    "errors.angular": 4e-7,
    "squareness": 8e-7,
    "orientation": 1e-6,
    "pivot_offset": 8e-7,
    "head_length": 1e-6,
    "tool_length": 1e-6,
    "expansion": 2e-7,
}
"""Standard uncertainty of the parameters of a machine after a usual calibration: m, rad, 1/K."""

SPIKE_SHARE = 0.002
SPIKE_SIZE = (15.0, 100.0)
"""Share of the samples of autocollimator and reference that are spikes, and how many times the noise they are."""


def vary_stage(
    stage: StageDescription, uncertainty: Mapping[str, float], draw: np.random.Generator
) -> StageDescription:
    """The stage with each parameter off by a normal error of its standard uncertainty."""

    def off(name: str, value: float) -> float:
        return float(value + uncertainty[name] * draw.normal())

    def pair(name: str, values: tuple[float, float]) -> tuple[float, float]:
        return off(name, values[0]), off(name, values[1])

    def planar(name: str, rows: Sequence[PlanarHarmonic]) -> tuple[PlanarHarmonic, ...]:
        return tuple(PlanarHarmonic(row.order, pair(name, row.x), pair(name, row.y)) for row in rows)

    graduation = [
        replace(row, cos=off("encoder.graduation", row.cos), sin=off("encoder.graduation", row.sin))
        for row in stage.ring.graduation
    ]
    encoder = replace(
        stage.ring,
        disc_radius=off("encoder.disc_radius", stage.ring.disc_radius),
        azimuths={head: off("encoder.azimuth", azimuth) for head, azimuth in stage.azimuths.items()},
        eccentricity=pair("encoder.eccentricity", stage.ring.eccentricity),
        graduation=tuple(graduation),
    )
    mirror = replace(
        stage.mirror,
        tilt=pair("mirror.tilt", stage.mirror.tilt),
        flatness=planar("mirror.flatness", stage.mirror.flatness),
    )
    spindle = replace(
        stage.spindle,
        radial=planar("spindle.radial", stage.spindle.radial),
        tilt=planar("spindle.tilt", stage.spindle.tilt),
        radial_compliance=off("spindle.radial_compliance", stage.spindle.radial_compliance),
        tilt_compliance=off("spindle.tilt_compliance", stage.spindle.tilt_compliance),
        radial_thermal=pair("spindle.radial_thermal", stage.spindle.radial_thermal),
    )
    reference = stage.reference and replace(
        stage.reference,
        height=off(f"{OWN_REFERENCE}.height", stage.reference.height),
        artefact_eccentricity=pair(f"{OWN_REFERENCE}.artefact_eccentricity", stage.reference.artefact_eccentricity),
    )
    return replace(stage.with_reference(reference), encoder=encoder, mirror=mirror, spindle=spindle)


def vary_machine(
    machine: MachineDescription, uncertainty: Mapping[str, float], draw: np.random.Generator
) -> tuple[MachineFault, ...]:
    """Small faults that together are a normal error of each parameter, of its standard uncertainty."""

    def sizes(name: str, count: int) -> list[float]:
        return [float(value) for value in uncertainty[name] * draw.normal(size=count)]

    faults = [make_fault("squareness", pair, angle=sizes("squareness", 1)[0]) for pair in ("XY", "XZ", "YZ")]
    faults += [make_fault("axis_orientation", axis, tilt=sizes("orientation", 2)) for axis in "CA"]
    faults += [make_fault("thermal_expansion", axis, coefficient=sizes("expansion", 1)[0]) for axis in "XYZ"]
    faults += [make_fault("pivot_offset", shift=sizes("pivot_offset", 2))]
    lengths = sizes("head_length", 1)[0] + sizes("tool_length", 1)[0]
    faults += [make_fault("tool_length", offset=lengths)]
    return (*(fault for fault in faults if isinstance(fault, MachineFault)), _VariedErrors(machine, uncertainty, draw))


class _VariedErrors(MachineFault):
    """Every coefficient of the error components is off a little."""

    def __init__(
        self, machine: MachineDescription, uncertainty: Mapping[str, float], draw: np.random.Generator
    ) -> None:
        self._errors = {}
        for name, component in machine.errors.items():
            std = uncertainty["errors.angular" if name[1] in "ABC" else "errors.linear"]
            poly = tuple(float(value + std * draw.normal()) if value else 0.0 for value in component.poly)
            waves = tuple(
                replace(wave, cos=float(wave.cos + std * draw.normal()), sin=float(wave.sin + std * draw.normal()))
                for wave in component.harmonic
            )
            self._errors[name] = ErrorComponent(poly, waves, component.table)

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Machine with the varied components."""
        return replace(machine, errors=self._errors)


def lose_blocks(blocks: list[SampleBlock], draw: np.random.Generator) -> list[SampleBlock]:
    """The blocks without up to two of them; first and last stay."""
    lost = set(draw.choice(np.arange(1, len(blocks) - 1), draw.integers(0, 3), replace=False).tolist())
    return [block for index, block in enumerate(blocks) if index not in lost]


def add_spikes(block: SampleBlock, size: float, noise: Noise, first: int) -> SampleBlock:
    """The block with now and then a sample that is off by many times `size`, in all its columns.

    Args:
        block: samples.
        size: noise of the signal.
        noise: where the chance comes from.
        first: index of the block's first sample.
    """
    count = len(block.rows)
    chance = noise.uniform(3 * first, 3 * count).reshape(count, 3)
    hit = chance[:, 0] < SPIKE_SHARE
    low, high = SPIKE_SIZE
    height: NDArray[np.float64] = np.where(hit, size * (low + (high - low) * chance[:, 1]), 0.0)
    angle = 2 * np.pi * chance[:, 2]
    rows = block.rows.copy()
    rows[:, 1:3] += height[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return replace(block, rows=rows)
