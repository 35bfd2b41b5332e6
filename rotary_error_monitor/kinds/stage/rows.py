"""A stage's recording beside its twin, as those ask it who make findings, candidates, noise and advice of its rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.known_effects import ProblemOfEffects
from rotary_error_monitor.gap.problem import Rows, SparseRows
from rotary_error_monitor.gap.structure import Track
from rotary_error_monitor.kinds.stage.play import Play
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import Signals, StageTwin


class StageRows(ProblemOfEffects, Protocol):
    """What `StageProblem` is to its parts."""

    @property
    def stage(self) -> StageDescription:
        """The description that the twin has."""

    @property
    def recording(self) -> StageRecording:
        """What was measured."""

    @property
    def effects(self) -> Sequence[StageEffect]:
        """Those that may be at work in this recording."""

    @property
    def twin(self) -> StageTwin:
        """Without causes."""

    @property
    def noise(self) -> StageNoise:
        """Of the recording, by which rows are made white."""

    @property
    def play(self) -> Play:
        """Where play may be taken up."""

    @property
    def keeps_signatures(self) -> bool:
        """Whether signatures of effects without size are kept."""

    @property
    def instants(self) -> int:
        """Number of instants at which the heads were read; of a stage without heads, its fastest sensor."""

    def raw_residual(self, causes: Sequence[Cause]) -> Signals:
        """Measured minus predicted (n, k) of each stream, in its unit."""

    def own_nuisance(self, causes: Sequence[Cause]) -> SparseRows:
        """White rows of one standard uncertainty of each uncertain parameter, as rows that are kept."""

    def tracks(self, rest: Rows) -> Iterator[Track]:
        """White rows with what they may depend on, for tests of structure, one channel at a time."""

    def known_start(self, key: tuple[str, str]) -> Array | None:
        """Values from which a candidate that was proposed before is fitted."""
