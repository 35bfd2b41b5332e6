"""A fault-isolation matrix: residuals of minimal overdetermined sets of equations, as structural analysis builds them.

Krysander, Aslund, Nyberg: An efficient algorithm for finding minimal overconstrained subsystems, IEEE Trans. SMC A 38
(2008); here found by trying all small sets, which a stage of fifteen equations allows.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from baselines import COMMAND, JITTER, Residuals, Threshold, answer, largest_order, orders_of

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import order_location
from rotary_error_monitor.effects.rotor import StageEffect

HEADS = ("head_a", "head_b", "head_c", "head_d")
BOTH = {name: (f"{name}_x", f"{name}_y") for name in ("radial", "tilt", "ring", "autocollimator", "lvdt")}
AFFECTED = {
    **dict.fromkeys(("reversal_backlash", "following_error", "drive_cyclic_error"), (COMMAND,)),
    **dict.fromkeys(("graduation_error", "disc_scale", "encoder_latency"), HEADS),
    **dict.fromkeys(("spindle_radial", "radial_hysteresis", "thermal_drift", "unbalance"), BOTH["radial"]),
    **dict.fromkeys(("bearing_asynchronous", "load_compliance"), BOTH["radial"] + BOTH["tilt"]),
    **dict.fromkeys(("lvdt_artefact", "lvdt_height"), BOTH["lvdt"]),
    **dict.fromkeys(
        ("mirror_wobble", "mirror_flatness", "autocollimator_roll", "autocollimator_nonlinearity",
         "autocollimator_drift", "autocollimator_latency"),
        BOTH["autocollimator"],
    ),
    "spindle_tilt": BOTH["tilt"],
    "disc_eccentricity": BOTH["ring"],
}  # fmt: skip
"""Equations of the stage that each effect breaks; those at a head or a component break that one alone."""


@dataclass(frozen=True)
class Structure:
    """Equations of a stage, linear about the twin, in the unknowns theta, d, g, c (see the twin's formulas)."""

    names: tuple[str, ...]
    matrix: np.ndarray  # (equations, unknowns)
    sensors: tuple[str, ...]

    @classmethod
    def of(cls, stage: StageDescription) -> Structure:
        height, radius = stage.lvdt.height if stage.lvdt else 0.0, stage.encoder.disc_radius
        theta, dx, dy, gx, gy, cx, cy = np.eye(7)
        rows = {
            COMMAND: theta,
            **{
                f"head_{letter}": theta + (-np.sin(phi) * cx + np.cos(phi) * cy).round(12) / radius
                for letter, phi in sorted(stage.encoder.azimuths.items())
            },
            "radial_x": dx, "radial_y": dy, "tilt_x": gx, "tilt_y": gy, "ring_x": cx - dx, "ring_y": cy - dy,
            "autocollimator_x": gx, "autocollimator_y": gy,
        }  # fmt: skip
        if stage.lvdt:
            rows |= {"lvdt_x": dx + height * gy, "lvdt_y": dy - height * gx}
        measured = tuple(name for name in rows if name in HEADS or name.startswith(("autocollimator", "lvdt")))
        return cls(tuple(rows), np.stack(list(rows.values())), measured)

    def minimal_sets(self, most: int = 6) -> list[tuple[int, ...]]:
        """Minimal structurally overdetermined sets of equations, smallest first; numbers that are drawn make the rank
        of a matrix that of its structure."""
        generic = np.where(self.matrix != 0, np.random.default_rng(0).uniform(1, 2, self.matrix.shape), 0.0)
        found: list[tuple[int, ...]] = []
        for size in range(2, most + 1):
            for rows in itertools.combinations(range(len(self.names)), size):
                if np.linalg.matrix_rank(generic[list(rows)]) < size and not any(set(f) <= set(rows) for f in found):
                    found.append(rows)
        return found


@dataclass(frozen=True)
class IsolationMatrix:
    """Residuals of minimal overdetermined sets, thresholded; the faults whose row of the matrix fits what fired."""

    structure: Structure
    sets: list[tuple[int, ...]]
    threshold: Threshold
    rows: Mapping[tuple[str, str], frozenset[str]]
    families: Mapping[str, range]

    @classmethod
    def learn(
        cls, stage: StageDescription, nulls: Sequence[Residuals], effects: Sequence[StageEffect]
    ) -> IsolationMatrix:
        structure = Structure.of(stage)
        faults = {
            (effect.name, place): frozenset(_broken(effect.name, place))
            for effect in effects
            for place in ([""] if effect.orders else effect.locations(stage))
        }
        sets = _separating(structure, faults)
        rows = {
            key: frozenset(str(i) for i, used in enumerate(sets) if broken & {structure.names[j] for j in used})
            for key, broken in faults.items()
        }
        signals = [residual_signals(structure, sets, n) for n in nulls]
        return cls(structure, sets, Threshold.of(signals), rows, {e.name: orders_of(e) for e in effects if e.orders})

    def diagnose(self, data: Residuals, left_out: Sequence[str]) -> dict:
        scores = self.threshold.scores(residual_signals(self.structure, self.sets, data))
        fired = frozenset(name for name, score in scores.items() if score > self.threshold.level)
        if not fired:
            return answer("no_gap")
        known = {key: row for key, row in self.rows.items() if key[0] not in left_out}
        for count in (1, 2):
            fits = {
                keys: frozenset().union(*(known[key] for key in keys)) for keys in itertools.combinations(known, count)
            }
            missing = {keys: len(row - fired) for keys, row in fits.items() if fired <= row}
            if missing:
                best = [keys for keys, number in missing.items() if number == min(missing.values())]
                named = [self._placed(key, data) for key in best[0]]
                alike = [self._placed(keys[0], data) for keys in best] if count == 1 else []
                return answer("explained", named, alike)
        return answer("unknown")

    def _placed(self, key: tuple[str, str], data: Residuals) -> tuple[str, str]:
        """With its order, where the effect is one of a family."""
        effect, place = key
        if effect not in self.families:
            return key
        equations = AFFECTED[effect]
        channel = next(
            (c for c in ("lvdt_x", "head_c") if "radial_x" in equations and c in data.sensors),
            "autocollimator_x" if "tilt_x" in equations else equations[0],
        )
        return effect, order_location(largest_order(data.channels[channel], data.angle, iter(self.families[effect])))


def _broken(effect: str, place: str) -> tuple[str, ...]:
    if place.startswith("head_"):
        return (place,)
    return (f"{effect.partition('_')[0]}_{place}",) if place in ("x", "y") else AFFECTED.get(effect, ())


def _separating(structure: Structure, faults: Mapping[tuple[str, str], frozenset[str]]) -> list[tuple[int, ...]]:
    """Sets, smallest first, each of which tells faults from one another, or from none, that no set before did."""
    chosen: list[tuple[int, ...]] = []
    open_pairs = set(itertools.combinations(sorted({*faults.values(), frozenset()}, key=sorted), 2))
    for used in structure.minimal_sets():
        names = {structure.names[i] for i in used}
        told = {pair for pair in open_pairs if bool(pair[0] & names) != bool(pair[1] & names)}
        if told:
            chosen.append(used)
            open_pairs -= told
    return chosen


def residual_signals(structure: Structure, sets: Sequence[tuple[int, ...]], data: Residuals) -> dict[str, np.ndarray]:
    """Each set's combination of sensors in which all unknowns cancel, over its noise."""
    found = {}
    for number, used in enumerate(sets):
        weights = np.linalg.svd(structure.matrix[list(used)].T)[2][-1]
        total, variance = np.zeros_like(data.time), 0.0
        for weight, index in zip(weights, used, strict=True):
            name = structure.names[index]
            if name in data.sensors:
                total += weight * data.sensors[name]
                variance += (weight * data.noise[name]) ** 2
            elif name == COMMAND:
                variance += (weight * JITTER) ** 2
        found[str(number)] = total / np.sqrt(max(variance, 1e-300))
    return found
