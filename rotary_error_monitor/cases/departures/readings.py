"""Forms of faults of what measures, as their physics gives them, where the textbook takes the first term only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Part, Ranges, Reals
from rotary_error_monitor.cases.departures.forms import Form
from rotary_error_monitor.cases.draws import ARCSEC
from rotary_error_monitor.cases.faults import Named
from rotary_error_monitor.cases.faults import instruments as seen
from rotary_error_monitor.plant.environment import lagged_warming
from rotary_error_monitor.plant.geometry import Plane
from rotary_error_monitor.plant.scene import Fault, Scene


@dataclass(frozen=True, kw_only=True)
class UnlikeGains(Form):
    """Interpolation of a head whose sine is larger than its cosine, by the strength times the offset of both."""

    most: ClassVar[float] = 1.5
    told = "sine and cosine of the head are of unlike size: a second wave in each line"

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Angle of the vector (cosine, sine) with offsets, of which the textbook's wave is the first order."""
        fault = self.textbook
        assert isinstance(fault, seen.SubdivisionalError)
        if stream != fault.location:
            return angle
        lines = scene.stage.ring.lines_per_revolution
        phase, offset = lines * angle, lines * complex(-fault.sin, fault.cos)
        vector = np.cos(phase) + 1j * (1 + self.strength * abs(offset)) * np.sin(phase) + offset
        return np.asarray(angle + np.angle(vector * np.exp(-1j * phase)) / lines, np.float64)


@dataclass(frozen=True, kw_only=True)
class Saturating(Form):
    """The detector's third-order error saturates; strength at a tilt of 100 arcsec."""

    most: ClassVar[float] = 100.0
    signed = False  # one shape only
    told = "saturates: cubic divided by 1 + {strength:.3g} (tilt / 100 arcsec)²"

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Bent axes."""
        assert isinstance(self.textbook, seen.AutocollimatorNonlinearity)
        return tilt + self.textbook.cubic * (self._bent(tilt.real) + 1j * self._bent(tilt.imag))

    def _bent(self, part: Reals) -> Reals:
        return np.asarray(part**3 / (1 + self.strength * (part / (100 * ARCSEC)) ** 2), np.float64)


@dataclass(frozen=True, kw_only=True)
class UnlikeAxes(Form):
    """The two axes of the detector are bent by unlike amounts, by the strength more and less."""

    told = "x bent by {percent:+.3g} % more, y less"

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Bent axes."""
        fault = self.textbook
        assert isinstance(fault, seen.AutocollimatorNonlinearity)
        own, other = 1 + self.strength, 1 - self.strength
        return tilt + fault.cubic * (own * tilt.real**3 + 1j * other * tilt.imag**3)


@dataclass(frozen=True, kw_only=True)
class SettlingDrift(Form):
    """The zero drifts fast at first and settles; strength is one over its time constant, 1/s."""

    most: ClassVar[float] = 0.5

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"settles with {1 / self.strength:.3g} s instead of drifting on"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Drifts settle."""
        return cls(strength=0.01)

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Drifted zero."""
        assert isinstance(self.textbook, seen.AutocollimatorDrift)
        pace = max(self.strength, 1e-9)
        return tilt - complex(*self.textbook.rate) * np.expm1(-pace * scene.time) / pace


@dataclass(frozen=True, kw_only=True)
class SkewReticle(Form):
    """One line of the reticle is turned less than the other, by the strength: the axes are out of square as well."""

    told = "y turned by {percent:+.3g} % more than x"

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Two axes turned by angles of their own."""
        assert isinstance(self.textbook, seen.AutocollimatorRoll)
        x, y = self.textbook.angle * (1 - self.strength), self.textbook.angle * (1 + self.strength)
        across = np.cos(x) * tilt.real + np.sin(x) * tilt.imag
        along = -np.sin(y) * tilt.real + np.cos(y) * tilt.imag
        return np.asarray(across + 1j * along)


@dataclass(frozen=True, kw_only=True)
class BentGain(Form):
    """The gain of an instrument changes with what it shows; strength at 20 arcsec or 5 µm."""

    most: ClassVar[float] = 2.0
    told = "gain changes with what is shown, by {percent:+.3g} % at 20 arcsec or 5 µm"

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Bent and stretched axis of the autocollimator."""
        return self._stretched(tilt, 20 * ARCSEC) if isinstance(self.textbook, seen.AutocollimatorGain) else tilt

    def touch(self, radial: Plane, scene: Scene) -> Plane:
        """Bent and stretched axis of the LVDT."""
        return self._stretched(radial, 5e-6) if isinstance(self.textbook, seen.LvdtGain) else radial

    def _stretched(self, value: Plane, usual: float) -> Plane:
        fault = self.textbook
        assert isinstance(fault, seen.AutocollimatorGain | seen.LvdtGain)
        part = value.real if fault.location == "x" else value.imag
        added = fault.relative * part * (1 + self.strength * part / usual)
        return np.asarray(value + (added if fault.location == "x" else 1j * added))


@dataclass(frozen=True, kw_only=True)
class LobedArtefact(Form):
    """The artefact is also out of round: its profile has `lobes`, as high as the strength times the shift."""

    lobes: int
    phase: float
    told = "the artefact has {lobes} lobes of {percent:.3g} % of the shift"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Two to four lobes."""
        return cls(lobes=int(draw.integers(2, 5)), phase=float(draw.uniform(0, 2 * np.pi)))

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The shift, and the lobes."""
        assert isinstance(textbook, seen.LvdtArtefact)
        return (textbook, self.of(textbook))

    def touch(self, radial: Plane, scene: Scene) -> Plane:
        """Profile under the two probes, which stand at 0° and 90°."""
        assert isinstance(self.textbook, seen.LvdtArtefact)
        height = self.strength * abs(complex(*self.textbook.shift))
        x = np.cos(self.lobes * (0 - scene.theta) + self.phase)
        y = np.cos(self.lobes * (np.pi / 2 - scene.theta) + self.phase)
        return np.asarray(radial + height * (x + 1j * y))


@dataclass(frozen=True, kw_only=True)
class OvalRing(Form):
    """The seat that shifts the ring also squeezes it: `strength` times the shift, without stretching it.

    A thin ring bent by `u cos(2 psi)` moves its lines by `-u / 2 sin(2 psi)` along itself (Timoshenko, inextensional).
    """

    phase: float
    most: ClassVar[float] = 3.0
    told = "the ring is also oval, by {percent:.3g} % of the shift"
    ranges: ClassVar[Ranges] = {"phase": (0, 2 * np.pi)}
    signed = False

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The shift, and the oval."""
        assert isinstance(textbook, seen.DiscEccentricity)
        return (textbook, self.of(textbook))

    def graduate(self, error: Reals, place: Reals, scene: Scene) -> Reals:
        """Lines moved along the ring."""
        assert isinstance(self.textbook, seen.DiscEccentricity)
        squeeze = self.strength * abs(complex(*self.textbook.shift)) / scene.stage.ring.disc_radius
        return error - squeeze / 2 * np.sin(2 * (place - self.phase))


@dataclass(frozen=True, kw_only=True)
class SlowLoss(Form):
    """Counts are lost one after another, over the strength in s, not at once."""

    most: ClassVar[float] = 12.0
    signed = False  # one shape only
    told = "lost little by little within {strength:.2g} s"

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Ramp in the reading."""
        fault = self.textbook
        assert isinstance(fault, seen.HeadMissedCounts)
        if stream != fault.location:
            return angle
        return angle + fault.step * np.clip((scene.time - fault.time) / max(self.strength, 1e-6), 0, 1)


@dataclass(frozen=True, kw_only=True)
class CreepingBracket(Form):
    """The bracket of a misplaced head creeps with its temperature; strength: part of the head's error per K."""

    lag: float
    most: ClassVar[float] = 0.5
    told = "the bracket of the head creeps as it warms, {lag:.0f} s behind the thermometer"
    ranges: ClassVar[Ranges] = {"lag": (2.0, 15.0)}

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The misplaced head, and its creep."""
        return (textbook, self.of(textbook)) if isinstance(textbook, Fault) else ()

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Reading of a head that moves along the ring."""
        fault, encoder = self.textbook, scene.stage.ring
        assert isinstance(fault, seen.HeadMisplacement)
        if stream != fault.location:
            return angle
        usual = fault.azimuth * abs(complex(*encoder.eccentricity)) / encoder.disc_radius
        warming = lagged_warming(scene.temperature, scene.stage.reference_temperature, scene.time, self.lag)
        return angle + self.strength * usual * warming


@dataclass(frozen=True, kw_only=True)
class PartlyRegained(Form):
    """A part of the lost counts comes back some seconds later, at the reference mark; strength is the part."""

    after: float
    told = "{percent:.3g} % come back {after:.1f} s later"
    ranges: ClassVar[Ranges] = {"after": (2.0, 8.0)}
    signed = False

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Two steps in the reading."""
        fault = self.textbook
        assert isinstance(fault, seen.HeadMissedCounts)
        if stream != fault.location:
            return angle
        steps = (scene.time >= fault.time) - self.strength * (scene.time >= fault.time + self.after)
        return angle + fault.step * steps
