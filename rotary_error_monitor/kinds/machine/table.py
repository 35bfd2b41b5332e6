"""Poses of a machine beside its twin: what the twin expects of the probe, and which effects are looked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.topics import topic_named
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Searched, values_of
from rotary_error_monitor.effects.machine_effect import LINEAR, MachineEffect
from rotary_error_monitor.gap.problem import Candidate, Conditions, Rows
from rotary_error_monitor.gap.table import TableProblem, acting
from rotary_error_monitor.kinds.machine.periods import FEWEST_PLACES, count_places, find_period
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

FOLDS = 6
"""Parts that are left out in turn: what is fitted to the five others is a tenth less certain, `sqrt(6 / 5)`, than what
is fitted to all, and six show whether one stretch alone is off."""


class MachineTable(TableProblem[None]):
    """Poses in the order of measuring, their rows the probe's components; a sixth of them is held out together.

    Args:
        machine: the description that the twin has.
        recording: poses and probe.
        effects: the known effects.
        std: (3,) stated standard deviation of each component of the probe, m.

    Attributes:
        index: (n,) number of each pose.
    """

    unit = ("µm", 1e6)
    step = 0.1
    """µm or µrad: the machine is linear in its errors to one part in 10^5."""
    shape_step = 1e-8
    """Of a period: small beside one turn in all turns over the travel, since a wave that is moved bends at once."""

    def __init__(
        self,
        machine: MachineDescription,
        recording: MachineRecording,
        effects: Sequence[MachineEffect],
        std: Array,
    ) -> None:
        self.names = {component: f"{topic_named('tool_probe')}.{component}" for component in "xyz"}
        self.machine, self.recording = machine, recording
        edges = np.linspace(0, len(recording.probe), 4 * FOLDS + 1)
        labels = (np.arange(4 * FOLDS) // 4).astype(np.intp)
        folds = Conditions(edges - 0.5, labels, tuple(f"poses {i + 1}/{FOLDS}" for i in range(FOLDS)))
        super().__init__(machine, folds, recording.probe.T, std, effects)
        self.index = np.arange(len(self.kept), dtype=np.float64)
        self._starts: dict[tuple[str, str], Array] = {}
        self._plain: Array | None = None
        self._derivatives: dict[tuple[object, ...], Array] = {}

    def settle(self, causes: Sequence[Cause]) -> None:
        """Nothing is fitted whatever the causes."""

    def predict(self, state: None, causes: Sequence[Cause]) -> Array:
        """(3, n) what the probe shows with these causes, m; that without any size is kept."""
        fitted = acting(causes)
        if fitted:
            return predict_probe(self.machine, self.recording, fitted).T
        if self._plain is None:
            self._plain = predict_probe(self.machine, self.recording).T
        return self._plain

    def derivative(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause]) -> Array:
        """(3, n, len(indices)) as of any table; that of an effect alone and without size is kept.

        Such are wanted again whenever outliers or the probe's drift are known better.
        """
        beside = [other for other in others if other.key != cause.key]
        if beside or acting([cause]):
            return super().derivative(cause, indices, others)
        key = (values_of([cause]), tuple(indices))
        if key not in self._derivatives:
            self._derivatives[key] = super().derivative(cause, indices, others)
        return self._derivatives[key]

    def quantities(self) -> Mapping[str, Array]:
        """Positions of the axes."""
        scales = [("mm", 1e3) if axis.kind == LINEAR else ("°", 180 / np.pi) for axis in self.machine.axes]
        positions = zip(self.machine.axes, scales, self.recording.positions.T, strict=True)
        return {f"{axis.letter}, {unit}": scale * position for axis, (unit, scale), position in positions}

    def candidates(self, rest: Rows, causes: Sequence[Cause]) -> tuple[Candidate, ...]:
        """Every effect at every place; harmonics of rotary axes of every order, the best period of each linear axis."""
        found = [candidate for effect in self.effects for candidate in self._of(effect, rest)]
        self._starts |= {candidate.key: candidate.start for candidate in found}
        return tuple(found)

    def at_zero(self, key: tuple[str, str]) -> Cause:
        """An effect without size, its shape as it was proposed."""
        effect = next(e for e in self.effects if e.name == key[0])
        return Cause(effect, key[1], self._starts.get(key, effect.start(key[1])))

    def _of(self, effect: AnyEffect, rest: Rows) -> Iterator[Candidate]:
        places = effect.locations(self.machine)
        for place in places:
            if effect.searched is Searched.ORDER:
                yield from self._harmonics(effect, place, len(places))
            elif effect.searched is Searched.WAVE:
                yield from self._waves(effect, place, len(places), rest)
            else:
                yield Candidate(effect, place, effect.start(place), -float(np.log(len(places))))

    def _harmonics(self, effect: AnyEffect, place: str, places: int) -> Iterator[Candidate]:
        most = int(effect.bounds()[1][effect.slices()["order"]][0])
        for order in range(1, most + 1):
            start = effect.start(place)
            start[effect.slices()["order"]] = order
            # Lower orders are likelier: eccentricity and oval shapes come before teeth.
            prior = -float(np.log(order * places * np.sum(1 / np.arange(1, most + 1))))
            yield Candidate(effect, place, start, prior)

    def _waves(self, effect: AnyEffect, place: str, places: int, rest: Rows) -> Iterator[Candidate]:
        """The wave that explains most along an axis, if that stood at enough places to tell one."""
        kept = self.kept
        position = self.recording.positions[kept, self.machine.letters.index(place)]
        if count_places(position) < FEWEST_PLACES:
            return
        start, white = effect.start(place), np.stack([rest[channel][:, 0] for channel in self.channels])
        signal = np.sum(white * self._along(effect, place), axis=0)[kept]
        start[effect.slices()["period"]], trials = find_period(position, signal, places * len(self.effects))
        yield Candidate(effect, place, start, -float(np.log(places * trials)))

    def _along(self, effect: AnyEffect, place: str) -> Array:
        """(3, n) direction in which the error of an axis shows at the poses."""
        position = self.recording.positions[:, self.machine.letters.index(place)]
        unit = effect.start(place)
        # Cosine and sine of the longest period, each times its own wave, add up to a constant.
        longest = float(effect.bounds()[1][effect.slices()["period"]][0])
        shown = np.zeros_like(self.measured)
        for name, wave in (("cos", np.cos), ("sin", np.sin)):
            long, size = unit.copy(), effect.slices()[name]
            long[effect.slices()["period"]], long[size] = longest, effect.scales()[size]
            shown += wave(2 * np.pi * position / longest) * self.shown((Cause(effect, place, long),))
        return np.asarray(shown / np.maximum(np.linalg.norm(shown, axis=0), np.finfo(np.float64).tiny), np.float64)
