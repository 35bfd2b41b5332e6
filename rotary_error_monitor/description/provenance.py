"""Where calibrated parts of a description are from, as its section `calibration` says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import NotNegative
from rotary_error_monitor.description.sections import Section

MOST_HISTORY = 10
"""Earlier calibrations that a section keeps: ten years of a yearly calibration, and a file that still can be read."""


@dataclass(frozen=True)
class Earlier(Section):
    """What an earlier calibration left, beside what it says as `Calibrated`."""

    is_open = True
    values: Annotated[
        Mapping[str, Any] | None, Expected("values by their places in the section; null where there was none")
    ] = None
    comment: Annotated[str | None, Expected("the comment beside them")] = None


@dataclass(frozen=True)
class Calibrated:
    """Where a part is from; of a folder, `sha256` is that of its files in the order of their names."""

    date: Annotated[str, Expected("a day such as 2026-11-21, in quotes", pattern=r"^\d{4}-\d{2}-\d{2}$")]
    source: Annotated[str, Expected("name of the recording or file of measurements")]
    sha256: Annotated[str, Expected("SHA-256 of the recording or file of measurements", pattern="^[0-9a-f]{64}$")]
    uncertainty: Annotated[NotNegative | None, Expected("standard uncertainty in m or rad, from 0 to 1000")] = None
    figures: Annotated[Mapping[str, float], Expected("figures by name in SI units")] = field(default_factory=dict)
    remark: Annotated[str | None, Expected("what does not fit, where it was written all the same (--force)")] = None
    history: Annotated[
        tuple[Earlier, ...],
        Expected(
            "what was there before, the newest first: {date, source, sha256, uncertainty, figures, values, comment}",
            count=(0, MOST_HISTORY),
        ),
    ] = ()
