"""The stage of Lou et al. 2019 with its instruments, simulated: what the paper states is as stated, all else is chosen.

The plant shares no formula with what estimates, calibrates and compares (`plant/`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import StageDescription, load_stage, stage_mapping
from rotary_error_monitor.description.stage_section import Mirror
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.files import write_whole
from rotary_error_monitor.notebook.simulation import write_plant
from rotary_error_monitor.plant.clocks import Clock, stage_clocks
from rotary_error_monitor.plant.environment import Forces, TemperatureCourse, intermittent_forces
from rotary_error_monitor.plant.motion import Motion, MotionSegment
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.reproduction.units import ARCSEC
from rotary_error_monitor.signals.blocks import NANOSECONDS

EPOCH_NS = 1_763_700_000 * NANOSECONDS
"""When the first recording begins, timestamp (ns): the same each time, so that the bag is."""

SAMPLES = 50_000.0
"""Samples a second (paper, Section 3: NI USB6002)."""

SPEED = 2 * math.pi
"""Speed, rad/s: one turn a second (paper, Section 3)."""

REST, TURNING = 0.5, 4.25
"""Time at rest, and turning each way, s: four turns and the ramps. The paper does not say how long it recorded."""

STEPS = 20.0
"""Distance of the reference's steps over the range of ±100 arcsec, arcsec; the paper does not state it."""

REFERENCE = 0.2
"""Accuracy ±, arcsec, of the reference autocollimator (paper, Section 2.2: AUTOMAT1000UH-3050)."""

LEFT_BY_A_LINE = (0.5, 0.8)
"""Residual ±, arcsec, of the miniature autocollimator in X and Y (paper, Figure 5)."""

_LINE_LEAVES = 0.4
"""Part of a cubic's value at the end of the range that a straight line fitted over the range leaves there."""

_CENTRES = (3e-7, 0.3 * ARCSEC)
"""How far the shaft goes round (m) and leans (rad) between ground and lapped centre holes; the paper does not say."""

_BLOCK_NS = NANOSECONDS // 100
"""Time of the samples of one message, ns: as drivers send them."""


@dataclass(frozen=True)
class LouStage:
    """What is true, and what its builder knows before anything was calibrated.

    Attributes:
        seed: of noise, jitter, forces and the errors of reference and centres.
    """

    seed: int

    @property
    def true(self) -> StageDescription:
        """The stage as it is: that of `config/stage.yaml`, with an autocollimator that is not straight."""
        stage = load_stage()
        assert stage.autocollimator is not None
        most = stage.autocollimator.range
        cubic = tuple(left * ARCSEC / _LINE_LEAVES / most**3 for left in LEFT_BY_A_LINE)
        response = Response(zero=(12 * ARCSEC, -7 * ARCSEC), cubic=cubic)
        return replace(stage, responses={**stage.responses, "autocollimator": response})

    @property
    def known(self) -> StageDescription:
        """The stage as its builder knows it at first: no error of assembly, no error motion, a straight instrument."""
        stage = load_stage()
        assert stage.encoder is not None and stage.reference is not None
        return replace(
            stage.with_reference(replace(stage.reference, artefact_eccentricity=(0.0, 0.0))),
            encoder=replace(stage.encoder, eccentricity=(0.0, 0.0), graduation=()),
            mirror=Mirror(),
            spindle=Spindle(),
        )

    def write_known(self, path: Path) -> None:
        """Write the stage file that the calibrations fill."""
        import yaml

        head = "# The stage as its builder knows it before calibration; SI units.\n"
        text = yaml.safe_dump({"stage": stage_mapping(self.known)}, sort_keys=False)
        write_whole(path, (head + text).encode())

    def write_collimator_steps(self, path: Path) -> None:
        """Write readings of the miniature autocollimator at steps of the reference along x and along y."""
        collimator = self.true.tilt_instrument
        response = self.true.response("autocollimator")
        levels = np.arange(-100.0, 100.1, STEPS)
        zero = np.zeros_like(levels)
        steps = np.concatenate([np.stack([levels, zero], 1), np.stack([zero, levels], 1)])
        draw = Noise(self.seed, "reference").generator()
        true = (steps + draw.uniform(-REFERENCE, REFERENCE, steps.shape)) * ARCSEC
        noise = draw.normal(0.0, collimator.noise, true.shape)
        read = np.array(response.zero) + true + np.array(response.cubic) * true**3 + noise
        read = np.rint(read / collimator.resolution) * collimator.resolution / ARCSEC
        head = "step,reference_x_arcsec,reference_y_arcsec,tilt_x_arcsec,tilt_y_arcsec\n"
        rows = (
            f"s{number},{step[0]:g},{step[1]:g},{tilt[0]:.3f},{tilt[1]:.3f}\n"
            for number, (step, tilt) in enumerate(zip(steps, read, strict=True), 1)
        )
        write_whole(path, (head + "".join(rows)).encode())

    def record_between_centres(self, folder: Path) -> StagePlant:
        """Record ring and mirror on the shaft between centres (paper, Figure 3); give the truth."""
        draw = Noise(self.seed, "centres").generator()
        (radial, lean), angles = _CENTRES, draw.uniform(0, 2 * np.pi, 2)
        spindle = Spindle(radial=(_once(radial, angles[0]),), tilt=(_once(lean, angles[1]),))
        shaft = replace(self.true, spindle=spindle).with_reference(None)
        plant = StagePlant(
            shaft, self.seed, EPOCH_NS, _motion(), temperature=TemperatureCourse(rise=0.0), clocks=_clocks()
        )
        return _record(folder, plant)

    def record(self, folder: Path, height: float, run: int, pushed: bool = False) -> StagePlant:
        """Record the stage with its reference at a height, m; `pushed` by forces that come and go. Give the truth."""
        stage = self.true
        assert stage.reference is not None
        stage = stage.with_reference(replace(stage.reference, height=height))
        seed = self.seed + 1000 * run
        forces = intermittent_forces(seed, 2 * (REST + TURNING)) if pushed else Forces()
        epoch = EPOCH_NS + run * 3600 * NANOSECONDS
        plant = StagePlant(stage, seed, epoch, _motion(), forces, TemperatureCourse(rise=0.5), _clocks())
        return _record(folder, plant)


def _once(size: float, angle: float) -> PlanarHarmonic:
    """Error motion of an amplitude that goes round once a turn, with the rotation."""
    cosine, sine = size * math.cos(angle), size * math.sin(angle)
    return PlanarHarmonic(1, (cosine, -sine), (sine, cosine))


def _motion() -> Motion:
    rest = MotionSegment(REST, 0.0)
    return Motion((rest, MotionSegment(TURNING, SPEED), MotionSegment(TURNING, -SPEED), rest))


def _clocks() -> Mapping[str, Clock]:
    return stage_clocks(rate=SAMPLES)


def _record(folder: Path, plant: StagePlant) -> StagePlant:
    """Write a bag of all streams, a message each 10 ms."""
    end = plant.epoch_ns + round(2 * (REST + TURNING) * NANOSECONDS)
    write_plant(folder, plant, range(plant.epoch_ns, end + 1, _BLOCK_NS), wire_of(plant.description))
    return plant
