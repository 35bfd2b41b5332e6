"""Streams of a bag are what was written, by whatever names; what is wrong is said."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from leaning_stage import write_bag
from mock_bags import write_mock_bag

from rotary_error_monitor import analyse, diagnose, estimate, read_bag
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.codec.contents import Temperature
from rotary_error_monitor.description.topics import samples_topic, stream_of_topic, topic_named
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.notebook.simulation import EPOCH_NS, simulate_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import block_from_samples

STAGE = config("stage.yaml")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A bag and the plant that it is of."""
    folder = tmp_path_factory.mktemp("recorded") / "bag"
    return folder, write_bag(folder, 5, seconds=3.0)


def test_streams_are_what_the_instruments_gave(recorded):
    bag, plant = recorded
    recording = read_bag(bag)
    assert set(recording.streams) == set(plant.streams) == set(recording.stage)
    for name, stream in recording.streams.items():
        samples = plant.samples(name, plant.index_at(name, EPOCH_NS), len(stream))
        np.testing.assert_array_equal(stream.times_ns, samples.times_ns)
        np.testing.assert_array_equal(stream.values, samples.rows[:, 1:])
        assert stream.fields == samples.names[1:]
        assert stream.rate == pytest.approx(plant.clocks[name].rate, rel=1e-3)
        assert np.shares_memory(stream[stream.fields[0]], stream.values)
        assert stream.topic == samples_topic(name) and stream_of_topic(stream.topic) == name
    assert recording["command"].units == ("rad", "rad/s") and recording["temperature"].units == ("°C",)
    assert recording["command"].to_dataframe().attrs["units"] == {"angle": "rad", "velocity": "rad/s"}
    assert abs(recording.start - datetime.fromtimestamp(EPOCH_NS / 1e9, UTC)).total_seconds() < 0.01
    assert recording.duration == pytest.approx(3.0, abs=0.01)
    assert recording.to_dataframe()["samples"].to_dict() == {name: len(s) for name, s in recording.streams.items()}


def test_a_bag_says_what_of_it_is_simulated(recorded, tmp_path):
    bag, plant = recorded
    recording = read_bag(bag)
    assert set(recording.simulated) == {samples_topic(stream) for stream in plant.streams}
    assert "9 topics, says the bag" in repr(recording) and "9 topics, says the bag" in recording._repr_html_()
    assert any("simulated" in remark for remark in estimate(recording).remarks)
    write_messages(tmp_path / "silent", {samples_topic("head_a"): [plant.samples("head_a", 0, 50)]})
    silent = read_bag(tmp_path / "silent")
    assert silent.simulated == () and "the bag does not say" in repr(silent)


def test_axes_of_a_machine_are_streams_too(tmp_path):
    recording = read_bag(write_mock_bag(tmp_path / "bag", 2_000))
    joints = recording["machine_joint_states"]
    assert recording.machine == joints.fields == ("X", "Y", "Z", "A", "C")
    assert len(joints) == 100 and "machine_joint_states" not in recording.stage
    assert set(joints.units) == {"m, rad"}
    recording.figure()


def test_a_recording_by_other_names_is_the_same(recorded, tmp_path):
    _, plant = recorded
    blocks = {stream: [plant.samples(stream, 0, 700)] for stream in plant.streams if stream != "force"}
    names = {stream: samples_topic(stream) for stream in blocks}
    given = {names["head_a"]: "/encoders/first"}
    write_messages(tmp_path / "named", {given.get(names[s], names[s]): each for s, each in blocks.items()})
    write_messages(tmp_path / "left", {f"/left{names[s]}": each for s, each in blocks.items()} | {
        f"/right{names[s]}": each for s, each in blocks.items() if s == "command"
    })  # fmt: skip
    file = tmp_path / "map.yaml"
    file.write_text("".join(f"{name}: {own}\n" for name, own in given.items()), encoding="utf-8")
    named = tmp_path / "named"
    found = [
        read_bag(named, topics=given),
        read_bag(named, topics=file),
        read_bag(named, topics=str(file)),
        read_bag(tmp_path / "left", cell="/left"),
    ]
    expected = estimate(named, topics=given).error_motion.tobytes()
    for recording in found:
        assert set(recording.streams) == set(blocks)
        assert recording["head_a"].values.tobytes() == found[0]["head_a"].values.tobytes()
        assert estimate(recording).error_motion.tobytes() == expected
    with pytest.raises(InputError, match="cell and topics were chosen when it was read"):
        estimate(found[0], cell="/left")
    with pytest.raises(InputError, match="the bag holds 2 cells: /left, /right"):
        read_bag(tmp_path / "left")
    with pytest.raises(InputError, match=r"topics: '/stage/head' is no topic of the wire contract; did you mean"):
        read_bag(named, topics={"/stage/head": "/encoders/first"})
    with pytest.raises(InputError, match=r"map.yaml:1: no topic '/encoders/first' in .*silent"):
        write_messages(tmp_path / "silent", {names["head_b"]: blocks["head_b"]})
        read_bag(tmp_path / "silent", topics=file)


def test_what_cannot_be_read_is_left_out_and_said(recorded, tmp_path):
    _, plant = recorded
    good = plant.samples("head_a", 0, 100)
    other = block_from_samples(good.times_ns + 1_000_000_000, ("position",), good.rows[:, 1:])
    warm = [Temperature(int(stamp), 20.0 + i) for i, stamp in enumerate(good.times_ns[:5])]
    contents = {samples_topic("head_a"): [good], samples_topic("head_b"): [good, other]}
    write_messages(tmp_path / "bag", contents | {topic_named("machine_temperature"): warm})
    recording = read_bag(tmp_path / "bag")
    assert set(recording.streams) == {"head_a", "machine_temperature"}
    assert recording["machine_temperature"]["temperature"].tolist() == [20.0, 21.0, 22.0, 23.0, 24.0]
    (said,) = [remark for remark in recording.remarks if "left out" in remark]
    assert "head_b" in said and "position" in said


WRONG = {
    "no bag": (lambda bag: read_bag(bag.parent / "nothing"), "no such bag; give the folder of a rosbag2 bag"),
    "no stream": (lambda bag: read_bag(bag)["head_x"], "no stream 'head_x'; the bag has head_a, head_b"),
    "no field": (lambda bag: read_bag(bag)["head_a"]["turn"], "head_a has no field 'turn'; it has angle"),
    "no cell": (lambda bag: read_bag(bag, cell="/up"), "no cell /up; the bag has /"),
    "figure": (lambda bag: read_bag(bag).figure(["head_x"]), "no stream 'head_x'"),
    "empty figure": (lambda bag: read_bag(bag).figure([]), "no streams to draw; name some of head_a, head_b"),
    "period": (lambda bag: estimate(bag, period=2.0), r"period is 2.0 s; it must be from 1e-05 to 1"),
    "no period": (lambda bag: estimate(bag, period=float("nan")), "period is nan s; it must be from 1e-05 to 1"),
    "no stage": (lambda bag: estimate(bag, "nothing.yaml"), "nothing.yaml"),
    "no machine": (lambda bag: estimate(bag, machine="lathe"), "no machine 'lathe'; give the path of a YAML file"),
    "units": (lambda bag: estimate(bag).to_dataframe(units="mm"), "units is 'mm'; give 'SI' for m and rad, or 'um'"),
    "height": (lambda bag: estimate(bag).at_height(60.0), "height is 60.0; it must be a height above the ring in m"),
    "heights": (lambda bag: analyse(bag, heights=[60.0]), "heights has 60.0; it must be a height above the ring in m"),
    "waves": (lambda bag: analyse(bag, waves=1), "waves is 1; it must be at least 3"),
    "limits": (lambda bag: analyse(bag, limits={"radial": 1}), "^limits radial=1: expected NAME_UNIT=NUMBER above 0"),
    "picture": (lambda bag: analyse(bag).figures("orders"), "shown is 'orders'; this analysis has course"),
    "ending": (lambda bag: analyse(bag).save("page.txt"), "page.txt: ends in none of html, json, csv, png"),
    "false alarms": (lambda bag: diagnose(bag, STAGE, false_alarms=2), "false_alarms is 2; it must lie between 0 and"),
    "causes": (lambda bag: diagnose(bag, STAGE, most_causes=0), "most_causes is 0; it must be at least 1"),
    "rate": (lambda bag: diagnose(bag, STAGE, most_rate=5), "most_rate is 5 Hz; at least 100 are needed"),
    "twin": (lambda bag: diagnose(bag, "twin.yaml"), "twin.yaml"),
    "over the bag": (lambda bag: estimate(bag).save(bag / "bag_0.mcap"), "bag_0.mcap: not written, for it is"),
    "seconds": (lambda bag: simulate_bag(bag, seconds=0.0), "seconds is 0.0; it must be a time above 0"),
    "there": (lambda bag: simulate_bag(bag, seconds=1.0), "exists"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_named_with_what_is_right(wrong, tmp_path_factory, request):
    bag = request.getfixturevalue("stopped")
    act, said = WRONG[wrong]
    with pytest.raises(InputError, match=said):
        act(bag)


def test_of_nothing_there_is_no_picture(stopped):
    """A rotor that does not turn, and neither a force nor a temperature beside it."""
    found = analyse(stopped)
    assert len(found.figures()) == len(found.result.acting) > 0
    lonely = replace(found, result=replace(found.result, acting={}))
    with pytest.raises(InputError, match="no picture: no whole turn at a constant speed, and no force or temperature"):
        lonely.figures()


def test_another_recording_may_have_nothing_in_common(stopped):
    found = analyse(stopped, against=stopped)
    assert found.changes == () and "have no figure in common" in repr(found) + found._repr_html_()


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A bag of a rotor that has hardly begun to turn."""
    folder = tmp_path_factory.mktemp("stopped") / "bag"
    simulate_bag(folder, seconds=1.6)
    assert [re.sub(r"\d+", "", path.name) for path in sorted(folder.glob("*.mcap"))] == ["bag_.mcap"]
    return folder
