"""The faults of a case: drawn, made as large as told, varied where the case says so."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from rotary_error_monitor.cases.departures import AnyFault, Varied, fit_textbook, vary_fault
from rotary_error_monitor.cases.faults import Named, UnsuitableSeedError
from rotary_error_monitor.cases.faults.axes import AxisFault
from rotary_error_monitor.cases.mimics import Mimic, Resemblance, Signatures, draw_mimic
from rotary_error_monitor.cases.response import FaultResponse
from rotary_error_monitor.errors import InputError

Kind = Literal["null", "single", "pair", "unknown", "variant", "mimic"]
LOUDEST: Mapping[str, float] = {
    "encoder_latency": 1.5e6,
    "following_error": 1.5e6,
    "head_latency": 1e5,
    "head_missed_counts": 1e5,
    "disc_eccentricity": 1e5,
    "reversal_backlash": 1e5,
    "lvdt_artefact": 1e5,
    "graduation_error": 3e4,
    "drive_cyclic_error": 3e4,
    "tool_length": 3e4,
    "axis_scale": 3e4,
    "pivot_offset": 3e4,
    "axis_backlash": 1e4,
    "setup_offset": 5e3,
}
"""Effects that may be far louder than another, and their largest size (see `Truth.snr`): what a real stage or machine
has at most, within the range of the instruments, and where terms of second order stay below their resolution."""

SomeFault = TypeVar("SomeFault", Named, Mimic)
AMOUNT: Mapping[Kind, int] = {"null": 0, "single": 1, "pair": 2, "unknown": 1, "variant": 1, "mimic": 1}
"""How many faults a case of each kind has."""

MIMICKED, COARSE, FINE = 41, 17, 7
"""Every so many samples of a stage are looked at: for what resembles what, for departures, and for sizes."""


@dataclass(frozen=True)
class KnownDeparture:
    """How the fault of a case departs from its textbook form.

    Attributes:
        mechanism: in words.
        share: root mean square of what the best textbook form leaves, over that of the fault's signal.
        off_textbook_snr: by channel, root of the summed squares of what it leaves, over the noise.
        fitted: parameters of the best textbook form.
    """

    mechanism: str
    share: float
    off_textbook_snr: Mapping[str, float]
    fitted: Mapping[str, Any]


@dataclass(frozen=True)
class DrawnFaults:
    """Faults of a case, and what is known of the special ones.

    Attributes:
        faults: as large as the case asks.
        departure: how the fault of a variant departs; None for others.
        resemblance: which known effect a mimic resembles; None for others.
    """

    faults: tuple[AnyFault, ...]
    departure: KnownDeparture | None = None
    resemblance: Resemblance | None = None


@dataclass(frozen=True)
class Casting:
    """What a case asks of its faults.

    Attributes:
        kind: how many faults, and of what sort.
        snr: range of the root of the summed squares of what a fault moves, over the noise.
        loudness: range of how many times larger the first of a pair is than the second; None makes both alike.
    """

    kind: Kind
    snr: tuple[float, float]
    loudness: tuple[float, float] | None = None

    def draw_faults(
        self,
        names: tuple[str, ...],
        draw: np.random.Generator,
        make: Callable[[str], Named],
        response: Callable[[int], FaultResponse],
    ) -> DrawnFaults:
        """Faults of these names as large as the case asks.

        Args:
            names: of the faults.
            draw: where chance comes from.
            make: draws a fault of a name, of any size.
            response: response of the recording that looks at every so many samples only.
        """
        fine = response(FINE)
        if self.kind == "mimic":
            mimic, resemblance = draw_mimic(names, draw, make, response(MIMICKED))
            return DrawnFaults((sized(mimic, draw, self.snr, fine),), resemblance=resemblance)
        faults = tuple(fine.made_real(sized(make(name), draw, self.snr, fine)) for name in names)
        if self.loudness is not None:
            quiet = fine.size(faults[1:])
            low, high = (min(times * quiet, LOUDEST[names[0]]) for times in self.loudness)
            faults = (fine.made_real(sized(faults[0], draw, (low, high), fine)), *faults[1:])
        if self.kind != "variant":
            return DrawnFaults(faults)
        varied = _varied(faults[0], draw, response)
        # What is told of a departure counts every sample: a jump may fall between those that are looked at.
        fit = fit_textbook(varied, response(1).channels)
        departure = KnownDeparture(varied.departure.words, fit.share, fit.off, fit.parameters)
        return DrawnFaults((varied,), departure)


def _varied(fault: Named, draw: np.random.Generator, response: Callable[[int], FaultResponse]) -> Varied:
    """The fault with a drawn departure after which it still resembles no other known effect more than its own.

    Raises:
        UnsuitableSeedError: each of many departures makes it another effect.
    """
    scattered = response(MIMICKED)
    signatures = Signatures(scattered, isinstance(fault, AxisFault))
    for _ in range(_MOST_DEPARTURES):
        varied, _ = vary_fault(fault, draw, response(COARSE).channels)
        if signatures.nearest_is_own(scattered.moved((varied,)), fault):
            return varied
    raise UnsuitableSeedError(f"{fault} becomes another effect by each departure in this recording; take another seed")


_SMALLER, _LARGER = 0.1, 1e3
_MOST_TRIALS, _MOST_GROWN, _MOST_DEPARTURES = 50, 4, 12


def sized(fault: SomeFault, draw: np.random.Generator, snr: tuple[float, float], response: FaultResponse) -> SomeFault:
    """The fault as large as a number drawn from `snr`.

    Raises:
        InputError: it does not show in this recording, or gives no finite reading however small.
    """
    target = float(np.exp(draw.uniform(*np.log(snr))))
    steps, grown = 2, 0  # not quite in proportion
    for _ in range(_MOST_TRIALS):
        moved = response.size((fault,))
        if not np.isfinite(moved):  # so large that a head looks past the ring
            fault = fault.scaled(_SMALLER)
            continue
        if moved == 0 and grown < _MOST_GROWN:  # it may have been drawn so small that rounding hides it
            fault, grown = fault.scaled(_LARGER), grown + 1
            continue
        if moved == 0:
            raise UnsuitableSeedError(f"{fault} does not show in this recording; make it longer or take another seed")
        fault = fault.scaled(target / moved)
        steps -= 1
        if steps == 0:
            return fault
    raise InputError(f"{fault} gives no finite reading however small; the stage or machine cannot be simulated")
