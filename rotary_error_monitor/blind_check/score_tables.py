"""Tables of the blind check: by kind, by effect, by size, and whether probabilities mean what they say."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from rotary_error_monitor.blind_check.reliability import SURE, Told, bins_of, calibration_error, error_by_chance
from rotary_error_monitor.blind_check.scores import FINDABLE, OpenedCase
from rotary_error_monitor.description.streams import REFERENCE_TITLE

SIZES = (0.0, 3.0, 6.0, 8.0, 10.0, 20.0, 40.0, 80.0, 160.0, 1e9)

DEPARTURES = (0.0, 0.05, 0.1, 0.15, 0.2, 1.0)
"""Bins of the share of a cause that its best textbook form leaves."""


def format_scores(outcomes: Sequence[OpenedCase]) -> str:
    """Tables of a run: by group, by effect, detection against size, calibration, parameters."""
    parts = []
    for rough in sorted({outcome.plan.rough for outcome in outcomes}):
        for family in sorted({outcome.plan.family for outcome in outcomes}):
            own = [o for o in outcomes if o.plan.rough == rough and o.plan.family == family]
            if own:
                parts.append(f"== {family}, {'as on a shop floor' if rough else 'clean'}")
                parts += [_by_group(own), _by_effect(own), _by_size(own), _by_departure(own)]
                parts += [_by_reference(own), _elsewhere_table(own)] if family == "stage" else []
    parts += [_mimics(outcomes), _refusals(outcomes)]
    parts.append(format_calibration("named causes", [pair for o in outcomes for pair in o.probabilities]))
    parts.append(format_calibration("ranked candidates, 1 % and more", [pair for o in outcomes for pair in o.ranked]))
    parts.append(_parameters(outcomes))
    return "\n\n".join(part for part in parts if part)


def _refusals(outcomes: Sequence[OpenedCase]) -> str:
    """Cases that were refused, each with what makes it again and the reason."""
    refused = [outcome for outcome in outcomes if outcome.refusal]
    lines = [f"refused: {o.plan.group} of seed {o.plan.seed} ({', '.join(o.effects)}): {o.refusal}" for o in refused]
    return "\n".join(lines)


def _findable(outcome: OpenedCase) -> bool:
    return outcome.plan.kind == "null" or outcome.size >= FINDABLE


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)


def _grouped_by(outcomes: Sequence[OpenedCase], key: Callable[[OpenedCase], str]) -> dict[str, list[OpenedCase]]:
    groups: dict[str, list[OpenedCase]] = defaultdict(list)
    for outcome in outcomes:
        groups[key(outcome)].append(outcome)
    return dict(sorted(groups.items()))


def _share(flags: Sequence[bool]) -> str:
    return f"{sum(flags)}/{len(flags)}" if flags else "-"


def _sort(outcome: OpenedCase) -> str:
    plan = outcome.plan
    return f"{plan.group}, {plan.kind}" if plan.group in ("noise", "motion") else plan.group


def _by_group(outcomes: Sequence[OpenedCase]) -> str:
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


def _by_effect(outcomes: Sequence[OpenedCase]) -> str:
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


def _by_size(outcomes: Sequence[OpenedCase]) -> str:
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


def _by_departure(outcomes: Sequence[OpenedCase]) -> str:
    rows = []
    for low, high in itertools.pairwise(DEPARTURES):
        group = [o for o in outcomes if o.departure is not None and low <= o.departure < high]
        if group:
            told = _share([o.told for o in group if o.told is not None])
            rows.append([f"{low:g} - {high:g}", _share([o.right for o in group if _findable(o)]), told])
    if not rows:
        return ""
    return "Variants against departure (share of the cause that no textbook form describes)\n" + _table(
        ["departure", "right", "told"], rows
    )


def _by_reference(outcomes: Sequence[OpenedCase]) -> str:
    rows = []
    for words, there in ((f"with the {REFERENCE_TITLE}", True), ("without", False)):
        group = [o for o in outcomes if o.referred is there and _findable(o) and not o.plan.left_out]
        if group:
            causes = [o.right for o in group if o.plan.kind != "null"]
            rows.append([words, _share(causes), _share([o.right for o in group if o.plan.kind == "null"])])
    return _table(["recording", "right", "nulls right"], rows)


def _elsewhere_table(outcomes: Sequence[OpenedCase]) -> str:
    """Part of the gap that causes take away at speeds never seen."""
    found = [o for o in outcomes if o.elsewhere is not None and o.verdict == "explained"]
    shrinks = [o.elsewhere for o in found if o.elsewhere is not None]
    if not shrinks:
        return ""
    row = [str(len(shrinks)), f"{np.median(shrinks):.3f}", f"{min(shrinks):.3f}"]
    return "Shrink of the gap at speeds never seen\n" + _table(["cases", "median", "least"], [row])


def _mimics(outcomes: Sequence[OpenedCase]) -> str:
    """What is said of faults that resemble a known effect by half: nothing should explain them, or be named."""
    rows = []
    for floor, group in _grouped_by([o for o in outcomes if o.plan.group == "mimic"], _floor).items():
        explained = [o.verdict == "explained" for o in group]
        named = [f"{o.effects[0]} as {_causes(o)}" for o in group if o.named]
        rows.append([floor, _share(explained), _share([bool(o.named) for o in group]), "; ".join(named)])
    return "Mimics\n" + _table(["recordings", "explained", "named at all", "as"], rows) if rows else ""


def _causes(outcome: OpenedCase) -> str:
    return " + ".join(" ".join(key).strip() for key in outcome.named)


def _floor(outcome: OpenedCase) -> str:
    return f"{outcome.plan.family}, {'as on a shop floor' if outcome.plan.rough else 'clean'}"


def format_calibration(of_what: str, told: Sequence[Told]) -> str:
    """Reliability by bins, and the expected calibration error: of all, and of those below and from `SURE` on.

    Beside it stands what chance makes of statements that are calibrated.
    """
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
        f"{words} {SURE:g} {calibration_error(part):.3f} of {sum(own.count for own in part)}, "
        f"{error_by_chance(part):.3f} by chance"
        for words, part in parts.items()
        if part
    )
    error = f"expected calibration error: {calibration_error(bins):.3f} ({apart} if all are calibrated)"
    return f"Calibration of probabilities of {of_what}\n{table}\n{error}"


def _parameters(outcomes: Sequence[OpenedCase]) -> str:
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
