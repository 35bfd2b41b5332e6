"""The low-order body array and the characteristic matrices of a machine, as text and as LaTeX (Pan et al. 2013)."""

from __future__ import annotations

from collections.abc import Iterator

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_tree import BASE
from rotary_error_monitor.machine.characteristic import (
    IDENTITY,
    CharacteristicMatrices,
    Entries,
    chain_equations,
    characteristic_matrices,
    plain,
)
from rotary_error_monitor.machine.topology import low_order_array

UNITS = (
    "lengths in mm, angles in rad; u is -1 at the lower end of an axis's travel and 1 at the upper one; of ∓ the upper "
    "sign is for travel in positive direction; T is the temperature, T_0 the reference temperature"
)


def array_text(machine: MachineDescription) -> str:
    """The array and the matrices as text."""
    return "\n".join(_text(machine))


def array_latex(machine: MachineDescription) -> str:
    """The same as LaTeX for a document that has amsmath."""
    return "\n".join(_latex(machine))


def _text(machine: MachineDescription) -> Iterator[str]:
    yield f"low-order body array of {machine.name} (Pan et al. 2013, Equations 2-4)"
    rows = low_order_array(machine)
    width = len(str(len(machine.bodies)))
    for power, row in enumerate(rows):
        yield f"  L^{power}(j)  " + "  ".join(f"{int(number):{width}d}" for number in row)
    names = [f"0 {BASE}", *(f"{number} {body.name}" for number, body in enumerate(machine.bodies, start=1))]
    yield f"bodies: {', '.join(names)}"
    yield UNITS
    for each in characteristic_matrices(machine):
        product = " ".join(plain(name) for name, _ in each.matrices)
        yield ""
        yield f"body {each.number} {each.body.name}, carried by {each.parent} {each.body.parent}:"
        yield f"  {plain(each.name)} = {product}"
        still = [plain(name) for name, entries in each.matrices if not entries]
        if still:
            yield f"  {' = '.join(still)} = I"
        for name, entries in each.matrices:
            if entries:
                yield from _text_matrix(plain(name), entries)
        for symbol in each.symbols:
            if not symbol.is_zero:
                yield f"  {plain(symbol.symbol)}: {plain(symbol.value)}"
        if zero := [plain(symbol.symbol) for symbol in each.symbols if symbol.is_zero]:
            yield f"  {', '.join(zero)}: 0"
    yield ""
    yield from map(plain, chain_equations(machine))


def _text_matrix(name: str, entries: Entries) -> Iterator[str]:
    cells = [[plain(entry) for entry in row] for row in entries]
    widths = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    indent = f"  {name} = "
    for number, row in enumerate(cells):
        start = indent if number == 0 else " " * len(indent)
        yield f"{start}[ {'  '.join(cell.ljust(size) for cell, size in zip(row, widths, strict=True))} ]"


def _latex(machine: MachineDescription) -> Iterator[str]:
    rows = low_order_array(machine)
    yield f"% {machine.name}: {UNITS}"
    yield f"\\[\\begin{{array}}{{c|{'c' * rows.shape[1]}}}"
    for power, row in enumerate(rows):
        numbers = " & ".join(str(int(number)) for number in row)
        yield f"L^{{{power}}}(j) & {numbers} \\\\" + (" \\hline" if power == 0 else "")
    yield "\\end{array}\\]"
    for each in characteristic_matrices(machine):
        yield f"% body {each.number}: {each.body.name}, carried by {each.body.parent}"
        yield "\\begin{gather*}"
        yield " \\\\\n".join(_latex_lines(each))
        yield "\\end{gather*}"
    for equation in chain_equations(machine):
        yield f"\\[{equation}\\]"


def _latex_lines(each: CharacteristicMatrices) -> Iterator[str]:
    """Lines of one body: its matrices, what their symbols are, and their product."""
    for name, entries in each.matrices:
        if not entries:
            yield f"{name} = {IDENTITY}"
            continue
        rows = " \\\\ ".join(" & ".join(row) for row in entries)
        yield f"{name} = \\begin{{bmatrix}} {rows} \\end{{bmatrix}}"
    for symbol in each.symbols:
        sign = "=" if not symbol.value.startswith("E_") else "\\equiv"
        yield f"{symbol.symbol} {sign} {symbol.value}"
    yield f"{each.name} = {' '.join(name for name, _ in each.matrices)}"
