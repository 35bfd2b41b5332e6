"""Where samples come from: no node of an instrument starts without a source, and what is simulated says so."""

from __future__ import annotations

import re
import signal

import pytest
import yaml
from nodes.probes import stage_with_probes
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from rotary_error_monitor.bags.metadata import SIMULATED, read_metadata
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.lvdt import LvdtNode
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.stage_command import StageCommand
from rotary_error_monitor.nodes.stage_follower import StageFollower
from rotary_error_monitor.nodes.stage_force import StageForce
from rotary_error_monitor.nodes.stage_temperature import StageTemperature
from rotary_error_monitor.resources import config
from rotary_error_monitor.testing import Cell

INSTRUMENTS = [
    (EncoderHead, "encoder_head_a"),
    (AutocollimatorNode, "autocollimator"),
    (LvdtNode, "lvdt"),
    (ListedSensorNode, "listed_sensor_top"),
    (StageCommand, "stage_command"),
    (StageForce, "stage_force"),
    (StageTemperature, "stage_temperature"),
]
NAMES = [name for _, name in INSTRUMENTS]
LEFT = ["-r", "__ns:=/left"]
CELL = ["--params-file", str(config("cell.yaml"))]


def real_cell():
    """The file of a real cell with the section of a listed sensor, which no stage has before its file lists one."""
    text = config("real_cell.yaml").read_text(encoding="utf-8")
    opened, count = re.subn(r"^# (/\*\*/listed_sensor_top|  ros__parameters)", r"\1", text, flags=re.MULTILINE)
    assert count == 2
    return opened


@pytest.fixture
def probed(tmp_path):
    """Parameters of a stage that lists the sensor top."""
    return {"stage": str(stage_with_probes(tmp_path))}


@pytest.mark.parametrize(("node_class", "name"), INSTRUMENTS, ids=NAMES)
def test_without_a_source_a_node_names_the_choices(cell, node_class, name, probed):
    with pytest.raises(InputError) as refused:
        cell.run(node_class, name, **probed)
    told = str(refused.value)
    assert told.startswith(f"/{name}: parameter 'source' is not given; expected: where the samples come from: ")
    node = cell.run(node_class, name, autostart=False, **probed)
    (source,) = (setting for setting in node.settings if setting.name == "source")
    assert {"mock"} < set(source.choices)
    for choice in source.choices:
        assert f"-p source:={choice} (" in told, "a few words for each"
    assert told.endswith(
        "-p source:=mock (simulated samples, for a mock cell); a whole mock cell is started with: make run"
    )


@pytest.mark.parametrize("given", [[], ["-p", "source:=''"]])
def test_a_process_without_a_source_ends_with_exit_code_two(given):
    with Cell() as cell:
        process = cell.start("autocollimator", ros_args=given)
        assert process.wait(30) == 2
        assert "error: /autocollimator: parameter 'source' is not given; expected: " in process.output
        assert "Traceback" not in process.output


def test_a_life_cycle_manager_gives_the_source_before_it_configures(cell):
    node = cell.run(EncoderHead, "encoder_head_a", autostart=False)
    assert node.trigger_configure().name == "FAILURE"
    (result,) = node.set_parameters([Parameter("source", value="nowhere")])
    assert not result.successful
    assert cell.set_parameter("encoder_head_a", "source", "mock")
    assert node.trigger_configure().name == "SUCCESS"


def topics_of(cell, node, namespace=""):
    """What a node publishes of the contract, as the graph says."""
    published = cell.node.get_publisher_names_and_types_by_node(node, namespace or "/")
    contract = {topic.name for topic in cell.wire.within(namespace)}
    return {name for name, _ in published if name in contract} - {"/diagnostics"}


@pytest.mark.parametrize(
    ("node_class", "name", "parameters"),
    [
        *((*instrument, {"source": "mock"}) for instrument in INSTRUMENTS),
        (MockController, "mock_controller", {"machine": "xyzac_trt"}),
        (StageFollower, "stage_follower", {}),
    ],
    ids=[*NAMES, "mock_controller", "stage_follower"],
)
def test_what_simulates_says_so_once_in_the_log_and_always_in_the_diagnostics(
    settings, capfd, node_class, name, parameters, probed
):
    with Cell(sensors=("axial_probe_top", "radial_probe_low"), parameters=probed) as cell:
        node = cell.run(node_class, name, ["-r", "__ns:=/left"], **parameters)
        figures = cell.figures(f"left/{name}: state")
        assert (figures["simulated"], figures["source"]) == ("true", "mock")
        assert cell.status(f"left/{name}: state").hardware_id == "mock"
        cell.wait_until(lambda: topics_of(cell, name, "/left"), "the graph to know the node")
        told = figures["simulated_topics"].split(", ")
        assert set(told) == topics_of(cell, name, "/left")
        cell.spin_for(1.5)
        warnings = [line for line in capfd.readouterr().err.splitlines() if "[WARN]" in line and "simulated" in line]
        assert len(warnings) == 1
        assert all(topic in warnings[0] for topic in told)
        node.trigger_deactivate()
        cell.forget_status(f"left/{name}: state")
        assert cell.figures(f"left/{name}: state")["simulated"] == "true"


@pytest.mark.parametrize(
    ("node_class", "name", "parameters", "source"),
    [
        (EncoderHead, "encoder_head_a", {"source": "joint_state"}, "joint_state"),
        (StageTemperature, "stage_temperature", {"source": "temperature"}, "temperature"),
        (ErrorEstimator, "error_estimator", {}, None),
        (Compensation, "compensation", {"machine": "xyzac_trt"}, None),
    ],
)
def test_what_does_not_simulate_says_nothing_of_it(cell, capfd, node_class, name, parameters, source):
    cell.run(node_class, name, **parameters)
    figures = cell.figures(f"{name}: state")
    assert figures.get("source") == source
    assert not {"simulated", "simulated_topics"} & set(figures)
    assert "simulated" not in capfd.readouterr().err


@pytest.mark.few(2)
@pytest.mark.parametrize("namespace", ["", "/left"])
@pytest.mark.parametrize("ending", ["end", "kill"])
def test_a_bag_says_which_of_its_streams_were_simulated(cell, tmp_path, namespace, ending):
    """Head a is simulated, head b has a driver; so is the cell beside, which this recorder does not hear."""
    place, bag = (["-r", f"__ns:={namespace}"] if namespace else []), tmp_path / "bag"
    recorder = cell.start("recorder", ros_args=place, folder=str(bag))
    beside = cell.run(EncoderHead, "encoder_head_c", ["-r", "__ns:=/beside"], source="mock")
    cell.run(EncoderHead, "encoder_head_a", place, source="mock")
    cell.run(EncoderHead, "encoder_head_b", place, source="joint_state")
    driver = cell.node.create_publisher(JointState, f"{namespace}/joint_states", 10)
    own = f"{namespace.lstrip('/')}/recorder".lstrip("/")

    topics = {f"/stage/head_{head}/{kind}" for head in "ab" for kind in ("samples", "joint_states")}

    def heard():
        driver.publish(messages.joint_state_message(beside.now_ns(), "", ["spindle"], [0.5]))
        return cell.recorder_hears(topics, own)

    cell.status(f"{own}: recording")
    cell.wait_until(heard, "the recorder to hear both heads")
    cell.wait_until(lambda: SIMULATED in read_metadata(bag).notes, "the bag to say so while it is recorded")
    if ending == "kill":
        recorder.send(signal.SIGKILL)
        recorder.wait()
        recover(bag)
    else:
        assert recorder.stop() == 0
    told = "/stage/head_a/joint_states, /stage/head_a/samples"
    assert read_metadata(bag).notes[SIMULATED] == told
    reader = BagReader(bag)
    assert f"{bag}: simulated: {told}" in reader.remarks
    assert all(reader.topics[f"/stage/head_{head}/samples"].count for head in "ab")


def test_the_bag_of_a_cell_without_a_mock_says_nothing(cell, tmp_path):
    recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    cell.run(EncoderHead, "encoder_head_b", source="joint_state")
    cell.wait_until(lambda: cell.recorder_hears({"/diagnostics"}), "diagnostics in the bag")
    cell.remove(recorder)
    assert SIMULATED not in read_metadata(tmp_path / "bag").notes


@pytest.mark.parametrize("namespace", [[], LEFT])
def test_the_command_line_counts_for_more_than_the_parameter_file(namespace):
    with Cell() as cell:
        given = ["-p", "source:=joint_state", "-p", "block_period:=0.02", "-p", "mock.seed:=9"]
        node = cell.run(EncoderHead, "encoder_head_a", [*CELL, *given, *namespace])
        shown = [node.setting(name) for name in ("source", "block_period", "mock.seed", "head")]
        assert shown == ["joint_state", 0.02, 9, "a"], "of a node's section, of that of all, nested, and the file's own"
        period = cell.run(ErrorEstimator, "error_estimator", [*CELL, "-p", "period:=0.004", *namespace])
        assert period.setting("period") == 0.004


@pytest.mark.parametrize("namespace", [[], LEFT])
def test_so_it_does_of_a_process(namespace):
    with Cell() as cell:
        cell.start("encoder_head", "encoder_head_a", [*CELL, *namespace], source="joint_state")
        name = "left/encoder_head_a" if namespace else "encoder_head_a"
        assert cell.figures(f"{name}: state")["source"] == "joint_state"


@pytest.mark.parametrize("file", ["cell.yaml", "real_cell.yaml"])
def test_no_section_of_a_shipped_file_is_behind_the_one_of_all(file):
    *_, last = yaml.safe_load(config(file).read_text(encoding="utf-8"))
    assert last == "/**", "what -p says is added to it, and the sections behind it would count for more"


@pytest.mark.parametrize(("node_class", "name"), INSTRUMENTS, ids=NAMES)
def test_in_the_file_of_a_real_cell_nothing_is_simulated(node_class, name, probed, tmp_path):
    file = tmp_path / "real_cell.yaml"
    file.write_text(real_cell(), encoding="utf-8")
    with Cell() as cell:
        node = cell.run(node_class, name, ["--params-file", str(file)], **probed)
        figures = cell.figures(f"{name}: state")
        assert figures["source"] == node.setting("source") != "mock"
        assert "simulated" not in figures
        assert f"/**/{name}" in yaml.safe_load(file.read_text(encoding="utf-8"))


def test_the_files_of_a_mock_and_of_a_real_cell_have_the_same_instruments():
    cells = (yaml.safe_load(text) for text in (config("cell.yaml").read_text(encoding="utf-8"), real_cell()))
    mock, real = ([name for name in cell if "source" in cell[name]["ros__parameters"]] for cell in cells)
    assert mock == real
