"""Estimates and diagnoses of simulated stages against their truth, which comes from the plant, over several seeds."""

from __future__ import annotations

import numpy as np
import pytest
from leaning_stage import MORE, ORDER, true_motion, write_bag

from rotary_error_monitor import diagnose, estimate
from rotary_error_monitor.resources import config

SEEDS = (21, 22)
"""Beside the seed of the recording that all tests share."""

HEIGHT = 0.06


@pytest.fixture(scope="module")
def found(made, motion, gap, tmp_path_factory):
    """Truth, estimate and diagnosis of each seed."""
    results = [(made[1], motion, gap)]
    for seed in SEEDS:
        bag = tmp_path_factory.mktemp("bags") / str(seed)
        plant = write_bag(bag, seed)
        results.append((plant, estimate(bag), diagnose(bag, config("stage.yaml"))))
    return results


def test_the_truth_is_within_two_standard_uncertainties(found):
    """Of tilt by its noise alone, of radial motion by far more, for its uncertainty holds what no noise shows."""
    inside, above = [], []
    for plant, motion, _ in found:
        truth = true_motion(plant, motion.stamp_ns)
        columns = [0, 1, 3, 4]
        inside.append(np.abs(motion.error_motion[:, columns] - truth) < 2 * motion.sigma[:, columns])
        moved = motion.at_height(HEIGHT)
        # a lever turns by the tilt: x by that about y, y by that about x the other way
        there = truth[:, :2] + HEIGHT * np.column_stack([truth[:, 3], -truth[:, 2]])
        above.append(np.abs(moved.values - there) < 2 * moved.sigma)
    assert np.mean(np.concatenate(inside), axis=0).min() > 0.94
    assert np.mean(np.concatenate(above), axis=0).min() > 0.94


def test_the_tilt_that_was_put_in_is_found_with_its_size(found):
    """Each standardised difference of four components and three seeds is a draw: their mean square is near 1."""
    named, differences = 0, []
    for _, _, gap in found:
        table = gap.to_dataframe()
        own = table[(table["effect"] == "spindle_tilt") & (table["location"] == f"order_{ORDER}")]
        if own.empty:
            continue
        named += 1
        for name in "xy":
            rows = own[own["parameter"] == name]
            truth = np.array([MORE if name == "x" else 0.0, 0.0])
            differences.append((rows["value"].to_numpy() - truth) / rows["sigma"].to_numpy())
    assert named >= len(found) - 1
    square = float(np.mean(np.square(np.concatenate(differences))))
    assert 0.13 < square < 2.9  # of 8 to 12 draws, chi-square is outside of it once in some hundred times
