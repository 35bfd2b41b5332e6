"""`check` of sound recordings by descriptions with a mistake in them, as a stranger would make it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from described_stages import stage_of
from world import DESCRIPTIONS, Options, Recording, make_recording, random_stage

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main

STAGES = 4
CONTRADICTED, NOTHING_WRONG = 10, 0
MISTAKES = ("heads_swapped", "diameter_for_radius", "no_eccentricity", "noise_large", "azimuths_reversed")


def is_off_centre(section: Mapping[str, Any]) -> bool:
    """Whether a ring is eccentric by more than its bearing can move: else a wrong eccentricity may be error motion."""
    return math.hypot(*section["encoder"]["eccentricity"]) > 3.0 * stage_of(section).limits.radial


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Recording, Path]]:
    """Recordings of stages with four heads or more, mounted worse than their bearings run, and their bags."""
    found = []
    for seed in range(STAGES):
        drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
        stage = next(each for each in drawn if len(each["encoder"]["heads"]) > 3 and is_off_centre(each))
        options = Options(motion=("steady", "s_curves")[seed % 2], odd_rates=False, peak_speed=4.0)
        recording = make_recording(seed, duration=6.0, stage=stage, options=options)
        bag = tmp_path_factory.mktemp("recordings") / "bag"
        write_messages(bag, recording.blocks)
        found.append((recording, bag))
    return found


def exit_code(section: object, bag: Path, folder: Path) -> int:
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump({"stage": section}, sort_keys=False), encoding="utf-8")
    return main(["check", "--stage", str(path), str(bag)])


def test_the_right_description_fits(
    recordings: list[tuple[Recording, Path]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert [exit_code(each.stage, bag, tmp_path) for each, bag in recordings] == STAGES * [NOTHING_WRONG]
    assert capsys.readouterr().out.count("The description fits the recording.") == STAGES


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_found(
    mistake: str, recordings: list[tuple[Recording, Path]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = DESCRIPTIONS[mistake]
    assert [exit_code(wrong(each.stage), bag, tmp_path) for each, bag in recordings] == STAGES * [CONTRADICTED]
    assert capsys.readouterr().out.count("The recording contradicts") == STAGES
