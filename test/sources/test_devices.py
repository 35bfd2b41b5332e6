"""Devices: found because they are defined, here and in packages of others, and served by the nodes that they name."""

from __future__ import annotations

import re
import socket
import struct
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from ports import free_port

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.device import POLL_RATE, Device, Instrument, opened, told_of
from rotary_error_monitor.sources.joint_state import joint_position
from rotary_error_monitor.sources.library import ENTRY_POINTS, device_settings, load_devices
from rotary_error_monitor.sources.source import Heard, Polled, Source

DOC = Path(__file__).parents[2] / "doc"
EXAMPLE = DOC / "examples" / "udp_encoder"
TEXT = (DOC / "devices.md").read_text(encoding="utf-8")
MINE = """
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.sources.device import Device


class Mine(Device):
    name = "{name}"
    serves = ("encoder_head",)
    settings = (Setting("{setting}", 500.0, "{meaning}"),)

    def open(self, instrument):
        return "nothing"
"""


def instrument(devices: dict[str, Device], **given: object) -> Instrument:
    values = {setting.name: setting.default for setting in device_settings(devices)} | given
    return Instrument("head_a", ("angle",), load_stage(), values.__getitem__, time.time_ns())


@pytest.fixture
def install_mine(install, tmp_path):
    """Function that installs a package with one device."""

    def installed(name="mine", setting="mine.rate", meaning="how often, Hz"):
        package = tmp_path / f"package_of_{name}"
        package.mkdir()
        (package / "__init__.py").write_text(MINE.format(name=name, setting=setting, meaning=meaning))
        install(package, {ENTRY_POINTS: {"mine": package.name}})

    return installed


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("encoder_head", ["counter", "joint_state", "mock"]),
        ("autocollimator", ["iio", "vector3", "mock"]),
        ("lvdt", ["vector3", "mock"]),
        ("listed_sensor", ["iio", "temperature", "vector3", "wrench", "mock"]),
        ("hygrometer", []),
    ],
)
def test_devices_of_an_instrument_the_mock_last(kind, names):
    assert list(load_devices(kind)) == names


@pytest.mark.parametrize("kind", ["encoder_head", "autocollimator", "lvdt", "listed_sensor"])
def test_each_parameter_is_there_once_and_says_what_it_means(kind):
    devices = load_devices(kind)
    source, *others = device_settings(devices)
    assert (source.name, source.default, source.choices, source.required) == ("source", "", tuple(devices), True)
    assert all(f"-p source:={name} ({device.meaning})" in source.hint for name, device in devices.items())
    assert all(device.meaning for device in devices.values())
    assert [name for name, device in devices.items() if device.simulated] == ["mock"]
    names = [setting.name for setting in others]
    assert len(set(names)) == len(names)
    assert set(names) == {setting.name for device in devices.values() for setting in device.settings}
    assert all(setting.meaning for setting in others)


def test_a_device_of_another_package_is_one_more_source(install_mine):
    install_mine()
    devices = load_devices("encoder_head")
    assert list(devices) == ["counter", "joint_state", "mine", "mock"]
    assert (
        "-p source:=joint_state (a driver that publishes sensor_msgs/JointState), -p source:=mine or -p source:=mock"
        in (device_settings(devices)[0].hint)
    )
    assert "mine.rate" in [setting.name for setting in device_settings(devices)]
    assert "mine" not in load_devices("autocollimator")
    with pytest.raises(InputError, match="open gives str; expected a source"):
        opened(devices["mine"], instrument(devices))


def test_a_name_that_is_taken_is_refused(install_mine):
    install_mine(name="counter")
    with pytest.raises(InputError, match=r"'mine' of package_of_counter: device 'counter' is already known"):
        load_devices("encoder_head")


def test_one_parameter_with_two_meanings_is_refused(install_mine):
    install_mine(setting=POLL_RATE.name, meaning="something else")
    devices = load_devices("encoder_head")
    with pytest.raises(InputError, match="devices 'counter' and 'mine' both have a setting 'poll_rate'"):
        device_settings(devices)


@pytest.mark.parametrize(
    ("before", "after", "problem"),
    [
        (
            '500.0, "how often, Hz"',
            '5, "how", (10, 20)',
            "setting 'mine.rate': default 5; expected: how",
        ),
        ('500.0, "how often, Hz"', 'None, "how"', "setting 'mine.rate': default None; expected true or"),
        ('500.0, "how often, Hz"', '"x", "how", choices=("a", "b")', "parameter 'mine.rate' is 'x'; expected: how"),
        ('"mine.rate"', '"stage"', "device 'mine': setting 'stage' is the node's own; choose another name"),
        (
            '(Setting("mine.rate", 500.0, "how often, Hz"),)',
            '("mine.rate",)',
            "hold 'mine.rate'; expected obj",
        ),
        ('("encoder_head",)', '"encoder_head"', "device 'mine' serves 'encoder_head'; expected a tuple of names"),
        (
            '    name = "mine"',
            '    name = "mine"\n    def __init__(self, port): pass',
            "device 'mine': .*missing 1 required",
        ),
        ("    def open", "    def shut", "device 'mine': .*abstract method open"),
        ("class Mine", "raise SystemExit(3)\nclass Mine", "cannot be loaded: SystemExit: 3"),
    ],
)
def test_a_mistake_in_a_class_is_told_with_its_name(install, tmp_path, before, after, problem):
    package = tmp_path / "mistaken"
    package.mkdir()
    content = MINE.format(name="mine", setting="mine.rate", meaning="how often, Hz")
    assert before in content
    (package / "__init__.py").write_text(content.replace(before, after))
    install(package, {ENTRY_POINTS: {"mine": "mistaken"}})
    with pytest.raises(InputError, match=f"entry point 'mine' of mistaken: .*{problem}"):
        load_devices("encoder_head")


def test_whatever_a_device_raises_is_told_with_its_name():
    with pytest.raises(InputError, match=r"device 'usb': OSError: .*unplugged"), told_of("usb"):
        raise OSError(5, "unplugged")
    with pytest.raises(InputError, match=r"^as it is$"), told_of("usb"):
        raise InputError("as it is")


def test_what_is_registered_is_a_module(install, tmp_path):
    package = tmp_path / "no_module"
    package.mkdir()
    (package / "__init__.py").write_text("thing = 3\n")
    install(package, {ENTRY_POINTS: {"mine": "no_module:thing"}})
    with pytest.raises(InputError, match=r"entry point 'mine' of no_module: no_module:thing is no module"):
        load_devices("encoder_head")


def test_sources_are_of_the_kind_that_the_node_treats_as_such(tmp_path):
    (tmp_path / "count").write_text("0\n")
    devices = load_devices("encoder_head")
    counter = devices["counter"].open(instrument(devices, **{"counter.device": str(tmp_path)}))
    assert isinstance(counter, Polled)
    heard = devices["joint_state"].open(instrument(devices, **{"joint_state.topic": "enc", "joint_state.joint": "C"}))
    assert isinstance(heard, Heard)
    assert (heard.topic, heard.type) == ("enc", "sensor_msgs/msg/JointState")
    assert heard.sample(SimpleNamespace(name=["X", "C"], position=[1.0, 2.0])) == (2.0,)


@pytest.mark.parametrize(
    ("names", "positions", "joint", "problem"),
    [
        (["X", "Y"], [1.0, 2.0], "", "expected a position of joint ''"),
        (["X"], [1.0], "C", "expected a position of joint 'C'"),
        (["X"], [], "X", "with 0 positions"),
    ],
)
def test_a_joint_that_is_not_there(names, positions, joint, problem):
    with pytest.raises(InputError, match=problem):
        joint_position(SimpleNamespace(name=names, position=positions), joint)


def test_the_only_joint_needs_no_name():
    assert joint_position(SimpleNamespace(name=["spindle"], position=[0.5]), "") == 0.5


def test_a_source_that_gives_no_samples_cannot_be_made():
    with pytest.raises(TypeError, match="abstract method take"):
        Source()


# The document and its example.


@pytest.fixture
def udp(install):
    """The example, installed; gives a function that opens it on a port."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    install(EXAMPLE, project["entry-points"])
    devices = load_devices("encoder_head")
    return lambda port: devices["udp"].open(instrument(devices, **{"udp.port": port}))


def send(port: int, *datagrams: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        for datagram in datagrams:
            box.sendto(datagram, ("127.0.0.1", port))


def test_the_document_shows_the_file_and_its_entry_point():
    (shown,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert shown == (EXAMPLE / "device.py").read_text(encoding="utf-8")
    (toml,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert tomllib.loads(toml)["project"]["entry-points"] == project["entry-points"]
    assert ENTRY_POINTS in project["entry-points"]


def test_the_document_names_all_that_a_device_has():
    table = set(re.findall(r"^\| `(\w+)", TEXT, re.MULTILINE))
    assert {name for name in vars(Device) if not name.startswith("_")} <= table
    assert {"Polled", "Heard", "Gathered", "Source"} <= table


def test_the_example_gives_what_the_box_sends(udp):
    port, now_ns = free_port(socket.SOCK_DGRAM), time.time_ns()
    source = udp(port)
    assert source.take(now_ns - 10, now_ns) is None
    send(port, *(struct.pack("<qd", now_ns + k, 0.1 * k) for k in range(5)))
    block = source.take(now_ns, now_ns + 3)
    np.testing.assert_array_equal(block.times_ns, now_ns + np.arange(3))
    np.testing.assert_allclose(block.column("angle"), [0.0, 0.1, 0.2])
    send(port, b"too short")
    with pytest.raises(InputError, match="a datagram has 9 bytes or more; expected 16"):
        source.take(now_ns + 3, now_ns + 4)
    np.testing.assert_allclose(source.take(now_ns + 3, now_ns + 9).column("angle"), [0.3, 0.4])
    with pytest.raises(InputError, match=f"udp.port is {port}: .*expected a port that is free"):
        udp(port)
    source.close()
    udp(port).close()
