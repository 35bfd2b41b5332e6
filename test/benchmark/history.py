"""Speed by version: ratios to a loop that never changes, kept in `history.csv`, and what became slower since.

A ratio says what a time cannot: that of another computer, or of this one while others use it, may stand beside it. Loop
and work take turns, and the scatter of their ratios says which difference between two versions is more than chance.
"""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FILE = Path(__file__).with_name("history.csv")
FIELDS = ("version", "figure", "ratio", "standard_error")

DOUBT = 3.0
"""Standard errors of a difference within which it is chance."""

NEGLIGIBLE = 0.05
"""Part by which a figure may grow without a word: what another build of Python or numpy makes of the same code."""


@dataclass(frozen=True)
class Speed:
    """Time of a piece of work, over that of the calibration loop.

    Attributes:
        ratio: median over several turns.
        error: standard error of that median, from the median absolute deviation of the turns.
    """

    ratio: float
    error: float

    def is_slower_than(self, other: Speed) -> bool:
        """Whether this is slower by more than chance, and by more than what is negligible."""
        grown = self.ratio - other.ratio
        return grown > max(DOUBT * math.hypot(self.error, other.error), NEGLIGIBLE * other.ratio)


def calibration_loop() -> float:
    """What all is held against: plain Python, small arrays and large ones in about equal parts, as in the package."""
    total, small, large = 0.0, np.arange(8.0), np.linspace(0.0, 1.0, 20_000)
    for i in range(40_000):
        total += (i & 7) * 0.5
    for _ in range(1_200):
        small = small * 0.5 + 1.0
    for _ in range(12):
        large = np.sin(large) + 0.5 * large
    return total + float(small.sum()) + float(large[-1])


def measure(work: Callable[[], object], turns: int = 9, clock: Callable[[], float] = time.process_time) -> Speed:
    """Speed of `work`, of which each call should take some tenths of a second; the first, which loads, does not count.

    Args:
        work: what is measured.
        turns: of loop and work.
        clock: gives the time in s, by default that of the processor.
    """
    work()
    ratios = []
    for _ in range(turns):
        begin = clock()
        calibration_loop()
        middle = clock()
        work()
        ratios.append((clock() - middle) / (middle - begin))
    median = float(np.median(ratios))
    deviation = 1.4826 * float(np.median(np.abs(np.array(ratios) - median)))
    return Speed(median, math.sqrt(math.pi / 2) * deviation / math.sqrt(turns))  # of a median of normal values


def read(path: Path = FILE) -> dict[str, dict[str, Speed]]:
    """Speeds by figure, and of each by version in the order in which they were kept."""
    kept: dict[str, dict[str, Speed]] = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            speed = Speed(float(row["ratio"]), float(row["standard_error"]))
            kept.setdefault(row["figure"], {})[row["version"]] = speed
    return kept


def keep(version: str, speeds: Mapping[str, Speed], path: Path = FILE) -> None:
    """Write the speeds of a version, in place of what was kept of it, behind those of the versions before."""
    kept = read(path) if path.is_file() else {}
    for figure, speed in speeds.items():
        kept.setdefault(figure, {}).pop(version, None)
        kept[figure][version] = speed
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(FIELDS)
        for figure, versions in kept.items():
            writer.writerows([v, figure, f"{s.ratio:.4g}", f"{s.error:.2g}"] for v, s in versions.items())


def told(speeds: Mapping[str, Speed], kept: Mapping[str, Mapping[str, Speed]]) -> Iterable[str]:
    """A line for each figure: the ratio now, that of the version kept last, and whether it became slower."""
    for figure, now in speeds.items():
        line = f"  {figure:<58} {now.ratio:9.3g} ± {now.error:.2g}"
        if figure not in kept:
            yield f"{line}   new"
            continue
        version, before = list(kept[figure].items())[-1]
        word = "SLOWER" if now.is_slower_than(before) else "faster" if before.is_slower_than(now) else "the same"
        yield f"{line}   {version}: {before.ratio:.3g}, {now.ratio / before.ratio:.2f} of it: {word}"
