"""The arithmetic of the power of detection: bound, ideal test, sizes reached, and pieces that are put together."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

sys.path.insert(0, str(Path(__file__).parent))

import bench_power
from power import (
    EFFECTS,
    MIDDLE,
    SIZES,
    Setting,
    Trial,
    ideal_power,
    ideal_size,
    information_of,
    search_sizes,
    size_reaching,
)

from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.kinds.stage.problem import StageProblem


@pytest.mark.parametrize("size", [0.0, 1.0, 2.5, 6.0])
def test_the_ideal_test_of_one_amplitude_is_that_of_a_normal_number(size):
    limit = norm.isf(0.005)
    assert ideal_power(size, 1, 0.01) == pytest.approx(norm.sf(limit - size) + norm.sf(limit + size), rel=1e-6)


@pytest.mark.parametrize("amplitudes", [1, 2, 4])
def test_the_ideal_size_has_the_ideal_power(amplitudes):
    for level in (0.5, 0.95):
        assert ideal_power(ideal_size(level, amplitudes), amplitudes) == pytest.approx(level)
    draw = np.random.default_rng(amplitudes)
    rows = draw.normal(size=(100_000, amplitudes))
    rows[:, 0] += ideal_size(0.5, amplitudes)
    none = np.sum(np.square(draw.normal(size=(400_000, amplitudes))), axis=1)
    limit = np.quantile(none, 0.99)
    assert np.mean(np.sum(np.square(rows), axis=1) > limit) == pytest.approx(0.5, abs=0.03)


def test_sizes_that_reach_a_share_are_interpolated():
    sizes = np.repeat([4.0, 6.0, 8.0], 2)
    hits = [False, False, True, False, True, True]
    assert size_reaching(0.25, sizes, hits) == pytest.approx(5.0)
    assert size_reaching(0.5, sizes, hits) == pytest.approx(6.0)
    assert size_reaching(0.95, sizes, hits) == pytest.approx(7.8)
    assert size_reaching(0.5, sizes, [True] * 6) == 4.0
    assert size_reaching(0.5, sizes, [False] * 6) == float("inf")


def test_shares_that_fall_with_the_size_are_taken_together():
    sizes = [4.0, 6.0, 8.0, 10.0]
    assert size_reaching(0.5, sizes, [False, True, False, True]) == pytest.approx(6.0)
    assert size_reaching(0.75, sizes, [False, True, False, True]) == pytest.approx(9.0)


def detector(threshold):
    return lambda size: [Trial(size, seed, True, size + 0.4 * seed >= threshold) for seed in range(3)]


@pytest.mark.parametrize(
    ("threshold", "tried"), [(5.0, (4.0, 7.0)), (2.0, (2.0, 7.0)), (9.0, (6.0, 13.0)), (99, (6, 30))]
)
def test_the_search_stops_where_all_or_none_are_named(threshold, tried):
    found = search_sizes(detector(threshold))
    sizes = sorted({trial.size for trial in found})
    assert sizes == [size for size in SIZES if tried[0] <= size <= tried[1]] and SIZES[MIDDLE] in sizes
    assert len(found) == 3 * len(sizes)


@pytest.mark.parametrize("effect", ["unbalance", "disc_scale"])
def test_the_bound_is_the_standard_deviation_of_the_fit(effect):
    setting = Setting.of(effect, 3)
    problem = setting.problem(20 * setting.std, 1)
    fit = fit_causes(problem, [setting.cause])
    covariance = fit.covariances[0][np.ix_(setting.linear, setting.linear)]
    direction = setting.cause.values[setting.linear]
    assert (direction @ np.linalg.solve(covariance, direction)) ** -0.5 == pytest.approx(setting.std, rel=0.02)
    fitted = fit.causes[0].values[setting.linear]
    apart = fitted - 20 * setting.std * direction
    assert apart @ np.linalg.solve(covariance, apart) < 25
    lengths = [np.linalg.norm(setting.std * direction)]
    assert [size for size, _ in setting.std_in_units] == pytest.approx(lengths)


def test_uncertain_parameters_widen_the_bound():
    setting = Setting.of("mirror_wobble", 3, rough=True)
    problem = setting.problem(0.0, 1)
    uncertain = information_of(problem, setting.cause)
    problem.nuisance = lambda causes: {}
    known = information_of(problem, setting.cause)
    # A long recording tells the tilt of the mirror far better than the description.
    assert isinstance(problem, StageProblem) and uncertain < 0.05 * known
    assert {effect.name for effect in EFFECTS} >= {"mirror_wobble"}


@pytest.mark.long
def test_pieces_are_put_together(tmp_path, monkeypatch, capsys):
    tried = []

    def try_size(setting, size, seed, false_alarms):
        tried.append((size, seed))
        return Trial(size, seed, size > 4, size > 6)

    monkeypatch.setattr(bench_power, "try_size", try_size)
    out = tmp_path / "power.json"
    arguments = ["--effect", "disc_scale", "--trials", "2", "-o", str(out)]
    bench_power.main(arguments)
    assert sorted(set(tried)) == sorted((size, seed) for size in (6.0, 7.0, 8.0) for seed in range(2))
    bench_power.main([*arguments, "--first", "2"])
    bench_power.main(arguments)
    assert len(tried) == 12
    bench_power.main(["--effect", "unbalance", "--trials", "1", "-o", str(out)])
    rows = json.loads(out.read_text())
    assert [len(row["trials"]) for row in rows.values()] == [12, 3]
    table = capsys.readouterr().out.splitlines()[-2:]
    assert [line.split()[0] for line in table] == ["disc_scale", "unbalance"]
    figures = [float(cell) for cell in table[0].split()[-6:]]
    assert figures == pytest.approx([12, 6.0, 6.5, 6.95, ideal_size(0.5, 1), ideal_size(0.95, 1)], abs=0.06)


def test_a_size_that_is_not_reached_is_told_as_such():
    trials = [{"size": size, "seed": 0, "seen": size > 5, "named": False} for size in (4.0, 6.0)]
    row = {
        "effect": "lean",
        "amplitudes": 1,
        "false_alarms": 0.01,
        "std": [(2e-6, "m"), (1e-9, "rad")],
        "trials": trials,
    }
    assert bench_power.cells_of(row)[:6] == ("lean", "2e-06 m and 1e-09 rad", "2", "5.0", "> 6", "> 6")
