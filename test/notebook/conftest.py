"""One recording and what notebooks make of it."""

from __future__ import annotations

import pytest
from leaning_stage import write_bag

from rotary_error_monitor import analyse, diagnose, estimate, read_bag
from rotary_error_monitor.resources import config

LIMITS = {"radial_total_um": 5, "tilt_synchronous_urad": 60.5}


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A bag and its truth."""
    folder = tmp_path_factory.mktemp("recorded") / "bag"
    return folder, write_bag(folder, 11)


@pytest.fixture(scope="session")
def bag(made):
    return made[0]


@pytest.fixture(scope="session")
def short(tmp_path_factory):
    """Of two turns."""
    folder = tmp_path_factory.mktemp("short") / "bag"
    write_bag(folder, 12, seconds=5.0)
    return folder


@pytest.fixture(scope="session")
def limits():
    """Of which values are within and beyond."""
    return LIMITS


@pytest.fixture(scope="session")
def recording(bag):
    return read_bag(bag)


@pytest.fixture(scope="session")
def motion(bag):
    return estimate(bag)


@pytest.fixture(scope="session")
def quality(bag):
    return analyse(bag, heights=(0.06,), limits=LIMITS)


@pytest.fixture(scope="session")
def gap(bag):
    return diagnose(bag, config("stage.yaml"))
