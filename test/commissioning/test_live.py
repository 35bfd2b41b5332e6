"""A newcomer's first hour: drivers of other makers, a stage that nobody has measured, and the commands that are typed.

Nothing of what drivers publish and of what is true comes from the package: the stage is one of the tests' own world.
"""

from __future__ import annotations

import copy
import math
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import yaml
from described_stages import stage_of
from world.newly_built import NewlyBuilt
from world.recording import AUTOCOLLIMATOR, COMMAND, head_topic

from commissioning.drivers import built_stage
from commissioning.test_command import check_errors
from commissioning.typed import Attempt, Place, Running, commissioned
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.nodes.transport import steady_transport
from rotary_error_monitor.resources import config
from rotary_error_monitor.testing.domains import own_domain

DOCUMENT = (Path(__file__).parents[2] / "doc" / "commissioning.md").read_text(encoding="utf-8")
HEIGHT = 0.06
"""Above the ring, m, where the radial error motion is held against the truth too: the highest of the papers."""

# What is typed, in this order; between them files are edited.
COPY = "cp config/real_cell.yaml cell.yaml"
UP = "rotary_error_monitor up cell.yaml"
COMMISSION = "rotary_error_monitor commission --live --stage nominal.yaml -o stage.yaml"
TYPED = (COPY, UP, COMMISSION, UP, COMMISSION)

SOURCES = ("encoder_head_", "autocollimator", "stage_command")


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    with own_domain() as domain:
        made = Place(tmp_path, domain)
        try:
            yield made
        finally:
            made.end()


def named(said: str) -> set[str]:
    """What is said to be wrong."""
    lines = said.partition("what is wrong:\n")[2].partition("what was found")[0].splitlines()
    return {line.strip() for line in lines if line.startswith("  ") and not line.startswith("    ")}


def but_autocollimator(said: str) -> set[str]:
    """The same without what is said of the autocollimator."""
    return {text for text in named(said) if "autocollimator" not in text}


def wrong_with(built: NewlyBuilt) -> set[str]:
    """What a stage has that its data sheets do not say, but for units and the autocollimator."""
    settled = " (put right in the stage file)"
    said = {
        f"head {letter} counts the other way{settled}"
        for letter, head in built.true["encoder"]["heads"].items()
        if head["sign"] == -1
    }
    if built.swapped:
        said.add(f"heads {built.swapped[0]} and {built.swapped[1]} are swapped{settled}")
    return said


def write_nominal(path: Path, built: NewlyBuilt) -> None:
    """What the data sheets say."""
    path.write_text(yaml.safe_dump({"stage": built.nominal}), encoding="utf-8")


def edit_cell(path: Path, unit_of: Callable[[str], str] = lambda name: "rad") -> None:
    """What a person does to a copy of the cell's file: own topics, no section of what is not there, own stage."""
    text = path.read_text(encoding="utf-8")
    sections = re.findall(r"^/\*\*/(\w+):.*\n((?:  .*\n)+)", text, re.MULTILINE)
    kept = [f"/**/{name}:\n{body}" for name, body in sections if name.startswith(SOURCES)]
    edited = "".join(kept) + "/**:\n  ros__parameters: {stage: nominal.yaml}\n"
    edited = re.sub(r"encoder_(\w)/joint_states", r"reader_\1/position", edited)
    edited = edited.replace("autocollimator_driver/tilt", "collimator/angles")
    edited = edited.replace("controller/joint_states", "plc/axes")
    for letter in "abcd":
        unit = unit_of(f"head_{letter}")
        edited = edited.replace(f"reader_{letter}/position, ", f"reader_{letter}/position, unit: {unit}, ")
    path.write_text(edited.replace("plc/axes, ", f"plc/axes, unit: {unit_of('command')}, "), encoding="utf-8")


def bring_up(place: Place, name: str) -> Running:
    """Start the cell and wait until each node of it is there: that takes long where many processes share few cores."""
    up = place.type(UP, name)
    nodes = re.findall(r"^/\*\*/(\w+):", (place.folder / "cell.yaml").read_text(encoding="utf-8"), re.MULTILINE)
    assert nodes
    for node in nodes:
        up.wait_for(f"[{node}]: active")
    return up


CASES = {
    "one head in degrees": (11, ["head_b"]),
    "all in degrees": (23, ["head_a", "head_b", "head_c", "head_d", "command"]),
}


@pytest.mark.long  # minutes
@pytest.mark.parametrize("case", CASES)
def test_a_newcomer_has_a_right_stage_file_after_five_commands(case: str, place: Place) -> None:
    seed, degrees = CASES[case]
    # who has no certificate of the bearing's tilt is not told how the autocollimator is turned
    certified = case == "one head in degrees"
    options = {"count": 4, "even": False, "swap": True, "reversed_heads": 1, "axes": [1.02, math.radians(12.0)]}
    options |= {"known_tilt": certified, "tilt": 2e-5}
    built = built_stage(seed, options)
    folder = place.folder
    (folder / "config").symlink_to(config("real_cell.yaml").parent)
    drivers = place.drive("drivers", seed=seed, build=options, degrees=degrees)
    write_nominal(folder / "nominal.yaml", built)

    subprocess.run(shlex.split(COPY), cwd=folder, check=True)
    edit_cell(folder / "cell.yaml")
    up = bring_up(place, "up")
    first = commissioned(place, COMMISSION, drivers)
    assert first.code == 10, first.said
    texts = {f"head {name[-1]} reads degrees" if name != "command" else "command is in degrees" for name in degrees}
    assert but_autocollimator(first.said) == wrong_with(built) | texts, first.said
    assert not (folder / "stage.yaml").exists()

    said = re.findall(r"or (\w+) \(of source joint_state\) to `joint_state: \{unit: (\w+)\}`", first.said)
    units = {node.replace("encoder_head_", "head_").replace("stage_", ""): unit for node, unit in said}
    assert units == dict.fromkeys(degrees, "deg")
    up.process.send_signal(signal.SIGINT)
    assert up.process.wait(60) == 0, up.said
    edit_cell_again(folder / "cell.yaml", units)
    bring_up(place, "up_again")
    second = commissioned(place, COMMISSION, drivers)
    place.end()  # what is checked now needs no running cell
    assert second.code == 0, second.said
    assert but_autocollimator(second.said) == wrong_with(built), second.said
    # nothing else: where nothing tells the tilt, nothing is said of the autocollimator
    turn = [text for text in named(second.said) if "the autocollimator is mounted turned by" in text]
    others = [text for text in named(second.said) if "autocollimator" in text and "gain" not in text]
    assert others == turn and bool(turn) is certified, second.said
    assert ("roll and gain of the autocollimator" in second.said) is not certified

    check_file(folder / "stage.yaml", second, built, HEIGHT if certified else 0.0)


def edit_cell_again(path: Path, units: dict[str, str]) -> None:
    """What the person does who has read what is in degrees."""
    for name, unit in units.items():
        topic = "plc/axes" if name == "command" else f"reader_{name[-1]}/position"
        text = path.read_text(encoding="utf-8")
        assert f"{topic}, unit: rad" in text
        path.write_text(text.replace(f"{topic}, unit: rad", f"{topic}, unit: {unit}"), encoding="utf-8")


def truly(built: NewlyBuilt) -> StageDescription:
    """The stage as it is, with azimuths as a file may state them, and as late as stamps are by their clocks too."""
    section, clocks = copy.deepcopy(built.true), built.recording.drawn["streams"]
    places = {head_topic(name): head for name, head in section["encoder"]["heads"].items()}
    for topic, place in (places | {COMMAND: section["command"], AUTOCOLLIMATOR: section["autocollimator"]}).items():
        place["latency"] += clocks[topic]["offset"] + 2e-5  # none is negative, and what all are late by shows nowhere
    for head in places.values():
        head["azimuth"] = math.remainder(head["azimuth"], 2 * math.pi)
    return stage_of(section)


def check_file(file: Path, attempt: Attempt, built: NewlyBuilt, height: float) -> None:
    """With the file that was written the estimator is right, as `check_errors` says."""
    stage = load_stage(file)
    # four estimates a sample while the stage turns, however long it stood before
    blocks = BagReader(attempt.bag).read_blocks(["/stage/head_a/samples"])["/stage/head_a/samples"]
    since = np.concatenate([block.times_ns for block in blocks]) - (built.recording.start_ns + attempt.shift)
    fewest = 3 * int(((since > 0) & (since < built.recording.duration * 1e9)).sum())
    assert fewest > 3000
    check_errors(built, truly(built), attempt.bag, stage, attempt.shift, height, fewest)
    if height:
        own, found = built.true["autocollimator"], stage.response("autocollimator")
        assert abs(found.roll - own["roll"]) < 0.02 and abs(found.gain / own["gain"] - 1) < 0.02


def two_cells(place: Place) -> dict[str, tuple[NewlyBuilt, Running]]:
    """Two stages in two namespaces, with other numbers of heads and other radii."""
    made = {}
    for cell, seed, count in (("/left", 31, 3), ("/right", 32, 5)):
        options = {"count": count, "even": False, "swap": False}
        built = built_stage(seed, options)
        drivers = place.drive(f"drivers{cell[1:]}", seed=seed, build=options, namespace=cell, blocks=True)
        made[cell] = built, drivers
        write_nominal(place.folder / f"nominal{cell[1:]}.yaml", built)
    return made


@pytest.mark.long
def test_two_cells_are_commissioned_at_once_and_neither_hears_the_other(place: Place) -> None:
    cells = two_cells(place)
    with ThreadPoolExecutor() as both:
        found = {
            cell: both.submit(
                commissioned,
                place,
                f"{COMMISSION.replace('nominal', f'nominal{cell[1:]}').replace('stage.yaml', f'{cell[1:]}.yaml')} "
                f"--namespace {cell}",
                drivers,
            )
            for cell, (_, drivers) in cells.items()
        }
    attempts = {cell: each.result() for cell, each in found.items()}
    place.end()  # what is checked now needs no running cell
    for cell, (built, _) in cells.items():
        attempt, heads = attempts[cell], built.true["encoder"]["heads"]
        assert attempt.code == 0, attempt.said
        other = next(each for each in cells if each != cell)
        assert f"{cell}/stage/head_a/samples" in attempt.said and f"{other}/stage" not in attempt.said
        assert named(attempt.said) == wrong_with(built), attempt.said
        file = place.folder / f"{cell[1:]}.yaml"
        stage = load_stage(file)
        assert list(stage.azimuths) == list(heads) and stage.ring.disc_radius == built.true["encoder"]["disc_radius"]
        check_file(file, attempt, built, 0.0)
        topics = BagReader(attempt.bag).topics
        assert {name for name in topics if "/head_" in name} == {f"/stage/head_{name}/samples" for name in heads}


def test_a_topic_that_is_mistyped_is_found_at_once(place: Place) -> None:
    options = {"count": 4, "even": False, "swap": False}
    place.drive("drivers", seed=41, build=options)
    write_nominal(place.folder / "nominal.yaml", built_stage(41, options))
    (place.folder / "config").symlink_to(config("real_cell.yaml").parent)
    cell = place.folder / "cell.yaml"
    subprocess.run(shlex.split(COPY), cwd=place.folder, check=True)
    edit_cell(cell)
    cell.write_text(cell.read_text().replace("reader_c/position", "reader_c/positions"))
    bring_up(place, "up")
    commission = place.type(COMMISSION + " --patience 12", "said")
    assert commission.process.wait(90) == 2, commission.said
    said = commission.said
    assert "/stage/head_c/samples: MISSING: /encoder_head_c publishes it, and no sample comes" in said
    assert re.search(r"/encoder_head_c says: .*nobody publishes on /reader_c/positions", said)
    assert "nobody listens: /reader_c/position (sensor_msgs/msg/JointState) of /drivers_41" in said
    assert re.search(r"/stage/head_a/samples: \d+\.\d samples/s, of /encoder_head_a", said)
    assert "no samples on /stage/head_c/samples within 12 s" in said


def test_a_stage_that_does_not_turn_and_ctrl_c_are_said(place: Place) -> None:
    options = {"count": 3, "even": False, "swap": False}
    drivers = place.drive("drivers", seed=42, build=options, blocks=True)
    write_nominal(place.folder / "nominal.yaml", built_stage(42, options))
    still = place.type(COMMISSION + " --record still --duration 4", "still_said")
    assert still.process.wait(90) == 2
    assert "turned 0° one way, 0° the other, of 370°" in still.said
    assert "the stage stands still" in still.said and "(the recording stays in still)" in still.said
    ended = place.type(COMMISSION + " --record ended", "ended_said")
    ended.wait_for("turn the stage slowly")
    drivers.tell("turn")
    time.sleep(8.0)  # part of a turn at least, and not yet one each way
    ended.process.send_signal(signal.SIGINT)
    assert ended.process.wait(60) == 2
    assert "the stage turns" in ended.said or "the stage moves over" in ended.said
    assert BagReader(place.folder / "ended").damage is None, "a bag that was ended by Ctrl-C is whole"
    assert "Traceback" not in ended.said + still.said


def test_a_topic_of_another_type_and_a_cell_elsewhere_are_said(place: Place) -> None:
    import rclpy
    from rclpy.context import Context
    from std_msgs.msg import Float64

    options = {"count": 3, "even": False, "swap": False}
    built = built_stage(43, options)
    write_nominal(place.folder / "nominal.yaml", built)
    place.drive("drivers", seed=43, build=options, blocks=True, namespace="/left")
    context = Context()
    with steady_transport():  # what the first participant of a process takes counts for all
        rclpy.init(context=context, domain_id=place.domain)
        node = rclpy.create_node("odd", context=context)
    try:
        node.create_publisher(Float64, "/stage/head_b/samples", 10)
        commission = place.type(COMMISSION + " --patience 8", "said")
        assert commission.process.wait(60) == 2
    finally:
        node.destroy_node()
        context.try_shutdown()
    said = commission.said
    assert "/odd on /stage/head_b/samples (of type std_msgs/msg/Float64, which is not heard)" in said
    assert "expected sensor_msgs/msg/PointCloud2" in said
    assert "/stage/head_a/samples: MISSING: nobody publishes it; expected encoder_head" in said
    assert "another cell speaks in /left: see --namespace" in said
    assert COMMAND in said


def test_what_is_typed_is_what_the_page_shows() -> None:
    blocks = re.findall(r"```sh\n(.*?)```", DOCUMENT, re.DOTALL)
    shown = [line.split("#")[0].strip() for block in blocks for line in block.splitlines()]
    assert len(TYPED) <= 5
    assert [line for line in shown if line in TYPED] == list(TYPED)
