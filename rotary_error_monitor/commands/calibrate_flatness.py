"""The step `flatness` of `calibrate`: what straightness leaves on a ground workpiece, and compensation of it."""

from __future__ import annotations

import argparse

from rotary_error_monitor.calibration.grinding import flatness_text, predict_flatness
from rotary_error_monitor.commands.calibration_arguments import Subparsers, add_figure, writing
from rotary_error_monitor.commands.values import limits_of, not_negative
from rotary_error_monitor.description.machine import load_machine, machine_path
from rotary_error_monitor.files import check_outputs


def add(steps: Subparsers[argparse.ArgumentParser]) -> None:
    """Describe the step's arguments."""
    text = "flatness that straightness leaves on a ground workpiece, and with compensation by a third axis"
    parser = steps.add_parser("flatness", help=text)
    parser.add_argument("machine", metavar="MACHINE", help="machine YAML, or the name of one that ships")
    parser.add_argument("--vertical", required=True, metavar="Y", help="the axis that compensates")
    parser.add_argument(
        "--workpiece", nargs=2, required=True, metavar="X=LOW,HIGH", help="two axes, mm; passes: the first"
    )
    parser.add_argument("--reversal-um", type=not_negative, required=True, help="reversal error of the vertical axis")
    parser.add_argument("--positioning-um", type=not_negative, required=True, help="its positioning error")
    add_figure(parser, "draw the three surfaces")
    parser.set_defaults(run=_flatness_step)


def _flatness_step(arguments: argparse.Namespace) -> int:
    check_outputs([arguments.figure], [machine_path(arguments.machine)])
    machine = load_machine(arguments.machine)
    limits = limits_of(arguments.workpiece, machine)
    sizes = arguments.reversal_um * 1e-6, arguments.positioning_um * 1e-6
    prediction = predict_flatness(machine, arguments.vertical, limits, *sizes)
    print(flatness_text(prediction))
    if arguments.figure:
        from rotary_error_monitor.report.calibration import draw_flatness

        with writing(arguments.figure):
            draw_flatness(arguments.figure, prediction)
    return 0
