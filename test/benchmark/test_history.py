"""What the speeds by version say: what became slower, and not what is chance."""

from __future__ import annotations

import numpy as np
import pytest
from benchmark import history
from benchmark.history import NEGLIGIBLE, Speed, keep, measure, read, told


class Clock:
    """Time that passes as a list of durations says, each call the next one."""

    def __init__(self, durations):
        self._durations, self.now = iter([0.0, *durations]), 0.0

    def __call__(self):
        self.now += next(self._durations)
        return self.now


def clock_of(turns, ratio, rng, scatter):
    """Loop, work, and the way to the next turn, on a computer whose speed changes from turn to turn."""
    durations = []
    for _ in range(turns):
        pace = rng.uniform(0.5, 3.0)
        durations += [pace, pace * ratio * (1 + scatter * rng.standard_normal()), 1.0]
    return Clock(durations[:-1])


@pytest.fixture(autouse=True)
def no_loop(monkeypatch):
    monkeypatch.setattr(history, "calibration_loop", lambda: 0.0)


def test_a_ratio_does_not_depend_on_how_busy_the_computer_is():
    rng = np.random.default_rng()
    speed = measure(lambda: None, 9, clock_of(9, 4.0, rng, 0.0))
    assert speed.ratio == pytest.approx(4.0, rel=1e-12)
    assert speed.error == pytest.approx(0.0, abs=1e-12)


def test_what_loads_at_the_first_call_does_not_count():
    calls = []
    measure(lambda: calls.append(len(calls)), 3, clock_of(3, 1.0, np.random.default_rng(), 0.0))
    assert len(calls) == 4


def test_the_standard_error_is_that_of_the_median():
    rng = np.random.default_rng()
    found = [measure(lambda: None, 25, clock_of(25, 2.0, rng, 0.1)) for _ in range(400)]
    scatter = np.std([speed.ratio for speed in found])
    assert scatter == pytest.approx(np.mean([speed.error for speed in found]), rel=0.25)


def test_chance_is_no_loss_of_speed_and_a_loss_is_one():
    """Two versions of equal speed, and one a quarter slower, at 3 % of scatter a turn."""
    rng = np.random.default_rng()

    def pairs(growth):
        speeds = [[measure(lambda: None, 9, clock_of(9, r, rng, 0.03)) for r in (1.0, growth)] for _ in range(400)]
        return np.mean([now.is_slower_than(before) for before, now in speeds])

    assert pairs(1.0) < 0.02
    assert pairs(1.25) > 0.95


def test_what_is_negligible_is_no_loss_however_sure_it_is():
    before = Speed(1.0, 1e-6)
    assert not Speed(1.0 + 0.9 * NEGLIGIBLE, 1e-6).is_slower_than(before)
    assert Speed(1.0 + 1.1 * NEGLIGIBLE, 1e-6).is_slower_than(before)


def test_versions_are_kept_behind_one_another_and_the_last_is_what_counts(tmp_path):
    path = tmp_path / "history.csv"
    keep("0.1.0", {"replay": Speed(8.0, 0.1), "gone": Speed(1.0, 0.1)}, path)
    keep("0.2.0", {"replay": Speed(4.0, 0.1), "read": Speed(1.0, 0.01)}, path)
    keep("0.2.0", {"replay": Speed(5.0, 0.1)}, path)
    assert path.read_text().splitlines() == [
        "version,figure,ratio,standard_error",
        "0.1.0,replay,8,0.1",
        "0.2.0,replay,5,0.1",
        "0.1.0,gone,1,0.1",
        "0.2.0,read,1,0.01",
    ]
    now = {"replay": Speed(6.0, 0.1), "read": Speed(0.5, 0.01), "more": Speed(1.0, 0.1)}
    replay, reading, more = told(now, read(path))
    assert replay.endswith("0.2.0: 5, 1.20 of it: SLOWER")
    assert reading.endswith("0.50 of it: faster")
    assert more.endswith("new")


def test_the_file_that_ships_holds_what_make_bench_measures():
    kept = read()
    assert kept
    for versions in kept.values():
        assert all(speed.ratio > 0 and speed.error >= 0 for speed in versions.values())
