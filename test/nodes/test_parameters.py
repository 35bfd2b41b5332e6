"""Parameters of nodes: what is wrong is refused, and the message says what would be right."""

from __future__ import annotations

from importlib import import_module

import pytest
import yaml
from rclpy.parameter import Parameter

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.resources import config
from rotary_error_monitor.supervision.cell_file import executables
from rotary_error_monitor.testing import Cell


class Probe(ManagedNode):
    settings = (
        Setting("limit", 0.5, "largest offset, m", (0.0, 1.0)),
        Setting("count", 3, "how many", (1, 10)),
        Setting("source", "mock", "where from", choices=("mock", "device")),
        Setting("speeds", [1.0, 2.0], "speeds, rad/s"),
        Setting("unit", "kN", "unit", choices=("N", "kN")),
        Setting("answer", "maybe", "answer", choices=("n", "no", "maybe")),
    )


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("limit", 2.0, r"/probe: parameter 'limit' is 2\.0; expected: largest offset, m \(.*from 0 to 1\)"),
        ("limit", 1, r"parameter 'limit' is 1; expected: .*a number with a point"),
        ("limit", float("nan"), "parameter 'limit' is nan"),
        ("count", 11, r"parameter 'count' is 11; expected: how many \(a whole number, from 1 to 10\)"),
        ("source", "counter", r"parameter 'source' is 'counter'; expected: where from \(one of mock, device\)"),
        ("speeds", [1.0, float("inf")], r"parameter 'speeds' is .*; expected: speeds, rad/s \(a list\)"),
        ("autostart", 1, "parameter 'autostart' is 1; expected: configure and activate at start"),
        ("unit", True, r"parameter 'unit' is True; expected: unit \(one of N, kN\)"),
        (
            "answer",
            False,
            "parameter 'answer' is False; expected: answer",
        ),  # which of the two was written, nobody knows
        ("limmit", 0.1, "no parameter 'limmit'; did you mean: limit"),
        ("qos_overrides./no/topic.publisher.depth", 3, "no parameter 'qos_overrides./no/topic"),
    ],
)
def test_a_wrong_parameter_is_named(name, value, problem):
    with Cell() as cell, pytest.raises(InputError, match=problem):
        cell.run(Probe, "probe", **{name.replace(".", "__") if name[0] != "q" else name: value})


def test_right_parameters_are_taken_and_described():
    with Cell(parameters={"machine": "xyzac_trt"}) as cell:  # of the cell, though this node does not use it
        node = cell.run(Probe, "probe", limit=0.25, source="device", use_sim_time=False)
        assert (node.setting("limit"), node.setting("count"), node.setting("source")) == (0.25, 3, "device")
        assert list(node.setting("speeds")) == [1.0, 2.0]
        descriptor = node.describe_parameter("limit")
        assert descriptor.floating_point_range[0].to_value == 1.0
        assert "largest offset" in descriptor.description


def test_a_choice_that_yaml_reads_as_a_truth_value_is_taken_for_what_it_is(tmp_path):
    """`-p unit:=N` reaches a node as false."""
    for arguments in (["-p", "unit:=N"], ["--params-file", str(tmp_path / "given.yaml")]):
        (tmp_path / "given.yaml").write_text("/**: {ros__parameters: {unit: N}}\n", encoding="utf-8")
        with Cell() as cell:
            node = cell.run(Probe, "probe", arguments)
            assert node.setting("unit") == "N"


def test_parameters_are_read_when_the_node_configures():
    with Cell() as cell:
        node = cell.run(Probe, "probe")
        (result,) = node.set_parameters([Parameter("limit", value=0.75)])
        assert not result.successful
        assert "limit: read when the node configures; clean it up first" in result.reason
        node.trigger_deactivate()
        node.trigger_cleanup()
        (result,) = node.set_parameters([Parameter("limit", value=0.75)])
        assert result.successful
        assert node.setting("limit") == 0.75


@pytest.mark.parametrize(
    ("name", "value"),
    [("limit", float("nan")), ("limit", float("inf")), ("limit", 7.0), ("limit", "0.5"), ("source", "nowhere"),
     ("speeds", [1.0, float("nan")]), ("count", 11), ("limmit", 0.5)],
)  # fmt: skip
def test_a_wrong_parameter_is_refused_before_the_node_configures_too(name, value):
    with Cell() as cell:
        node = cell.run(Probe, "probe", autostart=False)
        before = {setting.name: node.setting(setting.name) for setting in node.settings}
        assert not cell.set_parameter("probe", name, value)
        assert {setting.name: node.setting(setting.name) for setting in node.settings} == before


def test_cell_settings_by_name_and_group():
    assert [setting.name for setting in cell_settings("stage")] == ["stage"]
    assert {setting.name for setting in cell_settings("mock.")} >= {"mock.seed", "mock.epoch"}


def numbers_of(section, before=""):
    """Parameters by their dotted names."""
    found = {}
    for name, value in section.items():
        found |= numbers_of(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
    return found


ELSEWHERE = {"mock_controller", "stage_follower"}
"""Nodes that stand for others of the shipped cell, which can be started as it is: their publishers would be two."""


@pytest.mark.parametrize("name", sorted({*executables()} - ELSEWHERE))
def test_the_table_of_all_parameters_is_one(name):
    """Each parameter of each node stands in the shipped cell, with its default, but for `source` and `head`."""
    sections = {
        key.strip("/*"): numbers_of(section["ros__parameters"])
        for key, section in yaml.safe_load(config("cell.yaml").read_text(encoding="utf-8")).items()
    }
    own = next((found for key, found in sections.items() if key.startswith(name)), {})
    module = import_module(f"rotary_error_monitor.nodes.{name}")
    (kind,) = (each for each in vars(module).values() if is_node(each, module))
    assert not {each.name for each in kind.settings} - own.keys() - sections[""].keys()
    defaults = {each.name: each.default for each in kind.settings if each.name in own}
    assert {key: own[key] for key in defaults.keys() - {"source", "head"}} == {
        key: value for key, value in defaults.items() if key not in {"source", "head"}
    }


def is_node(each, module):
    return isinstance(each, type) and issubclass(each, ManagedNode) and each.__module__ == module.__name__
