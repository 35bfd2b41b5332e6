"""Which of the load cells that a stage lists show the force on its shaft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rotary_error_monitor.description.sections import Place
from rotary_error_monitor.description.sensor_section import SHAFT_FORCE, SensorSection


def force_contradictions(sensors: Mapping[str, SensorSection], named: Sequence[str]) -> Iterator[tuple[Place, str]]:
    """Places in a stage's file where it is not clear which of the listed forces is that on the shaft.

    Args:
        sensors: of the list, by name.
        named: names in `environment.force`.
    """
    forces = [name for name, sensor in sensors.items() if sensor.measures == SHAFT_FORCE]
    for number, name in enumerate(named):
        if name not in forces:
            listed = f"one of {', '.join(forces)}" if forces else "a sensor of kind force in 'sensors'"
            yield ("environment", "force", number), f"no force of the name '{name}' is listed; expected {listed}"
    if len(forces) > 1 and not named:
        yield (
            ("sensors", forces[1]),
            f"a force beside '{forces[0]}'; name the one on the shaft, or several that show it together, as "
            f"environment.force: [{forces[0]}]",
        )
