"""A machine written back as the content of a `machine` section: the inverse of `machine_from_mapping`."""

from __future__ import annotations

from typing import Any

from rotary_error_monitor.description.machine import Displacement, ErrorComponent, MachineDescription
from rotary_error_monitor.description.machine_limits import limits_mapping


def machine_mapping(machine: MachineDescription) -> dict[str, Any]:
    """Content of a `machine` section as a tree of bodies, whatever form it was read from."""
    content: dict[str, Any] = {
        "name": machine.name,
        "tool": machine.tool,
        "workpiece": machine.workpiece,
        "reference_temperature": machine.reference_temperature,
        "axes": {
            axis.letter: {
                "kind": axis.kind,
                "direction": list(axis.direction),
                "travel": list(axis.travel),
                "expansion": axis.expansion,
                "reversal": axis.reversal,
                **({} if axis.speed is None else {"speed": axis.speed}),
                **({} if axis.acceleration is None else {"acceleration": axis.acceleration}),
            }
            for axis in machine.axes
        },
        "bodies": [
            {
                "name": body.name,
                "parent": body.parent,
                "pose": _displacement(body.pose, "position"),
                "location_error": _displacement(body.location_error, "shift"),
                **({} if body.axis is None else {"axis": body.axis}),
            }
            for body in machine.bodies
        ],
        "errors": {name: _component(component) for name, component in machine.errors.items()},
    }
    if machine.monitored is not None:
        content["monitored"] = machine.monitored
    if limits := limits_mapping(machine.limits):
        content["limits"] = limits
    if machine.uncertainty:
        content["uncertainty"] = dict(machine.uncertainty)
    return content


def _displacement(displacement: Displacement, shift: str) -> dict[str, Any]:
    return {shift: list(displacement.shift), "rotation": list(displacement.rotation)}


def _component(component: ErrorComponent) -> dict[str, Any]:
    content: dict[str, Any] = {}
    if component.poly:
        content["poly"] = list(component.poly)
    if component.harmonic:
        content["harmonic"] = [{"order": w.order, "cos": w.cos, "sin": w.sin} for w in component.harmonic]
    if component.table is not None:
        table = component.table
        content["table"] = {
            "positions": list(table.positions),
            "forward": list(table.forward),
            "backward": list(table.backward),
        }
    return content
