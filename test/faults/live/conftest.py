"""One running cell for all faults here, and chance that can be repeated: FAULTS_SEED in the environment."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from faults.live.cell import LiveCell
from rotary_error_monitor.testing import Cell


@pytest.fixture(scope="package")
def seed() -> int:
    return int(os.environ.get("FAULTS_SEED") or random.SystemRandom().randrange(2**31))


@pytest.fixture(scope="package")
def chance(seed: int) -> random.Random:
    return random.Random(seed)


class Keeper:
    """Keeps one running cell for all tests, and starts another where that one does not come back."""

    def __init__(self, stack: ExitStack, seed: int) -> None:
        self._stack, self._seed = stack, seed
        self._live: LiveCell | None = None

    def well(self, pause: float) -> LiveCell:
        """The cell, all well, `pause` s after it was whole."""
        try:
            return self._prepared(self._live or self._started(), pause)
        except (TimeoutError, RuntimeError):
            return self._prepared(self._started(), pause)

    def _started(self) -> LiveCell:
        self._stack.close()
        self._live = LiveCell(self._stack.enter_context(Cell()), self._seed)
        self._live.start_all()
        return self._live

    @staticmethod
    def _prepared(live: LiveCell, pause: float) -> LiveCell:
        live.forget()
        live.make_whole()
        live.let_run(pause)
        live.wait_until_all_is_well(live.clock())
        return live


@pytest.fixture(scope="package")
def keeper(seed: int) -> Iterator[Keeper]:
    with ExitStack() as stack:
        yield Keeper(stack, seed)


@pytest.fixture
def live(keeper: Keeper, seed: int, chance: random.Random) -> LiveCell:
    """The running cell, all well, at a random time."""
    print(f"to repeat it: FAULTS_SEED={seed}")  # shown where a test fails
    return keeper.well(chance.uniform(0.0, 0.5))
