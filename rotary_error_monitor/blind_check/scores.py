"""Scores of the blind check: by kind, by effect, by size, and whether probabilities mean what they say."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotary_error_monitor.blind_check.cases import CasePlan
from rotary_error_monitor.blind_check.reliability import SURE, Told, bins_of, calibration_error

Key = tuple[str, str]
Reals = NDArray[np.float64]

SIZES = (0.0, 3.0, 6.0, 8.0, 10.0, 20.0, 40.0, 80.0, 160.0, 1e9)

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
class Outcome:
    """One case, opened.

    Attributes:
        effects: names that were at work.
        right: by the rules of the gap cases; for an effect left out of the library right is not to name another.
        alike: right, or what was at work stands in groups beside what is named instead.
        alarmed: a gap was seen.
        size: how far the smallest fault stands out of noise and of the twin's uncertainty, standard deviations.
        lvdt: whether the LVDT was there; None for a machine.
        told: the departure of a variant is told; None where it does not stand out, or there is none.
        elsewhere: part of the gap that the causes take away at speeds that they were not sized at; None if not asked.
        where_right: the first channel is among those moved most; None where nothing was moved or seen.
        probabilities: of each named cause, with whether it was one.
        ranked: probabilities of all candidates that are given one of `LEAST_RANKED` or more, with whether each was one.
        within: parameters within 3 of their standard deviations, of how many.
        within_departure: the same with the width of the departure in the standard deviation.
    """

    plan: CasePlan
    effects: tuple[str, ...]
    verdict: str
    named: tuple[Key, ...]
    right: bool
    alike: bool
    alarmed: bool
    told: bool | None
    size: float
    lvdt: bool | None
    elsewhere: float | None
    where_right: bool | None
    shrink: float
    probabilities: tuple[tuple[float, bool], ...]
    ranked: tuple[tuple[float, bool], ...]
    within: tuple[int, int]
    within_departure: tuple[int, int]
    seconds: float


def score_case(plan: CasePlan, truth: Mapping[str, Any], diagnosis: Mapping[str, Any], seconds: float) -> Outcome:
    """Compare a diagnosis with the truth."""
    wanted = [(row["effect"], row.get("location") or "") for row in truth["effects"]]
    named = [(row["effect"], row.get("location") or "") for row in diagnosis["causes"]]
    snr = {name: float(value) for name, value in truth["snr"].items()}
    hits = [key in wanted or _grouped(diagnosis, key, wanted) for key in named]
    probabilities = [float(row["probability"]) for row in diagnosis["causes"]]
    outside = tuple(truth.get("outside", ()))
    right = _right(plan, diagnosis, sorted(wanted), sorted(named), hits)
    known = plan.kind in ("single", "pair") and not plan.left_out and len(named) == len(wanted)
    return Outcome(
        plan=plan,
        effects=outside or tuple(effect for effect, _ in wanted),
        verdict=str(diagnosis["verdict"]),
        named=tuple(named),
        right=right,
        alike=right or (known and diagnosis["verdict"] == "explained" and all(hits)),
        alarmed=diagnosis["verdict"] != "no_gap",
        told=_told(truth, diagnosis),
        size=min((float(size) for size in truth["sizes"]), default=0.0),
        lvdt=None if plan.family == "machine" else any("/lvdt/" in channel for channel in snr),
        elsewhere=_elsewhere(diagnosis.get("elsewhere")),
        where_right=_where_right(snr, diagnosis),
        shrink=float(diagnosis["gap"]["shrink"]),
        # One of a group with the truth in it is not the truth: half of those told at 50 % must be wrong.
        probabilities=tuple(zip(probabilities, (key in wanted for key in named), strict=True)),
        ranked=tuple(_ranked(plan, diagnosis, wanted)),
        within=_within(truth, diagnosis, 0.0),
        within_departure=_within(truth, diagnosis, float(truth.get("departure", {}).get("share", 0.0))),
        seconds=seconds,
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
        moved.add("/stage/command/samples.angle")
    return any(first == name or first.startswith(f"{name}.") for name in moved)


def _ranked(plan: CasePlan, diagnosis: Mapping[str, Any], wanted: Sequence[Key]) -> Iterable[tuple[float, bool]]:
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


def format_scores(outcomes: Sequence[Outcome]) -> str:
    """Tables of a run: by group, by effect, detection against size, calibration, parameters."""
    parts = []
    for rough in sorted({outcome.plan.rough for outcome in outcomes}):
        for family in sorted({outcome.plan.family for outcome in outcomes}):
            own = [o for o in outcomes if o.plan.rough == rough and o.plan.family == family]
            if own:
                parts.append(f"== {family}, {'as on a shop floor' if rough else 'clean'}")
                parts += [_by_group(own), _by_effect(own), _by_size(own)]
                parts += [_by_lvdt(own), _elsewhere_table(own)] if family == "stage" else []
    parts.append(_mimics(outcomes))
    parts.append(format_calibration("named causes", [pair for o in outcomes for pair in o.probabilities]))
    parts.append(format_calibration("ranked candidates, 1 % and more", [pair for o in outcomes for pair in o.ranked]))
    parts.append(_parameters(outcomes))
    return "\n\n".join(part for part in parts if part)


def _findable(outcome: Outcome) -> bool:
    return outcome.plan.kind == "null" or outcome.size >= FINDABLE


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)


def _grouped_by(outcomes: Sequence[Outcome], key: Callable[[Outcome], str]) -> dict[str, list[Outcome]]:
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        groups[key(outcome)].append(outcome)
    return dict(sorted(groups.items()))


def _share(flags: Sequence[bool]) -> str:
    return f"{sum(flags)}/{len(flags)}" if flags else "-"


def _sort(outcome: Outcome) -> str:
    plan = outcome.plan
    return f"{plan.group}, {plan.kind}" if plan.group in ("noise", "motion") else plan.group


def _by_group(outcomes: Sequence[Outcome]) -> str:
    rows = []
    for name, group in _grouped_by(outcomes, _sort).items():
        shrinks = [o.shrink for o in group if o.verdict == "explained"]
        places = [o.where_right for o in group if o.where_right is not None]
        rows.append(
            [
                name,
                _share([o.right for o in group if _findable(o)]),
                _share([o.alike for o in group if _findable(o)]),
                _share([o.right for o in group if not _findable(o)]),
                _share(places),
                _share([o.told for o in group if o.told is not None]),
                f"{np.median(shrinks):.3f}" if shrinks else "-",
                f"{np.median([o.seconds for o in group]):.1f} / {max(o.seconds for o in group):.1f}",
            ]
        )
    return _table(
        [
            "kind",
            "right",
            "or said to be alike",
            "right, too small to be found",
            "where",
            "departures told",
            "median shrink",
            "seconds, median / most",
        ],
        rows,
    )


def _by_effect(outcomes: Sequence[Outcome]) -> str:
    alone = [o for o in outcomes if len(o.effects) == 1 and o.plan.group != "mimic"]
    rows = []
    for name, group in _grouped_by(alone, lambda o: o.effects[0]).items():
        known = [o for o in group if o.plan.group in ("single", "new speed", "unknown", "noise") and _findable(o)]
        varied = [o for o in group if o.plan.group == "variant"]
        weak = [o for o in group if o.plan.group == "weak"]
        left_out = [o for o in group if o.plan.left_out]
        named = sorted({_causes(o) for o in group if not o.right and o.named})
        rows.append(
            [
                name,
                _share([o.right for o in known]),
                _share([o.right for o in varied]),
                _share([o.right for o in weak]),
                _share([o.right for o in left_out]),
                "; ".join(named),
            ]
        )
    return _table(["effect", "right", "varied", "weak", "left out", "named instead"], rows)


def _by_size(outcomes: Sequence[Outcome]) -> str:
    own = [o for o in outcomes if o.plan.group in ("single", "new speed", "weak")]
    rows = []
    for low, high in itertools.pairwise(SIZES):
        group = [o for o in own if low <= o.size < high]
        if group:
            top = "" if high > 1e6 else f"{high:g}"
            rows.append([f"{low:g} - {top}", _share([o.alarmed for o in group]), _share([o.right for o in group])])
    if not rows:
        return ""
    return "Detection against size (beyond noise and the twin's uncertainty, standard deviations)\n" + _table(
        ["size", "seen", "right"], rows
    )


def _by_lvdt(outcomes: Sequence[Outcome]) -> str:
    rows = []
    for words, there in (("with the LVDT", True), ("without", False)):
        group = [o for o in outcomes if o.lvdt is there and _findable(o) and not o.plan.left_out]
        if group:
            causes = [o.right for o in group if o.plan.kind != "null"]
            rows.append([words, _share(causes), _share([o.right for o in group if o.plan.kind == "null"])])
    return _table(["recording", "right", "nulls right"], rows)


def _elsewhere_table(outcomes: Sequence[Outcome]) -> str:
    """Part of the gap that causes take away at speeds never seen."""
    found = [o for o in outcomes if o.elsewhere is not None and o.verdict == "explained"]
    shrinks = [o.elsewhere for o in found if o.elsewhere is not None]
    if not shrinks:
        return ""
    row = [str(len(shrinks)), f"{np.median(shrinks):.3f}", f"{min(shrinks):.3f}"]
    return "Shrink of the gap at speeds never seen\n" + _table(["cases", "median", "least"], [row])


def _mimics(outcomes: Sequence[Outcome]) -> str:
    """What is said of faults that resemble a known effect by half: nothing should explain them, or be named."""
    rows = []
    for floor, group in _grouped_by([o for o in outcomes if o.plan.group == "mimic"], _floor).items():
        explained = [o.verdict == "explained" for o in group]
        named = [f"{o.effects[0]} as {_causes(o)}" for o in group if o.named]
        rows.append([floor, _share(explained), _share([bool(o.named) for o in group]), "; ".join(named)])
    return "Mimics\n" + _table(["recordings", "explained", "named at all", "as"], rows) if rows else ""


def _causes(outcome: Outcome) -> str:
    return " + ".join(" ".join(key).strip() for key in outcome.named)


def _floor(outcome: Outcome) -> str:
    return f"{outcome.plan.family}, {'as on a shop floor' if outcome.plan.rough else 'clean'}"


def format_calibration(of_what: str, told: Sequence[Told]) -> str:
    """Reliability by bins, and the expected calibration error: of all, and of those below and from `SURE` on."""
    bins = bins_of(told)
    if not bins:
        return ""
    rows = []
    for own in bins:
        low, high = own.interval
        shown = [f"{own.low:g} - {own.high:g}", f"{own.stated:.3f}", f"{own.share:.3f}", f"{own.right}/{own.count}"]
        rows.append([*shown, f"{low:.3f} to {high:.3f}"])
    table = _table(["told", "mean", "share right", "right", "95 % interval"], rows)
    parts = {"below": [own for own in bins if own.low < SURE], "from": [own for own in bins if own.low >= SURE]}
    apart = ", ".join(
        f"{words} {SURE:g} {calibration_error(part):.3f} of {sum(own.count for own in part)}"
        for words, part in parts.items()
        if part
    )
    error = f"expected calibration error: {calibration_error(bins):.3f} ({apart})"
    return f"Calibration of probabilities of {of_what}\n{table}\n{error}"


def _parameters(outcomes: Sequence[Outcome]) -> str:
    """Parameters of named causes near enough to the truth; of variants as told, and with the departure's width."""
    varied = [o for o in outcomes if o.plan.kind == "variant"]
    plain = [o for o in outcomes if o.plan.kind != "variant"]
    lines = []
    for words, pairs in (
        ("", [o.within for o in plain]),
        (" of variants, as told", [o.within for o in varied]),
        (" of variants, with the width of the departure", [o.within_departure for o in varied]),
    ):
        inside, total = (sum(pair[i] for pair in pairs) for i in (0, 1))
        if total:
            lines.append(f"parameters within 3 standard deviations{words}: {inside}/{total} ({inside / total:.1%})")
    return "\n".join(lines)
