"""From probed poses to all parameters of a machine in its file, with a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.calibration.identification import (
    Identification,
    ProbedPoses,
    check_held_out,
    drop_outlying,
    identify_machine,
)
from rotary_error_monitor.calibration.machine_poses import read_probed_poses
from rotary_error_monitor.calibration.parameters import Orders, list_parameters
from rotary_error_monitor.calibration.quietness import quiet_length
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.calibration.verdict import CalibrationVerdict, judge_calibration
from rotary_error_monitor.calibration.volume import Limits, volumetric_difference
from rotary_error_monitor.description.machine import POSE_TERM, VOLUMETRIC, WHOLE_MACHINE, MachineDescription
from rotary_error_monitor.errors import told_of
from rotary_error_monitor.machine.pose_uncertainty import MIDDLE
from rotary_error_monitor.metrology.distributions import chi_square_limit
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM


@dataclass(frozen=True)
class MachineResult:
    """What identification found, the verdict on it, and whether the file was written."""

    identification: Identification
    verdict: CalibrationVerdict
    written: bool
    remarks: tuple[str, ...] = ()


def calibrate_machine(
    job: Job,
    orders: Orders,
    noise: float,
    required: float,
    limits: Limits | None = None,
    *,
    drop_outliers: bool = False,
) -> MachineResult:
    """All parameters of a machine from probed poses; what is not good is written by force only.

    Raises:
        InputError: the poses cannot be read or do not fit the machine.
    """
    machine = job.file.machine
    poses = read_probed_poses(job.source, machine, noise, job.layout)
    parameters = list_parameters(machine, orders)
    found = identify_machine(machine, parameters, poses)
    clean, kept, dropped = drop_outlying(machine, parameters, poses, found)
    remarks = poses.remarks
    if drop_outliers and dropped:
        remarks += tuple(f"{poses.name(pose.number)} stood off and is left out" for pose in dropped)
        found, poses = clean, poses.chosen(kept)
    else:
        found = replace(found, outlying=dropped)
    with told_of(job.source):
        held_out = check_held_out(machine, parameters, poses)
    negative, all_are = negative_reversals(found)
    doubts = (*_stray(found, poses), *unit_doubts(machine, found, poses), *(negative if all_are else ()))
    remarks += () if all_are else negative
    verdict = judge_calibration(found, held_out, poses, required=required, limits=limits, doubts=doubts)
    parts = job.file.set_machine(found.machine)
    figures = {"held_out_ratio": held_out.ratio, VOLUMETRIC: verdict.uncertainty, f"{VOLUMETRIC}_bound": verdict.bound}
    misfits = [] if verdict.good else [verdict.sentence]
    # a model that does not hold all errors misses by what it missed on the poses that were held out
    missed = held_out.error if held_out.ratio > held_out.limit else 0.0
    moved = volumetric_difference(found.machine, clean.machine, limits) if found.outlying else 0.0
    uncertainty = math.hypot(verdict.uncertainty, missed, moved)
    terms = {**verdict.pose_terms, MIDDLE: math.hypot(verdict.pose_terms.get(MIDDLE, 0.0), missed, moved)}
    by_pose = {f"{POSE_TERM}{letters}": size for letters, size in terms.items() if size > 0}
    whole = {WHOLE_MACHINE: (uncertainty, {**figures, **by_pose})}
    written = job.finish_parts({**dict.fromkeys(parts, (uncertainty, figures)), **whole}, misfits)
    return MachineResult(found, verdict, written, remarks)


def _stray(found: Identification, poses: ProbedPoses) -> tuple[str, ...]:
    """Which poses stand off, in words; nothing where none does."""
    if not found.outlying:
        return ()
    worst, count = found.outlying[0], len(found.outlying)
    name, size = poses.name(worst.number), worst.size * poses.noise * 1e6
    which = f"Of {count} poses that stand off, {name} does most" if count > 1 else f"P{name[1:]} stands off"
    return (
        f"{which}: the fit leaves {size:.1f} µm, {worst.ratio:.1f} standard deviations of what it leaves at the others "
        "(--drop-outliers leaves such poses out).",
    )


def negative_reversals(found: Identification) -> tuple[tuple[str, ...], bool]:
    """What is to be said of axes that go too far where play would hold them back, and whether it is all that show any.

    Play is positive. A controller that compensates too much makes one axis look so; several, and none that is
    positive, are directions of the other sign.
    """
    ratios = {
        parameter.name.partition(".")[0]: float(value / std)
        for parameter, value, std in zip(found.parameters, found.values, found.standard_uncertainty, strict=True)
        if parameter.name.endswith(".reversal")
    }
    limit = math.sqrt(chi_square_limit(FALSE_ALARM / max(1, len(ratios)), 1))
    shown = {letter: ratio for letter, ratio in ratios.items() if abs(ratio) > limit}
    below = [letter for letter, ratio in shown.items() if ratio < 0]
    if not below:
        return (), False
    return (
        f"Reversal of {', '.join(below)} is negative: such an axis goes further than it is told after it has turned, "
        "as a controller makes it that compensates too much; or are the directions those of the other side?",
    ), len(below) == len(shown) > 1


def unit_doubts(machine: MachineDescription, found: Identification, poses: ProbedPoses) -> tuple[str, ...]:
    """Residuals that are smaller than any instrument's, in words."""
    linear = [axis.kind == "linear" for axis in machine.axes]
    path = float(np.linalg.norm(np.ptp(poses.positions[:, linear], axis=0)))
    doubt = quiet_length(found.residual_ratio * poses.noise, float(np.abs(poses.deviations).max()), path)
    return () if doubt is None else (f"Readings scatter by {doubt}",)
