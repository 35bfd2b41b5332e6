"""`check` of a recording of a stage with a second autocollimator: fits as described, contradicted where it does not."""

from __future__ import annotations

import re

import pytest
import yaml
from world import Options, make_recording, random_stage, with_tilt_sensor

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main

SECOND = "tilt_sensor_second"


@pytest.fixture
def checked(tmp_path, capsys):
    """Function that checks the recording of a stage by the description of it that another function makes."""

    def check(seed, change):
        drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
        section = with_tilt_sensor(next(each for each in drawn if len(each["encoder"]["heads"]) > 3), seed)
        options = Options(motion="steady", odd_rates=False, peak_speed=4.0)
        recording = make_recording(seed, duration=6.0, stage=section, options=options)
        bag, path = tmp_path / f"bag_{seed}", tmp_path / "stage.yaml"
        write_messages(bag, recording.blocks)
        path.write_text(yaml.safe_dump({"stage": change(section)}, sort_keys=False), encoding="utf-8")
        main(["check", "--stage", str(path), str(bag)])
        return capsys.readouterr().out

    return check


def reversed_gain(section):
    second = section["sensors"]["second"]
    return {**section, "sensors": {"second": {**second, "gain": -second["gain"]}}}


@pytest.mark.parametrize("tilt", [True, False])
def test_a_description_that_fits_is_not_contradicted(checked, tilt):
    for seed in range(2):
        told = checked(
            seed, lambda section: section if tilt else {k: section[k] for k in section if k != "autocollimator"}
        )
        assert "The description fits the recording." in told, told
        assert f"{SECOND}: " not in told


def test_one_that_reads_the_other_way_about_is_named_with_its_field(checked):
    for seed in range(2):
        told = checked(seed, reversed_gain)
        assert re.search(rf"{SECOND}: tilt_[xy]: .* µrad from what description and other sensors say", told), told
