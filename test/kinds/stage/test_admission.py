"""Recordings and twins that are not worth a diagnosis are refused, with what can be said all the same."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.cases.draws import draw_stage
from rotary_error_monitor.cases.making import EPOCH_NS, make_stage_case
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.stage_section import Mirror
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.another import check_stage, stage_statements
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.twin.recording import SignalStream, record_stage
from rotary_error_monitor.twin.stage import twin_of

EFFECTS = load_effects(StageEffect)


def recorded(plant, length):
    blocks = {}
    for stream in plant.streams:
        count = plant.index_at(stream, plant.epoch_ns + round(length * 1e9))
        blocks[stream] = [plant.samples(stream, 0, count)]
    return record_stage(blocks, "abcd")


@pytest.fixture(scope="module")
def cases():
    return [make_stage_case(seed, "null", duration=20.0) for seed in (3, 4, 5, 6)]


@pytest.mark.parametrize("length", [2.0, 6.0, 11.5])
def test_a_short_recording_is_refused_with_what_can_be_said(cases, length):
    problem = StageProblem(cases[0].twin, recorded(cases[0].plant, length), EFFECTS)
    with pytest.raises(InputError) as error:
        diagnose(problem)
    told = str(error.value)
    assert "too little to hold data out" in told and "record at least 12 s." in told
    for sensor in ("head_a", "head_d", "autocollimator", "lvdt"):
        assert f"{sensor} " in told
    found, noise = re.search(r"autocollimator (\S+) µrad \(noise of one sample (\S+) µrad", told).groups()
    assert float(found) == pytest.approx(float(noise), rel=0.1)


def compared(twin_description, recording):
    """Arguments of `check_stage` for a description beside a recording."""
    problem = StageProblem(twin_description, recording, EFFECTS)
    return recording, problem.raw_residual(()), problem.twin, EFFECTS, problem.noise.std


def test_the_twin_of_any_other_stage_is_refused(cases):
    for case in cases:
        recording = recorded(case.plant, 20.0)
        for other in cases:
            if other is case:
                check_stage(*compared(other.twin, recording))
            else:
                with pytest.raises(InputError, match="It describes another stage") as error:
                    check_stage(*compared(other.twin, recording))
                told = str(error.value)
                assert re.search(r"head order \d+: twin \S+ µrad, recording \S+ µrad, \S+ µrad apart", told)
                assert "autocollimator order" in told


def test_twins_of_other_stages_are_refused_at_a_rate(cases):
    """A statement that happens to be true lets one pass: of 100 other stages 7 at most, four times what is usual."""
    recording = recorded(cases[0].plant, 20.0)
    _, _, own, _, std = compared(cases[0].twin, recording)
    refused = 0
    for seed in seeds(100):
        twin = twin_of(draw_stage(np.random.default_rng([7, seed])), recording, (), own.inputs)
        raw = {name: recording.streams[name].values - values for name, values in twin.predict().items()}
        try:
            check_stage(recording, raw, twin, EFFECTS, std)
        except InputError:
            refused += 1
    assert refused >= 0.93 * len(seeds(100))


@pytest.mark.parametrize("effects", [["spindle_radial", "mirror_wobble"], ["disc_eccentricity", "spindle_tilt"]])
def test_the_strongest_effects_do_not_pass_for_another_stage(effects):
    case = make_stage_case(8, "pair", effects, (2900.0, 3000.0), rough=True, duration=20.0)
    blocks = {stream: list(found) for stream, found in case.blocks.items()}
    check_stage(*compared(case.twin, record_stage(blocks, "abcd")))


def nominal(stage, *kept):
    """A description without what is usually calibrated, but for what is kept."""
    none = {
        "eccentricity": {"encoder": replace(stage.encoder, eccentricity=(0.0, 0.0), graduation=())},
        "mirror": {"mirror": Mirror()},
        "spindle": {"spindle": Spindle()},
        "artefact": {"lvdt": stage.lvdt and replace(stage.lvdt, artefact_eccentricity=(0.0, 0.0))},
        "lvdt": {"lvdt": None},
    }
    changes = {key: value for name, change in none.items() if name not in kept for key, value in change.items()}
    return replace(stage, **changes)


@pytest.fixture(scope="module")
def demo():
    """The recording that `rotary_error_monitor run` makes of the shipped stage, half as long, and that stage."""
    stage = load_stage()
    settings = MockSettings(1, EPOCH_NS, (np.pi / 2, np.pi), force_cycle=20.0)
    return recorded(mock_stage(stage, settings), 16.0), stage


@pytest.mark.parametrize(
    "kept",
    [(), ("lvdt",), ("spindle",), ("spindle", "lvdt"), ("spindle", "artefact", "lvdt"), ("mirror",), ("eccentricity",)],
)
def test_a_nominal_twin_is_diagnosed(demo, kept):
    recording, stage = demo
    diagnosis = diagnose(StageProblem(nominal(stage, *kept), recording, EFFECTS))
    assert diagnosis.verdict is not Verdict.NO_GAP
    told = " ".join(diagnosis.remarks)
    assert ("no eccentricity of the ring: a head shows" in told) == ("eccentricity" not in kept)
    assert ("no tilt of the mirror: the autocollimator shows" in told) == ("mirror" not in kept)
    assert "nan" not in told and "%" not in told and not re.search(r"\d{5}", told)
    assert diagnosis.where[0].share > 0
    # More is wrong than may be named: what is named must predict, as it departs, and be likelier than not, with what
    # looks the same.
    alike = {key for group in diagnosis.indistinguishable for key in group.effects}
    likely = {(row.effect, row.location): row.probability for row in diagnosis.ranking}
    for found in diagnosis.causes:
        assert found.probability > 0.5 or sum(likely.get(key, 0.0) for key in alike) > 0.5
        assert found.cause.key != ("graduation_error", "order_1")
        assert all(departure.share < 0.3 for departure in found.departures)
    assert diagnosis.gap.shrink > 0.5 or not diagnosis.causes


def test_all_that_a_nominal_twin_leaves_out_is_named_where_so_many_causes_are_allowed(demo):
    recording, stage = demo
    diagnosis = diagnose(StageProblem(nominal(stage, "spindle", "artefact", "lvdt"), recording, EFFECTS), most_causes=8)
    assert diagnosis.verdict is Verdict.EXPLAINED
    found = {found.cause.key: found.cause.values for found in diagnosis.causes}
    assert found["disc_eccentricity", ""] == pytest.approx(stage.encoder.eccentricity, abs=2e-8)
    assert found["mirror_wobble", ""] == pytest.approx(stage.mirror.tilt, abs=2e-7)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-30, 1e-12])
def test_a_twin_that_states_next_to_nothing_states_nothing(demo, size):
    recording, stage = demo
    tiny = nominal(stage)
    tiny = replace(tiny, encoder=replace(tiny.encoder, eccentricity=(size, size)), mirror=Mirror((size, -size)))
    arguments = compared(tiny, recording)
    assert stage_statements(*arguments[:3], arguments[4]) == ()
    check_stage(*arguments)


def test_units_that_no_effect_makes_are_refused_with_their_size(demo):
    recording, stage = demo
    arcsec = recording.streams["autocollimator"]
    wrong = SignalStream(arcsec.time, np.degrees(arcsec.values) * 3600)
    recording = replace(recording, streams={**recording.streams, "autocollimator": wrong})
    with pytest.raises(InputError, match=r"autocollimator \S+ rad \(known effects make \S+ µrad at most\).*units"):
        check_stage(*compared(nominal(stage), recording))


@pytest.mark.parametrize(
    ("section", "kind"), [("lvdt", "lvdt"), ("autocollimator", "autocollimator"), ("encoder", "encoder")]
)
@pytest.mark.parametrize("noise", [0.0, 1e-300, 1e-15])
def test_a_twin_without_noise_is_refused(demo, section, kind, noise):
    recording, stage = demo
    ideal = replace(getattr(stage, section), noise=noise)
    if section == "autocollimator":
        ideal = replace(ideal, resolution=0.0)
    if section == "encoder":
        ideal = replace(ideal, lines_per_revolution=100_000_000, counts_per_line=100_000_000)
    with pytest.raises(
        InputError, match=rf"stage\.{kind}: noise and resolution together are \S+ (m|rad); .* above 1e-12"
    ):
        StageProblem(replace(stage, **{section: ideal}), recording, EFFECTS)
