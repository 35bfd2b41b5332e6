"""What runs of a positioning test have in common, and the bounds of figures that it leaves or moves."""

from __future__ import annotations

import numpy as np
import pytest
from metrology.simulated_positioning import OTHER_AXES, Array, interval, linear, missed

from rotary_error_monitor.metrology.positioning import PositioningRuns
from rotary_error_monitor.metrology.positioning_bounds import bound_positioning
from rotary_error_monitor.metrology.run_effects import RunEffects, find_run_effects

FIGURES = ("reversal_error", "mean_reversal_error", "mean_deviation_range", "systematic_deviation")

DRIFTS = ("drift five times the scatter", "each run drifts by itself", "scale that grows")


def effects_of(runs: PositioningRuns) -> RunEffects:
    assert runs.backward is not None
    return find_run_effects(runs.targets, [runs.forward, runs.backward])


@pytest.mark.parametrize("kind", DRIFTS)
def test_bounds_hold_differences_of_means_of_runs_that_drift(kind: str) -> None:
    """Of 10 tests at 95 %, four that fail come by chance once in a thousand; without the effects B failed in nine."""
    found = missed(kind, 10)
    assert all(sum(found[f"bidirectional.{name}"]) < 4 / 10 for name in FIGURES), found


@pytest.mark.parametrize("seed", range(3))
def test_what_all_readings_of_a_cycle_share_is_in_no_difference(seed: int) -> None:
    """Closed form: cycles that are shifted and do nothing else leave E, M and B as exact as they are."""
    rng = np.random.default_rng(seed)
    targets, mean, play = np.linspace(0, 1, 9), 1e-6 * rng.normal(0, 3, 9), 1e-6 * rng.normal(2, 0.3, 9)
    shift = 1e-5 * rng.normal(size=5)
    there, back = mean + play / 2, mean - play / 2
    bounds = bound_positioning(PositioningRuns(targets, there[:, None] + shift, back[:, None] + shift))
    true = {
        "reversal_error": np.abs(play).max(),
        "mean_reversal_error": play.mean(),
        "mean_deviation_range": np.ptp(mean),
        "systematic_deviation": np.ptp([there, back]),
    }
    for name, value in true.items():
        assert interval(bounds, f"bidirectional.{name}") == pytest.approx((value, value), abs=1e-10), name


def test_a_shift_of_the_runs_there_moves_the_mean_reversal_error_by_the_t_distribution() -> None:
    """Closed form: runs back that do nothing, runs there that are shifted alone; Student's t of four."""
    rng = np.random.default_rng(1)
    shift = 1e-5 * rng.normal(size=5)
    still = np.zeros((9, 5))
    bounds = bound_positioning(PositioningRuns(np.linspace(0, 1, 9), still + shift, still))
    low, high = interval(bounds, "bidirectional.mean_reversal_error")
    reach = 2.776 * shift.std(ddof=1) / np.sqrt(5)
    assert (high + low) / 2 == pytest.approx(shift.mean(), rel=1e-6)
    assert (high - low) / 2 == pytest.approx(reach, rel=0.12)  # of 1024 draws


@pytest.mark.parametrize(("kind", "most", "least"), [("drift five times the scatter", 1.0, 0.99), ("", 0.55, 0.0)])
def test_effects_are_told_where_they_are(kind: str, most: float, least: float) -> None:
    """The first pattern is the one of all readings alike; of runs without effects none is more probable than before."""
    present = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        present.append(effects_of((OTHER_AXES[kind] if kind else linear)(rng).measured(rng)).present)
    found = np.mean(present, axis=0)
    assert least <= found[0] <= most, found
    assert found[1:].max() <= 0.55, found


@pytest.mark.parametrize("seed", range(4))
def test_means_over_targets_that_cycles_left_out_are_free_of_the_drift(seed: int) -> None:
    """A cycle 10 µm off leaves out some targets, which the mean of the others' readings misses by 2 µm."""
    rng = np.random.default_rng(seed)
    mean: Array = 1e-6 * rng.normal(0, 3, (2, 11))
    shift = 1e-5 * rng.normal(size=5)
    readings = mean[..., None] + shift + 1e-7 * rng.normal(size=(2, 11, 5))
    readings[rng.integers(2), rng.choice(11, 3, replace=False), rng.integers(5)] = np.nan
    found = find_run_effects(np.linspace(0, 1, 11), readings).means - mean
    assert np.ptp(found) < 5e-7
