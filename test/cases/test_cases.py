"""Cases: seeded, complete, as large as told, and rough where they are told to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.blind_check.cases import draw_machine
from rotary_error_monitor.cases import making as cases
from rotary_error_monitor.cases.case_faults import AMOUNT, LOUDEST, Kind
from rotary_error_monitor.cases.draws import machine_faults, stage_faults
from rotary_error_monitor.cases.faults import make_fault
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.machine import MachinePlant


@pytest.mark.parametrize("kind", AMOUNT)
def test_stage_case_holds_what_its_kind_says_and_comes_again_from_its_seed(kind: Kind) -> None:
    case, again = (make_stage_case(12, kind, duration=40) for _ in range(2))
    assert case.truth == again.truth
    assert len(case.truth.faults) == AMOUNT[kind]
    mapping = case.truth.as_mapping()
    assert len(mapping["effects"]) == (0 if kind in ("unknown", "mimic") else AMOUNT[kind])
    known = stage_faults(kind != "unknown")
    assert all(fault.name in known for fault in case.truth.faults) or kind == "mimic"
    for stream, blocks in case.blocks.items():
        for block, other in zip(blocks, again.blocks[stream], strict=True):
            np.testing.assert_array_equal(block.rows, other.rows)
    assert (max(case.truth.snr.values()) > 0) == (kind != "null")
    assert make_stage_case(13, kind).truth.faults != case.truth.faults or kind == "null"


def test_streams_have_rates_and_blocks_of_a_usual_recording() -> None:
    case = make_stage_case(1, "null")
    counts = {stream: sum(len(block.rows) for block in blocks) for stream, blocks in case.blocks.items()}
    assert counts.pop("autocollimator") == 16_000
    assert (counts.pop("force"), counts.pop("temperature")) == (4_000, 200)
    assert set(counts) == {"head_a", "head_b", "head_c", "head_d", "lvdt", "command"}
    assert set(counts.values()) == {10_000}
    for blocks in case.blocks.values():
        times = np.concatenate([block.times_ns for block in blocks])
        assert (np.diff(times) > 0).all()
        assert max(len(block.rows) for block in blocks) == 100


@pytest.mark.parametrize("name", ["disc_eccentricity", "autocollimator_gain", "following_error", "spindle_radial"])
def test_fault_is_as_large_as_told(name: str) -> None:
    snr = make_stage_case(5, "single", [name], snr=(150.0, 150.0)).truth.snr
    assert np.linalg.norm(list(snr.values())) == pytest.approx(150, rel=0.05)


def test_clean_recording_without_fault_differs_from_the_plant_by_noise_only() -> None:
    case = make_stage_case(2, "null")
    assert case.twin == case.plant.description
    stage, blocks = case.twin, case.blocks["autocollimator"]
    noise = np.concatenate(
        [
            block.rows[:, 1:] - case.plant.signal("autocollimator", (block.times_ns - case.plant.epoch_ns) * 1e-9)
            for block in blocks
        ]
    )
    assert noise.std() == pytest.approx(stage.autocollimator.noise * np.sqrt(1 + 1 / 12), rel=0.03)


def test_rough_cases_have_an_uncertain_twin_spikes_lost_blocks_and_missing_sensors() -> None:
    cases = [make_stage_case(seed, "null", rough=True, duration=20) for seed in range(12)]
    assert 0 < sum("lvdt" not in case.blocks for case in cases) < 12
    assert 0 < sum("force" not in case.blocks for case in cases) < 12
    lost = [50 - len(case.blocks["head_a"]) for case in cases]
    assert set(lost) == {0, 1, 2}
    for case in cases:
        assert (case.twin.lvdt is None) == ("lvdt" not in case.blocks)
        assert case.twin.autocollimator.turbulence is not None
        assert len(case.blocks["command"]) == 50
        shift = np.subtract(case.plant.description.encoder.eccentricity, case.twin.encoder.eccentricity)
        assert 0 < np.abs(shift).max() < 5 * case.twin.uncertainty["encoder.eccentricity"]
    spikes = 0
    for case in cases:
        for block in case.blocks["autocollimator"]:
            seen = case.plant.signal("autocollimator", (block.times_ns - case.plant.epoch_ns) * 1e-9)
            spikes += int((np.abs(block.rows[:, 1:] - seen).max(axis=1) > 9 * case.twin.autocollimator.noise).sum())
    assert 0.001 < spikes / (12 * 8000) < 0.003


def test_force_is_there_where_the_fault_needs_it() -> None:
    for seed in range(8):
        case = make_stage_case(seed, "single", ["load_compliance"], rough=True, duration=20)
        assert "force" in case.blocks


@pytest.mark.parametrize("rough", [False, True])
def test_machine_case_is_seeded_and_as_large_as_told(rough: bool) -> None:
    machine = load_machine("pan2013")
    one, two = (make_machine_case(machine, 4, "pair", rough=rough, snr=(80.0, 80.0)) for _ in range(2))
    np.testing.assert_array_equal(one.probe, two.probe)
    assert {fault.name for fault in one.truth.faults} <= set(machine_faults())
    assert len(one.probe) == (160 if rough else 240)
    single = make_machine_case(machine, 4, "single", ["squareness"], snr=(80.0, 80.0), rough=rough)
    assert single.truth.snr["/machine/tool_probe"] == pytest.approx(80, rel=0.01)
    assert bool(one.twin.uncertainty) == rough


def test_drawn_machines_have_usual_errors_and_no_slope_in_straightness() -> None:
    drawn, other = (draw_machine(seed) for seed in (1, 2))
    assert drawn.errors != other.errors
    assert len(drawn.errors) == 30
    assert drawn.errors["EYX"].poly[1] == 0 != drawn.errors["EXX"].poly[1]
    case = make_machine_case(drawn, 1, "null")
    assert 1e-6 < case.probe.std() < 1e-3
    assert case.truth.snr == {"/machine/tool_probe": 0.0}


def test_wrong_effects_are_refused() -> None:
    with pytest.raises(InputError, match=r"a case of kind single takes 1 effects of .*got squareness"):
        make_stage_case(1, "single", ["squareness"])
    with pytest.raises(InputError, match=r"a case of kind pair takes 2 effects .*got unbalance"):
        make_stage_case(1, "pair", ["unbalance"])


def test_effect_that_cannot_show_is_refused() -> None:
    machine = load_machine("pan2013")
    stuck = replace(machine, axes=tuple(replace(axis, travel=(-1e-300, 1e-300)) for axis in machine.axes))
    with pytest.raises(InputError, match="does not show in this recording"):
        make_machine_case(stuck, 1, "single", ["axis_scale"])


def test_a_fault_drawn_so_small_that_rounding_hides_it_is_made_larger(monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = make_fault("autocollimator_nonlinearity", cubic=1e-12)
    monkeypatch.setattr(cases, "draw_fault", lambda *given: hidden)
    truth = make_stage_case(5, "single", ["autocollimator_nonlinearity"], snr=(100.0, 100.0)).truth
    assert np.linalg.norm(list(truth.snr.values())) == pytest.approx(100.0, rel=0.05)


def test_a_fault_drawn_so_large_that_a_head_looks_past_the_ring_is_made_smaller(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    huge = make_fault("stiffening_bearing", radial=1e-3)
    monkeypatch.setattr(cases, "draw_fault", lambda *given: huge)
    case = make_stage_case(5, "unknown", ["stiffening_bearing"], duration=20.0)
    assert 30 < np.linalg.norm(list(case.truth.snr.values())) < 1200


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("seed", seeds(3))
def test_of_a_loud_pair_one_is_far_louder_and_the_other_well_above_noise(seed: int, rough: bool) -> None:
    machine = draw_machine(seed)
    stage = make_stage_case(
        seed, "pair", ["encoder_latency", "mirror_flatness"], (100.0, 300.0), rough, loudness=(30.0, 1000.0)
    )
    loud, quiet = ([f"/stage/{s}" for s in names] for names in (("head_a", "head_d"), ("autocollimator",)))
    snr = stage.truth.snr
    weak = np.linalg.norm([value for name, value in snr.items() if name.startswith(tuple(quiet))])
    strong = np.linalg.norm([value for name, value in snr.items() if name.startswith("/stage/head_")])
    assert 90 < weak < 320
    assert 29 < strong / weak < 1010
    assert all(snr[f"{name}/samples.angle"] > 10 * weak for name in loud)
    effects = ["tool_length", "squareness"]
    first, second = make_machine_case(
        machine, seed, "pair", effects, (40.0, 90.0), rough, loudness=(100.0, 100.0)
    ).truth.faults
    alone = [MachinePlant(machine, (fault,)) for fault in (first, second)]
    poses = make_machine_case(machine, seed, "pair", effects, (40.0, 90.0), rough, loudness=(100.0, 100.0)).poses
    base = MachinePlant(machine).tool_offset(poses)
    sizes = [np.linalg.norm(plant.tool_offset(poses)[:, :3] - base[:, :3]) for plant in alone]
    assert sizes[0] / sizes[1] == pytest.approx(100, rel=0.05)


def test_no_fault_is_louder_than_real_stages_and_machines_have_it() -> None:
    assert set(LOUDEST) <= {*stage_faults(), *machine_faults()}
    case = make_stage_case(
        2, "pair", ["disc_eccentricity", "lvdt_gain"], (900.0, 900.0), duration=20.0, loudness=(1e3, 1e3)
    )
    heads = [value for name, value in case.truth.snr.items() if "/head_" in name]
    assert np.linalg.norm(heads) == pytest.approx(LOUDEST["disc_eccentricity"], rel=0.05)


def test_a_ring_that_slips_steps_in_all_heads_and_nowhere_else() -> None:
    case = make_stage_case(4, "unknown", ["disc_slip"], duration=20.0)
    snr = case.truth.snr
    heads = [value for name, value in snr.items() if "/head_" in name]
    assert min(heads) > 0.9 * max(heads) > 10
    assert max(value for name, value in snr.items() if "/head_" not in name) == 0
    (slip,) = case.truth.faults
    shown = case.plant.signal("head_a", np.array([0.0, slip.time - 0.01, slip.time + 0.01, 19.0]))
    plain = replace(case.plant, faults=()).signal("head_a", np.array([0.0, slip.time - 0.01, slip.time + 0.01, 19.0]))
    np.testing.assert_allclose((shown - plain)[:, 0], [0, 0, slip.step, slip.step], atol=1e-12)
