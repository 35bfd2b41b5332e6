"""Whether what an instrument shows over a rotation fits its description, or a mistake that is made with it.

What turns with the rotor (eccentricity of the ring, tilt of the mirror) is large and known, so each instrument shows
the same figure in every turn. Directions that were exchanged, a diameter in the place of a radius or a part that was
left out make another figure, which is known as well. Over the angles that were visited the description is held against
each mistake by its sum of squares: that of a residual whose size is unknown beforehand (Jeffreys' prior) has the odds

    (sum of squares of the description / sum of squares of the mistake) ** angles

so a single angle tells a mistake only where it is glaring, and a whole turn where the figures differ by a tenth.

What makes no more of a difference than the rotor's own motion can is not told from it, and accuses nobody. It counts as
uncertainty instead: the square of the difference times the mistake's probability, its part of the total variance. A
vector that turns with the rotor is never told from the rotor's own (ISO 230-7:2015 leaves it out of the radial error
motion), so all of it counts. A calibration claims to have told them apart. Its claim is held against the turn as the
description is: of the vector that the turn shows beside the description, that part of the square counts which is the
probability that the claim does not hold, by its own uncertainty, what a rotor usually differs by from its description,
and what else the turn shows that is not described.
"""

from __future__ import annotations

import cmath
import copy
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import repeat
from typing import NamedTuple

import numpy as np

from rotary_error_monitor.arrays import Complex
from rotary_error_monitor.description.harmonics import PlanarHarmonic

BINS = 16
"""Angles told apart in a turn: error motion of order 5, the highest of usual size, changes from one to the next."""

ODDS = math.log(1e3)
"""Logarithm of the odds from which a mistake is taken for one, against the description."""

IMPOSSIBLE = -40.0
"""Logarithm of odds below which a double has no probability left beside one."""

ROUNDING = 1e-9
"""Part of sums of squares that must be left of their difference before it is trusted: far more than their rounding."""

LEAST_PART = 0.25
"""A mistake is one only where it explains as much of what the description leaves, in sum of squares, and a scale only
where it is wrong by as much."""

FINDING = 6.0
"""Standard deviations of the noise below which nothing is a finding: noise does not reach them in years."""

LEAST_NOISE = 1e-15
"""Less noise than any instrument has, m or rad: what is described as exact is still a number of 53 bits."""

FEWEST = 3
"""Angles from which a vector that turns with the rotor, or a scale and a turn, are fitted: each has two unknowns."""

DEPARTURE = 0.05
"""Part of its described size by which a rotor's motion usually differs from its description."""

LEAVES = 0.5
"""Part of what comes and goes within a turn, such as a push for half of it, that looks as if it turned."""


@dataclass(frozen=True)
class Claim:
    """What a calibration says of the vector that turns with the rotor.

    Attributes:
        uncertainty: stated standard uncertainty of a component, m or rad.
        own: standard deviation of the rotor's own vector from its description, m or rad.
    """

    uncertainty: float
    own: float

    def doubt(self, vector: float, rest: float, deviation: float) -> float:
        """Probability that it does not hold, by the size of the vector that is not described and of all the rest.

        No turn tells the vector from the rotor's own: it stays within `FINDING` of the standard deviations that are
        stated for a component, which hold half of its square by that probability beside the `deviation` of noise, but
        for what comes and goes within the turn.
        """
        variance = max(2.0 * self.uncertainty**2 + self.own**2 + (LEAVES * rest) ** 2, LEAST_NOISE**2)
        open_part = max(vector**2 - (LEAVES * rest) ** 2, 0.0) / FINDING**2 - deviation**2
        least = 2.0 * open_part / vector**2 if vector > 0.0 else 0.0
        return max(least, _probability(vector**2 / variance - ODDS))


def departure(motion: Iterable[PlanarHarmonic]) -> float:
    """Usual size of what a rotor of this described motion makes beside it, m or rad: root mean square."""
    return DEPARTURE * math.sqrt(0.5 * sum(x**2 for row in motion for x in (*row.x, *row.y)))


@dataclass(frozen=True)
class Mistake:
    """A mistake that fits better than the description.

    Attributes:
        mistake: what it is, in words.
        left: root mean square of what the description leaves unexplained, m or rad.
        explained: part of its square that the mistake explains.
        shown: what it makes of a described vector: factors of the vector and of its conjugate, and what it adds that
            turns with the rotor, at rotation 0.
    """

    mistake: str
    left: float
    explained: float
    shown: tuple[complex, complex, complex] = (1.0, 0.0, 0.0)

    def shows(self, theta: float, described: complex) -> complex:
        """What is read with the mistake at a rotation (rad) in the place of a described vector."""
        turned, mirrored, added = self.shown
        return turned * described + mirrored * described.conjugate() + added * cmath.exp(1j * theta)


class MistakenReading(NamedTuple):
    """What an instrument with a mistake shows in the place of a vector, `x + 1j * y`.

    Attributes:
        turned: factor of the vector.
        mirrored: factor of its conjugate; one of both is zero. Of several mistakes they are arrays (k, 1).
    """

    turned: complex | Complex = 0.0
    mirrored: complex | Complex = 0.0

    def __call__(self, vectors: Complex) -> Complex:
        """What is shown in the place of vectors (n,), or by several mistakes, (k, n)."""
        return np.asarray(self.turned * vectors + self.mirrored * np.conj(vectors))


class _Rival(NamedTuple):
    """An explanation beside the description: sum of squares, angles left to tell it, the difference that it makes.

    `shown` as of `Mistake`.
    """

    name: str
    square: float
    freedom: int
    difference: float
    shown: tuple[complex, complex, complex]


class FigureCheck:
    """Holds a vector in the plane that is seen over a rotation against its description and against mistakes.

    Attributes:
        covered: part of a turn that was seen, 0 to 1.
        unresolved: root mean square of what mistakes that are not told make by their probability, m or rad.
    """

    def __init__(
        self,
        mistakes: Mapping[str, MistakenReading],
        noise: float,
        fixed: float,
        fixed_name: str,
        *,
        claim: Claim | None = None,
    ) -> None:
        """Check that has seen nothing yet.

        Args:
            mistakes: readings by the words for the mistake; what each would show in the place of the described vector.
            noise: standard deviation of what noise leaves, m or rad; less than `FINDING` of it is no finding.
            fixed: largest vector that turns with the rotor and is not described, m or rad; a mistake that makes no
                more of a difference is none.
            fixed_name: words for that vector.
            claim: what a calibration says of the described vector; None where there was none.
        """
        self._mistakes = tuple(mistakes)
        factors = np.array(list(mistakes.values()), np.complex128).reshape(-1, 2).T[:, :, None]
        self._reading = MistakenReading(*factors)
        # of each mistake, as single numbers: so few are faster one by one
        self._factors = pairs = [(complex(each.turned), complex(each.mirrored)) for each in mistakes.values()]
        self._conjugates = [(t.conjugate(), m.conjugate(), abs(t) ** 2 + abs(m) ** 2) for t, m in pairs]
        self._noise = max(noise, LEAST_NOISE)
        self._fixed, self._fixed_name, self._claim = fixed, fixed_name, claim
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        # lists: single numbers are taken in far more often than all of them are looked at
        self._seen, self._described, self._turned = [0j] * BINS, [0j] * BINS, [1.0 + 0j] * BINS
        self._count, self._apart = [0] * BINS, [0.0] * BINS
        self._last = -1
        self.covered = self.unresolved = 0.0

    @property
    def stands_out(self) -> bool:
        """Whether what is not resolved is more than noise."""
        return self.unresolved > FINDING * self._noise

    def covers(self, thetas: Iterable[float]) -> bool:
        """Whether something was seen before at each of the rotations (rad)."""
        return self.covered == 1.0 or all(self._count[_place(theta)] for theta in thetas)

    def add(self, theta: float, seen: tuple[float, float], described: tuple[float, float]) -> bool:
        """Take in what is seen and described (x, y) at a rotation (rad); give whether an angle is new."""
        return self.extend([theta], [complex(*seen)], [complex(*described)])

    def extend(
        self,
        thetas: Iterable[float],
        seen: Iterable[complex],
        described: Iterable[complex],
        apart: Iterable[float] | None = None,
    ) -> bool:
        """The same at one rotation after another, of vectors `x + 1j * y`.

        Each may be off by so much that is `apart` (m or rad) from noise, as by stamps where the rotor turns fast; what
        that explains is no finding.
        """
        any_new, counts = False, self._count
        offs = repeat(0.0) if apart is None else apart
        for theta, here, said, off in zip(thetas, seen, described, offs, strict=apart is not None):
            place = _place(theta)
            new = counts[place] == 0
            if place != self._last:
                counts[place] = 0  # what was seen at the last visit makes room
                self._last = place
            counts[place] += 1
            part = 1.0 / counts[place]
            self._seen[place] += part * (here - self._seen[place])
            self._described[place] += part * (said - self._described[place])
            self._turned[place] = complex(math.cos(theta), math.sin(theta))
            self._apart[place] = off
            if new:
                self.covered, any_new = (BINS - counts.count(0)) / BINS, True
        return any_new

    def copy(self) -> FigureCheck:
        """What was seen up to now, for `mend`."""
        kept = copy.copy(self)
        kept._take(self)
        return kept

    def _take(self, other: FigureCheck) -> None:
        self._seen, self._described, self._turned = other._seen[:], other._described[:], other._turned[:]
        self._count, self._apart = other._count[:], other._apart[:]

    def mend(self, finding: Mistake, before: FigureCheck) -> None:
        """Forget what a mistake explains better than the description; there counts what was seen `before`."""
        wrong = [place for place in range(BINS) if self._is_mistaken(place, finding)]
        for place in wrong:
            fine = before._count[place] > 0 and not before._is_mistaken(place, finding)
            self._count[place] = before._count[place] if fine else 0
            self._seen[place], self._described[place] = before._seen[place], before._described[place]
            self._turned[place], self._apart[place] = before._turned[place], before._apart[place]
        self.covered, self._last = (BINS - self._count.count(0)) / BINS, -1

    def _is_mistaken(self, place: int, finding: Mistake) -> bool:
        seen, described, theta = self._seen[place], self._described[place], cmath.phase(self._turned[place])
        return self._count[place] > 0 and abs(seen - finding.shows(theta, described)) < abs(seen - described)

    def judge(self, deviation: float = 0.0) -> Mistake | None:
        """The mistake that explains most of what the description leaves; None where none does.

        Args:
            deviation: standard deviation of noise that is stated for a component, m or rad.
        """
        angles = BINS - self._count.count(0)
        if angles == 0:
            return None
        known = np.array([self._seen, self._described, self._turned])
        seen, described, turned = known if angles == BINS else known[:, np.array(self._count) > 0]
        left = seen - described
        off = sum(apart**2 for apart, count in zip(self._apart, self._count, strict=True) if count)
        least = angles * self._noise**2
        total = max(_square(left), least)
        # not `mean`, which takes as long as all the rest of this
        vector = complex(np.add.reduce(left / turned) / angles) if angles >= FEWEST else 0j
        # Nothing in a recording tells one that is described wrong from the rotor's own.
        self.unresolved = abs(vector)
        if self._claim is not None:
            rest = _size(left - vector * turned)
            self.unresolved *= math.sqrt(self._claim.doubt(abs(vector), rest, deviation))
        best, highest, penalty = None, ODDS, math.log(angles)
        rivals = [] if self._explain_nothing(seen, described, total) else self._wrong_readings(seen, described)
        rivals += self._fitted(seen, described, vector * turned, vector)
        for name, square, freedom, difference, shown in rivals:
            # what was fitted pays for its freedom (Schwarz 1978)
            odds = freedom * math.log(total / max(square, least)) - (angles - freedom) * penalty
            if odds < IMPOSSIBLE:
                continue
            self.unresolved = max(self.unresolved, difference * math.sqrt(_probability(odds)))
            # what stamps may make leaves open which of both it is, and accuses nobody
            explained = 1.0 - max(square, least + off) / total
            if explained < LEAST_PART or difference <= self._fixed:
                continue
            odds = -freedom * math.log1p(-explained) - (angles - freedom) * penalty
            if odds >= highest:
                best, highest = Mistake(name, math.sqrt(total / angles), explained, shown), odds
        return None if best is None or best.left < FINDING * math.sqrt((least + off) / angles) else best

    def _explain_nothing(self, seen: Complex, described: Complex, total: float) -> bool:
        """Whether no mistake has any probability beside a description that leaves a `total` sum of squares, for sure.

        What a mistake leaves, |s - t d - m d*|², follows from four sums over the angles for all of them at once.
        """
        size, square = (float(np.vdot(each, each).real) for each in (seen, described))
        product, mirrored = complex(np.vdot(described, seen)), complex(np.dot(described, seen))
        left = [size + each * square - 2.0 * (t * product + m * mirrored).real for t, m, each in self._conjugates]
        most = max(total * math.exp((1.0 - IMPOSSIBLE) / len(seen)), ROUNDING * (size + square))
        return all(each > most for each in left)

    def _wrong_readings(self, seen: Complex, described: Complex) -> list[_Rival]:
        """What each mistake would show."""
        angles = len(seen)
        shown = self._reading(described)
        squares = _squares(np.concatenate([seen - shown, shown - described]))
        return [
            _Rival(name, squares[k], angles, math.sqrt(squares[k + len(shown)] / angles), (*self._factors[k], 0.0))
            for k, name in enumerate(self._mistakes)
        ]

    def _fitted(self, seen: Complex, described: Complex, turning: Complex, vector: complex) -> list[_Rival]:
        """What was fitted: the vector that turns with the rotor, `turning` as it does, a scale and a turn."""
        angles, found = len(seen), list[_Rival]()
        if angles < FEWEST:
            return found
        differs = abs(vector)
        if differs > self._fixed:
            name = f"{self._fixed_name} differs by {differs:.3g}"
            found.append(_Rival(name, _square(seen - described - turning), angles - 1, differs, (1.0, 0.0, vector)))
        size = _square(described)
        scale = complex((seen * described.conj()).sum()) / size if size > 0.0 else 1.0 + 0j
        if abs(scale - 1.0) > LEAST_PART:
            name = f"what is read is {abs(scale):.3g} times what is described, turned by {_degrees(scale):.3g}°"
            difference = _size((scale - 1.0) * described)
            square = _square(seen - scale * described)
            found.append(_Rival(name, square, angles - 1, difference, (scale, 0.0, 0.0)))
        return found


def _place(theta: float) -> int:
    """Which of the angles told apart a rotation (rad) is at."""
    return int((theta / (2 * math.pi)) % 1.0 * BINS) % BINS


def _probability(odds: float) -> float:
    """Of what has the logarithm of the odds, by the logistic function."""
    return 0.5 + 0.5 * math.tanh(0.5 * odds)


def _degrees(value: complex) -> float:
    return math.degrees(math.atan2(value.imag, value.real))


def _square(values: Complex) -> float:
    return float(np.add.reduce((values * values.conj()).real))


def _squares(rows: Complex) -> list[float]:
    """The same of each row."""
    return list((rows * rows.conj()).real.sum(axis=1).tolist())


def _size(values: Complex) -> float:
    """Root mean square."""
    return math.sqrt(_square(values) / len(values))


MIRRORED: Mapping[str, MistakenReading] = {
    "x is reversed": MistakenReading(mirrored=-1.0),
    "y is reversed": MistakenReading(mirrored=1.0),
    "x and y are both reversed": MistakenReading(turned=-1.0),
    "x and y are exchanged": MistakenReading(mirrored=1j),
    "x and y are exchanged and reversed": MistakenReading(mirrored=-1j),
    "x is read as y and y as -x": MistakenReading(turned=1j),
    "x is read as -y and y as x": MistakenReading(turned=-1j),
}
"""The seven other ways in which two axes can be connected."""

DARK: Mapping[str, MistakenReading] = {"nothing is seen, as without light": MistakenReading()}
"""What an autocollimator shows whose light does not come back."""
