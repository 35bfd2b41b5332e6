"""The faults of a case: drawn, made as large as told, varied where the case says so."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.departures import AnyFault, fit_textbook, vary_fault
from rotary_error_monitor.plant.faults import Named
from rotary_error_monitor.plant.response import Response

Kind = Literal["null", "single", "pair", "unknown", "variant"]
AMOUNT: Mapping[Kind, int] = {"null": 0, "single": 1, "pair": 2, "unknown": 1, "variant": 1}
"""How many faults a case of each kind has."""

COARSE, FINE = 17, 7
"""Every so many samples of a stage are looked at while a departure is sought, and while sizes are measured."""


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
        response: Callable[[int], Response],
    ) -> tuple[tuple[AnyFault, ...], KnownDeparture | None]:
        """Faults of these names as large as the case asks, and how the varied one departs.

        Args:
            names: of the faults.
            draw: where chance comes from.
            make: draws a fault of a name, of any size.
            response: response of the recording that looks at every so many samples only.
        """
        fine = response(FINE)
        faults = tuple(sized(make(name), draw, self.snr, fine) for name in names)
        if self.loudness is not None:
            quiet = fine.size(faults[1:])
            low, high = self.loudness
            faults = (sized(faults[0], draw, (low * quiet, high * quiet), fine), *faults[1:])
        if self.kind != "variant":
            return faults, None
        varied, _ = vary_fault(faults[0], draw, response(COARSE).channels)
        fit = fit_textbook(varied, fine.channels)
        return (varied,), KnownDeparture(varied.departure.words, fit.share, fit.off, fit.parameters)


_SMALLER, _LARGER = 0.1, 1e3
_MOST_TRIALS, _MOST_GROWN = 50, 4


def sized(fault: Named, draw: np.random.Generator, snr: tuple[float, float], response: Response) -> Named:
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
            raise InputError(f"{fault} does not show in this recording; make it longer or take another seed")
        fault = fault.scaled(target / moved)
        steps -= 1
        if steps == 0:
            return fault
    raise InputError(f"{fault} gives no finite reading however small; the stage or machine cannot be simulated")
