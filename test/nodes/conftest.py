"""A cell for each test, and what is true in it."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from nodes.mock_cells import mock_parameters

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.testing import Cell

SPEEDS = (0.5, 1.5)
BLOCK_PERIOD = 0.05  # long blocks: the tests run many nodes on few cores


@pytest.fixture
def settings() -> MockSettings:
    """The mock stage of a test began a few seconds ago, so it turns when the test looks."""
    return MockSettings(seed=7, epoch_ns=time.time_ns() - 5_000_000_000, speeds=SPEEDS, forces=False)


@pytest.fixture
def plant(settings: MockSettings) -> StagePlant:
    return mock_stage(load_stage(), settings)


@pytest.fixture
def cell(settings: MockSettings) -> Iterator[Cell]:
    parameters = mock_parameters(settings, BLOCK_PERIOD)
    with Cell(parameters=parameters) as cell:
        yield cell
