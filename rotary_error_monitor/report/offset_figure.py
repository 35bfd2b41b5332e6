"""Pictures of an offset: parts of the bodies at one pose, or the course over the poses of a program."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.machine.budget import BodyPart, OffsetBudget
from rotary_error_monitor.metrology.positioning import COVERAGE
from rotary_error_monitor.report.drawing import WIDE, drawn, label, new_axes
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import BLACK, GREY, colour

HEIGHT = 3.4
"""Of a picture, inches."""

GROUP = 0.8
"""Of the distance between two components, what the bars of one take."""

EXACT = "exact (± U, k = 2, where stated)"

KINDS = (("Shift of the tool", "µm", slice(0, 3), "xyz"), ("Rotation of the tool", "µrad", slice(3, 6), "abc"))


def draw(machine: MachineDescription, budget: OffsetBudget) -> list[Drawn]:
    """Shift and rotation."""
    one = len(budget.exact) == 1
    return [(_bars if one else _course)(machine, budget, *kind) for kind in KINDS]


def _shown(budget: OffsetBudget, part: slice) -> list[BodyPart]:
    """Bodies that have a part in these components."""
    return [each for each in budget.parts if np.any(each.both[:, part])]


def _bars(machine: MachineDescription, budget: OffsetBudget, title: str, unit: str, part: slice, letters: str) -> Drawn:
    """A bar a body in each component, and the exact sum with its expanded uncertainty (k = 2)."""
    bodies = _shown(budget, part)
    names = [*(each.body.name for each in bodies), EXACT]
    figure, ax = new_axes(WIDE, HEIGHT, names)
    places = np.arange(3.0)
    width = GROUP / len(names)
    for number, name in enumerate(names):
        values = budget.exact if name == EXACT else bodies[number].both
        at = places + (number - (len(names) - 1) / 2) * width
        shade = GREY if name == EXACT else colour(number)
        ax.bar(at, values[0, part] * 1e6, width, color=shade, label=name)
        if name == EXACT and budget.uncertainty is not None:
            spread = COVERAGE * budget.uncertainty[0, part] * 1e6
            ax.errorbar(at, values[0, part] * 1e6, spread, fmt="none", ecolor=BLACK, capsize=3)
    ax.axhline(0.0, color=BLACK, linewidth=0.8)
    ax.set_xticks(places, list(letters))
    label(figure, ax, f"{title} by body, first order", "component", unit)
    told = ", ".join(
        f"{name} {value * 1e6:.2f} {unit}" for name, value in zip(letters, budget.exact[0, part], strict=True)
    )
    return drawn(figure, f"{title} of {machine.name} by body; exact: {told}")


def _course(
    machine: MachineDescription, budget: OffsetBudget, title: str, unit: str, part: slice, letters: str
) -> Drawn:
    """Each component over the poses, with its expanded uncertainty (k = 2) where it is stated."""
    figure, ax = new_axes(WIDE, HEIGHT, list(letters))
    poses = np.arange(1, len(budget.exact) + 1)
    for number, letter in enumerate(letters):
        k = part.start + number
        values = budget.exact[:, k] * 1e6
        ax.plot(poses, values, color=colour(number), label=letter, linewidth=1.2)
        if budget.uncertainty is not None:
            spread = COVERAGE * budget.uncertainty[:, k] * 1e6
            ax.fill_between(poses, values - spread, values + spread, color=colour(number), alpha=0.2, lw=0)
    label(figure, ax, f"{title} over the program", "pose", unit)
    largest = np.abs(budget.exact[:, part]).max(axis=0) * 1e6
    told = ", ".join(f"{letter} {value:.2f} {unit}" for letter, value in zip(letters, largest, strict=True))
    return drawn(figure, f"{title} of {machine.name} over {len(poses)} poses; largest amounts: {told}")
