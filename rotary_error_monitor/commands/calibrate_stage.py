"""Steps of `calibrate` that write a stage file: ring and mirror, and the autocollimator."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from rotary_error_monitor.calibration.assembly import calibrate_assembly
from rotary_error_monitor.calibration.assembly_doubts import Centres
from rotary_error_monitor.calibration.assembly_report import assembly_text
from rotary_error_monitor.calibration.collimator import KEPT, calibrate_autocollimator
from rotary_error_monitor.calibration.collimator_report import collimator_text
from rotary_error_monitor.calibration.collimator_steps import Quadrants
from rotary_error_monitor.commands.calibration_arguments import (
    NOT_GOOD,
    Subparsers,
    add_changed,
    add_columns,
    add_figure,
    changed_file,
    layout_of,
    today,
)
from rotary_error_monitor.commands.values import finite, not_negative, positive
from rotary_error_monitor.metrology.mirror_assembly import DELAY_STD
from rotary_error_monitor.metrology.two_axis_fit import ReferenceUncertainty
from rotary_error_monitor.units import ARCSEC


def add(steps: Subparsers[argparse.ArgumentParser]) -> None:
    """Describe their arguments."""
    _add_assembly(steps)
    _add_autocollimator(steps)


def _add_assembly(steps: Subparsers[argparse.ArgumentParser]) -> None:
    parser = steps.add_parser("assembly", help="ring and mirror of a stage, from a bag of its shaft between centres")
    parser.add_argument("source", type=Path, metavar="BAG")
    add_changed(parser, "stage")
    parser.add_argument(
        "--delay-ms",
        type=finite,
        default=0.0,
        help="age of the autocollimator's values beyond its described latency, as far as it is known (default 0)",
    )
    parser.add_argument(
        "--delay-std-ms",
        type=not_negative,
        default=DELAY_STD * 1e3,
        help="its standard uncertainty; matters where one direction and speed only are recorded (default 5)",
    )
    parser.add_argument(
        "--centre-radial-um",
        type=not_negative,
        default=Centres().radial * 1e6,
        help="how far the shaft may go round with its rotation between the centres, which looks like eccentricity: "
        "standard uncertainty in each direction, a fifth of the total run-out of live centres (default 1)",
    )
    parser.add_argument(
        "--centre-lean-arcsec",
        type=not_negative,
        default=Centres().lean * ARCSEC,
        help="and how far it may lean, which looks like a tilted mirror (default 1)",
    )
    parser.add_argument(
        "--as",
        dest="form",
        choices=("orders", "table"),
        default="orders",
        help="write graduation and flatness by the orders that stand out, or as measured curves of all orders, in CSV "
        "files beside the stage file (default: orders)",
    )
    add_figure(parser, "draw heads against one another and the mirror, before and after")
    parser.set_defaults(run=_assembly)


def _add_autocollimator(steps: Subparsers[argparse.ArgumentParser]) -> None:
    text = "steps of a reference before it: reference_x_arcsec,reference_y_arcsec,tilt_x_arcsec,… or q1_V,…,q4_V"
    parser = steps.add_parser("autocollimator", help=text)
    parser.add_argument("source", type=Path, metavar="STEPS.csv", help="units are those of the columns' names")
    add_changed(parser, "stage")
    parser.add_argument(
        "--reference-arcsec",
        type=positive,
        required=True,
        help="standard uncertainty of a step of the reference; of a stated accuracy of ±a, a / 1.73",
    )
    parser.add_argument(
        "--reference-scale",
        type=not_negative,
        default=0.0,
        help="that of all its angles alike, as a part of them (default 0)",
    )
    parser.add_argument(
        "--reference-roll-arcmin",
        type=not_negative,
        default=0.0,
        help="that of how its axes lie against those of the stage (default 0)",
    )
    usual = Quadrants()
    parser.add_argument(
        "--sensitivity",
        type=positive,
        default=usual.sensitivity,
        metavar="RAD",
        help=f"with voltages: iio.sensitivity of the node (default {usual.sensitivity:g})",
    )
    parser.add_argument(
        "--dark",
        type=finite,
        nargs=4,
        default=list(usual.dark),
        metavar="V",
        help="with voltages: iio.dark of the node (default 0)",
    )
    parser.add_argument(
        "--keep", nargs="+", choices=KEPT, default=[], help="leave these in the file as they are: calibrated elsewhere"
    )
    parser.add_argument(
        "--drop-outliers",
        action="store_true",
        help="leave steps out that do not fit the others, and readings that do not fit their step",
    )
    add_columns(parser, "reference_x=RefX,arcsec reference_y=RefY,arcsec q1_V=Ch0 q2_V=Ch1 q3_V=Ch2 q4_V=Ch3")
    add_figure(parser)
    parser.set_defaults(run=_autocollimator)


def _assembly(arguments: argparse.Namespace) -> int:
    with changed_file(arguments, arguments.stage) as output:
        result = calibrate_assembly(
            arguments.source,
            arguments.stage,
            output,
            arguments.date or today(),
            delay=(arguments.delay_ms * 1e-3, arguments.delay_std_ms * 1e-3),
            centres=Centres(arguments.centre_radial_um * 1e-6, arguments.centre_lean_arcsec / ARCSEC),
            as_table=arguments.form == "table",
            force=arguments.force,
        )
    print(assembly_text(result, output))
    if arguments.figure:
        from rotary_error_monitor.report.assembly import draw_assembly

        draw_assembly(arguments.figure, result)
    return 0 if result.written else NOT_GOOD


def _autocollimator(arguments: argparse.Namespace) -> int:
    roll = math.radians(arguments.reference_roll_arcmin / 60)
    with changed_file(arguments, arguments.stage) as output:
        result = calibrate_autocollimator(
            arguments.source,
            arguments.stage,
            output,
            arguments.date or today(),
            ReferenceUncertainty(arguments.reference_arcsec / ARCSEC, arguments.reference_scale, roll),
            quadrants=Quadrants(arguments.sensitivity, tuple(arguments.dark)),
            keep=tuple(arguments.keep),
            drop_outliers=arguments.drop_outliers,
            force=arguments.force,
            layout=layout_of(arguments),
        )
    print(collimator_text(result, output))
    if arguments.figure:
        from rotary_error_monitor.report.collimator import draw_collimator

        draw_collimator(arguments.figure, result)
    return 0 if result.written else NOT_GOOD
