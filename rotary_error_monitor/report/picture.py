"""What the figure of a diagnosis shows, in plain values: what a process that only draws needs, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rotary_error_monitor.gap.views import View

if TYPE_CHECKING:  # who draws need not load what diagnoses
    from rotary_error_monitor.gap.diagnosis import DiagnosisResult
    from rotary_error_monitor.gap.problem import DiagnosableProblem
    from rotary_error_monitor.gap.shrink import Gap

CHANNELS_SHOWN = 3
MOST_SHARES = 8
MOST_RANKED = 8
MOST_POINTS = 4000
"""Samples of a channel that are drawn; a picture holds no more."""


@dataclass(frozen=True)
class Picture:
    """The gap, where it lies, the ranking, and residuals of the channels that matter.

    Attributes:
        gap: before, after and noise floor by name, standard deviations of noise; after only where there are causes, and
            with their textbook forms alone where they depart from these.
        shrink: of the gap, with the causes; None where there are none.
        where: channels and their shares of the excess, the largest first.
        ranking: candidates and their probabilities, the likeliest first.
        channels: those whose residuals are shown.
        views: of these channels.
    """

    gap: tuple[tuple[str, float], ...]
    shrink: float | None
    where: tuple[tuple[str, float], ...]
    ranking: tuple[tuple[str, float], ...]
    channels: tuple[str, ...]
    views: tuple[View, ...]


def picture_of(problem: DiagnosableProblem, diagnosis: DiagnosisResult) -> Picture:
    """What the figure of a diagnosis shows."""
    shown = [share.channel for share in diagnosis.where if share.share > 0.01][:CHANNELS_SHOWN]
    views = problem.views(shown, [found.cause for found in diagnosis.causes]) if shown else []
    gap = diagnosis.gap
    return Picture(
        tuple(_bars(gap, bool(diagnosis.causes))),
        gap.shrink if diagnosis.causes else None,
        tuple((share.channel, share.share) for share in diagnosis.where[:MOST_SHARES]),
        tuple((f"{row.effect} {row.location}".strip(), row.probability) for row in diagnosis.ranking[:MOST_RANKED]),
        tuple(shown),
        tuple(_thinned(view) for view in views),
    )


def _bars(gap: Gap, with_causes: bool) -> Iterator[tuple[str, float]]:
    yield "before", gap.before
    if with_causes and gap.textbook is not None:
        yield "textbook\nforms", gap.textbook
    if with_causes:
        yield "after", gap.after
    yield "noise\nfloor", gap.noise_floor


def _thinned(view: View) -> View:
    step = max(1, len(view.x) // MOST_POINTS)
    return View(view.channel, view.quantity, view.x[::step], view.before[::step], view.after[::step], view.unit)
