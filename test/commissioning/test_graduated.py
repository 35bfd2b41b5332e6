"""Rings whose graduation is off by an arcsecond, as data sheets state, under heads that see it as a contradiction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from world.newly_built import NewlyBuilt, build

from commissioning.bags import run, written
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.recordings.stage_check import check_stage

SIZE = 3e-6
"""Standard deviation of a coefficient, rad: 0.6 arcsec, ten times the noise of a reading."""


def built(seed: int, count: int) -> NewlyBuilt:
    """A stage with the sign of its command stated, no two heads exchanged, stamps known to a microsecond."""
    made = build(seed, count=count, even=False, swap=False, duration=24.0, rounding="round", noise=0.5, graduation=SIZE)
    made.nominal.setdefault("uncertainty", {})["encoder.timing"] = 1e-6
    return made


def contradiction(azimuths: list[float], rows: dict[int, complex]) -> float:
    """Largest amplitude in which heads contradict one another by orders cos - i sin of a graduation, rad."""
    projector = HeadLayout(tuple(azimuths)).projector
    waves = [size * projector @ np.exp(1j * order * np.array(azimuths)) for order, size in rows.items()]
    return float(np.abs(waves).sum(axis=0).max())


@pytest.mark.few(1)
@pytest.mark.parametrize(("seed", "count"), [(0, 4), (1, 4), (2, 4), (3, 4), (0, 5), (1, 5)])
def test_the_heads_fit_the_file_that_is_written_of_them(tmp_path: Path, seed: int, count: int) -> None:
    made = built(seed, count)
    bag, nominal = written(made, tmp_path)
    output = tmp_path / "stage.yaml"
    assert run(bag, nominal, output) == 0
    stage = load_stage(output)
    check = check_stage(bag, stage)
    assert not check.doubts
    # until the first windows have shown how far the heads contradict one another, ticks beyond the limit are withheld
    assert check.figures["withheld"] < 0.02 * check.figures["estimates"]

    # what the heads contradict one another in is of the size that the ring's own has, and none is made up beside it
    assert {row.order for row in stage.ring.graduation} <= {2, 3, 5}
    azimuths = [head["azimuth"] for head in made.true["encoder"]["heads"].values()]
    true = {row["order"]: complex(row["cos"], -row["sin"]) for row in made.true["encoder"]["graduation"]}
    sizes = {order: abs(size) for order, size in true.items()}
    found = {row.order: np.hypot(row.cos, row.sin) for row in stage.ring.graduation}
    left = {order: max(size - found.get(order, 0.0), 0.0) for order, size in sizes.items()}
    assert contradiction(azimuths, left) < 0.5 * contradiction(azimuths, sizes)


@pytest.mark.long
@pytest.mark.parametrize("seed", [11])
def test_a_perfect_ring_is_given_no_graduation(tmp_path: Path, seed: int) -> None:
    bag, nominal = written(build(seed, count=5, even=False, swap=False, duration=24.0, rounding="round"), tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 0
    assert not load_stage(tmp_path / "stage.yaml").ring.graduation
