"""Lou, Hao, Cai, Lu, Wang, Fan: An Embedded Sensor System for Real-Time Detecting 5-DOF Error Motions (Sensors 2019).

The autocollimator is calibrated (Figure 5), ring and mirror are measured on the shaft between centres (Figures 3, 7,
8), error motion is separated (Figures 9 to 11), and an LVDT verifies it at two heights (Figures 13, 14) and while
forces push at the shaft (Figure 15).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.files import write_whole
from rotary_error_monitor.notebook.estimates import estimate
from rotary_error_monitor.notebook.recording import read_bag
from rotary_error_monitor.reproduction.lou2019_figures import Readings, original_errors, separated_errors, verified
from rotary_error_monitor.reproduction.lou2019_plant import LEFT_BY_A_LINE, REFERENCE, LouStage
from rotary_error_monitor.reproduction.procedure import Bench, PaperComparison, ProcedureStep, Reproduction
from rotary_error_monitor.reproduction.units import ARCSEC, UM

PAPER = (
    "Z.-F. Lou, X.-P. Hao, Y.-D. Cai, T.-F. Lu, X.-D. Wang, K.-C. Fan: An Embedded Sensor System for Real-Time "
    "Detecting 5-DOF Error Motions of Rotary Stages. Sensors 2019, 19"
)
SIMULATED = (
    "stage, read heads, autocollimator, LVDT, centres and the reference autocollimator, by exact geometry that shares "
    "no formula with the commands. As in the paper: ring of 200 mm and 0.412 arcsec with four heads, 50,000 samples a "
    "second, a turn a second, an autocollimator of ±100 arcsec with 0.1 arcsec resolution, a reference of ±0.2 arcsec, "
    "an LVDT of ±0.1 µm at 5, 16 and 60 mm. Chosen, for the paper prints no number: error motion, eccentricity, "
    "graduation and mirror, run-out of the centres, forces, and how long is recorded."
)

STAGE, STEPS, BETWEEN = "stage.yaml", "autocollimator_steps.csv", "between_centres"
RADIAL_MOST, RESIDUAL_MOST = 20e-6, 2e-6
"""Radial error motion and residual that the paper states as bounds, m (Section 3.3)."""

_CENTRES = ("--centre-radial-um", "0.3", "--centre-lean-arcsec", "0.3")


@dataclass(frozen=True)
class Verified:
    """A comparison with the LVDT.

    Attributes:
        name: of the recording.
        height: of the LVDT, mm.
        step: with what the command printed.
        result: what it wrote as JSON.
    """

    name: str
    height: float
    step: ProcedureStep
    result: Mapping[str, Any]

    @property
    def comparison(self) -> Mapping[str, Any]:
        """That of the one reference."""
        found: Mapping[str, Any] = self.result["comparisons"][0]
        return found

    @property
    def largest(self) -> float:
        """Largest residual of either axis, m."""
        figures = self.result["figures"]
        return max(float(each["value"]) for each in figures if each["name"].endswith("difference_largest"))

    @property
    def radial(self) -> float:
        """Largest range over a turn that monitor or LVDT show on an axis, m."""
        turnings = self.comparison["over_angle"]
        return max(
            float(np.ptp(each[f"{who}_{a}"])) for each in turnings for who in ("estimate", "reference") for a in "xy"
        )


@dataclass(frozen=True)
class Lou2019:
    """The procedure.

    Attributes:
        bench: where it is carried out.
        stage: what is true.
    """

    bench: Bench
    stage: LouStage

    def carry_out(self) -> Reproduction:
        """Simulate, measure, calibrate, verify.

        Raises:
            InputError: a command failed, or the folder holds results already.
        """
        self.stage.write_known(self.bench.path(STAGE))
        steps = [self._collimator(), self._assembly(), self._separation()]
        checks = [self._verification(13, "plain_5_mm", 5, 1), self._verification(14, "plain_60_mm", 60, 2)]
        checks += [self._verification(15, f"pushed_{k}", 16, 2 + k, pushed=True) for k in (1, 2)]
        rows = (*self._instruments(), *self._original_errors(), *self._verifications(checks))
        return Reproduction("lou2019", PAPER, SIMULATED, (*steps, *(each.step for each in checks)), rows)

    @cached_property
    def _calibrated(self) -> StageDescription:
        return load_stage(self.bench.path(STAGE))

    def _collimator(self) -> ProcedureStep:
        self.stage.write_collimator_steps(self.bench.path(STEPS))
        reference = f"{REFERENCE / math.sqrt(3):.3f}"
        told = self.bench.run(
            *("calibrate", "autocollimator", STEPS, "--stage", STAGE, "--reference-arcsec", reference),
            *("--figure", "autocollimator.png"),
        )
        picture = self.bench.picture("autocollimator.png", "Figure 5: calibration of the autocollimator")
        return ProcedureStep(
            "Calibrate the miniature autocollimator",
            "Section 2.2, Figures 4 and 5",
            *told,
            (picture,),
            "The instrument is bent so that a straight line leaves what the paper's Figure 5 leaves.",
        )

    def _assembly(self) -> ProcedureStep:
        self.stage.record_between_centres(self.bench.path(BETWEEN))
        told = self.bench.run("calibrate", "assembly", BETWEEN, "--stage", STAGE, *_CENTRES)
        figures = original_errors(Readings(self.bench.path(BETWEEN), self._calibrated))
        return ProcedureStep(
            "Measure the original errors of ring and mirror between centres",
            "Sections 2.1 and 3.1, Equation 3, Figures 3, 7 and 8",
            *told,
            figures,
        )

    def _separation(self) -> ProcedureStep:
        bag = self.bench.path("plain_5_mm")
        self.stage.record(bag, 0.005, 1)
        told = self.bench.run("replay", bag.name, "--twin", STAGE, "-o", "plain_5_mm.npz")
        figures = separated_errors(Readings(bag, self._calibrated), estimate(bag, self.bench.path(STAGE)))
        return ProcedureStep(
            "Separate the error motion from the errors of ring and mirror",
            "Section 3.2, Equations 3 to 6, Figures 9 to 11",
            *told,
            figures,
        )

    def _verification(self, figure: int, name: str, height: int, run: int, *, pushed: bool = False) -> Verified:
        bag = self.bench.path(name)
        if not bag.exists():
            self.stage.record(bag, height * 1e-3, run, pushed)
        stage = self._at_height(height)
        told = self.bench.run(
            *("compare", name, "--twin", stage, "--height", str(height), "--format", "html,json,png"),
            *("-o", f"{name}.html"),
            accepted=(0, 10),
        )
        result = json.loads(self.bench.path(f"{name}.json").read_text(encoding="utf-8"))
        whole = self.bench.picture(f"{name}.png", f"Figure {figure}: LVDT and monitor over angle and time")
        pictures = (whole,) if pushed else verified(figure, result["comparisons"][0])
        what = "while forces push at the shaft" if pushed else "against the LVDT"
        step = ProcedureStep(
            f"Verify the radial error motion at {height} mm {what}",
            f"Section 3.3, Equation 7, Figures 12 and {figure}",
            *told,
            pictures,
            f"The LVDT's height is in the description as {height} mm ({stage}).",
        )
        return Verified(name, height, step, result)

    def _at_height(self, height: int) -> str:
        """Name of the calibrated stage file with the LVDT at a height, mm."""
        text = self.bench.path(STAGE).read_text(encoding="utf-8")
        assert self._calibrated.reference is not None
        described = f"height: {self._calibrated.reference.height}"
        assert text.count(described) == 1, "the LVDT's is the one height in the file"
        name = f"stage_lvdt_{height}_mm.yaml"
        write_whole(self.bench.path(name), text.replace(described, f"height: {height * 1e-3:g}").encode())
        return name

    def _instruments(self) -> Iterator[PaperComparison]:
        ring = self._calibrated.ring
        count = ring.resolution / ARCSEC
        yield PaperComparison(
            "resolution of the encoder (Section 3)",
            "0.412 arcsec",
            f"{count:.4f} arcsec",
            "31,488 lines of 100 counts, rounded in the paper",
            abs(count - 0.412) < 5e-4,
        )
        radial = ring.disc_radius * math.tan(ring.resolution / 2) / UM
        yield PaperComparison(
            "resolution of the radial error (Equation 3)",
            "0.10 µm",
            f"{radial:.3f} µm",
            "with a radius of 100 mm: the 200 mm that the paper prints as the radius is the diameter of that ring",
            abs(radial - 0.10) < 5e-3,
        )
        command = read_bag(self.bench.path("plain_5_mm"))["command"]
        moved = np.abs(np.diff(command["angle"]))
        interval = float(np.median(moved[moved > 0.9 * moved.max()])) / ARCSEC
        yield PaperComparison(
            "angle between two samples at one turn a second (Section 3)",
            "25.9 arcsec",
            f"{interval:.2f} arcsec",
            "rounded in the paper",
            abs(interval - 25.9) < 0.05,
        )
        for axis, name in enumerate("XY"):
            line, found = self._residual_of_steps(axis)
            yield PaperComparison(
                f"autocollimator, residual in {name} within ±100 arcsec (Figure 5)",
                f"±{LEFT_BY_A_LINE[axis]} arcsec",
                f"±{line:.2f} arcsec by a line, ±{found:.2f} arcsec by the command",
                f"of readings at steps along {name}; what the command prints is of all steps, those across as well. "
                "The instrument is simulated so that a line leaves the paper's residual, beside the reference's own "
                "±0.2 arcsec; the command fits cubic terms too",
                found <= LEFT_BY_A_LINE[axis],
            )

    def _residual_of_steps(self, axis: int) -> tuple[float, float]:
        """Largest residual, arcsec, of the steps along an axis: from a straight line, and as calibrated."""
        rows = np.genfromtxt(self.bench.path(STEPS), delimiter=",", names=True, dtype=None, encoding="utf-8")
        reference = np.stack([rows["reference_x_arcsec"], rows["reference_y_arcsec"]], axis=1)
        read = np.stack([rows["tilt_x_arcsec"], rows["tilt_y_arcsec"]], axis=1)
        along = reference[:, 1 - axis] == 0
        x, y = reference[along, axis], read[along, axis]
        line = np.abs(y - np.polyval(np.polyfit(x, y, 1), x)).max()
        left = self._calibrated.response("autocollimator").corrected(read * ARCSEC) / ARCSEC - reference
        return float(line), float(np.abs(left[along, axis]).max())

    def _original_errors(self) -> Iterator[PaperComparison]:
        true, found = self.stage.true, self._calibrated
        off = np.array(found.ring.eccentricity) - np.array(true.ring.eccentricity)
        x, y = (value / UM for value in found.ring.eccentricity)
        yield PaperComparison(
            "eccentricity of the grid disc (Figure 7)",
            "no value",
            f"({x:.2f}, {y:.2f}) µm, off by {np.hypot(*off) / UM:.2f} µm",
            "the paper shows a curve; off by what the centres let the shaft go round",
        )
        off = np.array(found.mirror.tilt) - np.array(true.mirror.tilt)
        x, y = (value / ARCSEC for value in found.mirror.tilt)
        yield PaperComparison(
            "tilt of the mirror (Figure 8)",
            "no value",
            f"({x:.2f}, {y:.2f}) arcsec, off by {np.hypot(*off) / ARCSEC:.2f} arcsec",
            "the paper shows a curve; off by what the centres let the shaft lean",
        )

    def _verifications(self, checks: list[Verified]) -> Iterator[PaperComparison]:
        for each in checks:
            pushed = each.name.startswith("pushed")
            what = f"{each.height:g} mm" + (f", forces, {each.name[-1]}. time (Figure 15)" if pushed else "")
            if not pushed:
                yield PaperComparison(
                    f"radial error motion at {what} (Figures 13, 14)",
                    "less than 20 µm",
                    f"{each.radial / UM:.2f} µm",
                    "error motion is chosen so that the paper's bound holds at 60 mm",
                    each.radial < RADIAL_MOST,
                )
            yield PaperComparison(
                f"largest residual from the LVDT at {what}",
                "very consistent" if pushed else "less than 2 µm",
                f"{each.largest / UM:.2f} µm",
                "the simulated artefact is round and the LVDT stands still: what is left is noise and the calibration",
                each.largest < RESIDUAL_MOST,
            )
            yield PaperComparison(
                f"monitor and LVDT agree within the stated uncertainty at {what}",
                "no value",
                "yes" if each.result["agrees"] else "no",
                "the paper states no uncertainty of the monitor",
            )


def reproduce(bench: Bench, seed: int) -> Reproduction:
    """Carry the procedure of the paper out in the folder of the bench."""
    return Lou2019(bench, LouStage(seed)).carry_out()
