"""The OPC UA server, read by the library's own client: figures with unit, range, stamp and quality; who may what."""

from __future__ import annotations

import math
import re
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import asyncua
import numpy as np
import pytest
from asyncua import ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.sync import Client
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from faults.live.other_programs import stated
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from ports import free_port
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Header

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.messages import stamp_from_ns
from rotary_error_monitor.nodes.opcua_server import OpcuaServer
from rotary_error_monitor.opcua import server
from rotary_error_monitor.security.users import add_user
from rotary_error_monitor.testing import Cell
from rotary_error_monitor.testing.cell import PATIENCE

DOC = Path(__file__).parents[2] / "doc"
AXES = {"X": "µm", "Y": "µm", "Z": "µm", "A": "µrad", "C": "µrad"}
MACHINE = "xyzac_trt"
UNIT_IDS = {"µm": 13384, "µrad": 0x423937, "°C": 4408652}
"""UnitId of common codes as the OPC Foundation publishes them (UNECE_to_OPCUA.csv)."""

MOTION = dict(zip(("exc", "eyc", "ezc", "eac", "ebc", "ecc"), ["µm"] * 3 + ["µrad"] * 3, strict=True))
OFFSET = dict(zip("xyzabc", ["µm"] * 3 + ["µrad"] * 3, strict=True))


@pytest.fixture(scope="module")
def place():
    """A cell with a server, a client of it, and functions that publish on what the server hears."""
    with Cell(parameters={"machine": MACHINE}) as cell:
        port = free_port()
        cell.run(OpcuaServer, "opcua_server", port=port, period=0.02)
        with Client(f"opc.tcp://127.0.0.1:{port}/", timeout=PATIENCE) as client:
            yield Place(cell, client, port)


class Place:
    TOPICS = ("error_motion_figures", "tool_offset_figures", "corrected_offset_pose", "axis_corrections",
              "applied_corrections", "machine_temperature", "stage_temperature", "diagnostics")  # fmt: skip

    def __init__(self, cell, client, port):
        self.cell, self.client, self.port = cell, client, port
        self.index = client.get_namespace_index("urn:rotary_error_monitor:cell")
        self.send = {key: cell.publish_on(cell.wire.topic(key)) for key in self.TOPICS}

    def node(self, path):
        return self.client.get_node(ua.NodeId(path, self.index))

    def read(self, path):
        return self.node(path).read_data_value(raise_on_bad_status=False)

    def quality(self, path):
        return self.read(path).StatusCode.name

    def say(self, levels, now_ns, **figures):
        """Statuses with their levels on /diagnostics."""
        values = [KeyValue(key=key, value=str(value)) for key, value in figures.items()]
        told = [
            DiagnosticStatus(name=name, level=bytes([level]), message=f"level {level}", values=values)
            for name, level in levels.items()
        ]
        self.send["diagnostics"](DiagnosticArray(header=header(now_ns), status=told))

    def wait(self, send, shown, what):
        """Send again and again, as the cell does, until it is shown."""

        def there():
            send()
            return shown()

        self.cell.wait_until(there, what)


def header(stamp_ns):
    return Header(stamp=stamp_from_ns(stamp_ns))


def figures(values, stamp_ns):
    message = TwistStamped(header=header(stamp_ns))
    for vector, three in ((message.twist.linear, values[:3]), (message.twist.angular, values[3:])):
        vector.x, vector.y, vector.z = map(float, three)
    return message


def pose(values, stamp_ns):
    """By the exact quaternion of a rotation vector; values in µm and µrad."""
    message = PoseWithCovarianceStamped(header=header(stamp_ns))
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y, place.z = (1e-6 * value for value in values[:3])
    vector = 1e-6 * np.array(values[3:])
    angle = float(np.linalg.norm(vector))
    turn.x, turn.y, turn.z = (math.sin(angle / 2) * vector / angle).tolist()
    turn.w = math.cos(angle / 2)
    return message


def axes(values, stamp_ns):
    names = list(AXES)
    position = [1e-6 * value for value in values]
    return JointState(header=header(stamp_ns), name=names, position=position, velocity=[0.0] * 5, effort=[0.0] * 5)


JUDGES = {"error_estimator: estimate": 0, "compensation: correction": 0}


@pytest.mark.parametrize("seed", range(3))
def test_every_figure_has_value_unit_range_stamp_and_name(place, seed):
    rng = np.random.default_rng(seed)
    drawn = {
        "error_motion": dict(zip(MOTION, rng.normal(0, 20, 6), strict=True)),
        "tool_offset": dict(zip(OFFSET, rng.normal(0, 50, 6), strict=True)),
        "corrected_offset": dict(zip(OFFSET, rng.normal(0, 5, 6), strict=True)),
        "axis_corrections": dict(zip(AXES, rng.normal(0, 50, 5), strict=True)),
        "applied_corrections": dict(zip(AXES, rng.normal(0, 50, 5), strict=True)),
        "temperature": {"stage": rng.normal(20, 3), "machine": rng.normal(20, 3)},
    }
    units = {
        **{("error_motion", name): unit for name, unit in MOTION.items()},
        **{(folder, name): unit for folder in ("tool_offset", "corrected_offset") for name, unit in OFFSET.items()},
        **{(f"{which}_corrections", name): unit for which in ("axis", "applied") for name, unit in AXES.items()},
        ("temperature", "stage"): "°C",
        ("temperature", "machine"): "°C",
    }
    stamps = {}

    def send():
        now_ns = stamps["now"] = time.time_ns()
        place.say(JUDGES, now_ns)
        place.send["error_motion_figures"](figures(list(drawn["error_motion"].values()), now_ns))
        place.send["tool_offset_figures"](figures(list(drawn["tool_offset"].values()), now_ns))
        place.send["corrected_offset_pose"](pose(list(drawn["corrected_offset"].values()), now_ns))
        place.send["axis_corrections"](axes(drawn["axis_corrections"].values(), now_ns))
        place.send["applied_corrections"](axes(drawn["applied_corrections"].values(), now_ns))
        for of in ("stage", "machine"):
            place.send[f"{of}_temperature"](Temperature(header=header(now_ns), temperature=drawn["temperature"][of]))
        stamps.setdefault("first", now_ns)

    paths = [(folder, name) for folder, values in drawn.items() for name in values]
    nodes = [place.node("/".join(path)) for path in paths]

    found = []

    def all_shown():
        found[:] = place.client.read_attributes(nodes, ua.AttributeIds.Value)
        return all(
            value.StatusCode.name == ("BadNotConnected" if name == "ezc" else "Good")
            and (name == "ezc" or math.isclose(value.Value.Value, drawn[folder][name], rel_tol=1e-9))
            for (folder, name), value in zip(paths, found, strict=True)
        )

    place.wait(send, all_shown, "all figures")
    for (folder, name), node, value in zip(paths, nodes, found, strict=True):
        assert node.read_browse_name() == ua.QualifiedName(name, place.index)
        assert node.read_type_definition() == ua.NodeId(ua.ObjectIds.AnalogUnitType)
        unit = node.get_child("0:EngineeringUnits").read_value()
        assert unit.DisplayName.Text == units[folder, name]
        assert unit.UnitId == UNIT_IDS[units[folder, name]]
        assert unit.NamespaceUri == "http://www.opcfoundation.org/UA/units/un/cefact"
        span = node.get_child("0:EURange").read_value()
        assert span.Low < (0 if folder != "temperature" else 20) < span.High
        if name == "ezc":  # the stage of this cell has no sensor for it
            continue
        stamp_ns = round(value.SourceTimestamp.timestamp() * 1e6) * 1000
        assert stamps["first"] - 1000 <= stamp_ns <= stamps["now"]


def test_quality_follows_the_level_of_who_judges(place):
    for level, quality in ((1, "UncertainSubNormal"), (2, "BadDeviceFailure"), (0, "Good")):

        def send(level=level):
            now_ns = time.time_ns()
            place.say({"error_estimator: estimate": level}, now_ns)
            place.send["error_motion_figures"](figures([1.5, math.nan, 0, 4, 5, 6], now_ns))

        expected = {
            "error_motion/exc": (None if level == 2 else 1.5, quality),
            "error_motion/eyc": (None, "BadDeviceFailure" if level == 2 else "BadSensorFailure"),
            # the report itself is good; what it speaks of is not
            "health/error_estimator: estimate/level": (float(level), "Good"),
        }

        def shown(expected=expected, quality=quality):
            found = {path: place.read(path) for path in expected}
            same = {path: (value.Value.Value, value.StatusCode.name) for path, value in found.items()} == expected
            return same and place.quality("health/error_estimator: estimate/usable") == quality

        place.wait(send, shown, quality)


def test_what_falls_silent_is_bad_and_a_subscriber_is_told(place):
    def send():
        now_ns = time.time_ns()
        place.say({"error_estimator: estimate": 0}, now_ns)
        place.send["error_motion_figures"](figures([1, 2, 3, 4, 5, 6], now_ns))

    place.wait(send, lambda: place.quality("error_motion/exc") == "Good", "a good value")
    told = []

    class Handler:
        def datachange_notification(self, node, value, data):
            told.append(data.monitored_item.Value.StatusCode.name)

    subscription = place.client.create_subscription(20, Handler())
    subscription.subscribe_data_change(place.node("error_motion/exc"))
    place.cell.wait_until(lambda: told[-1:] == ["BadNoCommunication"], "the silence to be told")
    assert place.read("error_motion/exc").Value.Value is None
    subscription.delete()


def test_the_verdict_of_the_diagnosis_and_the_latch(place):
    said = {
        "verdict": "explained",
        "causes": "eccentricity head_a (98%)",
        "where": "exc: order 1",
        "gap_before": 3.25,
        "shrink": 0.75,
        "age_s": 12.5,
        "latched": "True",
        "linear_error_um": 500,
        "rotary_rate_rad_s": 0.02,
    }
    shown = {
        "gap/verdict": "explained",
        "gap/causes": said["causes"],
        "gap/where": said["where"],
        "gap/gap_before": 3.25,
        "gap/shrink": 0.75,
        "gap/age": 12.5,
        "gap/message": "level 1",
        "compensation/latched": True,
        "compensation/linear_error": 500.0,
        "compensation/rotary_rate": 0.02,
    }

    def send():
        place.say({"gap_monitor: verdict": 1, "compensation: correction": 2}, time.time_ns(), **said)

    def all_good():
        found = {path: place.read(path) for path in shown}
        return {path: (value.Value.Value, value.StatusCode.name) for path, value in found.items()} == {
            path: (value, "Good") for path, value in shown.items()
        }

    place.wait(send, all_good, "figures")
    assert place.node("gap/age").get_child("0:EngineeringUnits").read_value().DisplayName.Text == "s"

    def stale():
        place.say({"gap_monitor: verdict": 3}, time.time_ns(), **said)

    place.wait(stale, lambda: place.quality("gap/verdict") == "BadOutOfService", "a stale verdict")


def test_nothing_can_be_written_and_no_reset_is_there(place):
    node = place.node("error_motion/exc")
    for attempt in (
        lambda: node.write_value(1.0),
        lambda: node.write_attribute(ua.AttributeIds.DisplayName, ua.DataValue(ua.LocalizedText("mine"))),
        lambda: place.node("error_motion/exc/EURange").write_value(ua.Range(Low=0, High=1)),
        lambda: place.node("cell").add_object(place.index, "mine"),
        lambda: place.client.delete_nodes([node]),
    ):
        with pytest.raises(ua.UaStatusCodeError) as refused:
            attempt()
        assert refused.value.code in (ua.StatusCodes.BadUserAccessDenied, ua.StatusCodes.BadNotWritable)
    with pytest.raises(ua.UaStatusCodeError):
        place.node("compensation").call_method(ua.NodeId("compensation/reset", place.index))
    assert "reset" not in {child.read_browse_name().Name for child in place.node("compensation").get_children()}


def test_the_lines_of_the_document_read_a_value(place, capsys):
    (lines,) = re.findall(r"```python\n(.*?)```", (DOC / "opcua.md").read_text(encoding="utf-8"), re.DOTALL)
    assert lines.count(":4840/") == 1
    exec(compile(lines.replace(":4840/", f":{place.port}/"), "doc/opcua.md", "exec"), {})
    assert "DataValue(" in capsys.readouterr().out


def test_a_port_that_is_taken_is_said(place):
    with pytest.raises(InputError, match=rf"nothing can be served on 127\.0\.0\.1:{place.port} .*set port or address"):
        place.cell.run(OpcuaServer, "second_server", port=place.port)


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"address": "0.0.0.0"}, r"'security_policy' is 'None' and parameter 'address' is '0\.0\.0\.0'"),
        ({"security_policy": "Basic256Sha256"}, "parameter 'certificate' is empty"),
        ({"security_policy": "Basic128"}, "parameter 'security_policy' is 'Basic128'; expected: .*one of None"),
        ({"users": "/absent/users"}, "/absent/users: users cannot be read"),
        (
            {"security_policy": "Basic256Sha256", "certificate": "/absent/c.pem", "private_key": "/absent/k.pem"},
            r"certificate /absent/c\.pem: not to be read",
        ),
        ({"port": 80}, "parameter 'port' is 80"),
        (
            {"address": "0.0.0.0", "security_policy": "Basic256Sha256", "allow_control": True},
            r"'allow_control' is true and parameter 'users' empty: whoever reaches '0\.0\.0\.0' could reset",
        ),
        # past that: an address of documentation (RFC 5737), which no computer has
        (
            {"address": "192.0.2.1", "insecure": True},
            r"nothing can be served on 192\.0\.2\.1:4840 .*set port or address",
        ),
    ],
)
def test_wrong_parameters_are_refused_by_name(place, parameters, reason):
    with pytest.raises(InputError, match=reason):
        place.cell.run(OpcuaServer, "wrong_server", **parameters)


def test_without_the_library_it_is_said_how_to_install_it(place, monkeypatch):
    for name in [each for each in sys.modules if each.split(".")[0] == "asyncua"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "rotary_error_monitor.opcua.server")
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with pytest.raises(InputError, match=r"pip install 'rotary_error_monitor\[opcua\]'"):
        place.cell.run(OpcuaServer, "lonely_server")


def test_more_statuses_than_it_shows_are_left_out_and_told(place, monkeypatch):
    monkeypatch.setattr(server, "MOST_STATUSES", len(place.cell.statuses) + 20)
    many = {f"somebody: {number}": 0 for number in range(40)}
    place.wait(
        lambda: place.say(many, time.time_ns()),
        lambda: place.cell.has_status("opcua_server: server", "statuses of /diagnostics are left out: too many"),
        "too many statuses to be told",
    )

    def shown():
        return [child.read_browse_name().Name for child in place.node("health").get_children()]

    place.cell.wait_until(lambda: len(shown()) >= server.MOST_STATUSES, "as many as there may be")
    place.cell.spin_for(0.1)
    assert len(shown()) == server.MOST_STATUSES
    assert 0 < sum(name in many for name in shown()) < len(many)


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Certificate and key of a server and of a client, and a file of users."""
    folder = tmp_path_factory.mktemp("keys")
    for name in ("server", "client"):
        assert main(["security", "opcua", str(folder / name)]) == 0
    add_user(folder / "users", "ann", "correct horse")
    return folder


def encrypted_client(keys, port, user, password):
    client = Client(f"opc.tcp://127.0.0.1:{port}/", timeout=PATIENCE)
    client.application_uri = "urn:rotary_error_monitor:opcua_server"
    mine = keys / "client"
    client.set_security(SecurityPolicyBasic256Sha256, str(mine / "certificate.pem"), str(mine / "key.pem"))
    if user:
        client.set_user(user)
        client.set_password(password)
    return client


def refuse_without_encryption(port, monkeypatch):
    """No such endpoint is offered; a client that does not care what is offered is refused all the same."""

    def plain():
        client = Client(f"opc.tcp://127.0.0.1:{port}/", timeout=PATIENCE)
        client.set_user("ann")
        client.set_password("correct horse")
        return client

    with pytest.raises(ua.UaError, match="No matching endpoints"), plain():
        pass
    with monkeypatch.context() as patch:
        patch.setattr(asyncua.Client, "find_endpoint", staticmethod(lambda endpoints, *_: endpoints[0]))
        with pytest.raises(ua.UaStatusCodeError) as refused, plain():
            pass
    assert refused.value.code == ua.StatusCodes.BadUserAccessDenied


def test_an_encrypted_server_lets_its_users_in_who_may_reset(keys, monkeypatch):
    """The compensation is the real one: it tells its limits, and answers the reset."""
    port = free_port()
    with Cell(parameters={"machine": MACHINE}) as cell, ThreadPoolExecutor(1) as pool:
        cell.run(
            OpcuaServer,
            "opcua_server",
            port=port,
            period=0.02,
            security_policy="Basic256Sha256",
            certificate=str(keys / "server" / "certificate.pem"),
            private_key=str(keys / "server" / "key.pem"),
            users=str(keys / "users"),
            allow_control=True,
        )
        for user, password in (("ann", "correct horsf"), ("bob", "correct horse"), ("", "")):
            with pytest.raises(ua.UaStatusCodeError), encrypted_client(keys, port, user, password):
                pass
        refuse_without_encryption(port, monkeypatch)
        with encrypted_client(keys, port, "ann", "correct horse") as client:
            index = client.get_namespace_index("urn:rotary_error_monitor:cell")
            folder = client.get_node(ua.NodeId("compensation", index))

            def reset():
                asked = pool.submit(folder.call_method, ua.NodeId("compensation/reset", index))
                cell.wait_until(asked.done, "the answer")
                return asked.result()

            assert reset() == [False, "no compensation answers /compensation/reset; is it running?"]
            cell.run(Compensation, "compensation", linear__error=3e-4)
            # until the server has found it, and where it is late on a busy computer, the answer says so
            cell.wait_until(lambda: reset() == [True, "nothing was latched"], "the compensation's answer")
            limit = client.get_node(ua.NodeId("compensation/linear_error", index))
            cell.wait_until(lambda: limit.read_data_value(False).Value.Value == 300.0, "the limit")
            span = client.get_node(ua.NodeId("axis_corrections/X/EURange", index)).read_value()
            assert (span.Low, span.High) == (-300.0, 300.0)


def test_it_ends_at_once_on_a_signal_though_clients_are_there():
    with Cell() as cell:
        port = free_port()
        process = cell.start("opcua_server", port=port)
        cell.wait_for_status("opcua_server: server", "serving, not encrypted, to everybody, to read only")
        with Client(f"opc.tcp://127.0.0.1:{port}/", timeout=PATIENCE) as client:
            assert client.nodes.objects.get_child("2:cell")
            # a second and a half where nothing else runs
            with stated("its end", 6.0):
                assert process.stop(signal.SIGINT) == 0
