"""Scores of the blind check: each diagnosis beside the truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotary_error_monitor.blind_check.cases import CasePlan
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.description.topics import samples_topic

Key = tuple[str, str]
Reals = NDArray[np.float64]

FINDABLE = 8.0
"""Size from which an effect is found in 99 % of all recordings at a false-alarm rate of 1 %: five and a half standard
deviations for the test that decides among all effects and places, and 2.3 for chance on the other side."""

STANDS_OUT = 30.0
"""Departure from the textbook form from which it must be told: standard deviations of noise in one channel, and of all
channels beyond what the twin's uncertainty and the rotor's jitter could do."""

MOST_NAMED = 2
"""Causes that may be named where one effect departs from its textbook form: it, and what describes the departure."""

LEAST_RANKED = 0.01
"""Probability from which a candidate of the ranking counts: hundreds of others are told to be nothing, and rightly."""


@dataclass(frozen=True)
class OpenedCase:
    """One case, opened.

    Attributes:
        effects: names that were at work.
        right: by the rules of the gap cases; for an effect left out of the library right is not to name another.
        alike: right, or what was at work stands in groups beside what is named instead.
        alarmed: a gap was seen.
        size: how far the smallest fault stands out of noise and of the twin's uncertainty, standard deviations.
        referred: whether the stage's own reference was there; None for a machine.
        told: the departure of a variant is told; None where it does not stand out, or there is none.
        departure: share of a variant's cause that its best textbook form leaves; None if it is none.
        elsewhere: part of the gap that the causes take away at speeds that they were not sized at; None if not asked.
        where_right: the first channel is among those moved most; None where nothing was moved or seen.
        probabilities: of each named cause, with whether it was one.
        ranked: probabilities of all candidates that are given one of `LEAST_RANKED` or more, with whether each was one.
        within: parameters within 3 of their standard deviations, of how many.
        within_departure: the same with the width of the departure in the standard deviation.
        seconds: that the diagnosis took.
        refusal: why the case was refused, which is wrong of any; empty where it was diagnosed.
    """

    plan: CasePlan
    effects: tuple[str, ...]
    verdict: str
    named: tuple[Key, ...]
    right: bool
    alike: bool
    alarmed: bool
    told: bool | None
    departure: float | None
    size: float
    referred: bool | None
    elsewhere: float | None
    where_right: bool | None
    shrink: float
    probabilities: tuple[tuple[float, bool], ...]
    ranked: tuple[tuple[float, bool], ...]
    within: tuple[int, int]
    within_departure: tuple[int, int]
    seconds: float
    refusal: str = ""


def score_case(plan: CasePlan, truth: Mapping[str, Any], diagnosis: Mapping[str, Any], seconds: float) -> OpenedCase:
    """Compare a diagnosis with the truth."""
    wanted = [(row["effect"], row.get("location") or "") for row in truth["effects"]]
    named = [(row["effect"], row.get("location") or "") for row in diagnosis["causes"]]
    snr = {name: float(value) for name, value in truth["snr"].items()}
    hits = [key in wanted or _grouped(diagnosis, key, wanted) for key in named]
    probabilities = [float(row["probability"]) for row in diagnosis["causes"]]
    outside = tuple(truth.get("outside", ()))
    right = _right(plan, diagnosis, sorted(wanted), sorted(named), hits)
    known = plan.kind in ("single", "pair") and not plan.left_out and len(named) == len(wanted)
    return OpenedCase(
        plan=plan,
        effects=outside or tuple(effect for effect, _ in wanted),
        verdict=str(diagnosis["verdict"]),
        named=tuple(named),
        right=right,
        alike=right or (known and diagnosis["verdict"] == "explained" and all(hits)),
        alarmed=diagnosis["verdict"] != "no_gap",
        told=_told(truth, diagnosis),
        departure=truth.get("departure", {}).get("share"),
        size=min((float(size) for size in truth["sizes"]), default=0.0),
        referred=None if plan.family == "machine" else any(f"/{OWN_REFERENCE}/" in channel for channel in snr),
        elsewhere=_elsewhere(diagnosis.get("elsewhere")),
        where_right=_where_right(snr, diagnosis),
        shrink=float(diagnosis["gap"]["shrink"]),
        # One of a group with the truth in it is not the truth: half of those told at 50 % must be wrong.
        probabilities=tuple(zip(probabilities, (key in wanted for key in named), strict=True)),
        ranked=tuple(_ranked(diagnosis, wanted)),
        within=_within(truth, diagnosis, 0.0),
        within_departure=_within(truth, diagnosis, float(truth.get("departure", {}).get("share", 0.0))),
        seconds=seconds,
        refusal=diagnosis.get("refusal", ""),
    )


def _told(truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> bool | None:
    """Whether a departure that stands out is told: as such, by another cause, or as what remains."""
    loudest = max(truth.get("off_textbook_snr", {}).values(), default=0.0)
    if min(loudest, truth.get("departure_size") or 0.0) < STANDS_OUT:
        return None
    causes = diagnosis["causes"]
    described = any(cause.get("departures") for cause in causes)
    return bool(diagnosis["verdict"] == "partly_explained" or len(causes) > 1 or described)


def _elsewhere(gap: Mapping[str, float] | None) -> float | None:
    if gap is None:
        return None
    above = gap["before"] - 1.0
    return (gap["before"] - gap["after"]) / above if above > 0 else 0.0


def _right(plan: CasePlan, diagnosis: Mapping[str, Any], wanted: list[Key], named: list[Key], hits: list[bool]) -> bool:
    verdict = diagnosis["verdict"]
    if plan.kind == "null":
        return bool(verdict == "no_gap")
    if plan.kind in ("unknown", "mimic") or plan.left_out:
        return bool(verdict == "unknown" or (verdict == "partly_explained" and diagnosis["gap"]["shrink"] < 0.5))
    if plan.kind == "variant":
        return verdict in ("explained", "partly_explained") and any(hits) and len(named) <= MOST_NAMED
    if plan.kind == "single":
        return verdict == "explained" and len(named) == 1 and hits[0]
    return bool(verdict == "explained" and named == wanted)


def _grouped(diagnosis: Mapping[str, Any], key: Key, wanted: Iterable[Key]) -> bool:
    for group in diagnosis["indistinguishable"]:
        members = {(row["effect"], row.get("location") or "") for row in group["effects"]}
        if key in members and members & set(wanted):
            return True
    return False


def _where_right(snr: Mapping[str, float], diagnosis: Mapping[str, Any]) -> bool | None:
    top = max(snr.values(), default=0.0)
    if top <= 0 or not diagnosis["where"]:
        return None
    first = diagnosis["where"][0]["channel"]
    moved = {name for name, value in snr.items() if value > 0.3 * top}
    heads = [value for name, value in snr.items() if "/head_" in name]
    if heads and min(heads) > 0.9 * max(heads) > 0.27 * top:
        moved.add(f"{samples_topic('command')}.angle")
    return any(first == name or first.startswith(f"{name}.") for name in moved)


def _ranked(diagnosis: Mapping[str, Any], wanted: Sequence[Key]) -> Iterable[tuple[float, bool]]:
    for row in diagnosis.get("ranking", ()):
        if row["probability"] >= LEAST_RANKED:
            yield float(row["probability"]), (row["effect"], row.get("location") or "") in wanted


def _within(truth: Mapping[str, Any], diagnosis: Mapping[str, Any], share: float) -> tuple[int, int]:
    """Parameters of true causes within 3 standard deviations of the truth, and how many there are.

    With a departure of the `share` its width, `share` times the size of the parameter as a vector, is added as
    variances are; then the truth is the parameter at the reference or that of the best textbook form, whichever is
    nearer: of an effect that changes with temperature both are meant.
    """
    inside = total = 0
    for row in diagnosis["causes"]:
        true = [
            t["parameters"]
            for t in truth["effects"]
            if t["effect"] == row["effect"] and (t.get("location") or "") == row["location"]
        ]
        if true and share:
            true.append(truth["fitted"])
        for name, estimate in row["parameters"].items():
            std = np.atleast_1d(estimate["std"])
            if not true or not np.all(std > 0):
                continue
            ratios = [_distance(name, estimate["value"], values[name], std, share) for values in true]
            inside += int(np.count_nonzero(np.min(ratios, axis=0) <= 3))
            total += len(std)
    return inside, total


def _distance(name: str, estimate: ArrayLike, true: ArrayLike, std: Reals, share: float) -> Reals:
    """Standard deviations between an estimate and the truth, each number of a vector."""
    off = np.abs(np.subtract(np.atleast_1d(estimate), np.atleast_1d(true)))
    if name == "phase":
        off = np.abs(np.angle(np.exp(1j * off)))
    width = share * float(np.linalg.norm(np.atleast_1d(true)))
    return np.asarray(off / np.hypot(std, width), np.float64)
