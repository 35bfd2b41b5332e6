"""Reliability diagram: bins, their intervals, the calibration error, and the command that draws it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import binom, norm

from rotary_error_monitor.blind_check.reliability import (
    EDGES,
    SURE,
    Bin,
    bins_of,
    calibration_error,
    error_by_chance,
    read_told,
)
from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError


def test_a_bin_holds_its_lower_edge_and_the_last_one_all_above():
    told = [(0.0, False), (0.1, True), (0.0999, False), (0.9, True), (1.0, True), (1.0 + 1e-15, True)]
    assert [(own.low, own.right, own.count) for own in bins_of(told)] == [
        (0.0, 0, 2),
        (0.1, 1, 1),
        (0.9, 1, 1),
        (0.99, 2, 2),
    ]
    assert bins_of([]) == () and SURE in EDGES


@pytest.mark.parametrize(("right", "count"), [(0, 1), (0, 12), (3, 7), (20, 20), (197, 203)])
def test_the_interval_is_that_of_wilson(right, count):
    """Its ends are 1.96 of their own standard deviations off what was observed; all or none is an end itself."""
    interval = Bin(0.0, 1.0, 0.5, right, count).interval
    for bound, end in zip(interval, (0, count), strict=True):
        away = abs(right / count - bound) / np.sqrt(bound * (1 - bound) / count) if right != end else norm.ppf(0.975)
        assert away == pytest.approx(norm.ppf(0.975), rel=1e-9)
        assert right != end or bound == pytest.approx(end / count, abs=1e-12)


def test_the_interval_holds_the_frequency_in_about_95_of_100_cases():
    for frequency in (0.3, 0.5, 0.9):
        hits = np.arange(31)
        bounds = np.array([Bin(0.0, 1.0, 0.5, int(hit), 30).interval for hit in hits])
        inside = (bounds[:, 0] <= frequency) & (frequency <= bounds[:, 1])
        assert 0.92 < binom.pmf(hits[inside], 30, frequency).sum() < 0.99


def test_the_error_of_bins_of_known_shares():
    # A quarter of the statements is 0.1 off, the rest is as stated.
    told = [(0.6, hit < 5) for hit in range(10)] + [(0.8, hit < 24) for hit in range(30)]
    assert calibration_error(bins_of(told)) == pytest.approx(0.025)
    assert calibration_error(()) == 0.0


def test_what_is_drawn_from_its_probability_has_a_small_error():
    draw = np.random.default_rng(5)
    stated = draw.uniform(size=20_000)
    told = list(zip(stated.tolist(), (draw.uniform(size=len(stated)) < stated).tolist(), strict=True))
    bins = bins_of(told)
    assert calibration_error(bins) < 0.015
    assert all(own.interval[0] - 0.02 < own.stated < own.interval[1] + 0.02 for own in bins)


def written(path, *cases):
    path.write_text(json.dumps({"sha256": "", "outcomes": [{"probabilities": pairs} for pairs in cases]}))
    return path


@pytest.mark.long
def test_outcomes_of_several_runs_are_taken_together(tmp_path, capsys):
    first = written(tmp_path / "first.json", [[0.97, True]], [], [[0.3, False], [0.95, True]])
    second = written(tmp_path / "second.json", [[0.93, False]])
    assert read_told(first) == [(0.97, True), (0.3, False), (0.95, True)]
    arguments = ["--outcomes", str(first), "--outcomes", str(second)]
    for suffix, begin in ((".svg", b"<?xml"), (".png", b"\x89PNG")):
        diagram = tmp_path / f"diagram{suffix}"
        assert main(["gap-benchmark", *arguments, "--reliability", str(diagram)]) == 0
        assert diagram.read_bytes().startswith(begin)
    error = (0.3 + 0.93 + 2 * 0.04) / 4
    # by chance: E|X - p| = 2 p (1 - p) of one statement, and 4 p^2 (1 - p) of two with p = 0.96
    by_chance = 2 * 0.3 * 0.7, (2 * 0.93 * 0.07 + 4 * 0.96**2 * 0.04) / 3
    assert (
        f"expected calibration error: {error:.3f} (below 0.9 0.300 of 1, {by_chance[0]:.3f} by chance, "
        f"from 0.9 0.337 of 3, {by_chance[1]:.3f} by chance"
    ) in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize("count", [3, 30, 300])
def test_the_error_by_chance_is_the_mean_of_that_of_calibrated_statements(count):
    draw = np.random.default_rng(count)
    stated = np.repeat([0.25, 0.55, 0.93, 1.0], count)
    errors = []
    for _ in range(2000):
        hits = draw.uniform(size=len(stated)) < stated
        errors.append(calibration_error(bins_of(list(zip(stated.tolist(), hits.tolist(), strict=True)))))
    expected = error_by_chance(bins_of([(p, True) for p in stated.tolist()]))
    assert abs(np.mean(errors) - expected) < 5 * np.std(errors) / np.sqrt(len(errors))


def test_files_that_hold_no_outcomes_are_refused(tmp_path, capsys):
    for number, text in enumerate(("", "[]", "{}", '{"outcomes": [{}]}', '{"outcomes": [{"probabilities": [1]}]}')):
        path = tmp_path / f"{number}.json"
        path.write_text(text)
        with pytest.raises(InputError, match="gap-benchmark -o"):
            read_told(path)
        assert main(["gap-benchmark", "--outcomes", str(path)]) == 2
    assert main(["gap-benchmark", "--reliability", str(tmp_path / "diagram.jpg")]) == 2
    empty = written(tmp_path / "empty.json", [])
    assert main(["gap-benchmark", "--outcomes", str(empty), "-o", str(tmp_path / "out.json")]) == 2
    capsys.readouterr()
    diagram = tmp_path / "empty.svg"
    assert main(["gap-benchmark", "--outcomes", str(empty), "--reliability", str(diagram)]) == 0
    assert "no cause is named" in capsys.readouterr().out and diagram.exists()
