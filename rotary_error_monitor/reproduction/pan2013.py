"""Pan, Li, Yin: Error Model and Accuracy Calibration of 5-Axis Machine Tool (TELKOMNIKA 2013).

A laser interferometer measures positioning (Figures 11 to 13) and straightness (Figures 14 to 17), a laser tracker the
rotary axes (Figures 18, 19) and how axes and spindle lie beside each other (Figure 20); all fill one machine file
(Table 2), whose low-order body array (Table 1), characteristic matrices (Equations 5 to 12) and offset E (Equations 13
to 15) follow.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import yaml

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.reproduction import pan2013_figures, pan2013_rows
from rotary_error_monitor.reproduction.pan2013_plant import (
    CYCLES,
    POSITIONING,
    STRAIGHTNESS_NOISE,
    TRACKER_NOISE,
    PanMachine,
)
from rotary_error_monitor.reproduction.procedure import Bench, PaperComparison, ProcedureStep, Reproduction
from rotary_error_monitor.reproduction.units import ARCSEC, UM

PAPER = "F. Pan, M. Li, J. Yin: Error Model and Accuracy Calibration of 5-Axis Machine Tool. TELKOMNIKA 2013, page 4251"
SIMULATED = (
    "machine, laser interferometer and laser tracker, by closed forms and exact matrices that share no formula with "
    "the commands. As in the paper: bodies, order of axes, measured travels of 6000, 2000, 2000 mm, ±300° and ±110°; "
    "how axes and spindle lie beside each other as in Table 2. Amplitudes, lost motion and scatter are chosen so that "
    "the printed figures come out of an evaluation by ISO 230-2 and by least squares as far as sampling allows. Chosen "
    "freely, for the paper prints no number: forms of the curves, targets and cycles, lost motion and scatter of A and "
    "C, noise of the instruments, lengths of head and tool. Angular errors of X, Y, Z, straightness of Z and radial "
    "errors of A and C are not in the paper, and zero."
)

MACHINE, TRACKER, POSES = "machine.yaml", "tracker.csv", "poses.csv"
POSITIONED = {"X": 11, "Y": 12, "Z": 13, "A": 18, "C": 19}
"""Figure of the positioning error of each axis."""

STRAIGHT = {"EYX": 14, "EZX": 15, "EXY": 16, "EZY": 17}
"""Figure of each straightness error."""

DRAWN_POSES = 60
"""Poses at which the measured machine is held against the simulated one."""


@dataclass(frozen=True)
class Pan2013:
    """The procedure.

    Attributes:
        bench: where it is carried out.
        machine: what is true.
    """

    bench: Bench
    machine: PanMachine

    def carry_out(self) -> Reproduction:
        """Simulate, measure, fill the machine file, predict.

        Raises:
            InputError: a command failed, or the folder holds results already.
        """
        self.machine.write_known(self.bench.path(MACHINE))
        steps = [self._positioning(letter) for letter in "XYZ"]
        steps += [self._straightness(name) for name in STRAIGHT]
        steps += [self._positioning(letter) for letter in "AC"]
        lines, model, offset, costs = self._lines(), self._model(), self._offset(), self._costs()
        rows = (
            *pan2013_rows.positioning_rows(self._noted),
            *pan2013_rows.straightness_rows(self._noted),
            *pan2013_rows.relation_rows(lines.said),
            *pan2013_rows.model_rows(model.said),
            self._prediction(),
            _dearest(costs.said),
        )
        return Reproduction("pan2013", PAPER, SIMULATED, (*steps, lines, model, offset, costs), rows)

    @cached_property
    def _noted(self) -> Mapping[str, Any]:
        """What the calibrations noted in the machine file, by what they measured."""
        noted: Mapping[str, Any] = yaml.safe_load(self.bench.path(MACHINE).read_text(encoding="utf-8"))["machine"]
        calibrations: Mapping[str, Any] = noted["calibration"]
        return calibrations

    def _positioning(self, letter: str) -> ProcedureStep:
        source, number, rotary = f"{letter.lower()}_positioning.csv", POSITIONED[letter], letter in "AC"
        self.machine.write_positioning(self.bench.path(source), letter)
        told = self.bench.run(
            *("calibrate", "positioning", source, "--machine", MACHINE, "--axis", letter, "--drop-outliers")
        )
        return ProcedureStep(
            f"Measure {'angular positioning' if rotary else 'positioning'} of {letter}",
            f"Section {'5' if rotary else '4'}, Section 6, Figure {number}",
            *told,
            (pan2013_figures.positioning(number, letter, self.bench.path(source)),),
            f"A laser {'tracker' if rotary else 'interferometer'} at {POSITIONING[letter].targets} targets over the "
            f"whole travel, {CYCLES} times both ways.",
        )

    def _straightness(self, name: str) -> ProcedureStep:
        source, number = f"{name.lower()}.csv", STRAIGHT[name]
        self.machine.write_straightness(self.bench.path(source), name)
        told = self.bench.run(
            *("calibrate", "straightness", source, "--machine", MACHINE, "--component", name),
            *("--noise-um", f"{STRAIGHTNESS_NOISE / UM:g}"),
        )
        return ProcedureStep(
            f"Measure straightness of {name[2]} in {name[1]}",
            f"Section 6, Figure {number}",
            *told,
            (pan2013_figures.straightness(number, name, self.bench.path(source)),),
            "A laser's beam is the reference, not a mirror; it is aligned to some 10 µrad.",
        )

    def _lines(self) -> ProcedureStep:
        self.machine.write_tracker(self.bench.path(TRACKER))
        distance, angle = TRACKER_NOISE
        told = self.bench.run(
            *("calibrate", "squareness", TRACKER, "--machine", MACHINE, "--distance-um", f"{distance / UM:g}"),
            *("--distance-ppm", "0", "--angle-arcsec", f"{angle / ARCSEC:g}", "--figure", "axes.png"),
        )
        picture = self.bench.picture("axes.png", "Figure 20: squareness and distances, with their bounds")
        return ProcedureStep(
            "Measure how axes and spindle lie beside each other",
            "Section 5, Equation 16, Section 6, Figures 10 and 20, Table 2",
            *told,
            (picture,),
            "A tracker sees a reflector at the spindle's nose go along X, Y, Z, and reflectors go round C, A and the "
            "spindle; readings are means of both ways of approach.",
        )

    def _model(self) -> ProcedureStep:
        told = self.bench.run("offset", MACHINE, "--array", "text")
        return ProcedureStep(
            "Low-order body array and characteristic matrices of the measured machine",
            "Section 3, Equations 2 to 12, Table 1, Figures 4 and 5",
            *told,
            about="Equation 5 prints sin α in the rotation about z, where the rotation needs sin γ.",
        )

    def _offset(self) -> ProcedureStep:
        self.machine.write_poses(self.bench.path(POSES), DRAWN_POSES)
        told = self.bench.run("offset", MACHINE, "--program", POSES, "-o", "offset.json")
        return ProcedureStep(
            "Offset E of tool and workpiece at poses drawn in the working volume",
            "Section 3.2, Equations 13 to 15",
            *told,
            about="The paper states the formula and no value of E.",
        )

    def _costs(self) -> ProcedureStep:
        told = self.bench.run("calibrate", "errors", MACHINE, "--figure", "errors.png")
        picture = self.bench.picture("errors.png", "Offset over X and Y, and errors by what each costs")
        return ProcedureStep("Which errors cost most", "Section 1: the main errors", *told, (picture,))

    def _prediction(self) -> PaperComparison:
        """The measured machine file against the simulated machine."""
        poses = json.loads(self.bench.path("offset.json").read_text(encoding="utf-8"))["poses"]
        predicted = np.array([list(each["exact"].values()) for each in poses])
        unsure = np.array([list(each["standard_uncertainty"].values()) for each in poses])
        off = predicted - np.array([self._true(each["pose"]) for each in poses]) / UM
        within = float(np.mean(np.abs(off) <= 2 * unsure))
        largest, offset = (np.linalg.norm(each[:, :3], axis=1).max() for each in (off, predicted))
        return PaperComparison(
            f"offset E predicted from the measured file at {len(poses)} drawn poses",
            "not in the paper",
            f"{within:.0%} within twice the standard uncertainty; off by {largest:.2f} of {offset:.0f} µm at most",
            "held against exact products of matrices of the simulated machine; errors of one measurement are the same "
            "at all poses, so that runs differ",
        )

    def _true(self, pose: Mapping[str, float]) -> Array:
        """(6,) offset of the simulated machine at a pose of `offset`, m and rad."""
        at = {name[0]: value * 1e-3 for name, value in pose.items() if name.endswith("_mm")}
        at |= {name[0]: math.radians(value) for name, value in pose.items() if name.endswith("_deg")}
        ways = {name[0]: value for name, value in pose.items() if name.endswith("_direction")}
        return self.machine.offset(at, ways)


def _dearest(said: str) -> PaperComparison:
    """The errors that cost most, from the ranking."""
    names = [line[:40].strip() for line in said.splitlines()[1:4]]
    why = "the paper does not rank errors; root mean square of the tool's offset by each alone in the working volume"
    return PaperComparison("errors that cost most", "no value", ", ".join(names), why)


def reproduce(bench: Bench, seed: int) -> Reproduction:
    """Carry the procedure of the paper out in the folder of the bench."""
    return Pan2013(bench, PanMachine(seed)).carry_out()
