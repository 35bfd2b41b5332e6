"""Machines with drawn errors, probed at random poses, evaluated by the plant's exact rotations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rotary_error_monitor.calibration.identification import (
    ProbedPoses,
    check_held_out,
    identify_machine,
    parameter_scales,
)
from rotary_error_monitor.calibration.parameters import (
    Orders,
    apply_parameters,
    list_parameters,
    value_of,
    without_errors,
)
from rotary_error_monitor.calibration.verdict import judge_calibration
from rotary_error_monitor.calibration.volume import sample_volume
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.plant.machine import MachinePlant, MachineStates

NOISE = 1.5e-6
VOLUME = 800
"""Poses of the working volume at which the true error of the prediction is taken: of 100 the root mean square is off by
so much by itself that a bound of 95 % holds it in 92 of 100."""


@dataclass(frozen=True)
class Calibration:
    """A machine, how many poses are probed, and what is looked for."""

    machine: str
    poses: int
    orders: Orders = field(default_factory=Orders)


CALIBRATIONS: Mapping[str, Calibration] = {
    "head that swivels": Calibration("pan2013", 120),
    "trunnion, few poses": Calibration("xyzac_trt", 60),
    "trunnion, everything": Calibration("xyzac_trt", 150, Orders(reversal=True, expansion=True, setup=True)),
    "grinder": Calibration("grinder_zhou2023", 80),
}


def tool(machine: MachineDescription, positions: np.ndarray, direction: np.ndarray, warming: np.ndarray) -> np.ndarray:
    """(n, 3) true deviation of the tool tip, m."""
    return MachinePlant(machine).tool_offset(MachineStates(positions, direction, warming))[:, :3]


def rates(kind: str, count: int) -> dict[str, float]:
    """How often the 95 % bound of each result holds the truth in so many calibrations.

    Of parameters that are determined, at which part of them; of the tool, whether its root mean square error over the
    working volume is within its bound. A right model passes the held-out check in 99 of 100.
    """
    case = CALIBRATIONS[kind]
    ideal = without_errors(load_machine(case.machine))
    parameters = list_parameters(ideal, case.orders)
    low, high = np.array([axis.travel for axis in ideal.axes]).T
    volume = sample_volume(ideal, VOLUME)
    still = np.zeros_like(volume), np.zeros(VOLUME)
    found = []
    for seed in range(count):
        rng = np.random.default_rng([count, seed])
        truth = apply_parameters(ideal, parameters, parameter_scales(parameters) * rng.normal(size=len(parameters)))
        positions = rng.uniform(low, high, size=(case.poses, low.size))
        direction = rng.choice([-1.0, 1.0], size=positions.shape)
        warming = rng.uniform(-3, 3, size=case.poses)
        deviations = tool(truth, positions, direction, warming) + NOISE * rng.normal(size=(case.poses, 3))
        poses = ProbedPoses(positions, direction, ideal.reference_temperature + warming, deviations, NOISE)
        result = identify_machine(ideal, parameters, poses)
        held_out = check_held_out(ideal, parameters, poses)
        verdict = judge_calibration(result, held_out, poses, required=3e-6)
        true = np.array([value_of(truth, parameter) for parameter in parameters])
        off = np.abs(result.values - true)[result.determined]
        missed = tool(truth, volume, *still) - tool(result.machine, volume, *still)
        found.append(
            {
                "parameters": float(np.mean(off < 1.96 * result.standard_uncertainty[result.determined])),
                "tool": float(np.sqrt(np.mean(np.sum(missed**2, axis=1))) < verdict.bound),
                "held-out check": float(held_out.ratio <= held_out.limit),
            }
        )
    return {name: round(float(np.mean([each[name] for each in found])), 3) for name in found[0]}
