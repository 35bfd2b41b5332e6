"""What a recording between centres cannot tell of ring and mirror, and what contradicts it from outside.

A shaft that goes round with its rotation, because a centre runs out or a centre hole is not round, looks like an
eccentric ring and a tilted mirror: no reading tells them apart. How far it may do so is stated (`Centres`) and counts
into the uncertainty; what was there before, with its uncertainty, is held against what was found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.mirror_assembly import MirrorAssembly
from rotary_error_monitor.metrology.ring_assembly import RingAssembly
from rotary_error_monitor.units import ARCSEC

CHANGED = 0.01
"""Probability that an unchanged stage is said to have changed, by any of what is compared: a look costs little."""

SIGNIFICANT = 3.0
"""Standard deviations by which order 1 against the rotation exceeds that with it, if it does."""


@dataclass(frozen=True)
class Centres:
    """How well centres hold a shaft: its own motion of order 1 with the rotation, which nothing in a recording shows.

    The defaults are those of live centres with a run-out of 5 µm (total, as data sheets give it), a usual grade: an
    amplitude of up to 2.5 µm of unknown phase has a standard deviation of 1 µm in each direction, and two such centres
    0.3 m apart make a shaft lean by 1 arcsec.

    Attributes:
        radial: standard uncertainty of the shaft's displacement in each direction, m.
        lean: of its lean in each direction, rad.
    """

    radial: float = 1e-6
    lean: float = 1 / ARCSEC


@dataclass(frozen=True)
class Doubts:
    """Ring and mirror with what the recording cannot tell in their uncertainties.

    Attributes:
        misfits: what contradicts them, in words.
        remarks: what changed within what the centres explain, in words.
    """

    ring: RingAssembly
    mirror: MirrorAssembly | None
    misfits: tuple[str, ...]
    remarks: tuple[str, ...]


def doubt_assembly(
    stage: StageDescription, ring: RingAssembly, mirror: MirrorAssembly | None, centres: Centres
) -> Doubts:
    """Ring and mirror against what the description had, with uncertainties that hold what they may miss."""
    turned = "" if mirror is None else _against_rotation(stage, mirror, centres)
    # where the readings of the autocollimator are doubted as a whole, their change is no matter of the centres
    sure = _Found.of(ring, None if turned else mirror)
    ring = replace(ring, eccentricity_std=_wider_pair(ring.eccentricity_std, centres.radial))
    if mirror is not None:
        mirror = _centred(mirror, centres, _amplitude_against(mirror) if turned else 0.0)
    changes = _changes(stage, _Found.of(ring, mirror))
    limit = CHANGED / max(1, len(changes))
    told = {change.name: change.largest for change in changes if change.probability < limit}
    misfits = [turned] if turned else []
    zeros, moved = _head_zeros(ring, mirror)
    for name, size in moved.items():
        told[name] = max(told.get(name, 0.0), size)
    misfits += [zeros] if zeros else []
    misfits += [f"{change.sentence}: {_ADVICE[change.name]}" for change in changes if change.probability < limit]
    remarks = tuple(
        f"{change.sentence}; the shaft's motion between centres may be all of it"
        for change in _changes(stage, sure)
        if change.probability < limit and change.name not in told
    )
    ring = replace(
        ring,
        eccentricity_std=_wider_pair(ring.eccentricity_std, told.get("encoder.eccentricity", 0.0)),
        graduation_std=tuple(_wider_pair(pair, told.get("encoder.graduation", 0.0)) for pair in ring.graduation_std),
    )
    if mirror is not None:
        mirror = _doubted(mirror, told.get("mirror.tilt", 0.0), told.get("mirror.flatness", 0.0))
    return Doubts(ring, mirror, tuple(misfits), remarks)


def _head_zeros(ring: RingAssembly, mirror: MirrorAssembly | None) -> tuple[str, dict[str, float]]:
    """Heads whose zeros are so far apart that it is open where ring and mirror lie, in words, and by how much.

    The angle of the ring is the mean of the heads: one that is turned turns all phases, and none shows which it is.
    """
    offsets = np.array(ring.head_offsets)
    apart = np.abs(np.angle(np.exp(1j * (offsets - np.median(offsets)))))
    chord = 2 * float(np.sin(min(apart.max(initial=0.0), np.pi) / 2))
    moved = {"encoder.eccentricity": chord * float(np.hypot(*ring.eccentricity))}
    known = {"encoder.eccentricity": max(ring.eccentricity_std)}
    if mirror is not None:
        moved["mirror.tilt"], known["mirror.tilt"] = chord * float(np.hypot(*mirror.tilt)), max(mirror.tilt_std)
    if all(size <= SIGNIFICANT * known[name] for name, size in moved.items()):
        return "", {}
    moved["encoder.graduation"] = max(
        (min(2.0, row.order * chord) * float(np.hypot(row.cos, row.sin)) for row in ring.graduation), default=0.0
    )
    where = ", ".join(f"{number}: {offset:+.3f}" for number, offset in enumerate(offsets, start=1))
    open_by = moved["encoder.eccentricity"] * 1e6
    return (
        f"heads: their zeros are up to {apart.max():.3f} rad apart ({where} rad from the mean, in the order of the "
        f"file), so that it is open by {open_by:.1f} µm where the ring lies: state the zero of each head, or set it",
        moved,
    )


def _centred(mirror: MirrorAssembly, centres: Centres, turned: float) -> MirrorAssembly:
    """The mirror with what the centres, and an order 1 against the rotation, leave unsure, rad."""
    # a shaft that leans against its rotation looks like flatness of order 1
    leaning = tuple(
        float(np.hypot(std, centres.lean)) if row.order == 1 else std
        for row, std in zip(mirror.flatness, mirror.flatness_std, strict=True)
    )
    return _doubted(replace(mirror, flatness_std=leaning), float(np.hypot(centres.lean, turned)), turned)


def _doubted(mirror: MirrorAssembly, tilt: float, flatness: float) -> MirrorAssembly:
    stds = tuple(float(np.hypot(std, flatness)) for std in mirror.flatness_std)
    return replace(mirror, tilt_std=_wider_pair(mirror.tilt_std, tilt), flatness_std=stds)


def _wider_pair(stds: tuple[float, float], more: float) -> tuple[float, float]:
    return float(np.hypot(stds[0], more)), float(np.hypot(stds[1], more))


def _amplitude_against(mirror: MirrorAssembly) -> float:
    """Amplitude of order 1 against the rotation, rad."""
    return max((float(np.hypot(*row.x)) for row in mirror.flatness if row.order == 1), default=0.0)


def _against_rotation(stage: StageDescription, mirror: MirrorAssembly, centres: Centres) -> str:
    """Order 1 that goes mainly against the rotation, in words; a tilted mirror goes with it."""
    against, tilt = _amplitude_against(mirror), float(np.hypot(*mirror.tilt))
    spread = max(mirror.flatness_std, default=0.0)
    if against <= max(tilt, centres.lean) or against - tilt <= SIGNIFICANT * spread:
        return ""
    before = float(np.hypot(*stage.mirror.tilt)) * ARCSEC
    return (
        f"autocollimator: its order 1 goes against the rotation, by {against * ARCSEC:.3f} arcsec, and with it by "
        f"{tilt * ARCSEC:.3f} only; a tilted mirror goes with it (the file has a tilt of {before:.3f} arcsec): are its "
        "two axes exchanged, or is one of them of the wrong sign?"
    )


Rows = Mapping[int, Array]


@dataclass(frozen=True)
class _Found:
    """Vectors and rows by their names in the description, each with its standard uncertainties."""

    vectors: Mapping[str, tuple[Array, Array]]
    rows: Mapping[str, tuple[Rows, float, frozenset[int]]]

    @classmethod
    def of(cls, ring: RingAssembly, mirror: MirrorAssembly | None) -> _Found:
        vectors = {"encoder.eccentricity": (np.array(ring.eccentricity), np.array(ring.eccentricity_std))}
        graduation = {row.order: np.array([row.cos, row.sin]) for row in ring.graduation}
        std = max((max(pair) for pair in ring.graduation_std), default=0.0)
        rows = {"encoder.graduation": (graduation, std, frozenset(row.order for row in ring.kept))}
        if mirror is not None:
            vectors["mirror.tilt"] = np.array(mirror.tilt), np.array(mirror.tilt_std)
            flatness = {row.order: np.array([*row.x, *row.y]) for row in mirror.flatness}
            kept = frozenset(row.order for row in mirror.kept)
            rows["mirror.flatness"] = flatness, max(mirror.flatness_std, default=0.0), kept
        return cls(vectors, rows)


@dataclass(frozen=True)
class _Change:
    """Of what is called `name`: a sentence with both values, the probability by chance, the largest difference."""

    name: str
    sentence: str
    probability: float
    largest: float


_ADVICE = {
    "encoder.eccentricity": "was the ring mounted anew, or does the shaft move between its centres?",
    "encoder.graduation": "is it another ring, or another order of heads?",
    "mirror.tilt": "was the mirror or the autocollimator mounted anew, or does the shaft lean between its centres?",
    "mirror.flatness": "is it another mirror, or was the autocollimator turned?",
}


def _changes(stage: StageDescription, found: _Found) -> list[_Change]:
    """What the description has with an uncertainty, against what was found."""
    old_vectors = {"encoder.eccentricity": stage.ring.eccentricity, "mirror.tilt": stage.mirror.tilt}
    graduation = {row.order: np.array([row.cos, row.sin]) for row in stage.ring.graduation}
    flatness = {row.order: np.array([*row.x, *row.y]) for row in stage.mirror.flatness}
    changes = []
    for name, (values, stds) in found.vectors.items():
        known = stage.uncertainty.get(name)
        if known is not None:
            before, spread = np.array(old_vectors[name]), np.hypot(stds, known)
            changes.append(_changed(name, [(0, before, values)], [(known, stds)], spread))
    for name, (rows, std, kept) in found.rows.items():
        known = stage.uncertainty.get(name)
        if known is None or std == 0.0:
            continue
        old = {"encoder.graduation": graduation, "mirror.flatness": flatness}[name]
        orders = sorted((rows.keys() | old.keys()) - kept)
        zero = np.zeros(2 if name == "encoder.graduation" else 4)
        pairs = [(order, old.get(order, zero), rows.get(order, zero)) for order in orders]
        if pairs:
            width = len(zero)
            both = [(known, np.full(width, std))] * len(pairs)
            changes.append(_changed(name, pairs, both, np.full(width * len(pairs), np.hypot(std, known))))
    return changes


def _changed(
    name: str, pairs: Sequence[tuple[int, Array, Array]], stds: Sequence[tuple[float, Array]], spread: Array
) -> _Change:
    difference = np.concatenate([new - old for _, old, new in pairs])
    square = float(np.sum((difference / np.maximum(spread, np.finfo(np.float64).tiny)) ** 2))
    worst = int(np.argmax([np.abs(new - old).max() for _, old, new in pairs]))
    order, old, new = pairs[worst]
    scale, unit = (1e6, "µm") if name == "encoder.eccentricity" else (ARCSEC, "arcsec")
    what = name + (f", order {order}," if order else "")

    def shown(values: Array, std: float) -> str:
        return f"({', '.join(f'{value * scale:.4f}' for value in values)}) ± {std * scale:.4f} {unit}"

    sentence = f"{what} was {shown(old, stds[worst][0])} and now is {shown(new, float(stds[worst][1].max()))}"
    return _Change(name, sentence, chi_square_tail(square, len(difference)), float(np.abs(difference).max()))
