"""A trial of effects that are not the package's own: what is wrong with one is said before it takes part."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, order_location
from rotary_error_monitor.effects.library import is_foreign
from rotary_error_monitor.errors import InputError


def try_effects(effects: Iterable[AnyEffect], description: object, attempt: Callable[[Cause], None]) -> None:
    """Predict with each foreign effect, at its first place and at its usual size.

    Raises:
        InputError: an effect fails, or what it gives has another type or shape than expected or is not finite.
    """
    for effect in filter(is_foreign, effects):
        places = (order_location(effect.lowest),) if effect.orders else effect.locations(description)
        for place in places[:1]:
            values = effect.start(place)
            amplitudes = effect.indices(Role.LINEAR, Role.SHAPE)
            values[amplitudes] = effect.scales()[amplitudes]
            try:
                attempt(Cause(effect, place, values))
            except Exception as error:  # whatever a user's effect raises is reported with its name
                module = type(effect).__module__.rpartition(".")[2]
                told = f"{type(error).__name__}: {error}"
                raise InputError(f"effect '{effect.name}' of {module} fails: {told}") from error


def check_amended(amended: object) -> None:
    """Refuse what is no description of a machine.

    Raises:
        TypeError: it is something else.
    """
    if not isinstance(amended, MachineDescription):
        raise TypeError(f"amend gives {type(amended).__name__}; expected the description of a machine")


def check_signal(name: str, given: object, shape: tuple[int, ...]) -> None:
    """Refuse what is not one finite number for each sample.

    Raises:
        ValueError: it has another shape, or is not finite.
    """
    if np.shape(np.asarray(given)) != shape:
        raise ValueError(f"{name} gets shape {np.shape(np.asarray(given))}; expected {shape}")
    if not np.isfinite(np.asarray(given)).all():
        raise ValueError(f"{name} gets values that are not finite")
