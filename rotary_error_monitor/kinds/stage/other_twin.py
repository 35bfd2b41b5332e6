"""Twins that differ from one by what drives the stage: a warming or a force that nobody noticed, or one read late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.rotor import RotorState
from rotary_error_monitor.twin.stage import Acting, StageInputs, StageTwin, turned_by

Course = Callable[[Array], Array]
"""Values at any times (m,), s."""


def _always(size: float) -> Course:
    return lambda time: np.full(len(time), size)


@dataclass(frozen=True)
class Warmed:
    """Another course of temperature, of the stage or a place."""

    course: Course
    place: str = ""

    @property
    def what(self) -> tuple[str, ...]:
        """The temperature of that place."""
        return "warming", self.place

    def inputs(self, inputs: StageInputs) -> StageInputs:
        """What drives the stage, with it."""
        nothing = inputs.warmings.get(self.place, lambda time: np.zeros(len(time)))
        before = nothing if self.place else inputs.warming

        def warming(time: Array) -> Array:
            return np.asarray(before(time) + self.course(time), np.float64)

        if self.place:
            return replace(inputs, warmings={**inputs.warmings, self.place: warming})
        return replace(inputs, warmings={**inputs.warmings, "": warming}, warming=warming)

    def state(self, state: RotorState) -> RotorState:
        """A state of the rotor, with it."""
        added = self.course(state.time - state.age)
        if not self.place:
            return replace(state, warming=state.warming + added, _kept={})
        return replace(state, warmings={**state.warmings, self.place: state.warmings.get(self.place, 0.0) + added})


@dataclass(frozen=True)
class Pushed:
    """A force (2,) on the shaft, N, that was not noticed, always or on a course.

    Readings within the noise of a load cell are no force: what is wrong with its steps is wrong `where_it_acts`.
    """

    force: Array
    course: Course = field(default_factory=lambda: _always(1.0))
    where_it_acts: bool = False

    @property
    def what(self) -> tuple[str, ...]:
        """The force, along the axis on which it is most."""
        return "force", str(int(np.argmax(np.abs(self.force))))

    def inputs(self, inputs: StageInputs) -> StageInputs:
        """What drives the stage, with it."""
        before = inputs.force
        return replace(inputs, force=lambda time: self._with(before(time), time))

    def state(self, state: RotorState) -> RotorState:
        """A state of the rotor, with it."""
        return replace(state, force=np.asfortranarray(self._with(state.force, state.time - state.age)), _kept={})

    def _with(self, before: Array, time: Array) -> Array:
        """(n, 2) force with it at times (n,)."""
        added = np.outer(self.course(time), self.force)
        return np.asarray(before + (added * np.any(before, axis=1)[:, None] if self.where_it_acts else added))


@dataclass(frozen=True)
class Scaled:
    """More of the force by a part of it."""

    part: float

    @property
    def what(self) -> tuple[str, ...]:
        """The force as it acts."""
        return "force", ""

    def inputs(self, inputs: StageInputs) -> StageInputs:
        """What drives the stage, with it."""
        before = inputs.force
        return replace(inputs, force=lambda time: np.asarray(before(time) * (1 + self.part), np.float64))

    def state(self, state: RotorState) -> RotorState:
        """A state of the rotor, with it."""
        return replace(state, force=np.asfortranarray(state.force * (1 + self.part)), _kept={})


@dataclass(frozen=True)
class Late:
    """A force that acted earlier than it was read: what was read (m, 2), N, at times (m,), and by how much, s."""

    read: Course
    delay: float

    @property
    def what(self) -> tuple[str, ...]:
        """The force as it acts."""
        return "force", ""

    def inputs(self, inputs: StageInputs) -> StageInputs:
        """What drives the stage, with it."""
        return replace(inputs, force=self._acting)

    def state(self, state: RotorState) -> RotorState:
        """A state of the rotor, with it."""
        return replace(state, force=np.asfortranarray(self._acting(state.time - state.age)), _kept={})

    def _acting(self, time: Array) -> Array:
        return self.read(time + self.delay)


class OtherTwin(StageTwin):
    """A twin with something else acting on it; its states are the first one's but for that."""

    def __init__(self, twin: StageTwin, change: Warmed | Pushed | Scaled | Late) -> None:
        inputs = change.inputs(twin.inputs)
        super().__init__(twin.stage, inputs, twin.times, twin.observed, twin.known, twin.keeps_states)
        self._plain, self._change = twin, change

    @property
    def what(self) -> tuple[str, ...]:
        """Which input is another, and along which axis."""
        return self._change.what

    def beside(self, twin: StageTwin) -> OtherTwin:
        """The same beside another twin, such as that of a stretch of the recording."""
        return self if twin is self._plain else OtherTwin(twin, self._change)

    def state(self, stream: str, delay: float = 0.0) -> RotorState:
        """The rotor at the sample times of a stream, `delay` seconds earlier."""
        return self._change.state(self._plain.state(stream, delay))

    def _moved_state(self, stream: str, acting: Acting) -> RotorState:
        plain = self._plain._moved_state(stream, acting)
        # The first one's waves hold unless an effect turns the rotor by what is other.
        before = self._change.state(plain.unturned or plain)
        turned = before.theta + turned_by(acting, before)
        return (
            self._change.state(plain) if np.array_equal(turned, plain.theta) else super()._moved_state(stream, acting)
        )
