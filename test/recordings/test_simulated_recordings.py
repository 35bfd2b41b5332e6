"""A bag that says what of it was simulated: `replay`, `check` and `diagnose` say it in a line of their own."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import yaml

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

EPOCH_NS = 1_763_700_000_000_000_000
HEARD = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command")
TOPICS = [samples_topic(stream) for stream in HEARD]


@pytest.fixture(scope="module")
def silent_bag(tmp_path_factory):
    """A recording of 15 s that says nothing of a simulation."""
    plant = mock_stage(load_stage(), MockSettings(3, EPOCH_NS, (2.0, 3.0), forces=False, rate=500.0))
    contents = {
        topic: [plant.samples(stream, first, 100) for first in range(0, 7_500, 100)]
        for topic, stream in zip(TOPICS, HEARD, strict=True)
    }
    bag = tmp_path_factory.mktemp("simulated") / "bag"
    write_messages(bag, contents)
    return bag


@pytest.fixture(params=[[], TOPICS[:2], TOPICS], ids=["nothing", "two heads", "all"])
def told_bag(request, silent_bag, tmp_path):
    """The same with a word of its recorder about these topics, and that word."""
    bag = shutil.copytree(silent_bag, tmp_path / "bag")
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    word = ", ".join(request.param)
    content["rosbag2_bagfile_information"]["custom_data"] = {"simulated": word} if word else None
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return bag, word


@pytest.fixture(scope="module")
def silent():
    """By command, what it gave of the silent bag."""
    return {}


@pytest.mark.parametrize("command", ["replay", "check", "diagnose"])
def test_it_is_said_once_and_changes_nothing_else(command, told_bag, silent_bag, silent, tmp_path, capsys):
    def run(bag, name):
        out = tmp_path / name
        words = {
            "replay": [str(bag), "-o", f"{out}.npz"],
            "check": [str(bag)],
            "diagnose": [str(bag), "--twin", str(config("stage.yaml")), "-o", str(out), "--no-report"],
        }[command]
        code = main([command, *words])
        told = capsys.readouterr()
        lines = (told.out + told.err).replace(str(bag), "BAG").replace(str(out), "OUT").splitlines()
        return code, lines, out

    bag, word = told_bag
    code, lines, out = run(bag, "told")
    said = [line for line in lines if "simulated" in line]
    assert code != 2, lines
    assert len(said) == bool(word)
    if word:
        assert f"BAG: simulated: {word[:60]}" in said[0]
    if command == "diagnose":
        assert ("simulated: " in (out / "diagnosis.json").read_text(encoding="utf-8")) is bool(word)
    if command not in silent:
        silent[command] = run(silent_bag, "silent")
    silent_code, silent_lines, silent_out = silent[command]
    assert (silent_code, silent_lines) == (code, [line for line in lines if line not in said])
    if command == "replay":
        with np.load(f"{out}.npz") as one, np.load(f"{silent_out}.npz") as other:
            for name in one.files:
                np.testing.assert_array_equal(one[name], other[name])
