"""Zero, gains, roll and cubic terms of an instrument of two axes, by weighted least squares over steps of a reference.

Of a reference's tilt (a, b) the instrument reads along its axis i

    f_i = z_i + p_i + q_i p_i^3 + rate_i t,   p_i = M_i1 (a + s_x lost_x) + M_i2 (b + s_y lost_y)

where s is 1 or -1 by the side from which the reference came. `Response` has M as gain, roll, gain difference and
cross-coupling (polar decomposition), and q_i as cubic_i / gain^2.

One principle decides what the steps tell beside zero and M: each further term has a prior of mean 0 and of the size
that it may plausibly have (`BEND`, `DRIFT`, `LOST`). Where the steps tell more, the prior counts for nothing; where
they do not, the term stays near 0 and is as uncertain as the prior. So nothing is chosen by what it shows, after which
bounds would hold the truth too seldom. A term is told where its standard uncertainty is less than half of its prior's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.two_axis_steps import StepReadings

NAMES = ("zero[0]", "zero[1]", "gain", "roll", "gain_difference", "cross_coupling", "cubic[0]", "cubic[1]")
"""Numbers of a `Response` in the order of its covariance."""

TOLD = 0.5
"""Part of its prior's standard deviation below which that of a term is told."""

LEAST_GAIN, LEAST_RATIO = 1e-3, 0.1
"""Least gain that a stage file may state, and least part of the other axis' gain that an axis has."""

FLOOR = 1e-9
"""Part of the largest reading that the standard deviation of a mean is at least, so that arithmetic has a scale."""

SETTLED = 1e-3
"""Part of their standard uncertainties by which the numbers move in the last round."""

LEAST_SHARE = 1e-4
"""Part of what the reference is off by that the standard deviation of a mean is at least, for the same reason."""

_ROUNDS = 20
"""Gauss-Newton steps at most: a bend of some per cent, which is all that is not linear, settles in three or four; what
takes five times as many goes to and fro."""

_Z, _M, _Q, _RATE, _LOST = slice(0, 2), slice(2, 6), slice(6, 8), slice(8, 10), slice(10, 12)


BEND = 0.05
"""Part by which a reading plausibly bends at the end of the steps, as a standard deviation of a prior: a spot over half
of a quadrant detector bends so."""

DRIFT = 5e-9
"""The same of the drift of the zero, over the gain, rad/s: some arcsec an hour, as of a warm instrument."""

LOST = 5e-6
"""The same of half of the reference's lost motion, rad."""


@dataclass(frozen=True)
class ReferenceUncertainty:
    """How sure a reference is, as standard uncertainties.

    Attributes:
        step: of one setting by itself, the same in all of its visits, rad.
        scale: of all angles alike, as a part of them.
        roll: of its axes against those of the stage, rad.
    """

    step: float
    scale: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True)
class TwoAxisFit:
    """Fitted numbers, all in the order z, M, q, rate, lost (two, four, two, two, two).

    Attributes:
        values: (12,).
        covariance: (12, 12).
        fitted: (k, 2) readings that they predict, without drift.
        residual: (k, 2) mean readings less prediction with drift.
        deletion: (k,) chi-square (2 degrees of freedom) of a step against all others.
        chi_square: of the means that were used.
        freedom: its degrees of freedom: a term that its prior holds takes none.
        prior: (12,) standard deviations of priors; infinite of zero and M, 0 of what is not looked for.
    """

    values: Array
    covariance: Array
    fitted: Array
    residual: Array
    deletion: Array
    chi_square: float
    freedom: float
    prior: Array

    @property
    def matrix(self) -> Array:
        """(2, 2) M."""
        return self.values[_M].reshape(2, 2)

    @property
    def stds(self) -> Array:
        """(12,) standard uncertainties."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rate(self) -> tuple[Array, Array] | None:
        """(2,) rad/s of readings, and its standard uncertainty; None without times."""
        return (self.values[_RATE], self.stds[_RATE]) if self.prior[_RATE].all() else None

    @property
    def lost(self) -> tuple[Array, Array]:
        """(2,) half of the lost motion of the reference, rad, and its standard uncertainty; 0 where one-sided."""
        return self.values[_LOST], self.stds[_LOST]

    @property
    def told(self) -> NDArray[np.bool_]:
        """(2,) whether the steps tell the cubic term of either axis."""
        return np.asarray(self.stds[_Q] < TOLD * self.prior[_Q])

    def response(self) -> Response:
        """The instrument's response, of positive gain.

        Raises:
            InputError: its axes are of the wrong hand.
        """
        return response_of(self.values)

    def response_covariance(self, reference: ReferenceUncertainty) -> Array:
        """(8, 8) covariance of the response's numbers (`NAMES`), with what all steps of the reference share."""
        steps = np.maximum(self.stds[:8] * 1e-3, np.abs(self.values[:8]) * 1e-7)
        columns = []
        for k, step in enumerate(steps):
            moved = [numbers_of(response_of(self.values + sign * step * (np.arange(12) == k))) for sign in (1, -1)]
            columns.append((moved[0] - moved[1]) / (2 * step) if step > 0 else np.zeros(8))
        jacobian = np.stack(columns, axis=1)
        covariance = jacobian @ self.covariance[:8, :8] @ jacobian.T
        covariance[2, 2] += (reference.scale * self.response().gain) ** 2
        covariance[3, 3] += reference.roll**2
        return np.asarray(covariance)


def numbers_of(response: Response) -> Array:
    """(8,) numbers of a response in the order of `NAMES`."""
    zero, cubic = response.zero or (0.0, 0.0), response.cubic or (0.0, 0.0)
    linear = response.gain, response.roll, response.gain_difference, response.cross_coupling
    return np.array([*zero, *linear, *cubic])


def response_from(numbers: Array) -> Response:
    """Response of numbers (8,) in the order of `NAMES`."""
    z_x, z_y, gain, roll, difference, coupling, c_x, c_y = (float(number) for number in numbers)
    return Response((z_x, z_y), gain, roll, 0.0, difference, coupling, (c_x, c_y))


def response_of(values: Array) -> Response:
    """Response from fitted numbers (12,): M as a stretch along axes after a turn.

    Raises:
        InputError: M mirrors, so no turn comes near it.
    """
    (xx, xy), (yx, yy) = values[_M].reshape(2, 2)
    turning = complex(xx + yy, yx - xy) / 2
    against = complex(xx - yy, yx + xy) / 2
    if abs(turning) <= abs(against):
        raise InputError(
            "readings x and y are exchanged, or one of them counts the other way: no turn of the instrument brings its "
            "axes to those of the reference; exchange the columns or change the sign of one, here and at the instrument"
        )
    gain = abs(turning)
    stretch = against * turning / gain**2
    return response_from(
        np.array([*values[_Z], gain, np.angle(turning), 2 * stretch.real, stretch.imag, *values[_Q] * gain**2])
    )


def fit_steps(
    steps: StepReadings, used: NDArray[np.bool_], variances: Array, reference: ReferenceUncertainty
) -> TwoAxisFit:
    """Fit the steps that are `used` (k,), whose means have variances (k, 2) by themselves.

    Raises:
        InputError: the steps do not determine zero and M, tell axes of the wrong hand, or the readings do not follow.
    """
    problem = _Problem(steps, used, variances, reference)
    try:
        values, covariance, weights, jacobian = _settle(problem)
    except np.linalg.LinAlgError:
        raise InputError(
            "the readings follow the reference neither straight nor bent by a cubic term: are the steps in their "
            "order, and the columns in one unit?"
        ) from None
    off = problem.off(values)
    left = weights - weights @ jacobian @ covariance @ jacobian.T @ weights
    response_of(values)
    return TwoAxisFit(
        values,
        covariance,
        problem.predicted(values, drifting=False),
        problem.means - problem.predicted(values),
        _deletion(left, off, used),
        float(off @ weights @ off),
        2 * int(used.sum()) - float(np.trace(covariance @ jacobian.T @ weights @ jacobian)),
        problem.prior,
    )


def _settle(problem: _Problem) -> tuple[Array, Array, Array, Array]:
    """Numbers, their covariance, weights and derivatives, by Gauss and Newton.

    Raises:
        LinAlgError: the numbers do not settle.
    """
    values = problem.start()
    for _ in range(_ROUNDS):
        weights, jacobian = problem.weights(values), problem.jacobian(values)
        information = jacobian.T @ weights @ jacobian + problem.precision
        pull = jacobian.T @ weights @ problem.off(values) + problem.precision @ (problem.mean - values)
        covariance = _inverse(information, problem.looked_for)
        step = covariance @ pull
        values = values + step
        if step @ information @ step < SETTLED**2:
            return values, covariance, weights, jacobian
    raise np.linalg.LinAlgError


class _Problem:
    """Readings, their weights and priors, for one fit."""

    def __init__(
        self, steps: StepReadings, used: NDArray[np.bool_], variances: Array, reference: ReferenceUncertainty
    ) -> None:
        self.means, self.reference, self.used = steps.means, steps.reference, used
        self.largest = float(np.ptp(self.means[used], axis=0).max()) / 2
        gain = float(np.linalg.norm(self.start()[_M]))
        self.variances = np.maximum(variances, (FLOOR * self.largest + LEAST_SHARE * gain * reference.step) ** 2)
        self.same = (steps.settings[used][:, None] == steps.settings[used][None, :]) * reference.step**2
        time = steps.mean_times
        self.time = np.zeros(len(used)) if time is None else time
        both = [(steps.directions[used, axis] == sign).any() for axis in range(2) for sign in (1, -1)]
        self.ways = steps.directions * [both[0] and both[1], both[2] and both[3]]
        self.mean, self.prior = np.zeros(12), np.full(12, np.inf)
        self._set_priors(steps, time is not None)
        self.precision = np.diag(np.where(self.prior > 0, self.prior, np.inf) ** -2.0)
        self.looked_for = self.prior > 0

    def _set_priors(self, steps: StepReadings, timed: bool) -> None:
        start = self.start()
        self.prior[_Q] = BEND / np.square(np.abs(self.means[self.used] - start[_Z]).max(axis=0))
        self.prior[_LOST] = LOST * self.ways.any(axis=0)
        self.prior[_RATE] = 0.0
        if not timed:
            return
        self.prior[_RATE] = DRIFT * np.sqrt(abs(np.linalg.det(start[_M].reshape(2, 2))))
        standing = steps.slopes()
        if standing is not None:
            # what the readings do while the reference stands is one more measurement of the drift
            weights = np.stack([self.prior[_RATE] ** -2.0, np.maximum(standing[1], FLOOR * self.largest) ** -2.0])
            self.mean[_RATE] = weights[1] * standing[0] / weights.sum(axis=0)
            self.prior[_RATE] = weights.sum(axis=0) ** -0.5

    def start(self) -> Array:
        """(12,) by plain least squares without further terms."""
        design = np.column_stack([np.ones(int(self.used.sum())), self.reference[self.used]])
        found, _, rank, _ = np.linalg.lstsq(design / [1, *self._extent], self.means[self.used], rcond=1e-6)
        if rank < 3:
            raise InputError("the steps do not determine zero and gains: both axes of the reference must move, apart")
        z_and_m = found / np.array([1, *self._extent])[:, None]
        least, most = np.linalg.svd(z_and_m[1:], compute_uv=False)[::-1]
        if most < LEAST_GAIN or least < LEAST_RATIO * most:
            raise InputError(
                f"the readings follow the reference by {most:.3g} along one direction and {least:.3g} across; expected "
                f"{LEAST_GAIN:g} or more, and no axis less than {LEAST_RATIO:g} of the other: is a channel dead, or "
                "the unit wrong?"
            )
        return np.concatenate([z_and_m[0], z_and_m[1:].T.ravel(), np.zeros(6)])

    @property
    def _extent(self) -> Array:
        return np.asarray(np.maximum(np.ptp(self.reference[self.used], axis=0), np.finfo(float).tiny))

    def predicted(self, values: Array, drifting: bool = True) -> Array:
        """(k, 2) readings."""
        straight = self._straight(values)
        bent = values[_Z] + straight + values[_Q] * straight**3
        return np.asarray(bent + values[_RATE] * self.time[:, None] if drifting else bent)

    def off(self, values: Array) -> Array:
        """(2 u,) means less prediction of the u used steps, x before y."""
        return np.asarray((self.means - self.predicted(values))[self.used].T.ravel())

    def jacobian(self, values: Array) -> Array:
        """(2 u, 12) derivatives of what is predicted."""
        straight, matrix = self._straight(values), values[_M].reshape(2, 2)
        slope = 1 + 3 * values[_Q] * straight**2
        moved = self.reference + values[_LOST] * self.ways
        found = np.zeros((2, len(straight), 12))
        for axis in range(2):
            own = found[axis]
            own[:, axis] = 1.0
            own[:, 2 + 2 * axis : 4 + 2 * axis] = slope[:, [axis]] * moved
            own[:, 6 + axis] = straight[:, axis] ** 3
            own[:, 8 + axis] = self.time
            own[:, _LOST] = slope[:, [axis]] * matrix[axis] * self.ways
        return np.asarray(found[:, self.used].reshape(-1, 12))

    def weights(self, values: Array) -> Array:
        """(2 u, 2 u) inverse covariance of the means, x before y: what the reference is off by moves both."""
        matrix = values[_M].reshape(2, 2)
        covariance = np.kron(matrix @ matrix.T, self.same) + np.diag(self.variances[self.used].T.ravel())
        return np.asarray(np.linalg.inv(covariance))

    def _straight(self, values: Array) -> Array:
        return np.asarray((self.reference + values[_LOST] * self.ways) @ values[_M].reshape(2, 2).T)


def _inverse(information: Array, looked_for: NDArray[np.bool_]) -> Array:
    """Inverse over what is looked for, by numbers of one size; 0 elsewhere."""
    scale = np.sqrt(np.diag(information)[looked_for])
    part = np.linalg.inv(information[np.ix_(looked_for, looked_for)] / np.outer(scale, scale))
    found = np.zeros_like(information)
    found[np.ix_(looked_for, looked_for)] = part / np.outer(scale, scale)
    return found


def _deletion(left: Array, off: Array, used: NDArray[np.bool_]) -> Array:
    """(k,) chi-square of what a step would have to be moved by to fit the others; 0 of steps that are not used."""
    pull, count = left @ off, int(used.sum())
    found = np.zeros(len(used))
    for row, step in enumerate(np.flatnonzero(used)):
        pair = [row, row + count]
        found[step] = pull[pair] @ np.linalg.solve(left[np.ix_(pair, pair)], pull[pair])
    return found
