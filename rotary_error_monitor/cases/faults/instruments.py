"""Faults of what measures: ring, read heads, mirror, autocollimator and reference."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Self

import numpy as np

from rotary_error_monitor.cases.faults.named import Pair, Reals, StageFault, vocabulary
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.clocks import HEAD
from rotary_error_monitor.plant.geometry import Plane
from rotary_error_monitor.plant.scene import Scene


@vocabulary("disc_eccentricity")
class DiscEccentricity(StageFault):
    """The ring sits `shift` off its described centre."""

    shift: Pair

    def centre(self, eccentricity: Plane, scene: Scene) -> Plane:
        """Shifted ring."""
        return eccentricity + complex(*self.shift)


@vocabulary("graduation_error")
class GraduationError(StageFault):
    """One more order of graduation error."""

    order: int
    cos: float
    sin: float

    def graduate(self, error: Reals, place: Reals, scene: Scene) -> Reals:
        """Wave along the ring."""
        return error + self.cos * np.cos(self.order * place) + self.sin * np.sin(self.order * place)


@vocabulary("disc_scale")
class DiscScale(StageFault):
    """The ring is larger than described."""

    relative: float

    def describe(self, stage: StageDescription) -> StageDescription:
        """Larger ring."""
        encoder = replace(stage.ring, disc_radius=stage.ring.disc_radius * (1 + self.relative))
        return replace(stage, encoder=encoder)


@vocabulary("subdivisional_error")
class SubdivisionalError(StageFault):
    """One head's interpolation within a line errs, once a line."""

    cos: float
    sin: float

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Wave in the reading."""
        if stream != self.location:
            return angle
        phase = scene.stage.ring.lines_per_revolution * angle
        return angle + self.cos * np.cos(phase) + self.sin * np.sin(phase)


@vocabulary("head_misplacement")
class HeadMisplacement(StageFault):
    """One head stands `azimuth` further than described; its zero was set where it stands."""

    azimuth: float

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other azimuth."""
        head = self.location.removeprefix(HEAD)
        azimuths = {**stage.azimuths, head: stage.azimuths[head] + self.azimuth}
        return replace(stage, encoder=replace(stage.ring, azimuths=azimuths))


@vocabulary("head_latency")
class HeadLatency(StageFault):
    """One head's values are `delay` old at their stamps."""

    delay: float

    def age(self, stream: str) -> float:
        """Age of that head's values."""
        return self.delay if stream == self.location else 0.0


@vocabulary("encoder_latency")
class EncoderLatency(StageFault):
    """All heads' values are `delay` old at their stamps."""

    delay: float

    def age(self, stream: str) -> float:
        """Age of the heads' values."""
        return self.delay if stream.startswith(HEAD) else 0.0


@vocabulary("head_missed_counts")
class HeadMissedCounts(StageFault):
    """One head loses or gains `step` at `time` after the epoch."""

    time: float
    step: float

    def in_counts(self, count: float) -> Self:
        """The same with a whole number of counts, rad each, lost or gained: one at least."""
        return replace(self, step=math.copysign(max(round(abs(self.step) / count), 1) * count, self.step))

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Step in the reading."""
        return angle + self.step * (scene.time >= self.time) if stream == self.location else angle


@vocabulary("autocollimator_gain")
class AutocollimatorGain(StageFault):
    """One axis (`x` or `y`) of the autocollimator shows too much."""

    relative: float

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Stretched axis."""
        return tilt + self.relative * (tilt.real if self.location == "x" else 1j * tilt.imag)


@vocabulary("autocollimator_roll")
class AutocollimatorRoll(StageFault):
    """The autocollimator is turned about its line of sight."""

    angle: float

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Turned axes."""
        return tilt * complex(np.cos(self.angle), -np.sin(self.angle))


@vocabulary("autocollimator_nonlinearity")
class AutocollimatorNonlinearity(StageFault):
    """Each axis of the autocollimator errs with the third power."""

    cubic: float

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Bent axes."""
        return tilt + self.cubic * (tilt.real**3 + 1j * tilt.imag**3)


@vocabulary("autocollimator_drift")
class AutocollimatorDrift(StageFault):
    """The autocollimator's zero drifts at `rate`."""

    rate: Pair

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Drifted zero."""
        return tilt + complex(*self.rate) * scene.time


@vocabulary("autocollimator_latency")
class AutocollimatorLatency(StageFault):
    """The autocollimator's values are `delay` old at their stamps."""

    delay: float

    def age(self, stream: str) -> float:
        """Age of its values."""
        return self.delay if stream == "autocollimator" else 0.0


@vocabulary("mirror_wobble")
class MirrorWobble(StageFault):
    """The mirror leans more on the rotor than described."""

    tilt: Pair

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other mirror tilt."""
        x, y = stage.mirror.tilt
        return replace(stage, mirror=replace(stage.mirror, tilt=(x + self.tilt[0], y + self.tilt[1])))


@vocabulary("mirror_flatness")
class MirrorFlatness(StageFault):
    """One more order of the mirror's flatness."""

    order: int
    x: Pair
    y: Pair

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other mirror surface."""
        flatness = (*stage.mirror.flatness, PlanarHarmonic(self.order, self.x, self.y))
        return replace(stage, mirror=replace(stage.mirror, flatness=flatness))


@vocabulary("lvdt_gain")
class LvdtGain(StageFault):
    """One axis (`x` or `y`) of the LVDT shows too much."""

    relative: float

    def touch(self, radial: Plane, scene: Scene) -> Plane:
        """Stretched axis."""
        return radial + self.relative * (radial.real if self.location == "x" else 1j * radial.imag)


@vocabulary("lvdt_artefact")
class LvdtArtefact(StageFault):
    """The artefact sits `shift` off its described centre."""

    shift: Pair

    def describe(self, stage: StageDescription) -> StageDescription:
        """Shifted artefact."""
        if stage.reference is None:
            return stage
        x, y = stage.reference.artefact_eccentricity
        centre = (x + self.shift[0], y + self.shift[1])
        return stage.with_reference(replace(stage.reference, artefact_eccentricity=centre))


@vocabulary("lvdt_height")
class LvdtHeight(StageFault):
    """The LVDT touches higher than described."""

    offset: float

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other height."""
        if stage.reference is None:
            return stage
        return stage.with_reference(replace(stage.reference, height=stage.reference.height + self.offset))
