"""`rotary_error_monitor calibrate`: from measurements to the machine file, and to the tables that controllers load."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np

from rotary_error_monitor.calibration import reports
from rotary_error_monitor.calibration.axis_lines import calibrate_squareness
from rotary_error_monitor.calibration.controller_tables import (
    comp_file,
    compare_compensations,
    predict_axis_compensation,
    read_comp_file,
    volumetric_table,
)
from rotary_error_monitor.calibration.machine_step import calibrate_machine
from rotary_error_monitor.calibration.parameters import Orders
from rotary_error_monitor.calibration.steps import calibrate_positioning
from rotary_error_monitor.calibration.volume import (
    draws_for,
    estimate_uncertain_offsets,
    estimate_volumetric_map,
    rank_errors,
    sample_volume,
)
from rotary_error_monitor.commands import calibrate_flatness, calibrate_stage, calibrate_straightness
from rotary_error_monitor.commands.calibration_arguments import (
    NOT_GOOD,
    Subparsers,
    add_columns,
    add_figure,
    add_place,
    add_point,
    job_of,
    place_of,
    step,
)
from rotary_error_monitor.commands.values import (
    HELD,
    count_of,
    limits_of,
    not_negative,
    positive,
    split_word,
)
from rotary_error_monitor.description.machine import MachineDescription, load_machine, machine_path
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_whole
from rotary_error_monitor.machine.kernel import describe_kernel
from rotary_error_monitor.metrology.tracker import TrackerNoise

MOST_POSES = 10_000_000
"""Poses of an uncertainty at most: they take minutes, and some GB of memory."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.description = (
        "Exit codes: 0 written, 10 what was measured does not fit or is not good, nothing is written "
        "(--force writes it all the same), 2 bad input."
    )
    steps = parser.add_subparsers(title="steps", required=True, metavar="STEP")
    _add_positioning(steps)
    calibrate_straightness.add(steps)
    _add_squareness(steps)
    calibrate_stage.add(steps)
    _add_machine(steps)
    _add_tables(steps)
    _add_errors(steps)
    calibrate_flatness.add(steps)


def _add_positioning(steps: Subparsers[argparse.ArgumentParser]) -> None:
    text = "ISO 230-2 test of one axis: target_mm,direction,cycle,deviation_um (target_deg, deviation_arcsec)"
    parser = step(steps, "positioning", _positioning, text)
    parser.add_argument("--axis", required=True, help="letter, such as X")
    parser.add_argument(
        "--drop-outliers", action="store_true", help="leave flagged readings out of figures and machine file"
    )
    for unit, kind in (("um", "linear"), ("arcsec", "rotary")):
        parser.add_argument(
            f"--instrument-{unit}",
            type=not_negative,
            help="standard uncertainty of the instrument's difference between two positions (calibration, alignment, "
            f"temperature), which repeated runs do not show; of a {kind} axis",
        )
    add_columns(parser, "target=Pos,mm direction=Dir cycle=Run deviation=Error,um")
    add_place(parser)
    add_figure(parser)


def _add_squareness(steps: Subparsers[argparse.ArgumentParser]) -> None:
    text = (
        "laser tracker along and round axes and spindle: feature,distance_mm,elevation_deg,azimuth_deg, or "
        "feature,x_mm,y_mm,z_mm in the tracker's frame"
    )
    parser = step(steps, "squareness", _squareness, text)
    parser.add_argument("--distance-um", type=positive, default=0.5, help="standard uncertainty (default 0.5)")
    parser.add_argument("--distance-ppm", type=not_negative, default=0.5, help="and its relative part (default 0.5)")
    parser.add_argument("--angle-arcsec", type=positive, default=0.5, help="of both angles (default 0.5)")
    where = "where it stands in the frame of the tool, or of the workpiece where the axis carries that"
    add_point(parser, "--reflector-mm", where, ": the lever of angular errors that the file has")
    add_figure(parser, "draw how axes and spindle lie beside each other")
    add_columns(parser, "feature=Group x=X,mm y=Y,mm z=Z,mm")


def _add_machine(steps: Subparsers[argparse.ArgumentParser]) -> None:
    parser = step(steps, "machine", _machine, "all parameters from probed poses: a bag, or a CSV file")
    parser.add_argument("--noise-um", type=positive, default=1.5, help="standard deviation of the probe (default 1.5)")
    parser.add_argument(
        "--required-um", type=positive, default=3.0, help="good if the tool is predicted to this (default 3)"
    )
    parser.add_argument("--limits", nargs="*", default=[], metavar="X=LOW,HIGH", help="working volume, mm or degrees")
    for name in ("reversal", "expansion", "setup"):
        parser.add_argument(f"--{name}", action="store_true", help=f"look for {name} as well")
    parser.add_argument("--drop-outliers", action="store_true", help="leave out poses that stand off from the others")
    add_columns(parser, "X=x,mm … C=c,deg temperature=T dx=ex,um dy=ey,um dz=ez,um")


def _add_tables(steps: Subparsers[argparse.ArgumentParser]) -> None:
    parser = steps.add_parser("tables", help="LinuxCNC COMP_FILE of an axis, or a volumetric table")
    parser.add_argument("machine", metavar="MACHINE", help="machine YAML, or the name of one that ships")
    parser.add_argument("-o", "--output", type=Path, required=True)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--axis", help="COMP_FILE of this axis")
    what.add_argument("--grid", nargs="+", metavar="X=5", help=f"volumetric table: points by axis; {HELD}")
    parser.add_argument("--type", type=int, choices=(0, 1), default=0, help="COMP_FILE_TYPE (default 0)")
    parser.add_argument(
        "--against", type=Path, metavar="OLD.comp", help="say how far the COMP_FILE is from this one, of the same type"
    )
    parser.add_argument("--rows", type=int, default=256, help="rows of a COMP_FILE at most (default 256)")
    parser.set_defaults(run=_tables)


def _add_errors(steps: Subparsers[argparse.ArgumentParser]) -> None:
    parser = steps.add_parser("errors", help="what matters most: which error costs how much in the working volume")
    parser.add_argument("machine", metavar="MACHINE", help="machine YAML, or the name of one that ships")
    parser.add_argument("--limits", nargs="*", default=[], metavar="X=LOW,HIGH", help="working volume, mm or degrees")
    parser.add_argument(
        "--map", nargs=2, metavar=("X", "Z"), help="axes of the map (default: the first two); others at mid-travel"
    )
    parser.add_argument(
        "--uncertainty", type=int, metavar="POSES", help="what the description's uncertainty leaves at so many poses"
    )
    add_figure(parser, "draw map and ranked bars")
    parser.set_defaults(run=_errors)


def _positioning(arguments: argparse.Namespace) -> int:
    with job_of(arguments) as job:
        instrument = _instrument(arguments, job.file.machine)
        place = place_of(arguments, job.file.machine)
        result = calibrate_positioning(
            job, arguments.axis, drop_outliers=arguments.drop_outliers, instrument=instrument, place=place
        )
    print(reports.positioning_text(result, job.output))
    if arguments.figure:
        from rotary_error_monitor.report.calibration import draw_positioning

        draw_positioning(arguments.figure, result)
    return 0 if result.written else NOT_GOOD


def _instrument(arguments: argparse.Namespace, machine: MachineDescription) -> float:
    """Standard uncertainty of the instrument as given for the axis, m or rad; 0 if none was given.

    Raises:
        InputError: it was given for another kind of axis.
    """
    um, arcsec = arguments.instrument_um, arguments.instrument_arcsec
    rotary = machine.axis(arguments.axis).kind == "rotary"
    other, value, right = ("um", um, "arcsec") if rotary else ("arcsec", arcsec, "um")
    if value is not None:
        kind = "rotary" if rotary else "linear"
        raise InputError(f"--instrument-{other} {value:g}: axis {arguments.axis} is {kind}; use --instrument-{right}")
    return math.radians((arcsec or 0.0) / 3600) if rotary else (um or 0.0) * 1e-6


def _squareness(arguments: argparse.Namespace) -> int:
    angle = math.radians(arguments.angle_arcsec / 3600)
    noise = TrackerNoise(arguments.distance_um * 1e-6, arguments.distance_ppm * 1e-6, angle, angle)
    with job_of(arguments) as job:
        x, y, z = (part * 1e-3 for part in arguments.reflector_mm)
        result = calibrate_squareness(job, noise, (x, y, z))
    print(reports.squareness_text(result, job.output))
    if arguments.figure:
        from rotary_error_monitor.report.axes_figure import draw_axes

        draw_axes(arguments.figure, result)
    return 0 if result.written else NOT_GOOD


def _machine(arguments: argparse.Namespace) -> int:
    orders = Orders(reversal=arguments.reversal, expansion=arguments.expansion, setup=arguments.setup)
    noise, required = arguments.noise_um * 1e-6, arguments.required_um * 1e-6
    with job_of(arguments) as job:
        limits = limits_of(arguments.limits, job.file.machine)
        result = calibrate_machine(job, orders, noise, required, limits, drop_outliers=arguments.drop_outliers)
    print(reports.machine_text(result, job.output))
    return 0 if result.written else NOT_GOOD


def _tables(arguments: argparse.Namespace) -> int:
    check_outputs([arguments.output], [machine_path(arguments.machine), arguments.against])
    machine = load_machine(arguments.machine)
    if arguments.against and not arguments.axis:
        raise InputError(f"--against {arguments.against}: a COMP_FILE is of one axis; give --axis as well")
    if arguments.axis:
        return _comp_file(arguments, machine)
    counts = {name: count_of(value, f"{name}={value}") for name, value in map(split_word, arguments.grid)}
    write_whole(arguments.output, volumetric_table(machine, counts).encode("ascii"))
    print(f"{math.prod(counts.values())} poses written to {arguments.output}")
    return 0


def _comp_file(arguments: argparse.Namespace, machine: MachineDescription) -> int:
    compensation = predict_axis_compensation(machine, arguments.axis, arguments.rows)
    before = None
    if arguments.against:
        before = read_comp_file(arguments.against, machine.axis(arguments.axis), arguments.type)
    write_whole(arguments.output, comp_file(compensation, arguments.type).encode("ascii"))
    residue = np.rad2deg(compensation.residue) * 3600 if compensation.rotary else compensation.residue * 1e6
    unit = "arcsec" if compensation.rotary else "µm"
    print(f"{len(compensation.positions)} rows written to {arguments.output}, {residue:.3g} {unit} off between")
    print(f"[JOINT_N] COMP_FILE = {arguments.output.name}, COMP_FILE_TYPE = {arguments.type}; take BACKLASH out")
    if before is not None:
        print(reports.change_text(compare_compensations(before, compensation), arguments.against))
    return 0


def _errors(arguments: argparse.Namespace) -> int:
    check_outputs([arguments.figure], [machine_path(arguments.machine)])
    check_places([arguments.figure] if arguments.figure else [])
    machine = load_machine(arguments.machine)
    limits = limits_of(arguments.limits, machine)
    poses = arguments.uncertainty
    if poses is not None and not 1 <= poses <= MOST_POSES:
        raise InputError(f"--uncertainty {poses}; expected 1 to {MOST_POSES} poses")
    costs = rank_errors(machine, limits=limits)
    print(reports.ranking_text(costs))
    if poses is not None:
        if slower := describe_kernel():
            print(f"note: {slower}", file=sys.stderr)
        volume = sample_volume(machine, poses, limits)
        print(reports.uncertain_offsets_text(estimate_uncertain_offsets(machine, volume, draws=draws_for(poses))))
    if arguments.figure:
        from rotary_error_monitor.report.calibration import draw_errors

        axes = tuple(arguments.map or machine.letters[:2])
        chart = estimate_volumetric_map(machine, (axes[0], axes[1]))
        draw_errors(arguments.figure, costs, chart)
    return 0
