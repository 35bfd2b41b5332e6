"""What a real thing does beyond modulations of its textbook form: no jumps, and an instrument's zero that wanders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role, Searched
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.departures import SHARE, Words
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.p_values import log_chi_square_tail
from rotary_error_monitor.kinds.stage.gradual import begun_at, begun_before, moment_of, ramps, takes_time
from rotary_error_monitor.kinds.stage.lagging import LAGS, all_late
from rotary_error_monitor.kinds.stage.modulations import StageModulations, linear_values
from rotary_error_monitor.kinds.stage.play import Play, stays
from rotary_error_monitor.kinds.stage.search import find_step, trials_of_steps
from rotary_error_monitor.twin.stage import Signals, StageTwin


class Derivatives(Protocol):
    """Derivatives of what a twin predicts."""

    def __call__(
        self, cause: Cause, indices: Sequence[int], others: Sequence[Cause], twin: StageTwin | None = None
    ) -> Signals:
        """(n, k, p) of the signals that a cause moves, beside others; by another twin, if there is one."""


@dataclass(frozen=True)
class AddedForm:
    """Columns that no modulation of a cause gives.

    Attributes:
        kind: departures of one kind are taken together.
        words: says what it is.
        signals: (n, k, q) by stream, for one standard deviation of each.
        whole: whether a real thing has all of it as easily as some (`Departures.whole`).
    """

    kind: str
    words: Words
    signals: Signals
    whole: bool = True

    @property
    def count(self) -> int:
        """Number of columns."""
        return max((rows.shape[2] for rows in self.signals.values()), default=0)


def has_added_forms(effect: StageEffect, jumps: bool) -> bool:
    """Whether an effect, which may jump where the rotor turns back, has any that may be there as a whole."""
    return jumps or effect.searched is Searched.MOMENT or effect.displaces_instrument or effect.warms


class AddedForms:
    """Those of the effects of one recording.

    Args:
        twin: of the stage.
        play: of a drive that turns back as the recording does.
        modulations: of the same recording.
        derivatives: of what the twin predicts.
        left: times (m,) and white rows (m,) of a head beside causes; None where a part of the recording is looked at.
    """

    def __init__(
        self,
        twin: StageTwin,
        play: Play,
        modulations: StageModulations,
        derivatives: Derivatives,
        left: Callable[[str, Sequence[Cause]], tuple[Array, Array]] | None,
    ) -> None:
        self._twin, self._play, self._modulations, self._derivatives = twin, play, modulations, derivatives
        self._left = left

    def of(self, cause: Cause, causes: Sequence[Cause], signatures: Signals, jumps: bool) -> list[AddedForm]:
        """Those of a cause beside others.

        Args:
            cause: as fitted.
            causes: all that are fitted.
            signatures: (n, k, p) of the cause by stream.
            jumps: whether its textbook form jumps where the rotor turns back.
        """
        effect = cause.effect
        assert isinstance(effect, StageEffect)
        found = []
        if effect.searched is Searched.MOMENT or jumps:
            found.append(self._no_jump(cause, causes, signatures))
        if effect.searched is Searched.MOMENT and self._left:
            found += self._given_back(cause, causes, *self._left(cause.location, causes))
        if effect.displaces_instrument:
            zeros = {name: self._zeros(cause, name, rows.shape[1]) for name, rows in signatures.items()}
            found.append(AddedForm("zero", zero_wanders, zeros))
        if effect.warms:
            found.append(self._lagging(cause, causes, signatures))
        if self._modulations.goes_with_force(cause):
            found.append(self._unlike_directions(cause, causes))
        return found

    def staying(self, cause: Cause, causes: Sequence[Cause]) -> Signals:
        """Signature (n, k, p) of a cause that stays at rest as it was; textbooks put it back."""
        remembering = self._twin.driven_by(self._play.remembering())
        return self._derivatives(cause, cause.effect.indices(Role.LINEAR), causes, remembering)

    def _no_jump(self, cause: Cause, causes: Sequence[Cause], signatures: Signals) -> AddedForm:
        """What comes in the place of a textbook's jump."""
        linear, amplitudes = linear_values(cause)
        course: Callable[[Array], Array]
        if cause.effect.searched is Searched.MOMENT:
            kind, words, course = "little by little", takes_time, partial(ramps, moment_of(cause))
            shown = self._derivatives(begun_before(cause), linear, causes)
        else:
            kind, words, course = "at rest", stays, self._play.resting
            shown = {name: rows - signatures[name] for name, rows in self.staying(cause, causes).items()}
        moved = {name: (rows @ amplitudes)[:, :, None] for name, rows in shown.items()}
        return AddedForm(kind, words, {n: rows * course(self._twin.times[n])[:, None] for n, rows in moved.items()})

    def _given_back(self, cause: Cause, causes: Sequence[Cause], time: Array, rows: Array) -> list[AddedForm]:
        """A second step, at the moment that white rows (m,) at times (m,) show, if chance hardly makes it.

        Counts that were lost come back at the next reference mark, all of them or some.
        """
        moment, gain = find_step(time, rows)
        if log_chi_square_tail(gain, 1) + np.log(trials_of_steps(len(rows))) > np.log(FALSE_ALARMS):
            return []
        linear, amplitudes = linear_values(cause)
        shown = self._derivatives(begun_at(cause, moment), linear, causes)
        words = partial(comes_back, moment - moment_of(cause))
        return [AddedForm("given back", words, {name: (rows @ amplitudes)[:, :, None] for name, rows in shown.items()})]

    def _lagging(self, cause: Cause, causes: Sequence[Cause], signatures: Signals) -> AddedForm:
        """What goes with a temperature goes with that of a part, which lags; each lag may hold in full."""
        linear, amplitudes = linear_values(cause)
        duration = self._play.duration
        parts: dict[str, list[Array]] = {name: [] for name in signatures}
        for lag in LAGS:
            twin = self._twin.driven_by(all_late(self._twin.inputs, duration, lag * duration))
            for name, rows in self._derivatives(cause, linear, causes, twin).items():
                parts[name].append((rows - signatures[name]) @ amplitudes)
        return AddedForm("lag", lags, {name: np.stack(part, axis=2) for name, part in parts.items()})

    def _unlike_directions(self, cause: Cause, causes: Sequence[Cause]) -> AddedForm:
        """What yields more along one direction than across it: a symmetric tensor in the place of a number."""
        linear, amplitudes = linear_values(cause)
        force = self._twin.inputs.force
        turned: list[Callable[[Array], Array]] = [lambda t: force(t) * [1.0, -1.0], lambda t: force(t)[:, ::-1]]
        parts: dict[str, list[Array]] = {}
        for other in turned:
            twin = self._twin.driven_by(replace(self._twin.inputs, force=other))
            for name, rows in self._derivatives(cause, linear, causes, twin).items():
                parts.setdefault(name, []).append(SHARE * (rows @ amplitudes))
        signals = {name: np.stack(part, axis=2) for name, part in parts.items()}
        return AddedForm("unlike directions", yields_more_along_one, signals, whole=False)

    def _zeros(self, cause: Cause, stream: str, components: int) -> Array:
        """(n, k, q) each component of a stream in each slow course, as large as what the cause does there."""
        courses = self._modulations.slow(self._twin.state(stream))
        each = SHARE * self._modulations.size(cause, stream) * np.eye(components)
        return (each[:, :, None] * courses[:, None, None, :]).reshape(len(courses), components, -1)


def comes_back(later: float, change: float) -> str:
    """Words for a second step so many s after the first, or before it."""
    return f"comes back in part {later:.2g} s later" if later > 0 else f"began in part {-later:.2g} s before"


def lags(change: float) -> str:
    """Words for what is later than the thermometer."""
    return "lags behind the thermometer"


def yields_more_along_one(change: float) -> str:
    """Words for a stiffness that is not the same in all directions."""
    return "yields more along one direction than across it"


def zero_wanders(change: float) -> str:
    """Words for an instrument that what displaced it displaces further."""
    return "its zero wanders as it warms or with time"
