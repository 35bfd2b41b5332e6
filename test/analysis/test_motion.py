"""Error motion values of whole recordings of the independent plant, against its own waves in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.analysis.motion import analyse_motion
from rotary_error_monitor.analysis.signals import default_heights
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import load_stage

SEEDS = seeds(6)
HEIGHTS = (0.0, 0.016, 0.06)
RING = np.linspace(0.0, 2 * np.pi, 20_001)


def truths(true_profiles):
    """Values by signal and name, from the waves alone: radial without its first order, tilt with it."""
    without, whole = true_profiles(RING, without=(1,)), true_profiles(RING)
    found = {}
    for height in HEIGHTS:
        x = without["exc"] + height * without["ebc"]
        y = without["eyc"] - height * without["eac"]
        found[f"radial_x_at_{height * 1e3:g}mm", "synchronous"] = np.ptp(x)
        found[f"radial_y_at_{height * 1e3:g}mm", "synchronous"] = np.ptp(y)
        both = (whole["exc"] + height * whole["ebc"]) * np.cos(RING)
        both += (whole["eyc"] - height * whole["eac"]) * np.sin(RING)
        waves = np.column_stack([np.ones_like(RING), np.cos(RING), np.sin(RING)])
        left = both - waves @ np.linalg.lstsq(waves, both, rcond=None)[0]
        found[f"radial_rotating_at_{height * 1e3:g}mm", "synchronous"] = np.ptp(left)
    for axis, name in (("x", "eac"), ("y", "ebc")):
        found[f"tilt_{axis}", "synchronous"] = np.ptp(whole[name])
        found[f"tilt_{axis}", "residual_synchronous"] = np.ptp(without[name])
        found[f"tilt_{axis}", "fundamental"] = np.ptp(whole[name] - without[name])
    return found


def test_the_plants_own_waves_are_found_within_the_uncertainty(estimated, true_profiles):
    """At each speed in each direction, radial at three heights and tilt."""
    expected, off = truths(true_profiles), []
    inside = {(quantity, name): [] for quantity in ("radial", "tilt") for name in ("synchronous",)}
    inside |= {("tilt", name): [] for name in ("fundamental", "residual_synchronous")}
    for seed in SEEDS:
        segments = analyse_motion(estimated(seed), load_stage(), HEIGHTS)
        ways = {(np.sign(s.speed), round(abs(s.speed))) for s in segments if s.signals}
        assert ways == {(1, 2), (1, 4), (-1, 2), (-1, 4)}
        for segment in segments:
            for figures in segment.signals:
                for name, value in figures.values.items():
                    if (figures.signal, name) in expected:
                        truth = expected[figures.signal, name]
                        inside[figures.quantity, name].append(abs(value.value - truth) <= value.expanded)
                        off.append(abs(value.value - truth) / truth)
    assert {key: len(rows) for key, rows in inside.items() if key[0] == "tilt"} == dict.fromkeys(
        list(inside)[1:], 8 * len(SEEDS)
    )
    assert min(np.mean(rows) for rows in inside.values()) >= 0.93
    assert np.median(off) < 0.03


def test_nothing_asynchronous_is_told_of_a_stage_that_has_next_to_none(estimated):
    """The plant's rotor comes back within some hundredths of a micrometre: far less than its total error motion."""
    for seed in SEEDS:
        for segment in analyse_motion(estimated(seed), load_stage(), (0.0,)):
            for figures in segment.signals:
                if "asynchronous" in figures.values and segment.turned > 2:
                    value = figures.values["asynchronous"]
                    assert value.value - value.expanded < 0.15 * figures.values["total"].value


def test_what_is_said_of_a_segment_is_what_was_measured(estimated):
    estimates = estimated(0)
    for segment in analyse_motion(estimates, load_stage(), HEIGHTS):
        assert segment.steady
        if not segment.signals:
            continue
        turns = {figures.turns for figures in segment.signals}
        assert segment.turned - 2 < max(turns) <= segment.turned
        period = np.diff(estimates.stamp_ns).min() * 1e-9
        assert segment.samples == pytest.approx(2 * np.pi / abs(segment.speed) / period, rel=0.01)
        assert segment.bandwidth == pytest.approx(segment.cut_off * abs(segment.speed) / (2 * np.pi))
        assert segment.cut_off == min(150, int(segment.samples / 7))


def test_orders_of_the_plant_stand_out_and_odd_ones_are_hidden(estimated):
    described = {row.order: row for row in load_stage().spindle.radial}
    for segment in analyse_motion(estimated(1), load_stage(), (0.0,)):
        for figures in segment.signals:
            if figures.signal != "radial_x_at_0mm":
                continue
            spectrum = figures.spectrum
            assert all(order % 2 for order in spectrum.hidden) and {1, 3, 5} <= set(spectrum.hidden)
            for order in (2, 3, 5):
                truth = np.hypot(*described[order].x)
                row = order - 1
                assert abs(spectrum.amplitude[row] - truth) <= 3 * spectrum.uncertainty[row] + 0.01 * truth


def test_less_than_a_turn_says_which_figures_are_not_told(estimated):
    whole = estimated(2)
    first = np.searchsorted(np.abs(whole.theta - whole.theta[0]), 0.8 * 2 * np.pi)
    part = replace(whole, **{name: getattr(whole, name)[:first] for name in vars(whole)})
    (segment,) = analyse_motion(part, load_stage(), (0.0,))
    assert segment.signals == ()
    assert any("no whole one, so no error motion value is told" in remark for remark in segment.remarks)


def test_missing_samples_cost_the_turns_that_they_are_in(estimated):
    whole = estimated(3)
    lacking = whole.error_motion.copy()
    before = {s.name: s for s in analyse_motion(whole, load_stage(), (0.0,))}
    name, segment = max(before.items(), key=lambda item: item[1].turned)
    middle = np.searchsorted(whole.stamp_ns, segment.signals[0].middle_ns[0])
    lacking[middle : middle + 50, :2] = np.nan
    after = {s.name: s for s in analyse_motion(replace(whole, error_motion=lacking), load_stage(), (0.0,))}
    turns = {figures.signal: figures.turns for figures in after[name].signals}
    told = {figures.signal: figures.turns for figures in segment.signals}
    assert turns["radial_x_at_0mm"] == told["radial_x_at_0mm"] - 1
    assert turns["tilt_x"] == told["tilt_x"]
    assert "radial: 1 whole turns in which samples are missing are left out" in after[name].remarks


def test_heights_that_somebody_looks_at():
    stage = load_stage()
    assert default_heights(stage) == (0.0, 0.016)
    probe = ListedSensor("radial_probe", 1e-8, 1e-9, 1e-4, 2e-7, place={"azimuth": 0.0, "height": 0.1})
    assert default_heights(replace(stage, lvdt=None, sensors={"radial_probe_a": probe})) == (0.0, 0.1)
