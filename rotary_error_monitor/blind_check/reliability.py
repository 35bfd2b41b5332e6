"""Whether stated probabilities come true: bins of a reliability diagram, and the expected calibration error."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import read_text

Told = tuple[float, bool]
"""A stated probability, and whether what it was stated of is so."""

EDGES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Of the bins: finer near one, where most causes are named, and where 0.95 and 0.99 mean much different odds."""

SURE = 0.9
"""An edge: what is stated above is acted on, and errors there are told apart from those of doubtful statements."""


@dataclass(frozen=True)
class Bin:
    """Statements of about the same probability.

    Attributes:
        low, high: edges.
        stated: mean of the stated probabilities.
        right: how many were so.
        count: how many there are, at least one.
    """

    low: float
    high: float
    stated: float
    right: int
    count: int

    @property
    def share(self) -> float:
        """Observed frequency."""
        return self.right / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 % of the frequency (Wilson 1927).

        Beside few statements it covers as it should, and has a width where none or all were right (Brown, Cai and
        DasGupta, Statistical Science 16, 2001).
        """
        from scipy.stats import binomtest  # loads for a second or two

        found = binomtest(self.right, self.count).proportion_ci(0.95, "wilson")
        return float(found.low), float(found.high)


def bins_of(told: Sequence[Told]) -> tuple[Bin, ...]:
    """Bins that hold a statement, the least probable first; each holds its lower edge, the last one both."""
    found = []
    for low, high in itertools.pairwise(EDGES):
        # Sums of shares may be above one by rounding.
        own = [pair for pair in told if low <= pair[0] < high or pair[0] >= high == EDGES[-1]]
        if own:
            stated = float(np.mean([probability for probability, _ in own]))
            found.append(Bin(low, high, stated, sum(hit for _, hit in own), len(own)))
    return tuple(found)


def calibration_error(bins: Sequence[Bin]) -> float:
    """Expected calibration error: mean of |stated - share|, weighted by how often (Naeini et al., AAAI 2015)."""
    count = sum(own.count for own in bins)
    return sum(abs(own.stated - own.share) * own.count for own in bins) / count if count else 0.0


def error_by_chance(bins: Sequence[Bin]) -> float:
    """Expected calibration error where every statement comes true as often as stated: few statements scatter.

    The mean absolute deviation of a binomial count is 2 k (1 - p) P(k) with k the first whole number above n p
    (De Moivre 1730; Diaconis and Zabell, Statistical Science 6, 1991).
    """
    from scipy.stats import binom  # loads for a second or two

    off = 0.0
    for own in bins:
        k = math.floor(own.count * own.stated) + 1
        off += 2 * k * (1 - own.stated) * float(binom.pmf(k, own.count, own.stated))
    count = sum(own.count for own in bins)
    return off / count if count else 0.0


def read_told(path: Path) -> list[Told]:
    """Probabilities of all causes named in the outcomes of a run, with whether each was one.

    Raises:
        InputError: the file holds no outcomes.
    """
    try:
        rows = json.loads(read_text(path, "a JSON file"))["outcomes"]
        return [(float(probability), bool(hit)) for row in rows for probability, hit in row["probabilities"]]
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{path}: holds no outcomes; give a file that gap-benchmark -o wrote") from None
