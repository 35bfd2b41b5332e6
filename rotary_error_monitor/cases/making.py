"""Gap cases in memory: a recording of the true stage or machine, the twin that goes with it, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.cases.case_faults import AMOUNT, MIMICKED, Casting, Kind, KnownDeparture
from rotary_error_monitor.cases.departures import AnyFault, acting
from rotary_error_monitor.cases.draws import ARCSEC, DURATION, draw_fault, draw_stage, machine_faults, stage_faults
from rotary_error_monitor.cases.mimics import CANDIDATES, NO_HALF, Resemblance
from rotary_error_monitor.cases.response import (
    INPUTS,
    TRACKER_NOISE,
    MachineResponse,
    StageResponse,
    noise_of,
    times_of,
)
from rotary_error_monitor.cases.roughness import (
    MACHINE_UNCERTAINTY,
    STAGE_UNCERTAINTY,
    add_spikes,
    lose_blocks,
    vary_machine,
    vary_stage,
)
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE, TWO_AXIS
from rotary_error_monitor.description.two_axis_section import Turbulence
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.clocks import HEAD, STREAMS
from rotary_error_monitor.plant.environment import Forces, TemperatureCourse, intermittent_forces
from rotary_error_monitor.plant.machine import MachinePlant, MachineStates
from rotary_error_monitor.plant.motion import Motion, random_motion, reversing_motion
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.plant.noise_forms import NoiseForm, draw_noise
from rotary_error_monitor.plant.scene import Fault
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock, block_from_samples

EPOCH_NS = 1_763_700_000 * NANOSECONDS
BLOCK = 100  # samples
FORCED = frozenset({"load_compliance", "loaded_gear_mesh", "stiffening_bearing"})
STEADY = ("command", "temperature")  # streams that lose nothing


@dataclass(frozen=True)
class Truth:
    """What the twin does not know.

    Attributes:
        family: stage or machine.
        kind: how many effects, or that none of the vocabulary is at work (also that of mimics: unknown).
        faults: all that was done, also what no vocabulary names.
        snr: how much each channel, topic + `.` + field, is moved: root of the summed squares over the noise.
        departure: how the fault of a variant departs from its textbook form.
        resemblance: which known effect a mimic resembles.
    """

    family: Literal["stage", "machine"]
    kind: Kind
    faults: tuple[AnyFault, ...]
    snr: Mapping[str, float]
    departure: KnownDeparture | None = None
    resemblance: Resemblance | None = None

    def as_mapping(self) -> dict[str, Any]:
        """Content of a truth file; effects that no vocabulary names are left out."""
        outside = self.kind in ("unknown", "mimic")
        named = () if outside else self.faults
        effects = [{"effect": f.name, "location": f.location, "parameters": f.parameters} for f in named]
        kind = "unknown" if outside else self.kind
        content: dict[str, Any] = {"family": self.family, "kind": kind, "effects": effects, "snr": dict(self.snr)}
        if self.departure is not None:
            content["departure"] = {"mechanism": self.departure.mechanism, "share": self.departure.share}
            content["fitted"] = dict(self.departure.fitted)
            content["off_textbook_snr"] = dict(self.departure.off_textbook_snr)
        if self.resemblance is not None:
            content["resembles"] = dict(vars(self.resemblance))
        return content


@dataclass(frozen=True)
class StageCase:
    """Recording of a stage: blocks of each stream by its name, in order of time."""

    twin: StageDescription
    blocks: Mapping[str, Sequence[SampleBlock]]
    truth: Truth
    plant: StagePlant


@dataclass(frozen=True)
class MachineCase:
    """Recording of a machine: n static poses.

    Attributes:
        stamps_ns: (n,) timestamp (ns) of each pose.
        poses: what the axes were told, and the true warming.
        probe: (n, 3) measured tool tip minus where it should be, in the workpiece frame, m.
        temperature: (n,) measured, °C.
    """

    twin: MachineDescription
    stamps_ns: NDArray[np.int64]
    poses: MachineStates
    probe: NDArray[np.float64]
    temperature: NDArray[np.float64]
    truth: Truth


def make_stage_case(
    seed: int,
    kind: Kind = "single",
    effects: Sequence[str] | None = None,
    snr: tuple[float, float] | None = None,
    rough: bool = False,
    duration: float = DURATION,
    motion: Motion | None = None,
    loudness: tuple[float, float] | None = None,
    noise: str = "",
) -> StageCase:
    """Case of a stage from a seed.

    Args:
        seed: everything that is drawn depends on it alone.
        kind: null, single, pair, unknown (a fault that no vocabulary names), variant (a fault of the vocabulary that
            departs from its textbook form), or mimic (half of a known effect, which is none).
        effects: names of the faults, of a mimic those of which a half may be taken; None draws them.
        snr: each fault is made as large as a drawn number from this range (see `Truth.snr`, over all channels); None
            takes 60 to 600, and 300 to 3000 where the uncertain twin hides more.
        rough: as on a shop floor: uncertain twin, spikes, lost blocks, turbulence, sometimes no reference or force.
        duration: s.
        motion: what the controller commands; None reverses and changes speed, in rough cases at random.
        loudness: range of how many times larger the first of a pair is than the second; None makes them alike.
        noise: form of the noise that is not as the twin states it (`noise_forms.FORMS`); empty for as stated.

    Raises:
        InputError: an effect is none of a stage, there are not as many as the kind says, or one does not show in so
            short a recording.
    """
    draw = Noise(seed, "case").generator()
    names = _names(kind, effects, stage_faults, draw)
    twin = _rough_twin(draw_stage(draw)) if rough else draw_stage(draw)
    plain = _plain_stage(seed, draw, twin, names, rough, duration, motion)
    size = snr or ((300.0, 3000.0) if rough else (60.0, 600.0))
    heads = tuple(plain.stage.azimuths)
    drawn = Casting(kind, size, loudness).draw_faults(
        names,
        draw,
        lambda name: draw_fault(name, draw, heads, duration),
        lambda every: StageResponse(plain, duration, every, every == MIMICKED),
    )
    plant = replace(plain, faults=tuple(part for part in acting(drawn.faults) if isinstance(part, Fault)))
    if noise:
        plant = replace(plant, noise_forms=_noise_forms(plant, noise, draw, duration))
    blocks = {stream: _record(plant, stream, duration, rough, draw) for stream in plant.streams}
    twin = twin if OWN_REFERENCE in plain.clocks else twin.with_reference(None)
    ratios = StageResponse(plain, duration).ratios(drawn.faults)
    truth = Truth("stage", kind, drawn.faults, ratios, drawn.departure, drawn.resemblance)
    return StageCase(twin, blocks, truth, plant)


def _plain_stage(
    seed: int,
    draw: np.random.Generator,
    twin: StageDescription,
    names: Sequence[str],
    rough: bool,
    duration: float,
    motion: Motion | None,
) -> StagePlant:
    """The stage of a case without its faults: as the twin says, but for the uncertainty of a shop floor's."""
    sensors = set(STREAMS)
    if rough:
        needed = any(name.startswith((OWN_REFERENCE, "probe")) for name in names)
        sensors -= {OWN_REFERENCE} if draw.random() < 0.3 and not needed else set()
        sensors -= {"force"} if draw.random() < 0.25 and not FORCED & set(names) else set()
    true = vary_stage(twin, twin.uncertainty, draw) if rough else twin
    usual = random_motion(seed, duration, segments=max(4, round(duration / 7))) if rough else reversing_motion()
    plain = StagePlant(
        true,
        seed,
        EPOCH_NS,
        motion or usual,
        intermittent_forces(seed, duration) if "force" in sensors else Forces(),
        TemperatureCourse(rise=float(draw.uniform(1.5, 4.0)), settling=float(draw.uniform(10, 20))),
    )
    return replace(plain, clocks={name: c for name, c in plain.clocks.items() if name in sensors or HEAD in name})


def make_machine_case(
    machine: MachineDescription,
    seed: int,
    kind: Kind = "single",
    effects: Sequence[str] | None = None,
    snr: tuple[float, float] | None = None,
    rough: bool = False,
    loudness: tuple[float, float] | None = None,
    noise: str = "",
) -> MachineCase:
    """Case of the five-axis machine `machine`, which is the twin, from a seed.

    Arguments as for a stage, but that `snr` None takes 20 to 200, and 60 to 300 in rough cases.

    Raises:
        InputError: an effect is none of a machine, there are not as many as the kind says, or one does not show.
    """
    draw = Noise(seed, "case").generator()
    names = _names(kind, effects, machine_faults, draw)
    count = 160 if rough else 240
    low, high = (0.95 * np.array(limits) for limits in zip(*(axis.travel for axis in machine.axes), strict=True))
    warming = 3.0 * -np.expm1(-np.arange(count) / (count / 4))
    poses = MachineStates(
        draw.uniform(low, high, (count, len(low))), draw.choice([-1.0, 1.0], (count, len(low))), warming
    )
    twin = replace(machine, uncertainty=MACHINE_UNCERTAINTY) if rough else replace(machine, uncertainty={})
    varied = vary_machine(machine, MACHINE_UNCERTAINTY, draw) if rough else ()
    response = MachineResponse(MachinePlant(machine, varied), poses)
    size = snr or ((60.0, 300.0) if rough else (20.0, 200.0))
    drawn = Casting(kind, size, loudness).draw_faults(
        names, draw, lambda name: draw_fault(name, draw), lambda every: response
    )
    true = response.tool(drawn.faults)
    white = draw.normal(size=true.shape)
    if noise:
        form = draw_noise(noise, draw, 1.0, count)
        white = form.shaped(white, Noise(seed, "probe"), np.arange(count, dtype=np.float64))
    probe = true + TRACKER_NOISE * white
    if rough:
        outlying = draw.random(count) < 0.02
        probe[outlying] += draw.normal(size=(int(outlying.sum()), 3)) * 50e-6
    temperature = machine.reference_temperature + warming + 0.02 * draw.normal(size=count)
    stamps = EPOCH_NS + 20 * NANOSECONDS * np.arange(count, dtype=np.int64)
    ratios = response.ratios(drawn.faults)
    truth = Truth("machine", kind, drawn.faults, ratios, drawn.departure, drawn.resemblance)
    return MachineCase(twin, stamps, poses, probe, temperature, truth)


def _names(
    kind: Kind, effects: Sequence[str] | None, known: Callable[[bool], tuple[str, ...]], draw: np.random.Generator
) -> tuple[str, ...]:
    allowed, count = known(kind != "unknown"), AMOUNT[kind]
    if kind == "mimic":
        allowed = tuple(name for name in allowed if name not in NO_HALF)
        count = CANDIDATES if effects is None else len(effects)
    names = tuple(draw.choice(allowed, count, replace=False).tolist() if effects is None else effects)
    if set(names) - set(allowed) or len(names) != count:
        told = ", ".join(names) or "none"
        raise InputError(f"a case of kind {kind} takes {count} effects of {', '.join(allowed)}; got {told}")
    return names


def _noise_forms(plant: StagePlant, form: str, draw: np.random.Generator, duration: float) -> dict[str, NoiseForm]:
    """Noise of the form for each sensor of a stage, each of its own strength."""
    sensors = [stream for stream in plant.streams if stream not in INPUTS]
    rates = {stream: plant.clocks[stream].rate for stream in sensors}
    return {s: draw_noise(form, draw, rate, round(rate * duration)) for s, rate in rates.items()}


def _rough_twin(stage: StageDescription) -> StageDescription:
    air = replace(stage.tilt_instrument, turbulence=Turbulence(0.08 * ARCSEC, 0.3))
    return replace(stage, autocollimator=air, uncertainty=STAGE_UNCERTAINTY)


def _record(
    plant: StagePlant, stream: str, duration: float, rough: bool, draw: np.random.Generator
) -> list[SampleBlock]:
    count = len(times_of(plant, stream, duration))
    starts = range(0, count, BLOCK)
    whole = plant.samples(stream, 0, count)
    times, names, values = whole.times_ns, whole.names[1:], whole.rows[:, 1:]
    blocks = [block_from_samples(times[i : i + BLOCK], names, values[i : i + BLOCK]) for i in starts]
    if rough and stream in TWO_AXIS:
        chance, size = Noise(plant.seed, f"spikes_{stream}"), noise_of(plant.stage, stream)
        blocks = [add_spikes(block, size, chance, first) for block, first in zip(blocks, starts, strict=True)]
    return lose_blocks(blocks, draw) if rough and stream not in STEADY else blocks
