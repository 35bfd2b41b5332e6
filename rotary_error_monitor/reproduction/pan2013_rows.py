"""Each number of Pan et al. 2013, Section 6 and Tables 1 and 2, beside the one of a reproduction."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.reproduction.procedure import PaperComparison
from rotary_error_monitor.reproduction.units import ARCSEC, DEGREE, MM

_CHOSEN = "lost motion and scatter are chosen so that the median over many tests is the paper's"


@dataclass(frozen=True)
class Printed:
    """A figure of positioning that the paper prints.

    Attributes:
        figure: its name in the machine file.
        name: what the paper calls it.
        value: m or rad.
        text, table: as printed in Section 6 and in Table 2; empty where it is not there.
        rounding: how far the value in the table may be from the exact one, m or rad.
        sampling: part of the value within which 99.9 % of such tests lie, from 40,000 simulated ones.
    """

    figure: str
    name: str
    value: float
    text: str
    table: str
    rounding: float
    sampling: float


POSITIONING: Mapping[str, tuple[Printed, ...]] = {
    "X": (
        Printed("reversal_error", "backlash", 4.950e-6, "0.004950 mm", "", 0.0, 0.25),
        Printed("accuracy", "positioning accuracy", 69.909e-6, "0.069909 mm", "0.07/6000", 5e-6, 0.051),
        Printed("repeatability", "repeat positioning accuracy", 9.122e-6, "0.009122 mm", "00.1/6000", 5e-6, 0.28),
    ),
    "Y": (
        Printed("reversal_error", "backlash", 7.050e-6, "0.007050 mm", "", 0.0, 0.044),
        Printed("accuracy", "positioning accuracy", 53.431e-6, "0.053431 mm", "0.05/2000", 5e-6, 0.017),
        Printed("repeatability", "repeat positioning accuracy", 8.061e-6, "0.008061 mm", "0.008/2000", 5e-7, 0.076),
    ),
    "Z": (
        Printed("reversal_error", "backlash", 10.150e-6, "0.010150 mm", "", 0.0, 0.021),
        Printed("accuracy", "positioning accuracy", 24.393e-6, "0.024393 mm", "0.024/2000", 5e-7, 0.024),
        Printed("repeatability", "repeat positioning accuracy", 10.819e-6, "0.010819 mm", "0.011/2000", 5e-7, 0.04),
    ),
    "A": (Printed("accuracy", "positioning error", 0.016 * DEGREE, "", "0.016/360", 5e-4 * DEGREE, 0.019),),
    "C": (Printed("accuracy", "positioning error", 0.0372 * DEGREE, "", "0.0372/360", 5e-5 * DEGREE, 0.009),),
}

STRAIGHTNESS: Mapping[str, tuple[str, str, str]] = {
    "EYX": ("X-axis in XY plane", "0.00552 mm", "0.035/5000"),
    "EZX": ("X-axis in XZ plane", "0.00779 mm", "0.035/5000"),
    "EXY": ("Y-axis in XY plane", "0.00571 mm", "0.025/2500"),
    "EZY": ("Y-axis in YZ plane", "0.00211 mm", "0.005/2500"),
}
"""What, in the text of Section 6, and in Table 2."""

BOUNDS = 2.0
"""Times its bounds of 95 % that a measured relation may be off: four standard uncertainties, for the table has ten."""

_DIGIT = 5e-4
"""Half of the last digit of Table 2 between axes, mm."""

RELATIONS: tuple[tuple[str, str, str, float, int, str], ...] = (
    ("squareness", "Y-Z", "0.017/500", 0.017, 500, ""),
    ("squareness", "X-Y", "0.026/500", 0.026, 500, ""),
    ("squareness", "X-Z", "0.026/500", 0.026, 500, ""),
    ("perpendicularity", "C-XY plane", "0.006/300", 0.006, 300, ""),
    ("squareness", "A-C", "0.021/300", 0.021, 300, ""),
    ("squareness", "spindle-A", "0.003/80", 0.003, 80, ""),
    ("coplanarity", "spindle-A", "0.019", 0.019, 0, ""),
    ("coplanarity", "A-C", "0.020", 0.020, 0, ""),
    ("concentricity", "spindle-C", "0.014", 0.014, 0, "; told at the spindle's nose, for the paper does not say where"),
    (
        "perpendicularity",
        "spindle-XY plane",
        "0.006/30",
        0.006,
        300,
        "; the table's 30 mm is read as 300, for the text has 89.999°, the same as for C",
    ),
)
"""Rows of Table 2 between axes: item and axes as `calibrate squareness` names them, as printed, mm, over mm, remark."""

ANGLES: tuple[tuple[str, str, float], ...] = (
    ("squareness", "A-C", 89.996),
    ("squareness", "X-Y", 89.998),
    ("squareness", "X-Z", 89.998),
    ("squareness", "Y-Z", 89.997),
    ("perpendicularity", "C-XY plane", 89.999),
    ("perpendicularity", "spindle-XY plane", 89.999),
)
"""Angles of the text of Section 6, degrees."""

TEXT_FROM_TABLE = 1.5e-3
"""Degrees by which the text's angles, in steps of 0.001, may be from the table's: they are by up to 1.2 steps."""

TABLE_1 = (
    *("0123456789", "0002345678", "0000234567", "0000023456", "0000002345", "0000000234", "0000000023"),
    *("0000000002", "0000000000"),
)
"""The low-order body array as printed, L^0 to L^8, a digit a body."""

_RELATION = re.compile(
    r"^  (?P<item>\w+) (?P<axes>\S+(?: plane)?) +(?P<value>-?[\d.]+)"
    r"(?:/\d+ +(?P<degrees>[\d.]+)° +(?P<arcsec>-?[\d.]+))? +(?P<low>-?[\d.]+) … (?P<high>-?[\d.]+)(?:″| mm)$",
    re.MULTILINE,
)


def positioning_rows(noted: Mapping[str, Any]) -> Iterator[PaperComparison]:
    """Rows of Section 6 and Table 2, from what `calibrate positioning` noted in the machine file."""
    for letter, figures in POSITIONING.items():
        rotary = letter in "AC"
        found = noted[f"E{letter}{letter}"]["figures"]
        for each in figures:
            value = float(found[each.figure])
            symbol = {"accuracy": "A", "repeatability": "R", "reversal_error": "B"}[each.figure]
            shown = f"{value / DEGREE:.5f}°" if rotary else f"{value / MM:.6f} mm"
            kept = each.sampling * each.value
            why = f"{_CHOSEN}; 99.9 % of tests lie within {each.sampling * 100:.2g} % of it"
            if each.text:
                quantity = f"{letter}-axis {each.name} (Section 6), {symbol} of ISO 230-2"
                yield PaperComparison(quantity, each.text, shown, why, abs(value - each.value) <= kept)
            if each.table:
                why = "read as degrees over a turn; " + why if rotary else "rounded in the table"
                why += "; 00.1 is read as 0.01, for the text has 0.009122" if each.table.startswith("00.1") else ""
                holds = abs(value - each.value) <= kept + each.rounding
                yield PaperComparison(f"{letter}-axis {each.name} (Table 2)", each.table, shown, why, holds)


def straightness_rows(noted: Mapping[str, Any]) -> Iterator[PaperComparison]:
    """Rows of Section 6 and Table 2, from what `calibrate straightness` noted in the machine file."""
    for name, (what, text, table) in STRAIGHTNESS.items():
        figures = noted[name]["figures"]
        value, unsure = (float(figures[key]) / MM for key in ("straightness", "straightness_uncertainty"))
        shown = f"{value:.5f} ± {2 * unsure:.5f} mm"
        # within four standard uncertainties: of four curves in ten thousand runs one is not
        holds = abs(value - float(text.partition(" ")[0])) <= 4 * unsure
        why = "about the line of least squares; the curve's size is chosen as in the text; ± two standard uncertainties"
        yield PaperComparison(f"straightness of {what} (Section 6)", text, shown, why, holds)
        why = "not used: the table contradicts the text, which goes with Figures 14 to 17"
        yield PaperComparison(f"straightness of {what} (Table 2)", table, shown, why)


def relation_rows(said: str) -> Iterator[PaperComparison]:
    """Rows of Table 2 between axes and of the angles in Section 6, from what `calibrate squareness` printed.

    Raises:
        InputError: a relation of the paper is not in it.
    """
    found = {(match["item"], match["axes"]): match for match in _RELATION.finditer(said)}
    missing = [f"{row[0]} {row[1]}" for row in (*RELATIONS, *ANGLES) if (row[0], row[1]) not in found]
    if missing:
        raise InputError(f"calibrate squareness prints no {', '.join(missing)}, which Table 2 has: {said}")
    for item, axes, printed, size, length, remark in RELATIONS:
        match = found[item, axes]
        scale = length * ARCSEC if length else 1.0
        value = abs(float(match["arcsec"] if length else match["value"])) * scale
        half = (float(match["high"]) - float(match["low"])) / 2 * scale
        over = f"/{length}" if length else ""
        yield PaperComparison(
            f"{item} {axes} (Table 2)",
            f"{printed} mm",
            f"{value:.4f} ± {half:.4f}{over} mm",
            f"true in the simulation as printed, seen by a tracker; ± are bounds of 95 %{remark}",
            abs(value - size) <= BOUNDS * half + _DIGIT,
        )
    for item, axes, angle in ANGLES:
        match = found[item, axes]
        half = (float(match["high"]) - float(match["low"])) / 2 * ARCSEC / DEGREE
        yield PaperComparison(
            f"{item} {axes} (Section 6, Figure 20)",
            f"{angle}°",
            f"{float(match['degrees']):.5f}° ± {half:.5f}°",
            "Table 2 is simulated, from which the text is off by up to 0.0012°; it prints steps of 0.001°",
            abs(float(match["degrees"]) - angle) <= BOUNDS * half + TEXT_FROM_TABLE,
        )


def model_rows(said: str) -> Iterator[PaperComparison]:
    """Rows of Table 1 and of Equations 10 to 15, from what `offset --array text` printed."""
    rows = re.findall(r"^  L\^\d+\(j\) +([\d ]+)$", said, re.MULTILINE)
    array = tuple(row.replace(" ", "") for row in rows)
    yield PaperComparison(
        "low-order body array L^0 to L^8 (Table 1)",
        " ".join(TABLE_1[1]) + " in row L^1",
        " ".join("".join(array[1:2])) + " in row L^1",
        "all rows are the same for bodies 0 to 9; the paper's head is one column off and says 1 to 10",
        array == TABLE_1,
    )
    plain = " ".join(said.split())
    for name, paper, parts in _EQUATIONS:
        holds = all(part in plain for part in parts)
        why = "the same symbols; ΔT_01,p is not among these errors: the paper measures none at the workpiece"
        yield PaperComparison(name, paper, "the same" if holds else "others", why if "ΔT" in paper else "", holds)


_EQUATIONS = (
    (
        "characteristic matrices T_02, T_23 (Equations 11, 12)",
        "ΔT_02,p = I; ΔT_23,p has Δγ_xy alone; ΔT_s have six errors each",
        (
            "T_02,p = ΔT_02,p = I",
            "ΔT_23,p = [ 1 -Δγ_xy 0 0 ] [ Δγ_xy 1 0 0 ] [ 0 0 1 0 ] [ 0 0 0 1 ]",
            "ΔT_02,s = [ 1 -Δγ_y Δβ_y Δx_y ] [ Δγ_y 1 -Δα_y Δy_y ] [ -Δβ_y Δα_y 1 Δz_y ]",
            "ΔT_23,s = [ 1 -Δγ_x Δβ_x Δx_x ] [ Δγ_x 1 -Δα_x Δy_x ] [ -Δβ_x Δα_x 1 Δz_x ]",
        ),
    ),
    (
        "offset of tool and workpiece (Equations 13 to 15)",
        "0T_t = T_02 T_23 … T_89 T_t; E = 0T_t - 0T_w",
        ("0T_w = T_01 T_w", "0T_t = T_02 T_23 T_34 T_45 T_56 T_67 T_78 T_89 T_t", "E = 0T_t - 0T_w"),
    ),
)
"""What, in short, and the lines that say so."""
