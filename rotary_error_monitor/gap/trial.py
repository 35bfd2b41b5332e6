"""A trial of effects that are not the package's own: what is wrong with one is said before it takes part."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, Values, order_location
from rotary_error_monitor.effects.library import is_foreign
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError

if TYPE_CHECKING:
    from rotary_error_monitor.twin.stage import StageTwin


def try_stage_effects(effects: Iterable[StageEffect], twin: StageTwin) -> None:
    """Predict a recording with each foreign effect, at its first place and at its usual size.

    Raises:
        InputError: an effect fails, or what it gives has another shape than the signal or is not finite.
    """
    foreign = list(filter(is_foreign, effects))
    base = twin.predict() if foreign else {}
    for effect in foreign:

        def predict(place: str, values: Values, effect: StageEffect = effect) -> None:
            for name, signal in twin.predict((Cause(effect, place, values),)).items():
                if np.shape(signal) != base[name].shape:
                    raise ValueError(f"{name} gets shape {np.shape(signal)}; expected {base[name].shape}")
                if not np.isfinite(signal).all():
                    raise ValueError(f"{name} gets values that are not finite")

        _try(effect, effect.locations(twin.stage), predict)


def try_machine_effects(effects: Iterable[MachineEffect], machine: MachineDescription) -> None:
    """Put each foreign effect into the description, at its first place and at its usual size.

    Raises:
        InputError: an effect fails, or gives something else than a description.
    """
    for effect in filter(is_foreign, effects):

        def amend(place: str, values: Values, effect: MachineEffect = effect) -> None:
            amended: object = effect.amend(machine, values, place)
            if not isinstance(amended, MachineDescription):
                raise TypeError(f"amend gives {type(amended).__name__}; expected the description of a machine")

        _try(effect, effect.locations(machine), amend)


def _try(effect: AnyEffect, locations: tuple[str, ...], attempt: Callable[[str, Values], None]) -> None:
    places = (order_location(effect.lowest),) if effect.orders else locations
    for place in places[:1]:
        values = effect.start(place)
        sized = effect.indices(Role.LINEAR, Role.SHAPE)
        values[sized] = effect.scales()[sized]
        try:
            attempt(place, values)
        except Exception as error:  # whatever a user's effect raises is reported with its name
            module = type(effect).__module__.rpartition(".")[2]
            raise InputError(f"effect '{effect.name}' of {module} fails: {type(error).__name__}: {error}") from error
