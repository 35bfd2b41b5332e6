"""How many random stages a rate is taken over: a quarter of them in `make test`, all of them in `make rates`."""

from __future__ import annotations

import os

ALL = bool(os.environ.get("SWEEPS"))
PART = 4


def seeds(most: int, first: int = 0) -> range:
    """The first quarter of so many seeds, or with SWEEPS=1 all of them."""
    return range(first, first + (most if ALL else -(-most // PART)))
