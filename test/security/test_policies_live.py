"""The policies say what running nodes do: everything that a node opens is allowed, and nothing else is.

What a node opens is asked of the graph of ROS, so a topic or service that a node has and the contract has not, or the
other way round, fails here.
"""

from __future__ import annotations

from importlib.util import find_spec

import pytest
from nodes.probes import stage_with_probes
from ports import free_port

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import load_services, load_wire, wire_of
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.dashboard import Dashboard
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.linuxcnc_bridge import LinuxcncBridge
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.lvdt import LvdtNode
from rotary_error_monitor.nodes.metrics import Metrics
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.opcua_server import OpcuaServer
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.stage_command import StageCommand
from rotary_error_monitor.nodes.stage_follower import StageFollower
from rotary_error_monitor.nodes.stage_force import StageForce
from rotary_error_monitor.nodes.stage_temperature import StageTemperature
from rotary_error_monitor.nodes.visualization import Visualization
from rotary_error_monitor.security.access import OPERATOR, cell_accesses
from rotary_error_monitor.testing import Cell

HEADS = ("a", "b", "c", "d")
POLICIES = {access.node: access for access in cell_accesses(load_wire(HEADS), load_services())}
MACHINE = {"machine": "xyzac_trt"}
MOCK = {"source": "mock"}
NODES = {
    "encoder_head_a": (EncoderHead, MOCK),
    "encoder_head_d": (EncoderHead, MOCK),
    "autocollimator": (AutocollimatorNode, MOCK),
    "lvdt": (LvdtNode, MOCK),
    "mock_controller": (MockController, MACHINE),
    "error_estimator": (ErrorEstimator, {}),
    "compensation": (Compensation, MACHINE),
    "recorder": (Recorder, {}),
    "gap_monitor": (GapMonitor, {}),
    "visualization": (Visualization, {"machine": "xyzac_trt"}),
    "metrics": (Metrics, {}),
    "opcua_server": (OpcuaServer, MACHINE),
    "dashboard": (Dashboard, {}),
    "linuxcnc_bridge": (LinuxcncBridge, MACHINE),
    "stage_follower": (StageFollower, {}),
    "stage_command": (StageCommand, MOCK),
    "stage_force": (StageForce, MOCK),
    "stage_temperature": (StageTemperature, MOCK),
}


def test_there_is_a_policy_for_each_node_and_for_the_operator():
    assert {name.partition("_head_")[0] for name in POLICIES} == {
        *(name.partition("_head_")[0] for name in NODES),
        OPERATOR,
    }


@pytest.mark.parametrize("name", NODES)
def test_a_policy_allows_what_its_node_opens_and_nothing_else(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    node_class, parameters = NODES[name]
    if any(setting.name == "port" for setting in node_class.settings):
        parameters = {**parameters, "port": free_port()}  # another cell on this computer may have the usual one
    with Cell(HEADS) as cell:
        node = cell.run(node_class, name, **parameters)
        assert node.active
        absent = {"/tf"} if find_spec("tf2_ros") is None else set()
        for opened, allowed in (
            (node.get_publisher_names_and_types_by_node, [x for x in POLICIES[name].publish if x not in absent]),
            (node.get_subscriber_names_and_types_by_node, POLICIES[name].subscribe),
            (node.get_service_names_and_types_by_node, POLICIES[name].reply),
            (node.get_client_names_and_types_by_node, POLICIES[name].request),
        ):
            assert sorted(topic for topic, _ in opened(name, "/")) == list(allowed)


def test_so_does_the_policy_of_a_listed_sensor(tmp_path):
    file, name = stage_with_probes(tmp_path), "listed_sensor_top"
    allowed = {access.node: access for access in cell_accesses(wire_of(load_stage(file)), load_services())}[name]
    with Cell(HEADS) as cell:
        node = cell.run(ListedSensorNode, name, stage=str(file), source="mock")
        topics = [topic for topic, _ in node.get_publisher_names_and_types_by_node(name, "/")]
        assert sorted(topics) == list(allowed.publish)
        assert "/stage/axial_probe_top/samples" in topics
        assert [topic for topic, _ in node.get_subscriber_names_and_types_by_node(name, "/")] == []
        assert sorted(service for service, _ in node.get_service_names_and_types_by_node(name, "/")) == list(
            allowed.reply
        )


def test_what_the_contract_says_of_services_is_their_type(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for service in load_services():
        for server in service.servers:
            node_class, parameters = NODES[server]
            with Cell(HEADS) as cell:
                node = cell.run(node_class, server, **parameters)
                types = dict(node.get_service_names_and_types_by_node(server, "/"))
                assert types[f"/{server}{service.name[1:]}"] == [service.type]
