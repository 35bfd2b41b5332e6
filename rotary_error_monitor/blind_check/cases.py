"""The plan of a blind check of diagnosis, and its cases: drawn from a seed, made by the plant, written as bags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cases.case_faults import LOUDEST, Kind
from rotary_error_monitor.cases.draws import machine_faults, stage_faults
from rotary_error_monitor.cases.faults import UnsuitableSeedError
from rotary_error_monitor.cases.making import MachineCase, StageCase, make_machine_case, make_stage_case
from rotary_error_monitor.codec.contents import JointState, PointStamped, Temperature
from rotary_error_monitor.description.machine import MachineDescription, machine_from_mapping, machine_mapping
from rotary_error_monitor.description.stage import stage_mapping
from rotary_error_monitor.description.topics import samples_topic, topic_named
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.motion import motion_in_use, random_motion
from rotary_error_monitor.plant.noise_forms import FORMS
from rotary_error_monitor.signals.blocks import NANOSECONDS

Family = Literal["stage", "machine"]

VARIANT_SIZES: Mapping[tuple[Family, bool], tuple[float, float]] = {
    ("stage", False): (120.0, 3000.0),
    ("stage", True): (250.0, 5000.0),
    ("machine", False): (60.0, 900.0),
    ("machine", True): (90.0, 1500.0),
}
"""Range of sizes of variants by family and floor (see `Truth.snr`): of some the departure stands out, of some not."""

QUIET_SIZES: Mapping[tuple[Family, bool], tuple[float, float]] = {
    ("stage", False): (80.0, 600.0),
    ("stage", True): (600.0, 3000.0),
    ("machine", False): (25.0, 150.0),
    ("machine", True): (80.0, 400.0),
}
"""Range of sizes of the weak one of a loud pair by family and floor: well above noise and uncertainty."""

LOUDNESS = (30.0, 1000.0)
"""How many times larger the other one of a loud pair is; less where no real stage or machine has as much."""

WEAK = (4.0, 40.0)
"""Range of sizes around the detection limit of a clean recording (see `Truth.snr`)."""

STAND_INS: Mapping[str, tuple[str, ...]] = {
    "axis_scale": ("thermal_expansion",),
    "disc_eccentricity": ("spindle_radial", "graduation_error"),
    "drive_cyclic_error": ("graduation_error",),
    "encoder_latency": ("following_error",),
    "following_error": ("encoder_latency",),
    "graduation_error": ("spindle_radial", "drive_cyclic_error", "disc_eccentricity"),
    "head_droop": ("rotary_harmonic",),
    "lvdt_artefact": ("spindle_radial",),
    "mirror_flatness": ("spindle_tilt",),
    "mirror_wobble": ("spindle_tilt", "mirror_flatness"),
    "spindle_radial": ("graduation_error", "disc_eccentricity"),
    "spindle_tilt": ("mirror_flatness", "mirror_wobble"),
    "thermal_expansion": ("axis_scale",),
}
"""Effects that do what another does, alone or beside a third, in all recordings or in those without the LVDT.

Where one is taken out of the library its stand-ins go as well: they would explain the gap, and rightly.
"""

WITHOUT_TURNS = (
    "reversal_backlash",
    "encoder_latency",
    "following_error",
    "autocollimator_drift",
    "thermal_drift",
)
"""Effects of a stage that show on the smallest arc."""

STAGE_ONLY = frozenset({"new speed", "motion"})
"""Groups of recordings that move otherwise: the poses of a machine stand still."""

_SHARES: tuple[tuple[str, Kind, float], ...] = (
    ("single", "single", 0.40),
    ("pair", "pair", 0.12),
    ("unknown", "unknown", 0.16),
    ("null", "null", 0.16),
    ("weak", "single", 0.08),
    ("left out", "single", 0.08),
    ("new speed", "single", 0.06),
    ("variant", "variant", 0.30),
    ("loud", "pair", 0.12),
    ("mimic", "mimic", 0.12),
    ("noise", "null", 0.10),
    ("noise", "single", 0.06),
    ("motion", "null", 0.10),
    ("motion", "single", 0.10),
)

GROUPS = tuple(dict.fromkeys(group for group, _, _ in _SHARES))

MOST_SEEDS = 20
"""Seeds that are tried for a case: of some hundred cases one draws what does not show, and few twice running."""

OTHER_SPEED = 9.1
"""Speed, rad/s, of which parts are the speeds of a second recording; no first one has any of them."""

OTHER_DURATION = 20.0
"""Duration of a second recording, s."""


@dataclass(frozen=True)
class CasePlan:
    """One case of the check.

    Attributes:
        group: single, pair, unknown, null, weak, new speed (the causes must hold in a second recording, at speeds that
            the first one has not), left out: its effect is missing from the diagnoser's library, variant: its effect
            departs from the textbook form, loud: a pair of which one is far louder than the other, mimic: half of a
            known effect, which is none, noise: nothing or a single effect in noise that is not as stated, or motion:
            nothing or a single effect while the stage moves as one in use, on arcs too.
        effects: what is at work; None lets the seed draw it.
        left_out: effects that the diagnoser may not know.
        noise: form of a noise that is not as the twin states it; empty for as stated.
    """

    number: int
    seed: int
    family: Family
    group: str
    kind: Kind
    rough: bool
    effects: tuple[str, ...] | None = None
    snr: tuple[float, float] | None = None
    left_out: tuple[str, ...] = ()
    noise: str = ""

    @property
    def name(self) -> str:
        """Folder of the case: tells nothing of what is in it."""
        return f"case_{self.number:04d}"


def plan_cases(
    seed: int, count: int, families: Sequence[Family], rough: Sequence[bool], groups: Sequence[str] = ()
) -> tuple[CasePlan, ...]:
    """Cases of every family, clean and rough, in an order that tells nothing; of all groups by default.

    About `count` of the given groups together; of all groups as many of the first seven, and the others beside them.
    Single, weak, left-out and varied cases go round all effects of the family, those of noise round its forms.
    """
    whole = sum((share for group, _, share in _SHARES if group in groups), 0.0) or 1.0
    draw = np.random.default_rng(seed)
    rows: list[dict[str, Any]] = []
    for family in families:
        known = stage_faults() if family == "stage" else machine_faults()
        for harsh in rough:
            for group, kind, share in _SHARES:
                if (groups and group not in groups) or (group in STAGE_ONLY and family == "machine"):
                    continue
                own = draw.permutation(WITHOUT_TURNS if group == "motion" else known)
                for i in range(max(1, round(share / whole * count))):
                    named = _effects_of(group, kind, i, own, draw)
                    left_out = (*named, *STAND_INS.get(named[0], ())) if group == "left out" and named else ()
                    rows.append(
                        {
                            "family": family,
                            "group": group,
                            "kind": kind,
                            "rough": harsh,
                            "effects": named,
                            "snr": _sizes_of(group, family, harsh),
                            "left_out": left_out,
                            "noise": _noise_of(group, family, i),
                        }
                    )
    order = draw.permutation(len(rows))
    seeds = draw.integers(1, 2**31, len(rows))
    return tuple(CasePlan(i, int(seeds[i]), **rows[int(place)]) for i, place in enumerate(order))


def _sizes_of(group: str, family: Family, rough: bool) -> tuple[float, float] | None:
    """Range of sizes of the cases of a group; None for the usual one."""
    if group in ("variant", "loud"):
        return (VARIANT_SIZES if group == "variant" else QUIET_SIZES)[family, rough]
    return WEAK if group == "weak" else None


def _noise_of(group: str, family: Family, number: int) -> str:
    """Form of the noise of the case with that number; static poses have no hum."""
    forms = FORMS if family == "stage" else tuple(form for form in FORMS if form != "hum")
    return forms[number % len(forms)] if group == "noise" else ""


def _effects_of(
    group: str, kind: Kind, number: int, known: NDArray[np.str_], draw: np.random.Generator
) -> tuple[str, ...] | None:
    """Effects of the case with that number of its kind, the louder one first; None where there is nothing to choose.

    A pair of stand-ins for one another is one effect to any recording: such pairs are drawn again.
    """
    if kind in ("single", "variant"):
        return (str(known[number % len(known)]),)
    if kind != "pair":
        return None
    while True:
        first, second = (str(name) for name in draw.choice(known, 2, replace=False))
        if group == "loud" and first not in LOUDEST:
            continue
        if second not in STAND_INS.get(first, ()) and first not in STAND_INS.get(second, ()):
            return first, second


def make_case(plan: CasePlan) -> StageCase | MachineCase:
    """The case of a plan: the same whenever it is made. Where its seed makes none, the next one does."""
    for seed in range(plan.seed, plan.seed + MOST_SEEDS - 1):
        with suppress(UnsuitableSeedError):
            return _case_of(plan, seed)
    return _case_of(plan, plan.seed + MOST_SEEDS - 1)


def _case_of(plan: CasePlan, seed: int) -> StageCase | MachineCase:
    effects = None if plan.effects is None else list(plan.effects)
    drawn = (seed, plan.kind, effects, plan.snr, plan.rough)
    loudness = LOUDNESS if plan.group == "loud" else None
    if plan.family == "stage":
        motion = motion_in_use(seed) if plan.group == "motion" else None
        return make_stage_case(*drawn, motion=motion, loudness=loudness, noise=plan.noise)
    return make_machine_case(draw_machine(seed), *drawn, loudness=loudness, noise=plan.noise)


def write_case(case: StageCase | MachineCase, folder: Path) -> None:
    """Write `bag/` and `twin.yaml`; the truth is not written."""
    folder.mkdir(parents=True)
    if isinstance(case, StageCase):
        blocks = {samples_topic(stream): list(values) for stream, values in case.blocks.items()}
        write_messages(folder / "bag", blocks)
        content: dict[str, Any] = {"stage": stage_mapping(case.twin)}
    else:
        write_messages(folder / "bag", dict(_pose_messages(case)))
        content = {"machine": machine_mapping(case.twin)}
    (folder / "twin.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def write_elsewhere(case: StageCase | MachineCase, folder: Path, seed: int) -> None:
    """Write `elsewhere/`: a second recording of the same stage at other speeds.

    Raises:
        InputError: the case is of a machine, which stands still at its poses.
    """
    if isinstance(case, MachineCase):
        raise InputError("a machine has no second recording at another speed; give the case of a stage")
    motion = random_motion(seed, OTHER_DURATION, segments=4, top_speed=OTHER_SPEED)
    plant = replace(case.plant, seed=seed + 1, motion=motion)
    end = round(OTHER_DURATION * NANOSECONDS)
    blocks = {
        samples_topic(stream): [plant.samples(stream, 0, plant.clocks[stream].index_at(end))]
        for stream in plant.streams
    }
    write_messages(folder / "elsewhere", blocks)


def draw_machine(seed: int) -> MachineDescription:
    """A five-axis machine with errors of usual size, drawn."""
    draw = np.random.default_rng([seed, 5])

    def size(std: float, count: int) -> list[float]:
        return [float(value) for value in std * draw.normal(size=count)]

    errors: dict[str, Any] = {}
    for axis in "XYZ":
        for direction in "XYZABC":
            own = direction in (axis, "A", "B", "C")
            std = 5e-6 if direction in "ABC" else 1e-5
            errors[f"E{direction}{axis}"] = {"poly": [0.0, *(size(std, 2) if own else [0.0, *size(std, 1)])]}
    for axis in "CA":
        for direction in "XYZABC":
            cos, sin = size(5e-6, 2)
            errors[f"E{direction}{axis}"] = {"harmonic": [{"order": 1, "cos": cos, "sin": sin}]}
    return machine_from_mapping(
        {
            "travel": {"X": [-3.0, 3.0], "Y": [-1.0, 1.0], "Z": [-1.0, 1.0], "C": [-np.pi, np.pi], "A": [-1.9, 1.9]},
            "squareness": dict(zip(("XY", "XZ", "YZ"), size(3e-5, 3), strict=True)),
            "orientation": {"C": size(1e-5, 2), "A": size(4e-5, 2)},
            "pivot_offset": [*size(8e-6, 2), 0.0],
            "head_length": 0.35,
            "tool_length": 0.15,
            "errors": errors,
        }
    )


def _pose_messages(case: MachineCase) -> Iterator[tuple[str, list[Any]]]:
    stamps = [int(stamp) for stamp in case.stamps_ns]
    poses = case.poses
    states = [
        JointState(stamp, tuple(case.twin.letters), poses.positions[i], poses.directions[i], np.zeros(0))
        for i, stamp in enumerate(stamps)
    ]
    yield topic_named("machine_joint_states"), states
    yield topic_named("tool_probe"), [PointStamped(stamp, case.probe[i]) for i, stamp in enumerate(stamps)]
    warmth = [Temperature(stamp, float(case.temperature[i])) for i, stamp in enumerate(stamps)]
    yield topic_named("machine_temperature"), warmth
