"""A stage file without read heads: what it can show and cannot check, and what is wrong with one, with its line."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from described_stages import stage_of
from without_heads import STREAMS, example

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect, effects_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.observability import possible_components, unchecked_sensors
from rotary_error_monitor.signals.blocks import block_from_samples

START = 1_763_700_000_000_000_000


def test_the_example_is_a_stage_of_three_probes(tmp_path):
    stage = load_stage(example(tmp_path))
    assert stage.encoder is None and stage.azimuths == {} and tuple(stage.sensors) == STREAMS
    assert stage_of(stage_mapping(stage)) == stage and "encoder" not in stage_mapping(stage)
    assert Estimator(stage).inputs == ("command", *STREAMS)
    assert not [topic.name for topic in wire_of(stage) if "head" in topic.key]
    assert possible_components(stage) == ("exc", "eyc")
    assert unchecked_sensors(stage) == ()


def test_what_can_be_shown_and_checked_follows_from_what_is_there(tmp_path):
    stage = load_stage(example(tmp_path))
    two = replace(stage, sensors={name: stage.sensors[name] for name in STREAMS[:2]})
    assert possible_components(two) == ("exc", "eyc") and unchecked_sensors(two) == STREAMS[:2]
    high = {name: replace(each, place={**each.place, "height": 0.1}) for name, each in stage.sensors.items()}
    assert possible_components(replace(stage, sensors=high)) == (), "the tilt is not known"
    tilt = Autocollimator(5e-4, 5e-8, 2e-7)
    assert possible_components(replace(stage, sensors=high, autocollimator=tilt)) == ("exc", "eyc", "eac", "ebc")
    assert possible_components(replace(stage, sensors={}, autocollimator=tilt)) == ("eac", "ebc")


def test_effects_that_need_heads_are_not_offered(tmp_path):
    stage, effects = load_stage(example(tmp_path)), load_effects(StageEffect)
    left_out = {each.name for each in effects} - {each.name for each in effects_of(stage, effects)}
    assert {"disc_eccentricity", "graduation_error", "head_latency", "encoder_latency"} <= left_out
    assert not left_out & {"spindle_radial", "probe_zero", "probe_form", "probe_gain", "following_error"}


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"sensors": None}, r":1: stage: nothing measures the rotor; expected a section 'encoder', 'autocollimator'"),
        (
            {"uncertainty": {"encoder.eccentricity": 1e-8}},
            r":\d+: stage.uncertainty.encoder.eccentricity: the stage has",
        ),
        (
            {"uncertainty": {"encoder.timing": 1e-6}},
            r":\d+: stage.uncertainty.encoder.timing: the stage has no section",
        ),
        (
            {"calibration": {"encoder": {"date": "2026-11-21", "source": "a", "sha256": "0" * 64}}},
            r":\d+: stage.calibration.encoder: the stage has no section 'encoder'; expected that section",
        ),
    ],
)
def test_what_names_an_encoder_that_is_not_there_is_refused_with_its_line(tmp_path, capsys, changed, told):
    path = example(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["stage"] = {name: part for name, part in (content["stage"] | changed).items() if part is not None}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(str(path)) + told):
        load_stage(path)
    assert main(["check", "--stage", str(path), str(tmp_path)]) == 2
    assert re.search(told, capsys.readouterr().err)


def test_the_uncertainty_of_the_command_is_no_matter_of_the_encoder(tmp_path):
    path = example(tmp_path)
    path.write_text(path.read_text(encoding="utf-8") + "  uncertainty: {command.timing: 1.0e-05}\n", encoding="utf-8")
    assert load_stage(path).timing("command") == 1e-5


@pytest.mark.parametrize(
    ("recorded", "command", "lacking"),
    [
        (("command",), "check", "/stage/radial_probe_one/samples"),
        (("command",), "replay", "/stage/radial_probe_one/samples"),
        (
            ("command",),
            "diagnose",
            "the recording holds samples of no sensor; expected those of one or more of .*probe_one",
        ),
        (STREAMS, "check", "/stage/command/samples"),
        (STREAMS, "replay", "/stage/command/samples"),
        (STREAMS, "diagnose", "/stage/command/samples"),
    ],
)
def test_a_recording_that_lacks_what_it_takes_says_which(tmp_path, capsys, recorded, command, lacking):
    times, twin, bag = START + np.arange(4000) * 5_000_000, str(example(tmp_path)), str(tmp_path / "bag")
    fields = {"command": ("angle", "velocity")}
    blocks = {}
    for name in recorded:
        names = fields.get(name, ("displacement",))
        blocks[samples_topic(name)] = [block_from_samples(times, names, np.zeros((len(times), len(names))))]
    write_messages(bag, blocks)
    arguments = {
        "check": ["check", "--stage", twin, bag],
        "replay": ["replay", bag, "--twin", twin, "-o", str(tmp_path / "out.npz")],
        "diagnose": ["diagnose", bag, "--twin", twin, "-o", str(tmp_path / "out")],
    }[command]
    assert main(arguments) == 2
    assert re.search(lacking, capsys.readouterr().err)


def test_commands_that_need_heads_say_so(tmp_path, capsys):
    path = example(tmp_path)
    bag = str(tmp_path / "bag")
    write_messages(
        bag,
        {samples_topic("command"): [block_from_samples(np.array([START]), ("angle", "velocity"), np.zeros((1, 2)))]},
    )
    for arguments in (
        ["run", "--stage", str(path), "--folder", str(tmp_path / "new")],
        ["calibrate", "assembly", bag, "--stage", str(path), "--output", str(tmp_path / "calibrated.yaml")],
    ):
        assert main(arguments) == 2, arguments
        assert "the stage has no section 'encoder'" in capsys.readouterr().err, arguments
