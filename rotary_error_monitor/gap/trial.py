"""A trial of effects that are not the package's own: what is wrong with one is said before it takes part."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.quadrature import QuadratureDescription
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, Values, order_location
from rotary_error_monitor.effects.library import is_foreign
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.effects.mount_effect import MountEffect
from rotary_error_monitor.effects.quadrature_effect import CircleState, Complex, QuadratureEffect
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError

if TYPE_CHECKING:
    from rotary_error_monitor.twin.mount import MountTwin
    from rotary_error_monitor.twin.stage import StageTwin

Array = NDArray[np.float64]


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
                _check_signal(name, signal, base[name].shape)

        _try(effect, effect.locations(twin.stage), predict)


def try_machine_effects(effects: Iterable[MachineEffect], machine: MachineDescription) -> None:
    """Put each foreign effect into the description, at its first place and at its usual size.

    Raises:
        InputError: an effect fails, or gives something else than a description.
    """
    for effect in filter(is_foreign, effects):

        def amend(place: str, values: Values, effect: MachineEffect = effect) -> None:
            _check_amended(effect.amend(machine, values, place))

        _try(effect, effect.locations(machine), amend)


def try_mount_effects(effects: Iterable[MountEffect], twin: MountTwin) -> None:
    """Point with each foreign effect, at its first place and at its usual size.

    Raises:
        InputError: an effect fails, or gives something else than a description or a small rotation at each pointing.
    """
    for effect in filter(is_foreign, effects):

        def point(place: str, values: Values, effect: MountEffect = effect) -> None:
            _check_amended(effect.amend(twin.machine, values, place))
            state = twin.state(twin.mount.geometry, (Cause(effect, place, values),))
            turn = effect.turn(values, place, state)
            if turn is not None:
                _check_signal("turn", turn, state.tube.shape)

        _try(effect, effect.locations(twin.machine), point)


def try_quadrature_effects(
    effects: Iterable[QuadratureEffect], description: QuadratureDescription, phase: Array, amplitude: float
) -> None:
    """Displace points at phases (n,), rad, of an ideal circle with each foreign effect, at its usual size.

    Raises:
        InputError: an effect fails, or what it gives is not one finite displacement for each point.
    """
    turning = np.exp(1j * phase)
    state = CircleState(turning, amplitude, amplitude * turning)
    for effect in filter(is_foreign, effects):

        def displace(place: str, values: Values, effect: QuadratureEffect = effect) -> None:
            _check_signal("displacement", effect.displacement(values, place, state), phase.shape)

        _try(effect, effect.locations(description), displace)


def _check_amended(amended: object) -> None:
    if not isinstance(amended, MachineDescription):
        raise TypeError(f"amend gives {type(amended).__name__}; expected the description of a machine")


def _check_signal(name: str, given: Array | Complex, shape: tuple[int, ...]) -> None:
    if np.shape(given) != shape:
        raise ValueError(f"{name} gets shape {np.shape(given)}; expected {shape}")
    if not np.isfinite(given).all():
        raise ValueError(f"{name} gets values that are not finite")


def _try(effect: AnyEffect, locations: tuple[str, ...], attempt: Callable[[str, Values], None]) -> None:
    places = (order_location(effect.lowest),) if effect.orders else locations
    for place in places[:1]:
        values = effect.start(place)
        amplitudes = effect.indices(Role.LINEAR, Role.SHAPE)
        values[amplitudes] = effect.scales()[amplitudes]
        try:
            attempt(place, values)
        except Exception as error:  # whatever a user's effect raises is reported with its name
            module = type(effect).__module__.rpartition(".")[2]
            raise InputError(f"effect '{effect.name}' of {module} fails: {type(error).__name__}: {error}") from error
