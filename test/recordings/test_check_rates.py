"""How often `check` finds something wrong with healthy stages that are described as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from world import Options, Recording, make_recording, random_stage

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.signals.blocks import SampleBlock

MOTIONS = ("both_directions", "s_curves", "steady", "indexing")
AUTOCOLLIMATOR = "uncertainty of the autocollimator, times that of its noise"


def checked(recording: Recording, folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What is said of a recording by the exact description of its stage."""
    folder.mkdir()
    write_messages(folder / "bag", recording.blocks)
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump({"stage": recording.stage}, sort_keys=False), encoding="utf-8")
    main(["check", "--stage", str(path), str(folder / "bag")])
    return capsys.readouterr().out


def scale_of(said: str) -> float:
    """How sure the autocollimator is; its noise is of 0.7 to 1.3 times what is described."""
    found = re.search(rf"{AUTOCOLLIMATOR}.*: ([0-9.]+)$", said, re.MULTILINE)
    assert found, said
    return float(found[1])


def test_healthy_stages_are_not_contradicted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = {}
    for seed in range(8):
        options = Options(motion=MOTIONS[seed % 4], noise_shape=seed % 3 > 0, odd_rates=seed % 5 > 0)
        recording = make_recording(seed, duration=4.0, stage=random_stage(seed), options=options)
        said = checked(recording, tmp_path / str(seed), capsys)
        if "The recording contradicts" in said or scale_of(said) > 1.5:
            wrong[seed] = said
    assert not wrong


@pytest.mark.parametrize("command", ["check", "commission"])
def test_an_autocollimator_with_one_axis_is_named(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = make_recording(1, duration=0.5, stage=random_stage(1), options=Options(motion="steady"))
    topic = "/stage/autocollimator/samples"
    one = [SampleBlock(each.stamp_ns, each.names[:2], each.rows[:, :2]) for each in recording.blocks[topic]]
    write_messages(tmp_path / "bag", {**recording.blocks, topic: one})
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump({"stage": recording.stage}, sort_keys=False), encoding="utf-8")
    output = ["-o", str(tmp_path / "out.yaml")] if command == "commission" else []
    assert main([command, "--stage", str(path), str(tmp_path / "bag"), *output]) == 2
    expected = "autocollimator: a sample block holds t, tilt_x, but no field 'tilt_y'; expected t, tilt_x, tilt_y"
    assert expected in capsys.readouterr().err
