"""Which of two effects is chosen where they explain nearly the same."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Parameter
from rotary_error_monitor.gap.selection import select_causes


def better_column(data, column, more, rng):
    """A column that explains so much more than the given one, in squares of white rows; both together no more."""
    unit = column / np.linalg.norm(column)
    noise = data - unit * np.sum(data * unit)
    other = rng.normal(size=data.shape)
    other -= unit * np.sum(other * unit)
    other -= noise * np.sum(other * noise) / np.sum(noise**2)
    along = np.sqrt(more / np.sum(noise**2))
    beside = along * noise / np.linalg.norm(noise) + np.sqrt(1 - along**2) * other / np.linalg.norm(other)
    return unit * np.sum(data * unit) + beside * np.sqrt(more)


@pytest.mark.parametrize("usual", [1.0, 1e5])
@pytest.mark.parametrize(("amplitudes", "chosen"), [(1, "rival"), (4, "first")])
def test_a_rival_pays_for_its_freedom(linear, rng, usual, amplitudes, chosen):
    """It explains 10 more; with four amplitudes to choose the choice of them costs more than that gives.

    How large an effect usually is makes no difference: one that is larger or smaller is as likely.
    """
    first = linear.effects["first"]
    wide = type("Wide", (type(first),), {"parameters": (Parameter("size", "1", usual, amplitudes),)})
    rival = better_column(linear.data["x"], first.column["x"], 10.0, rng)
    # Parts of one column that no other amplitudes explain better.
    more = rng.normal(size=(800, amplitudes - 1))
    seen = np.column_stack([linear.data["x"], rival])
    more -= seen @ np.linalg.lstsq(seen, more, rcond=None)[0]
    linear.effects = {"first": first, "rival": wide("rival", {"x": np.column_stack([rival, more])})}
    (cause,) = select_causes(linear).chosen.fit.causes
    assert cause.effect.name == chosen
