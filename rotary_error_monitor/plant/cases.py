"""Gap cases in memory: a recording of the true stage or machine, the twin that goes with it, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage import StageDescription, Turbulence
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.case_faults import AMOUNT, Casting, Kind, KnownDeparture
from rotary_error_monitor.plant.departures import AnyFault, acting
from rotary_error_monitor.plant.draws import ARCSEC, DURATION, draw_fault, draw_stage, machine_faults, stage_faults
from rotary_error_monitor.plant.environment import Forces, Temperature, intermittent_forces
from rotary_error_monitor.plant.machine import MachinePlant, Poses
from rotary_error_monitor.plant.motion import Motion, random_motion, reversing_motion
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.plant.response import TRACKER_NOISE, MachineResponse, StageResponse, noise_of, times_of
from rotary_error_monitor.plant.roughness import (
    MACHINE_UNCERTAINTY,
    STAGE_UNCERTAINTY,
    add_spikes,
    lose_blocks,
    vary_machine,
    vary_stage,
)
from rotary_error_monitor.plant.stage import FIELDS, HEAD, Fault, StagePlant
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
        kind: how many effects, or that none of the vocabulary is at work.
        faults: all that was done, also what no vocabulary names.
        snr: how much each channel, topic + `.` + field, is moved: root of the summed squares over the noise.
        departure: how the fault of a variant departs from its textbook form.
    """

    family: Literal["stage", "machine"]
    kind: Kind
    faults: tuple[AnyFault, ...]
    snr: Mapping[str, float]
    departure: KnownDeparture | None = None

    def as_mapping(self) -> dict[str, Any]:
        """Content of a truth file; effects that no vocabulary names are left out."""
        named = [] if self.kind == "unknown" else self.faults
        effects = [{"effect": f.name, "location": f.location, "parameters": f.parameters} for f in named]
        content: dict[str, Any] = {"family": self.family, "kind": self.kind, "effects": effects, "snr": dict(self.snr)}
        if self.departure is not None:
            content["departure"] = {"mechanism": self.departure.mechanism, "share": self.departure.share}
            content["fitted"] = dict(self.departure.fitted)
            content["off_textbook_snr"] = dict(self.departure.off_textbook_snr)
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
    poses: Poses
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
) -> StageCase:
    """Case of a stage from a seed.

    Args:
        seed: everything that is drawn depends on it alone.
        kind: null, single, pair, unknown (a fault that no vocabulary names), or variant (a fault of the vocabulary that
            departs from its textbook form).
        effects: names of the faults; None draws them.
        snr: each fault is made as large as a drawn number from this range (see `Truth.snr`, over all channels); None
            takes 60 to 600, and 300 to 3000 where the uncertain twin hides more.
        rough: as on a shop floor: uncertain twin, spikes, lost blocks, turbulence, sometimes no LVDT or force.
        duration: s.
        motion: what the controller commands; None reverses and changes speed, in rough cases at random.
        loudness: range of how many times larger the first of a pair is than the second; None makes them alike.

    Raises:
        InputError: an effect is none of a stage, there are not as many as the kind says, or one does not show in so
            short a recording.
    """
    draw = Noise(seed, "case").generator()
    names = _names(kind, effects, stage_faults, draw)
    twin, sensors = draw_stage(draw), set(FIELDS)
    if rough:
        twin = _rough_twin(twin)
        sensors -= (
            {"lvdt"} if draw.random() < 0.3 and not any(n.startswith(("lvdt", "probe")) for n in names) else set()
        )
        sensors -= {"force"} if draw.random() < 0.25 and not FORCED & set(names) else set()
    true = vary_stage(twin, twin.uncertainty, draw) if rough else twin
    usual = random_motion(seed, duration, segments=max(4, round(duration / 7))) if rough else reversing_motion()
    plain = StagePlant(
        true,
        seed,
        EPOCH_NS,
        motion or usual,
        intermittent_forces(seed, duration) if "force" in sensors else Forces(),
        Temperature(rise=float(draw.uniform(1.5, 4.0)), settling=float(draw.uniform(10, 20))),
    )
    plain = replace(plain, clocks={name: c for name, c in plain.clocks.items() if name in sensors or HEAD in name})
    size = snr or ((300.0, 3000.0) if rough else (60.0, 600.0))
    heads = tuple(plain.stage.encoder.azimuths)
    faults, departure = Casting(kind, size, loudness).draw_faults(
        names, draw, lambda name: draw_fault(name, draw, heads, duration), partial(StageResponse, plain, duration)
    )
    plant = replace(plain, faults=tuple(part for part in acting(faults) if isinstance(part, Fault)))
    blocks = {stream: _record(plant, stream, duration, rough, draw) for stream in plant.streams}
    twin = twin if "lvdt" in sensors else replace(twin, lvdt=None)
    snr_of = StageResponse(plain, duration).ratios(faults)
    return StageCase(twin, blocks, Truth("stage", kind, faults, snr_of, departure), plant)


def make_machine_case(
    machine: MachineDescription,
    seed: int,
    kind: Kind = "single",
    effects: Sequence[str] | None = None,
    snr: tuple[float, float] | None = None,
    rough: bool = False,
    loudness: tuple[float, float] | None = None,
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
    poses = Poses(draw.uniform(low, high, (count, len(low))), draw.choice([-1.0, 1.0], (count, len(low))), warming)
    twin = replace(machine, uncertainty=MACHINE_UNCERTAINTY) if rough else replace(machine, uncertainty={})
    varied = vary_machine(machine, MACHINE_UNCERTAINTY, draw) if rough else ()
    response = MachineResponse(MachinePlant(machine, varied), poses)
    size = snr or ((60.0, 300.0) if rough else (20.0, 200.0))
    faults, departure = Casting(kind, size, loudness).draw_faults(
        names, draw, lambda name: draw_fault(name, draw), lambda every: response
    )
    true = response.tool(faults)
    probe = true + TRACKER_NOISE * draw.normal(size=true.shape)
    if rough:
        outlying = draw.random(count) < 0.02
        probe[outlying] += draw.normal(size=(int(outlying.sum()), 3)) * 50e-6
    temperature = machine.reference_temperature + warming + 0.02 * draw.normal(size=count)
    stamps = EPOCH_NS + 20 * NANOSECONDS * np.arange(count, dtype=np.int64)
    truth = Truth("machine", kind, faults, response.ratios(faults), departure)
    return MachineCase(twin, stamps, poses, probe, temperature, truth)


def _names(
    kind: Kind, effects: Sequence[str] | None, known: Callable[[bool], tuple[str, ...]], draw: np.random.Generator
) -> tuple[str, ...]:
    allowed, count = known(kind != "unknown"), AMOUNT[kind]
    names = tuple(draw.choice(allowed, count, replace=False).tolist() if effects is None else effects)
    if set(names) - set(allowed) or len(names) != count:
        told = ", ".join(names) or "none"
        raise InputError(f"a case of kind {kind} takes {count} effects of {', '.join(allowed)}; got {told}")
    return names


def _rough_twin(stage: StageDescription) -> StageDescription:
    air = replace(stage.autocollimator, turbulence=Turbulence(0.08 * ARCSEC, 0.3))
    return replace(stage, autocollimator=air, uncertainty=STAGE_UNCERTAINTY)


def _record(
    plant: StagePlant, stream: str, duration: float, rough: bool, draw: np.random.Generator
) -> list[SampleBlock]:
    count = len(times_of(plant, stream, duration))
    starts = range(0, count, BLOCK)
    whole = plant.samples(stream, 0, count)
    times, names, values = whole.times_ns, whole.names[1:], whole.rows[:, 1:]
    blocks = [block_from_samples(times[i : i + BLOCK], names, values[i : i + BLOCK]) for i in starts]
    if rough and stream in ("autocollimator", "lvdt"):
        chance, size = Noise(plant.seed, f"spikes_{stream}"), noise_of(plant.stage, stream)
        blocks = [add_spikes(block, size, chance, first) for block, first in zip(blocks, starts, strict=True)]
    return lose_blocks(blocks, draw) if rough and stream not in STEADY else blocks
