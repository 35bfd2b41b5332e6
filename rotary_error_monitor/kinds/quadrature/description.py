"""A pair of sine and cosine signals as it is described: what goes round once, and how large the circle is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rotary_error_monitor.description import schema


@dataclass(frozen=True)
class QuadratureDescription:
    """The twin of a pair of signals: section `quadrature` of `config/quadrature.yaml`.

    Attributes:
        period: what is measured while the signals go round once, m or rad.
        amplitude: radius of the circle, counts.
        uncertainty: standard uncertainty of the amplitude, counts.
        noise: least standard deviation of one signal, counts.
    """

    name: str
    period: float
    amplitude: float
    uncertainty: float
    noise: float


def load_quadrature(path: Path) -> QuadratureDescription:
    """Signals described in a YAML file.

    Raises:
        InputError: the file is missing or wrong; the message names file, line, value and what is expected.
    """
    section = schema.load(path, "quadrature")["quadrature"]
    numbers = {name: float(section[name]) for name in ("period", "amplitude", "uncertainty", "noise")}
    return QuadratureDescription(name=section["name"], **numbers)
