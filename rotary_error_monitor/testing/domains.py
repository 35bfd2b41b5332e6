"""A ROS domain of its own for each test, also for tests that run side by side."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from contextlib import contextmanager

from domain_coordinator import domain_id

_HIGHEST = 100
LOCALHOST = "LOCALHOST"


def discovery_environment(reach: str) -> dict[str, str]:
    """Environment in which nodes find one another as far as `reach` (`LOCALHOST`, `SUBNET`) goes."""
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": reach}


@contextmanager
def own_domain(reach: str = LOCALHOST) -> Iterator[int]:
    """Reserve a ROS domain id that no other test on this machine uses, and keep discovery within `reach`.

    The search starts at a random id: right after a test its domain may still hold word of participants that are gone.
    """
    discovery = discovery_environment(reach)
    start = random.randrange(_HIGHEST)
    ids = iter(1 + (start + i) % _HIGHEST for i in range(_HIGHEST))
    reservation = domain_id(lambda: next(ids))
    number = reservation.__enter__()
    before = {name: os.environ.get(name) for name in discovery}
    os.environ.update(discovery)
    try:
        yield number
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        # Never told of an exception: the coordinator would take an OSError of the test for a domain in use.
        reservation.__exit__(None, None, None)
