"""Single readings that are grossly wrong, bursts of them, and streams that begin late change no diagnosis."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.stretches import stage_problem
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
CAUSES = ("disc_eccentricity", "load_compliance", "mirror_flatness")
OFF = {"force": 200.0, "temperature": 50.0, "command": 1e-3}
"""N, K and rad by which an input is wrong; sensors are by 50 counts, or 50 times their noise."""


def case_of(cause, seed):
    """A case and its samples by stream: names, times (ns) and values."""
    case, samples = make_stage_case(seed, "single", [cause], duration=20.0), {}
    for stream, blocks in case.blocks.items():
        names = blocks[0].names[1:]
        times = np.concatenate([block.times_ns for block in blocks])
        samples[stream] = (names, times, np.concatenate([block.columns(names) for block in blocks]))
    return case, samples


def diagnosed(case, samples):
    blocks = {stream: [block_from_samples(t, n, v)] for stream, (n, t, v) in samples.items()}
    recording = record_stage(blocks, sorted(case.twin.azimuths))
    return diagnose(stage_problem(case.twin, recording, EFFECTS))


def size_of(case, stream):
    encoder = case.twin.encoder
    count = 2 * np.pi / (encoder.lines_per_revolution * encoder.counts_per_line)
    noise = {"autocollimator": case.twin.autocollimator.noise, "lvdt": case.twin.lvdt.noise}
    return 50 * count if stream.startswith("head") else OFF.get(stream) or 50 * noise[stream]


def spoilt(case, stream, samples, how, draw):
    """Samples of a stream with one that is wrong, one in a hundred, or all for 20 ms by as much."""
    names, times, values = samples
    wrong, at = np.zeros(len(times), bool), int(draw.integers(len(times) // 10, len(times) * 9 // 10))
    wrong[at] = how == "one"
    wrong |= (how == "hundredth") & (draw.random(len(times)) < 0.01)
    wrong |= (how == "burst") & (times >= times[at]) & (times < times[at] + 20_000_000)
    signs = 1.0 if how == "burst" else draw.choice([-1.0, 1.0], (wrong.sum(), values.shape[1]))
    values = values.copy()
    values[wrong] += size_of(case, stream) * signs
    return names, times, values


def assert_the_same(found, plain):
    assert found.verdict is plain.verdict
    assert [each.cause.key for each in found.causes] == [each.cause.key for each in plain.causes]
    for one, other in zip(found.causes, plain.causes, strict=True):
        assert not one.departures
        for name, value in one.parameters.items():
            off = np.abs(np.asarray(value.value) - other.parameters[name].value)
            assert np.all(off <= 0.5 * np.asarray(other.parameters[name].std)), name


@pytest.mark.parametrize("cause", CAUSES)
def test_gross_readings_of_all_instruments_change_nothing(cause):
    seed = 9100 + CAUSES.index(cause)
    draw = np.random.default_rng(seed)
    case, samples = case_of(cause, seed)
    plain = diagnosed(case, samples)
    for how in ("one", "hundredth", "burst"):
        wrong = {
            stream: spoilt(case, stream, own, how, draw) if stream not in ("head_a", "head_c") else own
            for stream, own in samples.items()
        }
        found = diagnosed(case, wrong)
        assert_the_same(found, plain)
        told = {remark.partition(":")[0] for remark in found.remarks if "spikes left out" in remark}
        changed = {stream for stream, (_, _, values) in wrong.items() if np.any(values != samples[stream][2])}
        assert changed and changed <= told


@pytest.mark.parametrize("cause", CAUSES)
def test_streams_that_begin_late_and_end_early_change_nothing(cause):
    seed = 9200 + CAUSES.index(cause)
    case, samples = case_of(cause, seed)
    plain = diagnosed(case, samples)
    for streams in (["force", "temperature"], ["head_b", "lvdt"]):
        cut = dict(samples)
        for stream in streams:
            names, times, values = samples[stream]
            kept = (times >= times[0] + 1_000_000_000) & (times <= times[-1] - 1_000_000_000)
            cut[stream] = names, times[kept], values[kept]
        assert_the_same(diagnosed(case, cut), plain)


@pytest.mark.parametrize("seed", range(9300, 9304))
def test_a_mark_on_the_ring_is_no_gross_reading(seed):
    """Two degrees of the ring are scratched: each head shows it once a turn for a few samples, which is unknown."""
    case, samples = case_of("disc_eccentricity", seed)
    _, times, command = samples["command"]
    for stream, (names, own, values) in samples.items():
        if stream.startswith("head"):
            turned = np.interp(own, times, command[:, 0])
            seen = np.mod(case.twin.azimuths[stream[-1]] - turned, 2 * np.pi)
            samples[stream] = names, own, values + size_of(case, stream) * (np.abs(seen - 3.0) < 0.02)[:, None]
    found = diagnosed(case, samples)
    assert found.verdict is Verdict.UNKNOWN
    heads = [share.pattern for share in found.where if "head_" in share.channel]
    assert len(heads) == 4 and all("place" in pattern for pattern in heads), found.where
