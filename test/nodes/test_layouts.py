"""Layouts for Foxglove and PlotJuggler and the analyzers, against a bag and the statuses of a cell that runs.

Each topic and field path is looked up in recorded messages, read by rosbags, as the tools read them.
"""

from __future__ import annotations

import json
import re
import time
from xml.etree import ElementTree

import pytest
import yaml
from checkout import node_names
from nodes.mock_cells import mock_parameters
from rosbags.highlevel import AnyReader

from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.diagnostics import status_name
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.visualization import Visualization
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.testing import Cell

FOXGLOVE_PANELS = {
    "3D", "DiagnosticStatusPanel", "DiagnosticSummary", "Image", "Indicator", "Gauge", "Teleop", "map", "PieChart",
    "Parameters", "Plot", "Publish", "CallService", "RawMessages", "RosOut", "StateTransitions", "Table", "TopicGraph",
    "SourceInfo", "GlobalVariableSliderPanel", "NodePlayground", "Tab", "PlaybackPerformance",
}  # fmt: skip
"""Built-in panels of Lichtblick, the open fork of Foxglove Studio: packages/suite-base/src/panels/index.ts."""

PLOTJUGGLER_PLUGINS = {"ROS2 Topic Subscriber", "ROS2 Topic Re-Publisher", "ROS2 bags"}
"""Names of plugins for ROS 2: plotjuggler-ros-plugins, `name()` in plugins/{DataStreamROS2,TopicPublisherROS2,…}."""

FOXGLOVE = json.loads(config("foxglove/cell.json").read_text(encoding="utf-8"))
PLOTJUGGLER = ElementTree.fromstring(config("plotjuggler/cell.xml").read_bytes())
ANALYZERS = {
    name: section
    for name, section in yaml.safe_load(config("diagnostic_aggregator.yaml").read_text(encoding="utf-8"))["analyzers"][
        "ros__parameters"
    ].items()
    if isinstance(section, dict)
}
SHOWN = ("error_motion_figures", "tool_offset_figures", "corrected_offset_pose", "axis_corrections",
         "applied_corrections", "diagnostics")  # fmt: skip


class Recorded:
    """What a cell said: last message of each topic, latest statuses by hardware and name, markers that were drawn."""

    def __init__(self, bag, statuses, markers):
        self.statuses, self.markers = statuses, markers
        self.last, self.told = {}, {}
        with AnyReader([bag]) as reader:
            for connection, _, data in reader.messages():
                if connection.msgtype != "sensor_msgs/msg/PointCloud2":
                    self.last[connection.topic] = message = reader.deserialize(data, connection.msgtype)
                    for status in getattr(message, "status", ()):
                        told = self.told.setdefault((status.hardware_id, status.name), {})
                        # a figure of a cell that holds for a moment is none then
                        told |= {each.key: each.value for each in status.values if each.value != "none"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    settings = MockSettings(seed=3, epoch_ns=time.time_ns() - 5_000_000_000, speeds=(1.5,), forces=False)
    bag = tmp_path_factory.mktemp("layouts") / "bag"
    with Cell(parameters={**mock_parameters(settings, 0.05), "machine": "xyzac_trt"}) as cell:
        names = {cell.wire.topic(key).name for key in SHOWN}
        pictures = cell.collect(cell.wire.topic("error_motion_markers"))
        recorder = cell.run(Recorder, "recorder", folder=str(bag))
        for letter in "abcd":
            cell.run(EncoderHead, f"encoder_head_{letter}", source="mock")
        cell.run(AutocollimatorNode, "autocollimator", source="mock")
        cell.run(MockController, "mock_controller")
        cell.run(ErrorEstimator, "error_estimator", check_turns=0.0)
        cell.run(Compensation, "compensation", age_limit=1.0)  # the tests share few cores
        cell.run(Visualization, "visualization")
        cell.run(GapMonitor, "gap_monitor")
        for status in ("compensation: correction", "error_estimator: estimate", "gap_monitor: verdict"):
            cell.status(status)
        all_say = set(ANALYZERS) - {"surroundings"}
        cell.wait_until(
            lambda: all_say <= {key for name in dict(cell.statuses) for key in owners(name)}, "a status of each node"
        )
        cell.wait_until(lambda: cell.recorder_hears(names) and len(pictures) > 0, "all that layouts show")
        # a figure that is none before the first correction
        cell.wait_until(
            lambda: cell.figures("compensation: correction")["standard_uncertainty_um"] != "none", "a known uncertainty"
        )
        statuses = dict(cell.statuses)
        cell.forget_status("recorder: recording")
        cell.status("recorder: recording")  # until then the recorder has it, too
        cell.remove(recorder)
    return Recorded(bag, statuses, pictures[-1])


def at(message, path):
    """The number at a path such as `pose.position.x` or `position[2]`; AttributeError, IndexError where none is."""
    for part in path.split("."):
        name, _, index = part.partition("[")
        message = getattr(message, name)
        if index:
            message = message[int(index.rstrip("]"))]
    assert isinstance(float(message), float)
    return message


def test_each_path_of_foxglove_is_in_the_bag(recorded):
    paths = [path for panel in FOXGLOVE["configById"].values() for path in panel.get("paths", ())]
    topics = {path["value"].partition(".")[0] for path in paths}
    assert topics == {
        name for name in recorded.last if name.endswith(("/figures", "_corrections", "corrected_offset/pose"))
    }
    for path in paths:
        topic, _, field = path["value"].partition(".")
        at(recorded.last[topic], field)
        if "_corrections" in topic:
            axis = recorded.last[topic].name[int(re.search(r"\[(\d+)\]", field)[1])]
            assert path["label"].split()[0] == axis


def test_the_other_panels_of_foxglove_show_what_is_there(recorded):
    panels = FOXGLOVE["configById"]
    topics = {topic for panel in panels.values() for topic in panel.get("topics", {})}
    assert topics == {"/stage/error_motion/markers"}
    (frame,) = {panel["followTf"] for panel in panels.values() if "followTf" in panel}
    assert {marker.header.frame_id for marker in recorded.markers.markers} == {frame}
    shown = [panel for panel in panels.values() if "topicToRender" in panel]
    assert shown and {panel["topicToRender"] for panel in shown} == {"/diagnostics"}
    for panel in shown:
        if "selectedName" in panel:
            assert (panel["selectedHardwareId"], panel["selectedName"]) in recorded.told


def leaves(tree):
    """Panels of a layout; each split has two parts and a share for the first."""
    if isinstance(tree, str):
        return [tree]
    assert set(tree) == {"direction", "first", "second", "splitPercentage"}
    assert tree["direction"] in ("row", "column") and 5 < tree["splitPercentage"] < 95
    return leaves(tree["first"]) + leaves(tree["second"])


def test_panels_of_foxglove_exist_and_each_is_in_the_layout_once():
    assert set(FOXGLOVE) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    assert sorted(leaves(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])
    kinds = {name.partition("!")[0] for name in FOXGLOVE["configById"]}
    assert kinds <= FOXGLOVE_PANELS
    assert kinds >= {"3D", "Plot", "DiagnosticSummary"}
    paths = [path for panel in FOXGLOVE["configById"].values() for path in panel.get("paths", ())]
    assert all(re.fullmatch(r"#[0-9a-f]{6}", path["color"]) and path["enabled"] for path in paths)


def series(recorded, curve):
    """Whether PlotJuggler makes that series (plotjuggler-ros-plugins and its ParserROS).

    A joint state is `<topic>/<joint>/<field>`, diagnostics `<topic>/<hardware id>/<status>/<key>`, all else
    `<topic>/<field>/<field>`.
    """
    topic = max((name for name in recorded.last if curve.startswith(f"{name}/")), key=len, default="")
    assert topic, f"{curve}: no such topic in the bag"
    parts = curve.removeprefix(f"{topic}/").split("/")
    message = recorded.last[topic]
    if hasattr(message, "status"):
        hardware, status, key = parts
        return float(recorded.told[hardware, status][key])
    if hasattr(message, "effort"):
        joint, field = parts
        return getattr(message, field)[list(message.name).index(joint)]
    return at(message, ".".join(parts))


CURVES = [curve.get("name") for curve in PLOTJUGGLER.iter("curve")]


def test_each_curve_of_plotjuggler_is_made_of_the_bag(recorded):
    for curve in CURVES:
        assert isinstance(float(series(recorded, curve)), float), curve
    selected = {topic.get("name") for topic in PLOTJUGGLER.iter("topic")}
    assert selected <= set(recorded.last)
    assert all(any(curve.startswith(f"{topic}/") for topic in selected) for curve in CURVES)
    assert all(any(curve.startswith(f"{topic}/") for curve in CURVES) for topic in selected)


def test_plotjuggler_has_the_plugins_and_can_lay_it_out():
    assert PLOTJUGGLER.tag == "root"
    plugins = {plugin.get("ID") for plugin in PLOTJUGGLER.iter("plugin")}
    assert plugins and plugins <= PLOTJUGGLER_PLUGINS
    assert PLOTJUGGLER.find("previouslyLoaded_Streamer").get("name") in plugins
    for tab in PLOTJUGGLER.iter("Tab"):
        assert int(tab.get("containers")) == len(tab.findall("Container"))
    for splitter in PLOTJUGGLER.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes").split(";")]
        assert int(splitter.get("count")) == len(sizes) == len(splitter)
        assert abs(sum(sizes) - 1.0) < 1e-5
    for area in PLOTJUGGLER.iter("DockArea"):
        (plot,) = area.findall("plot")
        assert plot.get("mode") == "TimeSeries" and plot.findall("curve")
    assert len(CURVES) == len(set(CURVES))


def matches(analyzer, name):
    """As `GenericAnalyzer::match` (ros/diagnostics, diagnostic_aggregator/src/generic_analyzer.cpp)."""
    known = {"type", "path", "regex", "startswith", "contains", "name", "expected"}
    assert set(analyzer) <= known and analyzer["type"] == "diagnostic_aggregator/GenericAnalyzer"
    return (
        any(re.fullmatch(pattern, name) for pattern in analyzer.get("regex", ()))
        or any(name.startswith(each) for each in analyzer.get("startswith", ()))
        or any(each in name for each in analyzer.get("contains", ()))
        or name in (*analyzer.get("name", ()), *analyzer.get("expected", ()))
    )


def owners(name):
    return [key for key, analyzer in ANALYZERS.items() if matches(analyzer, name)]


def test_each_status_of_the_cell_belongs_to_one_analyzer(recorded):
    assert len(recorded.statuses) > 25
    found = {name: owners(name) for name in recorded.statuses}
    assert all(len(each) == 1 for each in found.values()), found
    assert {each for (each,) in found.values()} == set(ANALYZERS) - {"surroundings"}


@pytest.mark.parametrize("namespace", ["", "/left", "/hall_2/left"])
@pytest.mark.parametrize("node", node_names())
def test_so_does_each_node_in_any_namespace(node, namespace):
    names = [f"{node}_{name}" for name in ("a", "top_2")] if node in ("encoder_head", "listed_sensor") else [node]
    for name in names:
        status = status_name(f"{namespace}/{name}: /stage/head_a/samples")
        assert len(owners(status)) == 1, status
    assert owners(status_name(f"{namespace}/not_of_the_package: state")) == []


def test_paths_of_analyzers_are_told_apart():
    assert len({analyzer["path"] for analyzer in ANALYZERS.values()}) == len(ANALYZERS)
