"""Evidence of sets of effects: how well each explains the data, against the degrees of freedom that it takes.

For columns X with white data y, each member j having f_j of them and amplitudes a_j, the logarithm of the marginal
likelihood of the linear Gaussian model relative to no effect at all is

    log E = (reduction - sum_j f_j (1 + ln(P_j / f_j))) / 2,    reduction = b' (X'X)^-1 b,  b = X'y,  P_j = |X_j a_j|^2

The prior of each member's amplitudes is as wide as the member is seen to be (the local empirical Bayes prior of George
and Foster, Biometrika 87, 2000): effects that look the same count the same, and one that is larger than usual has
nothing held against it. But where an amplitude would pass the bound of its parameter it stays there, and the reduction
is what is left with that. The twin's uncertain parameters are integrated out beforehand. Each candidate also pays for
the places, orders and moments that were searched to propose it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.bounded import descend_within
from rotary_error_monitor.gap.normal import BlockNormal, Normal, own_products, stack, width_of
from rotary_error_monitor.gap.p_values import log_f_tail
from rotary_error_monitor.gap.problem import Candidate, Columns, Conditions, LearntNoise, Problem, Rows

_SINGULAR = 1e-9
"""Part of a column that must remain beside the others for its amplitude to be looked at at all."""

_INVISIBLE = 1e-6
"""An effect of usual size that moves all rows together by less than this many standard deviations is not seen."""


@dataclass(frozen=True)
class Hypothesis:
    """How a set of candidates does.

    Attributes:
        members: positions of the candidates.
        reduction: of chi-square, the extra sum of squares that they explain.
        dof: degrees of freedom, the number of amplitudes.
        log_evidence: relative to no effect, prior of the search included.
        amplitudes: best values, member after member.
        noise_dof: degrees of freedom with which the level of the noise is known.
    """

    members: tuple[int, ...]
    reduction: float
    dof: int
    log_evidence: float
    amplitudes: Array
    noise_dof: float = np.inf

    @property
    def log_p_value(self) -> float:
        """Natural logarithm of the chance that noise alone gives this reduction to these columns."""
        return log_f_tail(self.reduction / max(self.dof, 1), max(self.dof, 1), self.noise_dof)

    def evidence_in(self, scatter: float) -> float:
        """Log evidence where squares are `scatter` times those of noise: they are divided by it, priors are not."""
        return self.log_evidence - 0.5 * self.reduction * (1 - 1 / scatter)


def price_of(power: Array, count: Array) -> Array:
    """What the evidence of members is less than half of what they explain: of their power, and number of amplitudes."""
    return np.asarray(0.5 * count * (1 + np.log(np.maximum(power / count, 1.0))), np.float64)


class HypothesisTable:
    """All candidates on one table: their normal equations, the nuisances integrated out.

    Args:
        problem: recording beside twin.
        data: white rows (m, 1) that the candidates compete for.
        nuisance: white rows of the twin's uncertain parameters.
        candidates: competitors.
        columns: their signatures.
    """

    def __init__(
        self,
        problem: Problem,
        data: Rows,
        nuisance: Columns,
        candidates: Sequence[Candidate],
        columns: Sequence[Columns],
    ) -> None:
        seen = [i for i, rows in enumerate(columns) if width_of(rows)]
        self.candidates = tuple(candidates[i] for i in seen)
        self.nuisances = width_of(nuisance)
        self.conditions: Conditions = problem.conditions.joined()
        leading = own_products(problem, nuisance, self.conditions)
        self.blocks: BlockNormal = stack(
            problem, data, [nuisance, *(columns[i] for i in seen)], leading, self.conditions
        )
        scales = [candidate.effect.scales()[candidate.linear] for candidate in self.candidates]
        self._scale = np.concatenate([np.zeros(0), *scales])
        bounds = [candidate.effect.bounds() for candidate in self.candidates]
        pairs = list(zip(bounds, self.candidates, strict=True))
        self._low = np.concatenate([np.zeros(0), *(low[candidate.linear] for (low, _), candidate in pairs)])
        self._high = np.concatenate([np.zeros(0), *(high[candidate.linear] for (_, high), candidate in pairs)])
        sizes = np.concatenate([[0], np.cumsum([len(scale) for scale in scales])]).astype(np.intp)
        self._places = [np.arange(a, b, dtype=np.intp) for a, b in itertools.pairwise(sizes)]
        self._owner = np.repeat(np.arange(len(scales)), [len(scale) for scale in scales])
        total = self.blocks.total()
        self.normal: Normal = total.without(self.nuisances)
        self._before = np.diagonal(total.gram)[self.nuisances :].copy()
        self._dropped: set[int] = set()
        self.noise_dof = problem.noise_dof if isinstance(problem, LearntNoise) else np.inf
        self.effects = len({candidate.effect.name for candidate in self.candidates})

    def drop(self, member: int) -> None:
        """Propose a candidate no more: the twin cannot predict it."""
        self._dropped.add(member)

    def columns_of(self, members: Sequence[int]) -> NDArray[np.intp]:
        """Positions of the members' columns among those of all candidates."""
        return np.concatenate([self._places[i] for i in members]) if members else np.zeros(0, np.intp)

    def bounds_of(self, members: Sequence[int]) -> tuple[Array, Array]:
        """Least and largest amplitude of the nuisances, which have none, and of the members' columns."""
        index, free = self.columns_of(members), np.full(self.nuisances, np.inf)
        return np.concatenate([-free, self._low[index]]), np.concatenate([free, self._high[index]])

    def position(self, key: tuple[str, str]) -> int | None:
        """Position of a candidate by name and location."""
        return next((i for i, candidate in enumerate(self.candidates) if candidate.key == key), None)

    def evaluate(self, members: Sequence[int]) -> Hypothesis:
        """Evidence of a set of candidates together."""
        return self.evaluate_all([members])[0]

    def evaluate_all(self, sets: Sequence[Sequence[int]]) -> list[Hypothesis]:
        """Evidence of many sets, those with as many columns worked out together."""
        indices = [self.columns_of(members) for members in sets]
        widths = [len(index) for index in indices]
        found: dict[int, Hypothesis] = {}
        for width in set(widths):
            places = [i for i, other in enumerate(widths) if other == width]
            index = np.array([indices[i] for i in places], np.intp).reshape(len(places), width)
            reduction, dof, price, amplitudes = self._evidence(index)
            for row, i in enumerate(places):
                prior = sum(self.log_prior(member) for member in sets[i])
                log_evidence = float(0.5 * reduction[row] - price[row] + prior)
                found[i] = Hypothesis(
                    tuple(sets[i]),
                    float(reduction[row]),
                    int(dof[row]),
                    log_evidence,
                    amplitudes[row].copy(),
                    self.noise_dof,
                )
        return [found[i] for i in range(len(sets))]

    def _evidence(self, index: NDArray[np.intp]) -> tuple[Array, Array, Array, Array]:
        """Reductions, degrees of freedom, prices of these (k,) and amplitudes (k, w) of sets of columns."""
        gram = self.normal.gram[index[:, :, None], index[:, None, :]]
        scale = self._scale[index]
        # Columns of length one: how large an effect usually is says nothing of what can be told apart.
        length = np.sqrt(np.maximum(np.einsum("kii->ki", gram), 0.0))
        unit = 1 / np.where(length * scale > _INVISIBLE, length, np.inf)
        values, vectors = np.linalg.eigh(gram * unit[:, :, None] * unit[:, None, :])
        # Directions that the recording does not show keep amplitude zero.
        seen = values > _SINGULAR
        part = np.einsum("kij,ki->kj", vectors, unit * self.normal.moment[index])
        solved = np.where(seen, part / np.where(seen, values, 1.0), 0.0)
        amplitudes, reduction = unit * np.einsum("kij,kj->ki", vectors, solved), np.sum(part * solved, axis=1)
        self._hold(index, unit > 0, amplitudes, reduction)
        return reduction, seen.sum(axis=1), self._price(index, unit > 0, gram, amplitudes), amplitudes

    def _price(self, index: NDArray[np.intp], shown: NDArray[np.bool_], gram: Array, amplitudes: Array) -> Array:
        """(k,) what the evidence of each set is less than half its reduction, by the power of each of its members."""
        owner = self._owner[index]
        together = (owner[:, :, None] == owner[:, None, :]) & shown[:, :, None] & shown[:, None, :]
        power = amplitudes * (np.where(together, gram, 0.0) @ amplitudes[:, :, None])[:, :, 0]
        # Of each column: the power of its member, and the number of columns that this has.
        each, count = np.einsum("kij,kj->ki", together, power), np.maximum(together.sum(axis=2), 1)
        return np.asarray(np.sum(np.where(shown, price_of(each, count) / count, 0.0), axis=1), np.float64)

    def _hold(self, index: NDArray[np.intp], shown: NDArray[np.bool_], amplitudes: Array, reduction: Array) -> None:
        """Bring amplitudes (k, w) within their bounds, and the reduction (k,) of those sets to what is left of it."""
        beyond = np.any((amplitudes < self._low[index]) | (amplitudes > self._high[index]), axis=1)
        if not beyond.any():
            return
        chosen, visible = index[beyond], shown[beyond]
        gram = self.normal.gram[chosen[:, :, None], chosen[:, None, :]] * visible[:, :, None] * visible[:, None, :]
        moment = self.normal.moment[chosen] * visible
        held = descend_within(gram, moment, self._low[chosen], self._high[chosen], amplitudes[beyond])
        amplitudes[beyond] = held
        reduction[beyond] = np.maximum(np.sum((2 * moment - np.einsum("kij,kj->ki", gram, held)) * held, axis=1), 0.0)

    def singles(self, beside: Sequence[int] = ()) -> list[Hypothesis]:
        """Each candidate beside the given ones, in the order of the candidates; those themselves are left out."""
        return self.evaluate_all([(*beside, i) for i in self.free(beside)])

    def taken(self, member: int) -> float:
        """Part of a candidate's power that uncertain parameters of the twin can take."""
        index = self._places[member]
        before = float(self._before[index].sum())
        left = float(np.diagonal(self.normal.gram)[index].sum())
        return 1.0 - left / before if before > 0 else 0.0

    def replacements(self, members: Sequence[int], place: int, candidates: Sequence[int]) -> list[Hypothesis]:
        """The set with each of the candidates at that place."""
        return self.evaluate_all([(*members[:place], i, *members[place + 1 :]) for i in candidates])

    def free(self, beside: Sequence[int]) -> list[int]:
        """Candidates that can stand beside the given ones: the same effect at the same place counts once."""
        taken = {self.candidates[i].key for i in (*beside, *self._dropped)}
        return [i for i, candidate in enumerate(self.candidates) if candidate.key not in taken]

    def best_pair(self, shortlist: Sequence[int]) -> Hypothesis | None:
        """The pair with the most evidence, one of them from the shortlist."""
        pairs = {tuple(sorted((i, j))) for i in shortlist for j in self.free((i,))}
        return max(self.evaluate_all(sorted(pairs)), key=lambda hypothesis: hypothesis.log_evidence, default=None)

    def exchange(self, start: Hypothesis, scatter: float = 1.0) -> Hypothesis:
        """The set improved by replacing one member at a time as long as that helps; see `Hypothesis.evidence_in`."""
        best = start
        while True:
            trials = [
                hypothesis
                for k in range(len(best.members))
                for hypothesis in self.replacements(
                    best.members, k, self.free((*best.members[:k], *best.members[k + 1 :]))
                )
            ]
            found = max(trials, key=lambda hypothesis: hypothesis.evidence_in(scatter), default=best)
            if found.evidence_in(scatter) <= best.evidence_in(scatter) + 1e-9:
                return best
            best = found

    def log_prior(self, member: int) -> float:
        """Logarithm of the chance of one candidate among all effects, places, orders and moments."""
        return self.candidates[member].log_prior - float(np.log(self.effects))

    def causes(self, hypothesis: Hypothesis) -> tuple[Cause, ...]:
        """The members with their amplitudes."""
        place, found = 0, []
        for member in hypothesis.members:
            size = len(self._places[member])
            found.append(self.candidates[member].cause(hypothesis.amplitudes[place : place + size]))
            place += size
        return tuple(found)
