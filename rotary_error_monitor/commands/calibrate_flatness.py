"""The step `flatness` of `calibrate`: what straightness leaves on a ground workpiece, and compensation of it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from rotary_error_monitor.calibration.flatness_doubts import (
    CurveDoubt,
    bounds_text,
    check_curve,
    predict_bounds,
    read_covariance,
)
from rotary_error_monitor.calibration.grinding import (
    FlatnessPrediction,
    VerticalErrors,
    flatness_text,
    predict_flatness,
    trajectory_csv,
)
from rotary_error_monitor.calibration.workpiece import measured_text, read_workpiece
from rotary_error_monitor.commands.calibration_arguments import (
    NOT_GOOD,
    Subparsers,
    add_columns,
    add_figure,
    layout_of,
)
from rotary_error_monitor.commands.values import limits_of, not_negative, positive, split_word
from rotary_error_monitor.description.machine import MachineDescription, load_machine, machine_path
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_whole

USUAL_REVERSAL_UM = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0)
"""From none to what a vertical axis without a counterbalance may have."""


def add(steps: Subparsers[argparse.ArgumentParser]) -> None:
    """Describe the step's arguments."""
    text = "flatness that straightness leaves on a ground workpiece, and with compensation by a third axis"
    parser = steps.add_parser("flatness", help=text)
    parser.add_argument("machine", metavar="MACHINE", help="machine YAML, or the name of one that ships")
    parser.add_argument("--vertical", required=True, metavar="Y", help="the axis that compensates")
    parser.add_argument(
        "--workpiece", nargs=2, required=True, metavar="X=LOW,HIGH", help="two axes, mm; passes: the first"
    )
    parser.add_argument(
        "--reversal-um",
        type=not_negative,
        nargs="+",
        default=list(USUAL_REVERSAL_UM),
        metavar="UM",
        help="reversal errors of the vertical axis to be tried (default 0 to 3)",
    )
    parser.add_argument("--positioning-um", type=not_negative, required=True, help="its positioning error")
    parser.add_argument(
        "--positioning-period-um",
        type=positive,
        default=20.0,
        help="wave of that: the signal period of its scale (default 20)",
    )
    parser.add_argument(
        "--measured", type=Path, metavar="CSV", help="surface ground without compensation: X_mm,Z_mm,height_um"
    )
    parser.add_argument("--measured-after", type=Path, metavar="CSV", help="surface ground with it")
    add_columns(parser, "X=x,mm Z=z,mm height=Height,um", "of surfaces")
    parser.add_argument(
        "--covariance",
        nargs=2,
        default=(),
        metavar="X=CSV",
        help="of both axes the files that `calibrate straightness --covariance` wrote, for 95 %% intervals",
    )
    parser.add_argument("--height-noise-um", type=positive, help="standard deviation of their heights, for an interval")
    parser.add_argument(
        "--trajectory", type=Path, metavar="OUT.csv", help="write what the vertical axis adds over the workpiece"
    )
    parser.add_argument("--step-mm", type=positive, default=10.0, help="of its points (default 10)")
    parser.add_argument(
        "--force", action="store_true", help="write the trajectory also where a measured surface contradicts it"
    )
    add_figure(parser, "draw surfaces, trajectory, and flatness over the reversal error")
    parser.set_defaults(run=_flatness)


def _flatness(arguments: argparse.Namespace) -> int:
    written = [arguments.figure, arguments.trajectory]
    measured = {"before": arguments.measured, "after": arguments.measured_after}
    stated = {name: Path(file) for name, file in map(split_word, arguments.covariance)}
    check_outputs(written, [machine_path(arguments.machine), *measured.values(), *stated.values()])
    check_places(path for path in written if path is not None)
    _check_surfaces(arguments)
    machine = load_machine(arguments.machine)
    limits = limits_of(arguments.workpiece, machine)
    reversal = tuple(size * 1e-6 for size in sorted(set(arguments.reversal_um)))
    errors = VerticalErrors(reversal, arguments.positioning_um * 1e-6, arguments.positioning_period_um * 1e-6)
    prediction = predict_flatness(machine, arguments.vertical, limits, errors)
    layout = layout_of(arguments)
    surfaces = {name: read_workpiece(path, prediction, layout) for name, path in measured.items() if path is not None}
    told = [flatness_text(prediction), *_intervals(machine, prediction, stated)]
    trajectory = trajectory_csv(prediction, arguments.step_mm * 1e-3) if arguments.trajectory else ""
    noise = None if arguments.height_noise_um is None else arguments.height_noise_um * 1e-6
    contradiction = surfaces["before"].contradiction if "before" in surfaces else None
    told += [measured_text(*each, noise) for each in surfaces.items()]
    told += _fate(contradiction, arguments.trajectory, arguments.force)
    print("\n".join(told))
    if arguments.trajectory and (contradiction is None or arguments.force):
        write_whole(arguments.trajectory, trajectory.encode())
    if arguments.figure:
        from rotary_error_monitor.report.flatness import draw_flatness

        draw_flatness(arguments.figure, prediction, surfaces)
    return 0 if contradiction is None or arguments.force else NOT_GOOD


def _fate(contradiction: str | None, trajectory: Path | None, force: bool) -> list[str]:
    """What a surface contradicts, and whether a trajectory is written all the same; nothing where all fits."""
    if contradiction is None:
        return []
    written = [] if trajectory is None or force else [f"{trajectory} not written; --force writes it all the same"]
    return [f"does not fit: {contradiction}", *written]


def _check_surfaces(arguments: argparse.Namespace) -> None:
    """Refuse what is said of measured surfaces where none is given.

    Raises:
        InputError: something is said of them.
    """
    if arguments.measured is not None or arguments.measured_after is not None:
        return
    said = {"--height-noise-um": arguments.height_noise_um is not None, "--columns": bool(arguments.columns)}
    for option in (option for option, is_given in said.items() if is_given):
        raise InputError(f"{option} is of measured surfaces, and there is none; give --measured or --measured-after")


def _intervals(machine: MachineDescription, prediction: FlatnessPrediction, stated: Mapping[str, Path]) -> list[str]:
    """What the covariances of the curves, by axis, say of a prediction; nothing without them.

    Raises:
        InputError: they are not of both axes, or not of the curves of the machine file.
    """
    if not stated:
        return []
    if set(stated) != set(prediction.feeds):
        raise InputError(f"--covariance of {', '.join(stated)}; expected one of each of {', '.join(prediction.feeds)}")
    doubts: dict[str, CurveDoubt] = {}
    for letter, path in stated.items():
        doubts[letter] = read_covariance(path)
        check_curve(machine, prediction.vertical, letter, doubts[letter])
    return [bounds_text(prediction, predict_bounds(prediction, doubts))]
