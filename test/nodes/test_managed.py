"""What all nodes share: life cycle, diagnostics, end by signals, wrong input."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping

import pytest
import yaml
from faults.documenting import Row, shows
from lifecycle_msgs.msg import Transition
from nodes.probes import stage_with_probes
from ports import free_port
from rclpy.parameter import Parameter

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import managed
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.dashboard import Dashboard
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.linuxcnc_bridge import LinuxcncBridge
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.lvdt import LvdtNode
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.metrics import Metrics
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.opcua_server import OpcuaServer
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.visualization import Visualization
from rotary_error_monitor.resources import config
from rotary_error_monitor.testing import Cell


def test_a_life_cycle_manager_can_take_over(cell):
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    cell.run(EncoderHead, "encoder_head_a", autostart=False, source="mock")
    assert cell.change_state("encoder_head_a", Transition.TRANSITION_CONFIGURE)
    cell.wait_for_status("encoder_head_a: state", "inactive")
    assert blocks == []
    for _ in range(2):
        assert cell.change_state("encoder_head_a", Transition.TRANSITION_ACTIVATE)
        cell.wait_until(lambda: len(blocks) > 2, "blocks of an active node")
        assert cell.change_state("encoder_head_a", Transition.TRANSITION_DEACTIVATE)
        cell.forget_status("encoder_head_a: state")
        cell.wait_for_status("encoder_head_a: state", "inactive")
        cell.wait_for_silence(blocks)  # what was on its way by then
        blocks.clear()
        cell.spin_for(0.3)
        assert blocks == []
        assert cell.change_state("encoder_head_a", Transition.TRANSITION_CLEANUP)
        assert cell.change_state("encoder_head_a", Transition.TRANSITION_CONFIGURE)
    assert cell.change_state("encoder_head_a", Transition.TRANSITION_INACTIVE_SHUTDOWN)


def test_a_node_that_cannot_be_configured_stays_unconfigured_until_it_can(cell):
    node = cell.run(EncoderHead, "encoder_head_x", autostart=False, source="mock")
    assert not cell.change_state("encoder_head_x", Transition.TRANSITION_CONFIGURE)
    node.set_parameters([Parameter("head", value="b")])
    assert cell.change_state("encoder_head_x", Transition.TRANSITION_CONFIGURE)


def test_a_wrong_stage_is_named_with_file_and_line(cell, tmp_path):
    text = config("stage.yaml").read_text(encoding="utf-8")
    path = tmp_path / "stage.yaml"
    for wrong, problem in (
        (text.replace("disc_radius: 0.1", "disc_radius: 100.0"), r"stage\.yaml:\d+: .*disc_radius"),
        (text.replace("disc_radius:", "disk_radius:"), r"stage\.yaml:\d+: .*disk_radius"),
        (text.replace("disc_radius: 0.1", "disc_radius: 0.1 m"), r"stage\.yaml:\d+: .*disc_radius.*'0\.1 m'"),
    ):
        path.write_text(wrong, encoding="utf-8")
        with pytest.raises(InputError, match=problem):
            cell.run(EncoderHead, "encoder_head_a", stage=str(path), source="mock")
    with pytest.raises(InputError, match=r"nowhere\.yaml: cannot be read"):
        cell.run(EncoderHead, "encoder_head_a", stage="nowhere.yaml", source="mock")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["-p", "block_period:=7.0"], "parameter 'block_period' is 7.0"),
        (["-p", "head:=x"], "the stage has the heads a, b, c, d"),
        (["-p", "stage:=nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["--params-file", "nowhere.yaml"], "nowhere.yaml"),
        (["--nonsense"], "--nonsense"),
    ],
)
def test_wrong_input_ends_a_process_with_exit_code_two(arguments, problem):
    with Cell() as cell:
        process = cell.start("encoder_head", "encoder_head_q", ros_args=arguments, source="mock")
        assert process.wait(30) == 2
        assert problem in process.output
        assert "Traceback" not in process.output


class Faulty(ManagedNode):
    def open(self) -> None:
        self.at_each(10_000_000, lambda _: [][0])


def test_a_fault_of_the_program_is_told(cell):
    node = cell.run(Faulty, "faulty")
    with pytest.raises(IndexError):
        cell.wait_until(lambda: False, "a node that fails")
    assert node.end.done()


def test_simulated_time_drives_the_blocks(cell):
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    set_time = cell.clock()
    cell.run(EncoderHead, "encoder_head_a", use_sim_time=True, mock__epoch=1, source="mock")
    cell.spin_for(0.2)
    assert blocks == []
    for step in range(1, 4):
        set_time(100_000_000_000 + step * 50_000_000)
        cell.wait_until(lambda step=step: len(blocks) >= step, f"block {step}")
    assert [block.header.stamp.sec for block in blocks] == [100, 100, 100]
    assert len(blocks) == 3


@shows(
    Row(
        "processes",
        "`use_sim_time` is set and nothing publishes `/clock`",
        "`state` of each such node: nothing has come on /clock, time stands still",
        "nothing: time stands at 0",
        "nothing",
        "with the first `/clock`",
    )
)
def test_simulated_time_without_a_clock_is_said_and_nothing_goes_out(cell):
    blocks = cell.collect(cell.wire.topic("head_samples", "a"))
    cell.run(EncoderHead, "encoder_head_a", use_sim_time=True, mock__epoch=1, source="mock")
    status = cell.wait_for_status("encoder_head_a: state", "nothing has come on /clock: time stands still")
    assert status.level == b"\x02"
    assert blocks == []
    cell.clock()(100_000_000_000)
    cell.wait_until(lambda: len(blocks) > 0, "blocks")
    cell.wait_for_status("encoder_head_a: state", "nothing new has come on /clock for")


NODES = [
    (EncoderHead, "encoder_head_c"),
    (AutocollimatorNode, "autocollimator"),
    (LvdtNode, "lvdt"),
    (ListedSensorNode, "listed_sensor_top"),
    (MockController, "mock_controller"),
    (LinuxcncBridge, "linuxcnc_bridge"),
    (ErrorEstimator, "error_estimator"),
    (Compensation, "compensation"),
    (Recorder, "recorder"),
    (GapMonitor, "gap_monitor"),
    (Visualization, "visualization"),
    (Metrics, "metrics"),
    (OpcuaServer, "opcua_server"),
    (Dashboard, "dashboard"),
]


@pytest.mark.parametrize(("node_class", "name"), NODES, ids=[name for _, name in NODES])
def test_the_parameter_file_of_the_cell_fits_every_node(node_class, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    more: dict[str, object] = {"stage": str(stage_with_probes(tmp_path))} if node_class is ListedSensorNode else {}
    if any(setting.name == "port" for setting in node_class.settings):
        more["port"] = free_port()  # another cell on this computer may have the usual one
    with Cell() as cell:
        node = cell.run(node_class, name, ros_args=["--params-file", str(config("cell.yaml"))], **more)
        assert node.active
        shown = yaml.safe_load(config("cell.yaml").read_text(encoding="utf-8"))
        own = dict(_flat(shown.get(f"/**/{name}", {"ros__parameters": {}})["ros__parameters"]))
        defaults = {setting.name: setting.default for setting in node.settings}
        assert set(own) <= set(defaults)
        assert {key: value for key, value in own.items() if key not in ("source", "head")} == {
            key: defaults[key] for key in own if key not in ("source", "head")
        }, "each is shown with its default; a source has none, and a head is one of four"
        assert f"/**/{name}" in shown or name == "mock_controller"


def _flat(tree: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def test_quality_of_service_can_be_overridden(cell):
    topic = cell.wire.topic("head_samples", "a").name
    name = f"qos_overrides.{topic}.publisher.reliability"
    cell.run(EncoderHead, "encoder_head_a", **{name: "best_effort"}, source="mock")
    cell.wait_until(lambda: cell.node.get_publishers_info_by_topic(topic) != [], "the publisher")
    (info,) = cell.node.get_publishers_info_by_topic(topic)
    assert info.qos_profile.reliability.name == "BEST_EFFORT"


class Told(ManagedNode):
    word = "one"

    def conditions(self, now_ns: int) -> list[Condition]:
        return [Condition("word", Level.WARN, self.word)]

    def news(self, now_ns: int) -> Hashable:
        return self.word


def test_what_is_new_is_said_at_once_and_not_with_the_report_of_the_next_second(cell, monkeypatch):
    monkeypatch.setattr(managed, "_DIAGNOSTICS_PERIOD", 3600.0)
    node = cell.run(Told, "told")
    cell.wait_for_status("told: word", "one")
    node.word = "another"
    cell.wait_for_status("told: word", "another")
    node.refuse("/topic", InputError("no number"))
    cell.wait_for_status("told: refused /topic", "no number")
