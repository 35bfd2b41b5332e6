"""The devices that are known: those of this room, and those of installed plug-ins."""

from __future__ import annotations

import rotary_error_monitor.sources as room
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plugins import classes_in, modules_of
from rotary_error_monitor.sources.device import Device
from rotary_error_monitor.sources.mock import MOCK

ENTRY_POINTS = "rotary_error_monitor.devices"
_TAKEN = {"source", "head", "stage", "machine", "autostart", "security", "block_period"}
"""Parameters that the node of an instrument has in any case."""


def load_devices(instrument: str) -> dict[str, Device]:
    """Devices that can be an instrument, by name, the mock last: it is for trying things out.

    Args:
        instrument: name of its node, such as `encoder_head`.

    Raises:
        InputError: a plug-in cannot be loaded, or two devices share a name.
    """
    found: dict[str, Device] = {}
    for module, origin in modules_of(room, ENTRY_POINTS):
        for kind in classes_in(module, Device):
            if not kind.name or instrument not in _served(kind, origin):
                continue
            if kind.name in found:
                raise InputError(f"{origin}: device '{kind.name}' is already known; choose another name")
            found[kind.name] = _made(kind, origin)
    return dict(sorted(found.items(), key=lambda item: (item[0] == MOCK, item[0])))


def device_settings(devices: dict[str, Device]) -> tuple[Setting, ...]:
    """The parameter `source`, and those of the devices; what several share is there once.

    Raises:
        InputError: two devices mean different things by one name.
    """
    found: dict[str, tuple[Setting, str]] = {}
    for device in devices.values():
        for setting in device.settings:
            known, owner = found.setdefault(setting.name, (setting, device.name))
            if known != setting:
                raise InputError(f"devices '{owner}' and '{device.name}' both have a setting '{setting.name}'")
    return (_source(devices), *(setting for setting, _ in found.values()))


def _source(devices: dict[str, Device]) -> Setting:
    """The parameter `source`: it has no default, so that no real cell publishes simulated samples unasked."""
    meaning = "where the samples come from"
    told = [
        f"-p source:={name}" + (f" ({device.meaning})" if device.meaning else "") for name, device in devices.items()
    ]
    hint = f"{meaning}: {' or '.join([', '.join(told[:-1]), *told[-1:]]) if told[1:] else ''.join(told)}"
    mock = "; a whole mock cell is started with: make run" if MOCK in devices else ""
    return Setting("source", "", meaning, choices=tuple(devices), required=True, hint=hint + mock)


def _served(kind: type[Device], origin: str) -> tuple[str, ...]:
    serves: object = kind.serves
    if not isinstance(serves, tuple):
        raise InputError(f"{origin}: device '{kind.name}' serves {serves!r}; expected a tuple of names")
    return kind.serves


def _made(kind: type[Device], origin: str) -> Device:
    """The device of a class.

    Raises:
        InputError: the class is not as it should be.
    """
    try:
        device = kind()
        for setting in device.settings:
            if not isinstance(setting, Setting):
                raise InputError(f"settings hold {setting!r}; expected objects of the class Setting")
            if setting.name in _TAKEN:
                raise InputError(f"setting '{setting.name}' is the node's own; choose another name")
            setting.check_itself()
    except (InputError, TypeError) as error:
        raise InputError(f"{origin}: device '{kind.name}': {error}") from error
    return device
