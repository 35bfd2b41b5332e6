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


@pytest.mark.parametrize(("usual", "chosen"), [(1.0, "rival"), (1e5, "first")])
def test_a_rival_pays_for_its_freedom(linear, rng, usual, chosen):
    """It explains 10 more; with a size that may be anything the choice of it costs more than that gives."""
    first = linear.effects["first"]
    rare = type("Rare", (type(first),), {"parameters": (Parameter("size", "1", usual),)})
    rival = better_column(linear.data["x"], first.column["x"], 10.0, rng)
    linear.effects = {"first": first, "rival": rare("rival", {"x": rival})}
    (cause,) = select_causes(linear).chosen.fit.causes
    assert cause.effect.name == chosen
