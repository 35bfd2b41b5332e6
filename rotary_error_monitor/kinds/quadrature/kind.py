"""Sine and cosine signals as a kind of thing to be diagnosed: files of samples, held against a circle."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.kind import Kind, TwinFile, check_signal
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription, load_quadrature
from rotary_error_monitor.kinds.quadrature.effects import CircleState, QuadratureEffect
from rotary_error_monitor.kinds.quadrature.problem import QuadratureProblem
from rotary_error_monitor.kinds.quadrature.signals import read_quadrature


class QuadratureKind(Kind[QuadratureDescription, QuadratureEffect, QuadratureProblem]):
    """Pairs of sine and cosine signals."""

    effect = QuadratureEffect

    def describe(self, path: Path) -> QuadratureDescription:
        """Section `quadrature`."""
        return load_quadrature(path)

    def problem(
        self, recording: Path, twin: TwinFile[QuadratureDescription, QuadratureEffect], most_rate: float
    ) -> QuadratureProblem:
        """A file of samples."""
        return QuadratureProblem(twin.description, read_quadrature(recording), twin.effects, twin.known)

    def attempt(self, problem: QuadratureProblem, cause: Cause) -> None:
        """The effect displaces each point of an ideal circle."""
        assert isinstance(cause.effect, QuadratureEffect)
        turning, amplitude = np.exp(1j * problem.phase), problem.settled(())
        state = CircleState(turning, amplitude, amplitude * turning)
        moved = cause.effect.displacement(cause.values, cause.location, state)
        check_signal("displacement", moved, problem.phase.shape, is_complex=True)
