"""The low-order body array and the characteristic matrices of a machine as formulas (Pan et al. 2013, Equations 2-15).

Entries are LaTeX with the paper's symbols where they depend on the pose or are errors, and numbers in mm where they are
the constants of this machine. `plain` makes text of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Axis, Body, Displacement, ErrorComponent
from rotary_error_monitor.description.machine_tree import BASE
from rotary_error_monitor.machine.topology import way

Entries = tuple[tuple[str, ...], ...]
"""Rows of a matrix."""

GREEK = ("\\alpha", "\\beta", "\\gamma")
"""Letters of rotations about x, y, z."""

NEGLIGIBLE = 1e-12
"""Part of a matrix entry, in mm or without unit, that is rounding: a millionth of a nanometre."""

IDENTITY = "I_{4 \\times 4}"


@dataclass(frozen=True)
class Symbol:
    """What a symbol stands for: its LaTeX, and its value in this machine as LaTeX with its unit."""

    symbol: str
    value: str

    @property
    def is_zero(self) -> bool:
        """Whether it stands for an error that this machine is not described to have."""
        return self.value.endswith("= 0")


@dataclass(frozen=True)
class CharacteristicMatrices:
    """T = Tp ΔTp Ts ΔTs of one body in the frame of what carries it (Equations 5-9).

    Attributes:
        body: the body, V; `number` its number and `parent` that of the body S that carries it.
        matrices: Tp, ΔTp, Ts, ΔTs with their names in LaTeX; the entries are empty for an identity.
        symbols: what the symbols in them stand for.
    """

    body: Body
    number: int
    parent: int
    matrices: tuple[tuple[str, Entries], ...]
    symbols: tuple[Symbol, ...]

    @property
    def name(self) -> str:
        """LaTeX of the whole matrix, such as T_{23}."""
        return f"T_{{{_pair(self.parent, self.number)}}}"


def characteristic_matrices(machine: MachineDescription) -> tuple[CharacteristicMatrices, ...]:
    """Those of the bodies from the base to the workpiece, then to the tool; a body on both ways comes once."""
    numbers = body_numbers(machine)
    bodies = dict.fromkeys((*way(machine, machine.workpiece), *way(machine, machine.tool)))
    return tuple(_matrices(machine, body, numbers) for body in bodies)


def body_numbers(machine: MachineDescription) -> dict[str, int]:
    """Number of each body by its name, the base being 0 (Pan et al. 2013, Section 3.1)."""
    return {BASE: 0, **{body.name: number for number, body in enumerate(machine.bodies, start=1)}}


def chain_equations(machine: MachineDescription) -> tuple[str, ...]:
    """The products of the two ways and the error between them, in LaTeX (Equations 13-15)."""
    numbers = body_numbers(machine)
    found = []
    for name, letter in ((machine.workpiece, "w"), (machine.tool, "t")):
        bodies = way(machine, name)
        product = " ".join(f"T_{{{_pair(numbers[body.parent], numbers[body.name])}}}" for body in bodies)
        found.append(f"{{}}^{{0}}T_{{{letter}}} = {product} T_{{{letter}}}".replace("=  ", "= "))
    return (*found, "E = {}^{0}T_{t} - {}^{0}T_{w}")


def plain(latex: str) -> str:
    """LaTeX of this module as text."""
    latex = _POWER_OF_TEN.sub(r"e\1", latex)
    for mark, text in _PLAIN.items():
        latex = latex.replace(mark, text)
    return latex


_POWER_OF_TEN = re.compile(r" \\cdot 10\^\{(-?\d+)\}")

_PLAIN = {
    "\\Delta ": "Δ",
    "\\Delta": "Δ",
    "\\alpha": "α",
    "\\beta": "β",
    "\\gamma": "γ",
    "\\theta": "θ",
    "\\cos": "cos",
    "\\sin": "sin",
    "\\mathrm": "",
    "\\times": "×",
    "\\mp": "∓",
    "\\ ": " ",
    "{}^{0}": "0",
    "\\ldots": "…",
    "{": "",
    "}": "",
}
"""Text for each mark, in an order in which none spoils another."""


def _matrices(machine: MachineDescription, body: Body, numbers: dict[str, int]) -> CharacteristicMatrices:
    pair = _pair(numbers[body.parent], numbers[body.name])
    location = _location_symbols(machine, body, pair)
    found = [
        (f"T_{{{pair},p}}", _pose_entries(body.pose)),
        (f"\\Delta T_{{{pair},p}}", _error_entries([symbol for symbol, value in location])),
    ]
    symbols = [
        Symbol(symbol, _size(value, k >= 3)) for k, (symbol, value) in enumerate(location) if value and symbol != "0"
    ]
    moved: Entries = ()
    errors: Entries = ()
    if body.axis is not None:
        axis = machine.axis(body.axis)
        moved = _motion_entries(axis)
        motion = [_error_symbol(k, axis.letter.lower()) for k in range(6)]
        errors = _error_entries(motion)
        symbols += [Symbol(_position(axis), _travel(axis))]
        symbols += [Symbol(symbol, _component(machine, axis, k)) for k, symbol in enumerate(motion)]
    found += [(f"T_{{{pair},s}}", moved), (f"\\Delta T_{{{pair},s}}", errors)]
    return CharacteristicMatrices(body, numbers[body.name], numbers[body.parent], tuple(found), tuple(symbols))


def _pair(parent: int, number: int) -> str:
    """Subscript SV; with a comma where a number has two digits."""
    return f"{parent}{',' if max(parent, number) > 9 else ''}{number}"


def _number(value: float) -> str:
    """A number in LaTeX, as short as six digits allow."""
    text = f"{0.0 if abs(value) < NEGLIGIBLE else value:.6g}"
    mantissa, mark, power = text.partition("e")
    return f"{mantissa} \\cdot 10^{{{int(power)}}}" if mark else text


def _pose_entries(pose: Displacement) -> Entries:
    """Tp: numbers, mm; empty for an identity."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(pose.rotation).as_matrix()
    matrix[:3, 3] = np.array(pose.shift) * 1e3
    if np.allclose(matrix, np.eye(4), rtol=0, atol=NEGLIGIBLE):
        return ()
    return tuple(tuple(_number(float(value)) for value in row) for row in matrix)


def _error_entries(symbols: Sequence[str]) -> Entries:
    """ΔT in first order (Equations 6, 8) of the symbols of x, y, z, α, β, γ, "0" for no error; empty without any."""
    if all(symbol == "0" for symbol in symbols):
        return ()
    x, y, z, a, b, c = symbols
    return (
        ("1", _minus(c), b, x),
        (c, "1", _minus(a), y),
        (_minus(b), a, "1", z),
        ("0", "0", "0", "1"),
    )


def _minus(symbol: str) -> str:
    return symbol if symbol == "0" else f"-{symbol}"


def _motion_entries(axis: Axis) -> Entries:
    """Ts (Equation 7): along the axis's direction, or by Rodrigues' formula n nᵀ + (1 - n nᵀ) cos θ + [n]× sin θ."""
    n, symbol = np.array(axis.direction), _position(axis)
    if axis.kind == "linear":
        shift = [_sum([(float(part), symbol)]) for part in n]
        return (*tuple((*("1" if i == j else "0" for j in range(3)), shift[i]) for i in range(3)), ("0", "0", "0", "1"))
    square, cross = np.outer(n, n), np.cross(np.eye(3), n)
    rows = [
        tuple(
            _sum(
                [
                    (float(square[i, j]), ""),
                    (float(i == j) - float(square[i, j]), f"\\cos {symbol}"),
                    (float(cross[i, j]), f"\\sin {symbol}"),
                ]
            )
            for j in range(3)
        )
        for i in range(3)
    ]
    return (*tuple((*row, "0") for row in rows), ("0", "0", "0", "1"))


def _sum(terms: Sequence[tuple[float, str]]) -> str:
    """Sum of numbers times symbols, zeros left out."""
    text = ""
    for value, symbol in terms:
        if abs(value) < NEGLIGIBLE:
            continue
        size = "" if symbol and abs(abs(value) - 1) < NEGLIGIBLE else _number(abs(value))
        term = f"{size} {symbol}".strip()
        text += f" {'-' if value < 0 else '+'} {term}" if text else f"{'-' if value < 0 else ''}{term}"
    return text or "0"


def _position(axis: Axis) -> str:
    """Symbol of an axis's position: x of a linear axis X, θ_C of a rotary axis C."""
    return axis.letter.lower() if axis.kind == "linear" else f"\\theta_{{{axis.letter}}}"


def _error_symbol(component: int, subscript: str) -> str:
    """Symbol of an error, as Equations 10-12 have them: Δx … Δγ with a subscript."""
    letter = "xyz"[component] if component < 3 else GREEK[component - 3]
    return f"\\Delta {letter}_{{{subscript}}}"


def _location_symbols(machine: MachineDescription, body: Body, pair: str) -> list[tuple[str, float]]:
    """Symbols and values of a body's location error, "0" for those that are zero.

    Subscripts are those of the paper: `wd` of the workpiece, two axes for the squareness of linear ones (Δγ_xy), and S
    and V for all others.
    """
    found = []
    values = (*body.location_error.shift, *body.location_error.rotation)
    for component, value in enumerate(values):
        subscript = "wd" if body.name == machine.workpiece else _square_axes(machine, body, component) or pair
        found.append((_error_symbol(component, subscript) if value else "0", value))
    return found


def _square_axes(machine: MachineDescription, body: Body, component: int) -> str:
    """Both linear axes of which this rotation changes the squareness, such as xy; nothing for another error."""
    if component < 3 or body.axis is None or machine.axis(body.axis).kind != "linear":
        return ""
    own = machine.axis(body.axis)
    turned = np.cross(np.eye(3)[component - 3], own.direction)
    for other in machine.axes:
        if other.kind == "linear" and np.allclose(np.abs(turned @ np.array(other.direction)), 1.0):
            return "".join(sorted((own.letter.lower(), other.letter.lower())))
    return ""


def _size(value: float, is_angle: bool) -> str:
    return f"{_number(value)}\\ \\mathrm{{rad}}" if is_angle else f"{_number(value * 1e3)}\\ \\mathrm{{mm}}"


def _travel(axis: Axis) -> str:
    low, high = axis.travel
    scale, unit = axis.shown
    return f"{_number(low * scale)} \\ldots {_number(high * scale)}\\ \\mathrm{{{unit}}}"


def _component(machine: MachineDescription, axis: Axis, component: int) -> str:
    """An error component of an axis by its name in ISO 230-1 and its terms, in mm or rad."""
    name = f"E{DIRECTIONS[component]}{axis.letter}"
    error = machine.errors.get(name, ErrorComponent())
    scale = 1e3 if component < 3 else 1.0
    terms = [(value * scale, "" if power == 0 else _power(power)) for power, value in enumerate(error.poly)]
    symbol = _position(axis)
    for wave in error.harmonic:
        order = wave.order if axis.kind == "rotary" else wave.order * 1e-3  # per mm
        argument = symbol if order == 1 else f"{_number(order)} {symbol}"
        terms += [(wave.cos * scale, f"\\cos({argument})"), (wave.sin * scale, f"\\sin({argument})")]
    added = list(_added(axis, component, scale))
    text = _sum(terms)
    if error.table is not None:
        text = "" if text == "0" else f"{text} + "
        text += f"\\mathrm{{table\\ of\\ {len(error.table.positions)}\\ positions}}"
    elif added and text == "0":
        text = ""
    text = (text + "".join(added)).removeprefix(" + ") or "0"
    unit = "mm" if component < 3 else "rad"
    shown = f"({text})" if " + " in text or " - " in text or "\\mp" in text else text
    return f"E_{{{name[1:]}}} = {shown}" + ("" if text == "0" else f"\\ \\mathrm{{{unit}}}")


def _power(power: int) -> str:
    return "u" if power == 1 else f"u^{{{power}}}"


def _added(axis: Axis, component: int, scale: float) -> Iterator[str]:
    """What reversal and thermal expansion add along or about the axis's own direction."""
    along = float(axis.direction[component % 3]) if (component < 3) == (axis.kind == "linear") else 0.0
    if not along:
        return
    if axis.expansion:
        position = _position(axis)
        yield f" + {_number(along * axis.expansion)} (T - T_{{0}}) {position}"
    if axis.reversal:
        yield f" \\mp {_number(abs(along * axis.reversal) / 2 * scale)}"
