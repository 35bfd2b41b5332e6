"""`rotary_error_monitor offset`: where the errors of a machine put the tool, and which body has what part in it."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rotary_error_monitor.commands.values import HELD, files_of, finite, number_of, split_word
from rotary_error_monitor.description.machine import MachineDescription, load_machine, machine_path
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_all
from rotary_error_monitor.recordings.formats import FORMATS

if TYPE_CHECKING:  # takes long to load, and is needed once the arguments are right
    from rotary_error_monitor.calibration.machine_poses import Poses

SIGNS = {"+": 1.0, "-": -1.0, "+1": 1.0, "1": 1.0, "-1": -1.0, "0": 0.0}
"""Directions of travel by how they may be written."""

COLDEST, WARMEST = -50.0, 150.0
"""Temperatures of a machine, °C: what its file may state as well."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "The offset is that of the tool as the workpiece sees it, x, y, z in µm and the rotation vector a, b, c in "
        "µrad. Exit codes: 0 done, 2 wrong input. doc/offset.md says what the figures mean."
    )
    parser.add_argument("machine", metavar="MACHINE", help="machine YAML, or the name of one that ships")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--at", nargs="+", metavar="X=100", help=f"one pose, mm or degrees; {HELD}")
    where.add_argument(
        "--program", type=Path, metavar="POSES.csv", help="poses, a row each: X_mm,…,C_deg,… and X_direction,… if known"
    )
    where.add_argument("--array", choices=("text", "latex"), help="print the low-order body array and all matrices")
    parser.add_argument(
        "--direction", nargs="+", default=[], metavar="X=+", help="by which way --at was reached, + or -; else unknown"
    )
    parser.add_argument(
        "--temperature", type=finite, metavar="DEGC", help="of --at (default: the file's reference temperature)"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help=f"file that ends in {', '.join(FORMATS)}")
    parser.add_argument(
        "--format", default="", metavar="LIST", help=f"of {','.join(FORMATS)}: files beside one another, named as OUT"
    )


def run(arguments: argparse.Namespace) -> int:
    """Compute, print the tables, and write the results."""
    outputs = _outputs(arguments)
    machine = load_machine(arguments.machine)
    if arguments.array:
        from rotary_error_monitor.report.characteristic import array_latex, array_text

        print(array_text(machine) if arguments.array == "text" else array_latex(machine))
        return 0
    poses = _poses(arguments, machine)
    from rotary_error_monitor.machine.budget import estimate_budget
    from rotary_error_monitor.report.offset import offset_text

    budget = estimate_budget(machine, poses.positions, direction=poses.direction, temperature=poses.temperature)
    print(offset_text(machine, poses, budget))
    if outputs:
        from rotary_error_monitor.report.offset import offset_contents

        source = str(arguments.program) if arguments.program else ""
        write_all(dict(offset_contents(machine, poses, budget, outputs, source)))
        print(f"written to {', '.join(map(str, outputs.values()))}")
    return 0


def _outputs(arguments: argparse.Namespace) -> Mapping[str, Path]:
    """File of each format; none where no output is given."""
    for name in ("direction", "temperature"):
        if getattr(arguments, name) not in ([], None) and not arguments.at:
            raise InputError(f"--{name} belongs to --at; a program has columns for it")
    if arguments.array and arguments.output is not None:
        raise InputError(f"-o is {arguments.output}; what --array prints is not written: redirect it by > to a file")
    outputs = files_of(arguments)
    check_outputs(outputs.values(), [machine_path(arguments.machine), arguments.program])
    check_places(outputs.values())
    return outputs


def _poses(arguments: argparse.Namespace, machine: MachineDescription) -> Poses:
    """Poses that were asked for.

    Raises:
        InputError: a word is wrong, or a pose beyond the travel.
    """
    import numpy as np

    from rotary_error_monitor.calibration.machine_poses import Poses, check_within_travel, read_poses

    if arguments.program:
        return read_poses(arguments.program, machine)
    position, direction = {axis.letter: axis.home for axis in machine.axes}, dict.fromkeys(machine.letters, 0.0)
    for words in (arguments.at, arguments.direction):
        named = [split_word(word)[0] for word in words]
        if twice := [name for name in named if named.count(name) > 1]:
            raise InputError(f"axis {twice[0]} is given twice: {' '.join(words)}; give it once")
    for name, text in map(split_word, arguments.at):
        scale, _ = machine.axis(name).shown
        position[name] = number_of(text, f"--at {name}={text}") / scale
        if not math.isfinite(position[name]):
            raise InputError(f"--at {name}={text}: expected a finite number of mm or degrees")
    for name, text in map(split_word, arguments.direction):
        if text not in SIGNS:
            raise InputError(f"--direction {name}={text}: expected + or -, or 0 where it is unknown")
        direction[machine.axis(name).letter] = SIGNS[text]
    pose = np.array([[position[letter] for letter in machine.letters]])
    check_within_travel("--at", machine, pose[0])
    warmth = machine.reference_temperature if arguments.temperature is None else arguments.temperature
    if not COLDEST <= warmth <= WARMEST:
        raise InputError(f"--temperature is {warmth:g}; expected °C from {COLDEST:g} to {WARMEST:g}")
    return Poses(pose, np.array([[direction[letter] for letter in machine.letters]]), np.array([warmth]))
