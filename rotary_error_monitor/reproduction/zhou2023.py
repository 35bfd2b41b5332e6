"""Zhou, Zheng, Li, Yuan, Wang, Fang, Xu: Splicing Measurement and Compensation of Straightness Errors (2023).

Z is measured along a short mirror in two placements (Figures 6 to 9) and along a long one (Figures 10, 11), X along the
long one in two placements (Figure 12). Both curves are rotated (Figure 13), the error matrix of the workpiece becomes
what the wheel follows (Figure 15), and a workpiece is ground without it and with it (Figures 16, 17).
"""

from __future__ import annotations

from dataclasses import dataclass

from rotary_error_monitor.reproduction import zhou2023_figures as figures
from rotary_error_monitor.reproduction import zhou2023_plant as plant
from rotary_error_monitor.reproduction.procedure import Bench, ProcedureStep, Reproduction
from rotary_error_monitor.reproduction.units import UM
from rotary_error_monitor.reproduction.zhou2023_rows import Results, rows

PAPER = (
    "L. Zhou, N. Zheng, J. Li, Z. Yuan, J. Wang, F. Fang, Q. Xu: Splicing Measurement and Compensation of Straightness "
    "Errors for Ultra-Precision Guideways. Micromachines 2023, 14, 1670"
)
SIMULATED = (
    "guideways, mirrors, sensor, the vertical axis and grinding, by closed forms that share no formula with the "
    "commands. As in the paper: mirrors of 440 mm and 0.08 µm and of 840 mm and 0.12 µm, five runs each way at 600 "
    "mm/min and 100 ms, placements, a sensor of ±60 nm, a positioning error of Y of 1.2 µm, a workpiece of 1400 mm x "
    "500 mm. Chosen so that the paper's ranges come out: the shapes of X (5.5 µm) and Z (5.8 µm; 7.54 µm on the "
    "workpiece), and what grinding itself leaves (2.98 µm after compensation). Chosen, for the paper prints no number: "
    "forms of the mirrors, how runs differ, where the workpiece lies along Z, reversal error of Y (3 µm), distance of "
    "the passes."
)

MACHINE = "grinder.yaml"
_NOISE = f"{plant.SENSOR_NOISE / UM:.3f}"
_SHORT = ("--mirror-length-mm", "440", "--mirror-flatness-um", "0.08")
_LONG = ("--mirror-length-mm", "840", "--mirror-flatness-um", "0.12")
_DIRECT = ("--direct", "z_direct.csv", "--direct-mirror-length-mm", "840", "--direct-flatness-um", "0.12")
_WORKPIECE = ("--vertical", "Y", "--workpiece", "X=-1400,0", "Z=-650,-150", "--positioning-um", "1.2")
_INTERFEROMETER = "0.005"
"""Flatness (µm) that an interferometer leaves of a mirror: its noise of 1 nm from peak to valley."""


@dataclass(frozen=True)
class Zhou2023:
    """The procedure.

    Attributes:
        bench: where it is carried out.
        grinder: what is true.
    """

    bench: Bench
    grinder: plant.ZhouGrinder

    def carry_out(self) -> Reproduction:
        """Measure mirrors and guideways, splice, compare, rotate, grind.

        Raises:
            InputError: a command failed, or the folder holds results already.
        """
        self.grinder.write_machine(self.bench.path(MACHINE))
        steps = [
            self._mirror(),
            self._spliced(),
            self._direct(),
            self._compared(),
            self._known_mirror(),
            self._second_axis(),
            self._trajectory(),
            self._workpiece("with", "workpiece_after.csv"),
            self._workpiece("unrotated", "workpiece_unrotated.csv"),
            self._table(),
        ]
        said = Results(self.bench.folder, {step.title: step.said for step in steps})
        return Reproduction("zhou2023", PAPER, SIMULATED, tuple(steps), tuple(rows(said)))

    def _straightness(self, source: str, component: str, *more: str) -> tuple[str, str]:
        return self.bench.run(
            *("calibrate", "straightness", source, "--machine", MACHINE, "--component", component),
            *("--noise-um", _NOISE, *more),
        )

    def _mirror(self) -> ProcedureStep:
        self.grinder.write_mirror(self.bench.path("mirror_1.csv"), plant.MIRROR_1)
        self.grinder.write_mirror(self.bench.path("mirror_2.csv"), plant.MIRROR_2)
        return ProcedureStep(
            "Measure the mirrors by an interferometer",
            "Section 2.2, Figure 4",
            figures=(figures.mirror_form(self.bench.path("mirror_1.csv")),),
            about="Simulated only; mirror_1.csv and mirror_2.csv hold what the interferometer shows.",
        )

    def _spliced(self) -> ProcedureStep:
        source = self.bench.path("z_spliced.csv")
        self.grinder.write_runs(source, plant.Z, plant.MIRROR_1, (-0.8, -0.44))
        told = self._straightness(source.name, "EYZ", *_SHORT, "--monotone")
        first, second = figures.placements(source, plant.SENSOR_NOISE)
        line = figures.stated_curve(self.bench.path(MACHINE), "EYZ")
        return ProcedureStep(
            "Splice Z from two placements of mirror No. 1",
            "Section 2, Equation 1, Figures 6 to 9",
            *told,
            (
                figures.runs(6, first),
                figures.repeatability(first),
                figures.runs(8, second),
                figures.straightness("Figure 9: straightness of Z, spliced", line),
            ),
            "Equation 1 as printed, both sines with the same sign, is no rotation; the command takes a rotation.",
        )

    def _direct(self) -> ProcedureStep:
        source = self.bench.path("z_direct.csv")
        # the mirror is 40 mm longer than the travel: 20 mm at either end stay unused
        self.grinder.write_runs(source, plant.Z, plant.MIRROR_2, (-0.82,))
        told = self._straightness(source.name, "EYZ", *_LONG, "-o", "direct.yaml")
        line = figures.stated_curve(self.bench.path("direct.yaml"), "EYZ")
        return ProcedureStep(
            "Measure Z directly along mirror No. 2",
            "Section 2.2, Figure 10",
            *told,
            (figures.straightness("Figure 10: straightness of Z, along mirror No. 2", line),),
        )

    def _compared(self) -> ProcedureStep:
        told = self._straightness(
            "z_spliced.csv", "EYZ", *_SHORT, *_DIRECT, "-o", "compared.yaml", "--figure", "compared.png"
        )
        lines = [figures.stated_curve(self.bench.path(name), "EYZ") for name in (MACHINE, "direct.yaml")]
        return ProcedureStep(
            "Compare the two",
            "Section 2.2, Figure 11",
            *told,
            (
                figures.difference(*lines),
                self.bench.picture("compared.png", "What the command draws of the comparison"),
            ),
        )

    def _known_mirror(self) -> ProcedureStep:
        told = self._straightness(
            *("z_spliced.csv", "EYZ", *_SHORT[:3], _INTERFEROMETER),
            *("--mirror-profile", "mirror_1.csv", "-o", "known_mirror.yaml"),
        )
        return ProcedureStep(
            "Splice Z with the measured form of mirror No. 1 taken off",
            "not in the paper, which neglects the mirror",
            *told,
            about="Overlaps do not show a mirror's curvature: spliced, it looks like a bow of the guideway.",
        )

    def _second_axis(self) -> ProcedureStep:
        source = self.bench.path("x_spliced.csv")
        self.grinder.write_runs(source, plant.X, plant.MIRROR_2, (-1.4, -0.84))
        told = self._straightness(source.name, "EYX", *_LONG, "--monotone")
        line = figures.stated_curve(self.bench.path(MACHINE), "EYX")
        return ProcedureStep(
            "Splice X from two placements of mirror No. 2",
            "Section 2.2, Figure 12",
            *told,
            (figures.straightness("Figure 12: straightness of X, spliced", line),),
        )

    def _trajectory(self) -> ProcedureStep:
        told = self.bench.run("calibrate", "flatness", MACHINE, *_WORKPIECE, "--trajectory", "wheel.csv")
        wheel = figures.SurfaceTable(self.bench.path("wheel.csv"))
        for name, column in (("after", "Y_correction_um"), ("unrotated", "error_um")):
            sign = -1.0 if column == "error_um" else 1.0
            self.grinder.write_surface(self.bench.path(f"workpiece_{name}.csv"), sign * wheel.values(column))
        self.grinder.write_surface(self.bench.path("workpiece_before.csv"), None)
        rotations = [figures.rotated(self.bench.path(MACHINE), name) for name in ("EYX", "EYZ")]
        shown = figures.surface("Figure 15: trajectory of the wheel", wheel, wheel.values("Y_correction_um"))
        return ProcedureStep(
            "Rotate both curves, and make the wheel's trajectory of the error matrix",
            "Section 3.1, Equation 2, Figures 13 and 15",
            *told,
            (*rotations, shown),
        )

    def _workpiece(self, how: str, after: str) -> ProcedureStep:
        picture = f"flatness_{how}.png"
        measured = ("--measured", "workpiece_before.csv", "--measured-after", after, "--height-noise-um", _NOISE)
        told = self.bench.run(
            *("calibrate", "flatness", MACHINE, *_WORKPIECE, "--reversal-um", f"{plant.REVERSAL / UM:g}"),
            *measured,
            *(("--figure", picture) if how == "with" else ()),
        )
        names = {16: "workpiece_before.csv", 17: after} if how == "with" else {0: after}
        titles = {
            16: "Figure 16: ground without compensation",
            17: "Figure 17: ground with compensation",
            0: "Ground with curves that are not rotated",
        }
        tables = {number: figures.SurfaceTable(self.bench.path(name)) for number, name in names.items()}
        maps = [figures.surface(titles[n], table, table.levelled("height_um")) for n, table in tables.items()]
        if how != "with":
            title, source = "Grind with the curves as measured instead", "Section 3.1 says why not, and shows no result"
            return ProcedureStep(title, source, *told, tuple(maps))
        maps.append(self.bench.picture(picture, "What the command draws of prediction and measurement"))
        return ProcedureStep(
            "Grind a workpiece without and with compensation",
            "Section 3.2, Figures 14, 16 and 17",
            *told,
            tuple(maps),
            "Simulated is the true surface. The paper says that it measured with the sensor on the machine, whose own "
            "straightness then is in the readings unless it was taken off.",
        )

    def _table(self) -> ProcedureStep:
        told = self.bench.run("calibrate", "tables", MACHINE, "--grid", "X=141", "Z=81", "-o", "compensation.csv")
        return ProcedureStep("Write the compensation table of the controller", "Section 3.1", *told)


def reproduce(bench: Bench, seed: int) -> Reproduction:
    """Carry the procedure of the paper out in the folder of the bench."""
    return Zhou2023(bench, plant.ZhouGrinder(seed)).carry_out()
