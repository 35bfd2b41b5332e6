"""Thermometers that repeat a value under fresh stamps: told where their noise would have moved it."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from described_stages import by_stream, stage_of
from faults.documenting import Row, shows
from kinds.stage.test_thermometers import EFFECTS, section
from world import Options, make_recording

from rotary_error_monitor.kinds.stage.stretches import stage_problem
from rotary_error_monitor.kinds.stage.thermometers import with_useful_inputs
from rotary_error_monitor.twin.recording import SignalStream, StageRecording, record_stage

NAME, TOPIC = "thermometer_bearing", "/stage/thermometer_bearing/samples"


def read(noise, resolution, temperature, seed):
    """What `with_useful_inputs` makes of a thermometer of such noise and resolution that reads `temperature` (n,)."""
    stage = stage_of(section(("bearing",)))
    stage = replace(stage, inputs={NAME: replace(stage.inputs[NAME], noise=noise, resolution=resolution)})
    noisy = temperature + noise * np.random.default_rng(seed).normal(size=len(temperature))
    shown = np.round(noisy / resolution) * resolution if resolution else noisy
    return stage, shown


def said_of(stage, shown):
    stream = SignalStream(np.arange(len(shown)) * 1.0, shown[:, None])
    found, recording = with_useful_inputs(stage, StageRecording(0, {NAME: stream}))
    assert (NAME in found.inputs) == (NAME in recording.streams) == (not recording.remarks)
    return recording.remarks


@pytest.mark.parametrize("ratio", [0.0, 0.02, 0.1, 0.3, 1.0, 3.0, math.inf])
def test_a_temperature_that_stands_still_is_not_taken_for_one_that_is_stuck(ratio):
    """Noise over resolution from none to no steps; in the middle of a step, where readings repeat most."""
    noise, resolution = (0.01 * ratio, 0.01) if ratio < math.inf else (0.01, 0.0)
    for seed in range(50):
        assert not said_of(*read(noise, resolution, np.full(4000, 22.0), seed))


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
def test_one_that_cuts_off_towards_zero_reads_it_for_longer(ratio):
    """Of a load cell whose axis nobody pushed 23 readings in a row were 0, and it was left out as stuck."""
    for seed in range(50):
        stage, shown = read(0.01 * ratio, 0.0, np.zeros(4000), seed)
        stage = replace(stage, inputs={NAME: replace(stage.inputs[NAME], resolution=0.01)})
        assert not said_of(stage, np.trunc(shown / 0.01) * 0.01)


def test_a_long_run_of_zero_hides_no_shorter_one_that_is_stuck():
    """Of noise of a step 55 may be 0, and 23 any other reading."""
    stage, shown = read(0.01, 0.01, 0.05 * np.sin(0.3 * np.arange(300.0)), 1)
    shown[10:55] = 0.0
    assert not said_of(stage, shown)
    shown[200:235] = 0.2
    (told,) = said_of(stage, shown)
    assert told.startswith(f"{NAME}: stuck at 0.2 °C from 200.0 s on: 35 equal ones")


@pytest.mark.parametrize("ratio", [0.5, 1.0, 3.0, math.inf])
@pytest.mark.parametrize("seed", range(5))
def test_one_that_is_stuck_is_told_after_as_many_readings_as_chance_does_not_make_equal(ratio, seed):
    """By a closed form: the odds that n readings in the middle of a step are equal are below 1e-9."""
    noise, resolution = (0.01 * ratio, 0.01) if ratio < math.inf else (0.01, 0.0)
    equal = math.erf(0.5 * resolution / noise / math.sqrt(2.0))
    needed = 1 + math.ceil(math.log(1e-9) / math.log(equal)) if equal else 3
    stage, shown = read(noise, resolution, 22.0 + 0.02 * np.sin(0.02 * np.arange(300.0)), seed)
    shown[200 : 200 + needed] = shown[200]
    (told,) = said_of(stage, shown)
    assert re.match(rf"{NAME}: stuck at 2\d\.?\d* °C from (19\d|200)\.0 s on: \d+ equal ones where .*; left out", told)


@shows(
    Row(
        "joints",
        "A listed thermometer repeats a value under fresh stamps",
        "`diagnose` and `gap_monitor`: stuck, since when, and how many readings are equal, where stated noise makes "
        "so many less likely than 1e-9: with noise of half a step 56 of them, with noise of a step 23. With a tenth of "
        "a step or less it is not told: a million may be equal",
        "it is left out of the recording; of one that is not told nothing is known beyond its stated `uncertainty`",
        "no drift with that place is named",
        "with the next recording without it",
    ),
    Row(
        "joints",
        "The thermometer of the machine, or of the stage, repeats a value under fresh stamps",
        "not told: no description states its noise and resolution, and a temperature may stand still for hours",
        "it is believed",
        "corrections with that temperature",
        "with the next temperature",
    ),
)
@pytest.mark.parametrize("seed", range(4))
def test_a_stuck_thermometer_is_left_out_of_a_diagnosis_and_a_sound_one_is_not(seed):
    rates = {f"/stage/head_{head}/samples": 200.0 for head in "abcd"} | {TOPIC: 5.0}
    options = Options.textbook(motion="both_directions", peak_speed=5.0, rates=rates, noise=1.0, quantise=True)
    topics = dict(make_recording(seed, duration=12.0, stage=section(), options=options).blocks)
    stage = stage_of(section())
    for stuck in (False, True):
        if stuck:
            kept = topics[TOPIC][len(topics[TOPIC]) // 3].rows[-1, 1]
            late = topics[TOPIC][len(topics[TOPIC]) // 3 :]
            frozen = [
                replace(block, rows=np.column_stack([block.rows[:, 0], np.full(len(block.rows), kept)]))
                for block in late
            ]
            topics[TOPIC] = [*topics[TOPIC][: len(topics[TOPIC]) // 3], *frozen]
        recording = record_stage(by_stream(topics), "abcd", without=("lvdt",), listed=tuple(stage.listed))
        problem = stage_problem(stage, recording, EFFECTS)
        assert set(problem.stage.thermometers) == ({"housing"} if stuck else {"bearing", "housing"})
        assert any(f"{NAME}: stuck at" in remark for remark in problem.recording.remarks) == stuck
