"""Mimics: faults outside the vocabulary whose signal resembles that of a known effect by about half of its power."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.cases.departures.departure import Varied
from rotary_error_monitor.cases.departures.halves import MACHINE_HALVES, STAGE_HALVES, PoseOnlyOneWay
from rotary_error_monitor.cases.draws import AT_A_HEAD, LOCATIONS, ORDERED_PLACES, ORDERS
from rotary_error_monitor.cases.faults import VOCABULARY, Named, UnsuitableSeedError, make_fault
from rotary_error_monitor.cases.faults.axes import AxisFault
from rotary_error_monitor.cases.response import FaultResponse

CORRELATIONS = (0.6, 0.8)
"""Range of the correlation of a mimic with the known effect that resembles it most: 0.71 is half of the power."""

ALIKE = 0.002
"""Difference of two correlations that tells nothing: effects that do the same to a recording differ by less."""

UNIT = 1e-6
"""Parameters of signatures before they are scaled, in m, rad or their own unit: a usual size of most of them, so that
few need scaling."""

VISIBLE = (1.0, 1e4)
"""Range of sizes of signatures, standard deviations, that is let be: large enough for rounding, small enough to be in
proportion."""

NO_HALF: Mapping[str, str] = {
    "head_missed_counts": "half of a step is a later step",
    "radial_hysteresis": "one side only is half as much about another zero",
    "reversal_backlash": "one side only is half as much about another zero",
}
"""Effects of which a half is the effect again, and why."""

NOT_ONE_WAY = ("axis_backlash", "setup_offset")
"""Effects that in one direction only are half of a backlash and half of an offset together."""

SHAPES: Mapping[str, tuple[dict[str, float], ...]] = {
    "bearing_asynchronous": ({"phase": 0.0, "order": 2.5},),
    "head_missed_counts": tuple({"time": time} for time in np.linspace(4.0, 36.0, 9).tolist()),
    "cyclic_error": tuple({"period": period} for period in (0.01, 0.016, 0.02, 0.04)),
}
"""Shapes at which the signatures of effects that have one other than a whole order are taken."""

CANDIDATES = 6
"""How many effects are drawn of which a half may be taken: some have no half in some recordings."""

_TRIALS = 60
"""How often a half is drawn before there is none: most of those drawn resemble by half (64 of 73), so 60 in vain mean
that none of these effects has one here."""


@dataclass(frozen=True)
class Mimic(Varied):
    """Half of a known effect, which is none."""

    @property
    def name(self) -> str:
        """What it is, in words."""
        return f"{self.textbook.name} {self.departure.words}"

    def scaled(self, factor: float) -> Mimic:
        """The same, `factor` times as large."""
        return replace(self, textbook=self.textbook.scaled(factor))


@dataclass(frozen=True)
class Resemblance:
    """The known effect that resembles a fault most.

    Attributes:
        effect, location: which.
        correlation: of the fault's signal with the nearest that the effect makes, over the noise.
    """

    effect: str
    location: str
    correlation: float


class Signatures:
    """Signals of all known effects of a family at all their places, over the noise."""

    def __init__(self, response: FaultResponse, machine: bool) -> None:
        """Take the signatures."""
        self._response = response
        self._bases: dict[tuple[str, str, int], Array] = {}
        for name, kind in VOCABULARY.items():
            if issubclass(kind, AxisFault) == machine:
                self._bases |= self._of(name, None)

    def nearest(self, moved: Array, like: Named) -> Resemblance:
        """The effect that resembles the signal (m,) most; the order of `like` counts beside the usual ones."""
        found = self._correlations(moved, like)
        best = max(found, key=lambda key: found[key])
        return Resemblance(best[0], best[1], found[best])

    def nearest_is_own(self, moved: Array, own: Named) -> bool:
        """Whether no other known effect resembles the signal (m,) more than `own` does; those that are alike may."""
        found = self._correlations(moved, own)
        mine = max(value for key, value in found.items() if key[:2] == (own.name, own.location))
        return mine >= max(found.values()) - ALIKE

    def _correlations(self, moved: Array, like: Named) -> dict[tuple[str, str, int], float]:
        bases = self._bases | {(*key[:2], -1 - key[2]): basis for key, basis in self._of(like.name, like).items()}
        size = float(np.linalg.norm(moved))
        return {key: float(np.linalg.norm(basis.T @ moved)) / size for key, basis in bases.items()}

    def _of(self, name: str, like: Named | None) -> dict[tuple[str, str, int], Array]:
        """Orthonormal columns (m, k) for each place of an effect and each shape there."""
        bases = {}
        for number, (location, faults) in enumerate(_places(name, like)):
            table = np.stack([_seen(fault, self._response) for fault in faults], axis=1)
            norms = np.linalg.norm(table, axis=0)
            if norms.any():
                basis, sizes, _ = np.linalg.svd(table[:, norms > 0] / norms[norms > 0], full_matrices=False)
                bases[name, location, number] = basis[:, sizes > 1e-6 * sizes[0]]
        return bases


def _seen(fault: Named, response: FaultResponse) -> Array:
    """(m,) signal of the fault, of a size at which it is neither rounded nor out of proportion."""
    moved = response.moved((fault,))
    for _ in range(6):
        size = float(np.linalg.norm(moved))
        if VISIBLE[0] <= size <= VISIBLE[1]:
            break
        fault = fault.scaled(1e3 if size == 0 else 0.1 if not np.isfinite(size) else 100 / size)
        moved = response.moved((fault,))
    return moved


def draw_mimic(
    names: tuple[str, ...], draw: np.random.Generator, make: Callable[[str], Named], response: FaultResponse
) -> tuple[Mimic, Resemblance]:
    """Half of a drawn effect that resembles the nearest known one by a correlation within `CORRELATIONS`.

    Args:
        names: of the effects of which a half may be taken.
        draw: where chance comes from.
        make: draws a fault of a name, of any size.
        response: of the recording.

    Raises:
        UnsuitableSeedError: none resembles one by half in this recording.
    """
    possible = [name for name in names if name not in NO_HALF]
    machine = any(issubclass(VOCABULARY[name], AxisFault) for name in names)
    signatures = Signatures(response, machine)
    for _ in range(_TRIALS if possible else 0):
        fault = make(str(draw.choice(possible)))
        halves = MACHINE_HALVES if machine else STAGE_HALVES
        half = halves[int(draw.integers(len(halves)))]
        if half is PoseOnlyOneWay and fault.name in NOT_ONE_WAY:
            continue
        mimic = Mimic(fault, half.drawn(draw))
        moved = response.moved((mimic,))
        if not np.isfinite(moved).all() or not moved.any():
            continue
        found = signatures.nearest(moved, fault)
        if CORRELATIONS[0] <= found.correlation <= CORRELATIONS[1]:
            return mimic, found
    raise UnsuitableSeedError(f"no half of {', '.join(names)} resembles a known effect by half in this recording")


def _places(name: str, like: Named | None) -> Iterator[tuple[str, list[Named]]]:
    """Each place of an effect, with a fault of unit size for each of its parameters there."""
    locations: tuple[str, ...] = tuple(LOCATIONS.get(name, ("",)))
    if name in AT_A_HEAD:
        locations = tuple(f"head_{letter}" for letter in "abcd")
    own = like.parameters if like is not None and like.name == name else {}
    if name in ORDERS:
        low, high = ORDERS[name]
        orders = range(low, high + 1) if high - low < 20 else sorted({int(own.get("order", low)), low, high})
        for order in orders:
            for location in (f"order_{order}",) if name in ORDERED_PLACES else locations:
                yield location, _units(name, location, {"order": order})
        return
    known: dict[str, Any] = {key: own[key] for key in ("order", "phase", "period", "time") if key in own}
    for location in locations:
        for usual in SHAPES.get(name, ({},)):
            shape: dict[str, Any] = {**usual, **known}
            faults = _units(name, location, shape)
            if name == "bearing_asynchronous":  # sine and cosine together make any phase
                faults += _units(name, location, {**shape, "phase": shape["phase"] + np.pi / 2})
            yield location, faults


def _units(name: str, location: str, shape: Mapping[str, Any]) -> list[Named]:
    """A fault of unit size for each parameter, and each component of a vector."""
    kind = VOCABULARY[name]
    sizes = {row.name: {"Pair": 2, "Vector": 3}.get(str(row.type), 1) for row in fields(kind)}
    free = [key for key in sizes if key != "location" and key not in shape]
    nothing: dict[str, Any] = {key: [0.0] * sizes[key] if sizes[key] > 1 else 0.0 for key in free}
    faults = []
    for key in free:
        for index in range(sizes[key]):
            value = [UNIT if i == index else 0.0 for i in range(sizes[key])]
            faults.append(make_fault(name, location, **shape, **{**nothing, key: value if sizes[key] > 1 else UNIT}))
    return faults
