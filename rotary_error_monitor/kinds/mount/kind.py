"""Two-axis mounts as a kind of thing to be diagnosed: pointing files, held against the stars."""

from __future__ import annotations

from pathlib import Path

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.kind import Kind, TwinFile, check_amended, check_signal
from rotary_error_monitor.kinds.mount.description import MountDescription, load_mount
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.pointings import read_pointings
from rotary_error_monitor.kinds.mount.problem import MountProblem


class MountKind(Kind[MountDescription, MountEffect, MountProblem]):
    """Two-axis mounts."""

    effect = MountEffect

    def describe(self, path: Path) -> MountDescription:
        """Section `mount`."""
        return load_mount(path)

    def problem(self, recording: Path, twin: TwinFile[MountDescription, MountEffect], most_rate: float) -> MountProblem:
        """A pointing file."""
        return MountProblem(twin.description, read_pointings(recording), twin.effects, twin.known)

    def acted_on(self, problem: MountProblem, description: MountDescription) -> MachineDescription:
        """The mount as a machine of two axes."""
        return problem.twin.machine

    def attempt(self, problem: MountProblem, cause: Cause) -> None:
        """The effect gives a description, and no rotation or a small one at each pointing."""
        effect, twin = cause.effect, problem.twin
        assert isinstance(effect, MountEffect)
        check_amended(effect.amend(twin.machine, cause.values, cause.location))
        state = twin.state(twin.mount.geometry, (cause,))
        turn = effect.turn(cause.values, cause.location, state)
        if turn is not None:
            check_signal("turn", turn, state.tube.shape)
