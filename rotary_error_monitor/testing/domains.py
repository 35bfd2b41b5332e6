"""A ROS domain of its own for each test, also for tests that run side by side."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager

from domain_coordinator import domain_id

from rotary_error_monitor.nodes.transport import environment

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
    start = random.randrange(_HIGHEST)
    ids = iter(1 + (start + i) % _HIGHEST for i in range(_HIGHEST))
    reservation = domain_id(lambda: next(ids))
    number = reservation.__enter__()
    try:
        with environment(discovery_environment(reach)):
            yield number
    finally:
        # Never told of an exception: the coordinator would take an OSError of the test for a domain in use.
        reservation.__exit__(None, None, None)
