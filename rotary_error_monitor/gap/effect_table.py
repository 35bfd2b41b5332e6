"""The effects that a diagnosis can name, as tables: what each is, its parameters, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence

from rotary_error_monitor.effects.effect import AnyEffect, Parameter, ParameterEstimate, Role
from rotary_error_monitor.gap.quantities import quantity


def effect_table(effects: Sequence[AnyEffect]) -> str:
    """Effects of one kind of thing as a Markdown table, one row each."""
    head = "| effect | what it is | parameters, usual size | what to do about it | source |\n|---|---|---|---|---|"
    rows = (
        f"| `{effect.name}` | {effect.title} | {', '.join(map(_parameter, effect.parameters))} | {effect.remedy} | "
        f"{effect.source} |"
        for effect in effects
    )
    return "\n".join([head, *rows, ""])


def _parameter(parameter: Parameter) -> str:
    of = f" ({parameter.size})" if parameter.size > 1 else ""
    if parameter.role is Role.FIXED:
        return f"`{parameter.name}`{of}: searched for"
    return f"`{parameter.name}`{of}: {quantity(ParameterEstimate(parameter.scale, 0.0), parameter.unit)}"
