"""What the diagnosis needs to know of thermometers: how twin and recording are read, and what is predicted."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from bath_thermometer.effects import Array, Thermometer, ThermometerEffect
from rotary_error_monitor.description.sections import load
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.kind import Kind, TwinFile
from rotary_error_monitor.gap.problem import Rows
from rotary_error_monitor.gap.table import TableProblem, folded


class ThermometerProblem(TableProblem[None]):
    """Readings of a thermometer beside the temperature of the bath."""

    names = MappingProxyType({"reading": "/thermometer/reading.temperature"})
    unit = ("K", 1.0)

    def __init__(self, table: Array, twin: TwinFile[Thermometer, ThermometerEffect]) -> None:
        self.time, self.bath, reading = table.T
        spans = folded(np.linspace(0, len(table), 25), 6, "spans of time")
        noise = np.array([twin.description.noise])
        super().__init__(twin.description, spans, reading[None], noise, twin.effects, twin.known)
        self.zero = twin.description.zero

    def settle(self, causes: Sequence[Cause]) -> None:
        """Nothing is fitted whatever the causes."""

    def predict(self, state: None, causes: Sequence[Cause]) -> Array:
        """(1, n) what the thermometer shows, °C."""
        shown = self.bath
        for cause in (*self.known, *causes):
            assert isinstance(cause.effect, ThermometerEffect)
            shown = cause.effect.shown(cause.values, self.time, shown)
        return shown[None]

    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """One standard uncertainty of the zero."""
        return self.white(np.full((1, len(self.time), 1), self.zero))

    def quantities(self) -> Mapping[str, Array]:
        """Time and the bath's temperature."""
        return {"time, s": self.time, "bath, °C": self.bath}


class ThermometerKind(Kind[Thermometer, ThermometerEffect, ThermometerProblem]):
    """Thermometers."""

    effect = ThermometerEffect

    def describe(self, path: Path) -> Thermometer:
        """Section `thermometer`."""
        return load(path, "thermometer", Thermometer)

    def problem(
        self, recording: Path, twin: TwinFile[Thermometer, ThermometerEffect], most_rate: float
    ) -> ThermometerProblem:
        """Comma-separated text with a line of headings: time in s, temperature of bath and thermometer in °C."""
        try:
            table = np.loadtxt(recording, delimiter=",", skiprows=1, ndmin=2)
        except (OSError, ValueError) as error:
            raise InputError(f"{recording}: {error}") from error
        if table.shape[1] != 3 or len(table) < 100 or not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0).any():
            raise InputError(f"{recording}: expected 100 rows of three finite numbers or more, in rising time")
        return ThermometerProblem(table, twin)
