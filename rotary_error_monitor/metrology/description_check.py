"""Whether what an instrument shows over a rotation fits its description, or a mistake that is made with it.

What turns with the rotor (eccentricity of the ring, tilt of the mirror) is large and known, so each instrument shows
the same figure in every turn. Directions that were exchanged, a diameter in the place of a radius or a part that was
left out make another figure, which is known as well. Over the angles that were visited the description is held against
each mistake by its sum of squares: that of a residual whose size is unknown beforehand (Jeffreys' prior) has the odds

    (sum of squares of the description / sum of squares of the mistake) ** angles

so a single angle tells a mistake only where it is glaring, and a whole turn where the figures differ by a tenth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.complex128]

BINS = 16
"""Angles told apart in a turn: error motion of order 5, the highest of usual size, changes from one to the next."""

ODDS = math.log(1e3)
"""Logarithm of the odds from which a mistake is taken for one, against the description."""

LEAST_PART = 0.25
"""A mistake is one only where it explains as much of what the description leaves, in sum of squares, and a scale only
where it is wrong by as much."""

FEWEST = 3
"""Angles from which a vector that turns with the rotor, or a scale and a turn, are fitted: each has two unknowns."""


@dataclass(frozen=True)
class Finding:
    """A mistake that fits better than the description.

    Attributes:
        mistake: what it is, in words.
        left: root mean square of what the description leaves unexplained, m or rad.
        explained: part of its square that the mistake explains.
    """

    mistake: str
    left: float
    explained: float


Reading = Callable[[complex], complex]
"""What an instrument with a mistake shows in the place of a vector, `x + 1j * y`."""


class FigureCheck:
    """Holds a vector in the plane that is seen over a rotation against its description and against mistakes.

    Attributes:
        covered: part of a turn that was seen, 0 to 1.
    """

    def __init__(self, mistakes: Mapping[str, Reading], noise: float, fixed: float, fixed_name: str) -> None:
        """Check that has seen nothing yet.

        Args:
            mistakes: readings by the words for the mistake; what each would show in the place of the described vector.
            noise: standard deviation of what noise leaves, m or rad; less than six of it is no finding.
            fixed: largest vector that turns with the rotor and is not described, m or rad; a mistake that makes no
                more of a difference is none.
            fixed_name: words for that vector.
        """
        self._mistakes = dict(mistakes)
        self._noise = noise
        self._fixed, self._fixed_name = fixed, fixed_name
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._seen = np.zeros(BINS, np.complex128)
        self._described = np.zeros(BINS, np.complex128)
        self._turned = np.ones(BINS, np.complex128)
        self._count = np.zeros(BINS, np.int64)
        self._last = -1
        self.covered = 0.0

    def add(self, theta: float, seen: tuple[float, float], described: tuple[float, float]) -> bool:
        """Take in what is seen and described (x, y) at a rotation (rad); give whether an angle is new."""
        place = int((theta / (2 * math.pi)) % 1.0 * BINS) % BINS
        new = self._count[place] == 0
        if place != self._last:
            self._count[place] = 0  # what was seen at the last visit makes room
            self._last = place
        count = self._count[place] + 1
        part = 1.0 / count
        self._seen[place] += part * (complex(*seen) - self._seen[place])
        self._described[place] += part * (complex(*described) - self._described[place])
        self._turned[place] = complex(math.cos(theta), math.sin(theta))
        self._count[place] = count
        self.covered = float((self._count > 0).mean())
        return bool(new)

    def judge(self) -> Finding | None:
        """The mistake that explains most of what the description leaves; None where none does."""
        visited = self._count > 0
        angles = int(visited.sum())
        if angles == 0:
            return None
        seen, described = self._seen[visited], self._described[visited]
        total = _square(seen - described)
        left = math.sqrt(total / angles)
        if left < 6.0 * self._noise:
            return None
        shown = {name: _each(reading, described) for name, reading in self._mistakes.items()}
        found = {
            name: (_square(seen - values), angles)
            for name, values in shown.items()
            if self._is_no_motion(values - described)
        }
        if angles >= FEWEST:
            found |= self._fitted(seen, described, self._turned[visited])
        odds = {}
        for name, (square, freedom) in found.items():
            least = max(square, angles * self._noise**2)
            explained = 1.0 - least / total
            if explained >= LEAST_PART:
                free = angles - freedom  # what was fitted pays for its freedom (Schwarz 1978)
                odds[name] = -freedom * math.log1p(-explained) - free * math.log(angles), explained
        best = max(odds, key=lambda each: odds[each][0], default="")
        if not best or odds[best][0] < ODDS:
            return None
        return Finding(best, left, odds[best][1])

    def _is_no_motion(self, difference: Array) -> bool:
        """Whether a mistake makes more of a difference than the rotor itself, whose motion may look like it."""
        return math.sqrt(_square(difference) / len(difference)) > self._fixed

    def _fitted(self, seen: Array, described: Array, turned: Array) -> dict[str, tuple[float, int]]:
        """Mistakes with two unknowns that are larger than they may be: sum of squares, and angles left to tell."""
        found = {}
        residual, rest = seen - described, len(seen) - 1
        vector = complex((residual / turned).mean())
        if abs(vector) > self._fixed:
            found[f"{self._fixed_name} differs by {abs(vector):.3g}"] = _square(residual - vector * turned), rest
        size = _square(described)
        scale = complex((seen * described.conj()).sum()) / size if size > 0.0 else 1.0 + 0j
        if abs(scale - 1.0) > LEAST_PART and self._is_no_motion((scale - 1.0) * described):
            square = _square(seen - scale * described)
            found[f"what is read is {abs(scale):.3g} times what is described, turned by {_degrees(scale):.3g}°"] = (
                square,
                rest,
            )
        return found


def _degrees(value: complex) -> float:
    return math.degrees(math.atan2(value.imag, value.real))


def _square(values: Array) -> float:
    return float((values * values.conj()).real.sum())


def _each(reading: Reading, described: Array) -> Array:
    return np.array([reading(complex(value)) for value in described])


MIRRORED: Mapping[str, Reading] = {
    "x is reversed": lambda v: complex(-v.real, v.imag),
    "y is reversed": lambda v: complex(v.real, -v.imag),
    "x and y are both reversed": lambda v: -v,
    "x and y are exchanged": lambda v: complex(v.imag, v.real),
    "x and y are exchanged and reversed": lambda v: complex(-v.imag, -v.real),
    "x is read as y and y as -x": lambda v: complex(-v.imag, v.real),
    "x is read as -y and y as x": lambda v: complex(v.imag, -v.real),
}
"""The seven other ways in which two axes can be connected."""

DARK: Mapping[str, Reading] = {"nothing is seen, as without light": lambda v: 0j}
