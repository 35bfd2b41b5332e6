"""Slow noise of pointings: what one shares with those before and after it, whatever part of the sky they are on.

The air in a dome and a mount that creeps move the image for minutes. That is no error of the mount as long as it is as
large as the noise; it is told from one as of a stage's or a machine's instrument (`gap/slow_noise.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.known_effects import KnownEffects
from rotary_error_monitor.gap.problem import Columns
from rotary_error_monitor.gap.slow_evidence import SIZES
from rotary_error_monitor.gap.slow_noise import Rivals, cosines, evidence_of_slow_noise, learn_slow_noise
from rotary_error_monitor.kinds.mount.course import POWERS
from rotary_error_monitor.kinds.mount.sky import estimate_repeatability, unshared
from rotary_error_monitor.kinds.mount.twin import MountRecording
from rotary_error_monitor.noise.slow_noise import Cells, SlowNoise

LEAST_SLOW = float(SIZES[0])
"""Size, in standard deviations of white noise, below which slow noise is none."""

SAME_NOISE = 0.05
"""Relative change of the noise that is not worth looking at all rows again."""

MOST_ROUNDS = 4
"""Times that level and slow part of the noise are told beside one another: as a rule the third changes nothing."""

ALWAYS = 1.0
"""Probability that something unknown is at work in a mount beside the known effects (`MountProblem.m_open`)."""

WAVES = 40
"""Half periods of the shortest wave over the recording that is looked for in the place of slow noise, as of a stage."""

MOMENTS = 80
"""Moments at which an axis may jump: those that are closer explain nearly the same."""

SAME = 0.1
"""Part by which sizes of slow noise may differ and be the same, as of a stage."""


class SlowPointings:
    """What slow noise is weighed against, and its courses at the pointings.

    Each way is an instrument of its own: one axis is driven, the other stands still.

    Args:
        recording: the pointings.
        turned: (2, n) what a turn of either axis moves along its way: the hour axis stars far from the pole more, the
            declination axis those beyond it the other way.
        on_sky: (n, p) whatever is smooth on the sky, or goes with the direction of travel.
        least: standard deviation of a pointing, rad, that the mount has at least.

    Attributes:
        passed: (n,) part of the recording that has passed.
        places: (n, 3) where neighbours are close to one another: readings, rad, and that part.
    """

    def __init__(self, recording: MountRecording, turned: Array, on_sky: Array, least: float) -> None:
        time = recording.time
        self.passed = (time - time.min()) / max(float(np.ptp(time)), 1.0)
        self.places = np.column_stack([recording.readings, self.passed])
        self._least = least
        self._moved = [(np.ones(len(time)), own) for own in turned]
        self._on_sky = on_sky / np.maximum(np.sqrt(np.mean(np.square(on_sky), axis=0)), 1e-9)

    def noise_along(
        self,
        way: int,
        errors: Array,
        std: float,
        kept: NDArray[np.bool_],
        angles: Array,
        known: KnownEffects,
        shown: Callable[[float, Columns], Array],
    ) -> tuple[float, Array]:
        """Standard deviation of white noise along one way, rad, and (n, q) that of each slow course, in that.

        Together they are no louder than what neighbours on the sky do not share. All of the slow noise counts, though
        neighbours in a strip are near in time as well and share some of it: there it looks the same as an error that
        has its place on the sky, and what may be a fault of the mount is not made noise. On a real mount the louder
        noise hid causes, and predicted patches of the sky that were left out worse (198 arcsec, 187 so).

        Args:
            way: 0 for that of the hour axis, 1 for that of the declination axis.
            errors: (n,) rad, beside the causes found.
            std: of all noise, of which neighbours on the sky do not share so much, rad.
            kept: (n,) pointings that are no outliers.
            angles: (n, u) what one standard uncertainty of each angle of the geometry does, rad.
            known: effects beside the causes found.
            shown: from a standard deviation and columns (n, p) of these along this way, beside white noise of that.
        """
        white, none = std, without_slow_courses(len(kept))
        for _ in range(MOST_ROUNDS):
            slow = self._learn(way, errors / white, kept, angles / white, known, partial(shown, white))
            if not slow.shape[1]:
                return std, none
            before, white = white, self._white_beside(slow, errors, kept)
            if abs(white / before - 1) < SAME_NOISE:
                break
        apart = float(np.mean(np.square(unshared(errors[kept, None], self.places[kept]))))
        alike = root_mean_square(slow[kept]) ** 2
        while white**2 * (1 + alike) > apart * (1 + SAME_NOISE):
            part = float(np.sqrt(max(apart / white**2 - 1, 0.0) / alike))
            if part * root_mean_square(slow) < LEAST_SLOW:
                return std, none
            slow, alike = part * slow, part**2 * alike
            white = max(white, self._white_beside(slow, errors, kept))
        return white, slow

    def _white_beside(self, slow: Array, errors: Array, kept: NDArray[np.bool_]) -> float:
        """Noise along one way without its slow part: neighbours on the sky share that no more than what is white."""
        white = whitening(slow, kept).whiten((errors * kept)[:, None])
        return max(float(estimate_repeatability(white[kept], self.places[kept])[0][0]), self._least)

    def _learn(
        self,
        way: int,
        white: Array,
        kept: NDArray[np.bool_],
        angles: Array,
        known: KnownEffects,
        shown: Callable[[Columns], Array],
    ) -> Array:
        """(n, q) one standard deviation of each slow course along one way, in those of white noise; q = 0 for none.

        It moves what is seen, or turns the axis, whichever is likelier. Something unknown that is smooth on the sky is
        always there: it is uncertain, and takes no part.
        """
        rows = (white * kept)[None]
        uncertain = np.hstack([angles, float(np.linalg.norm(rows)) * self._on_sky, *known.sizes(shown)])
        weight = max(
            ((moved * kept)[None] for moved in self._moved[way]),
            key=lambda weight: evidence_of_slow_noise(rows, weight, self.passed, uncertain),
        )
        arguments = rows, weight, self.passed, uncertain, self._rivals(way), known.seen_by(shown)
        std = learn_slow_noise(*arguments, prior_of_unknown=ALWAYS)
        return without_slow_courses(len(kept)) if std is None else weight.T * cosines(self.passed) * std

    def _rivals(self, way: int) -> Iterator[Rivals]:
        """What a mount may do with time: an axis, or all that is seen, drifts, swings, settles or jumps."""
        time = self.passed - self.passed.mean()
        yield self._in_each_frame(way, [np.stack([time**k for k in range(1, POWERS + 1)], axis=1)])
        # Swings whose amplitude or period changes steadily: none of any other period lies between two of them.
        turns = [0.5 * np.pi * order * self.passed for order in range(2, 2 * WAVES + 1)]
        swings = [np.stack([np.cos(turn), np.sin(turn)], axis=1) for turn in turns]
        yield self._in_each_frame(way, [np.hstack([swing, time[:, None] * swing]) for swing in swings])
        lasting = (np.exp(-self.passed / part) for part in 0.01 * 1.5 ** np.arange(12))
        yield self._in_each_frame(way, [np.stack([left, self.passed * left], axis=1) for left in lasting])
        moments = np.sort(self.passed)[2:-1]
        moments = moments[:: max(1, len(moments) // MOMENTS)]
        jumps = [(self.passed >= moment)[:, None].astype(np.float64) for moment in moments]
        yield self._in_each_frame(way, jumps)

    def _in_each_frame(self, way: int, courses: Sequence[Array]) -> list[Array]:
        return [moved[:, None] * course for course in courses for moved in self._moved[way]]


def without_slow_courses(count: int) -> Array:
    """(count, 0) of noise that is white."""
    return np.zeros((count, 0))


def root_mean_square(courses: Array) -> float:
    """Size of slow noise with courses (n, q), in standard deviations of the white noise."""
    return float(np.sqrt(np.sum(np.square(courses)) / len(courses)))


def whitening(courses: Array, kept: NDArray[np.bool_]) -> SlowNoise:
    """The map that makes rows of one way white beside slow courses (n, q)."""
    return SlowNoise(Cells(np.arange(len(kept)), kept.astype(np.float64)), courses)


def are_alike(courses: Array, others: Array) -> bool:
    """Whether slow noise is the same, to a part that changes nothing."""
    return courses.shape == others.shape and np.allclose(courses, others, rtol=SAME, atol=0.0)
