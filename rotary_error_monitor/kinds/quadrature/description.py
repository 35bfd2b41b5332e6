"""A pair of sine and cosine signals as it is described: what goes round once, and how large the circle is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Name
from rotary_error_monitor.description.sections import load

Counts = Annotated[float, Expected("counts of a converter, at most 1.0e+15", 1e-9, 1e15)]


@dataclass(frozen=True)
class QuadratureDescription:
    """The twin of a pair of signals: section `quadrature` of `config/quadrature.yaml`."""

    name: Name
    period: Annotated[
        float, Expected("what is measured while the signals go round once, in m or rad, at most 1000", 1e-12, 1000)
    ]
    amplitude: Annotated[Counts, Expected("radius of the circle in counts")]
    uncertainty: Annotated[Counts, Expected("standard uncertainty of the amplitude in counts")]
    noise: Annotated[
        Counts, Expected("least standard deviation of one signal in counts; rounding to whole counts gives 0.29")
    ]


def load_quadrature(path: Path) -> QuadratureDescription:
    """Signals described in a YAML file.

    Raises:
        InputError: the file is missing or wrong; the message names file, line, value and what is expected.
    """
    return load(path, "quadrature", QuadratureDescription)
