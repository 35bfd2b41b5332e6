"""The page and the table of a verification: the monitor against references, by direction, what was taken off, words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rotary_error_monitor.analysis.verification_result import (
    AxisFigures,
    ReferenceComparison,
    TurningComparison,
    Verification,
)
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.page import (
    Tone,
    about,
    bullets,
    images,
    paragraph,
    section,
    table,
    terms,
    verdict,
    whole_page,
)
from rotary_error_monitor.report.wording import aligned, with_unit
from rotary_error_monitor.units import MICRO

_TERMS = {
    "difference": "reference less monitor, the reference's zero and the eccentricity of its target taken off",
    "95 % bound": "1.96 standard deviations of one difference: by the covariance of the estimate, the noise of the "
    "reference and what is stated of its gain, directions, height and form; root mean square over the time",
    "inside": "part of the differences that is inside its own bound; 95 % is expected where the statement is right",
    "needed": "part from which chance does not explain that it is less: by the scatter from turn to turn, by what is "
    "the same in all turns, and with a noise of the reference that is known to a third; all directions of one "
    "comparison together are wrong in 1 % of the cases",
    "mean": "of the differences at each angle over the whole turns, as root mean square over the angle; at most: the "
    "standard uncertainty of one reading of monitor and reference, of what is the same in all turns, and what the "
    "scatter from turn to turn leaves in a mean. Stamps of heads that may be apart are in the bound of one difference, "
    "not in this: what stands still is in the zero, what wanders is seen from turn to turn",
    "zero": "mean of the difference by direction and speed: no error motion, for that is about its mean (ISO 230-7)",
    "eccentricity": "of the target in the rotor's frame: once-per-turn motion that turns with the rotor, which no "
    "reference on a target tells from it. ± U is the expanded uncertainty, k = 2 (about 95 %)",
    "height that fits best": "where the differences would be least, by the tilt; ± U as above. It is told, not used",
}

_HEAD = (
    *("direction", "axis", "turns", "RMS, µm", "largest, µm", "95 % bound, µm", "inside", "needed"),
    *("mean, RMS, µm", "mean, at most, µm", "agrees"),
)


_CLEARLY = 2.0
"""Expanded uncertainties from which a height that fits better is worth a note: hardly ever by chance."""


def verdict_sentence(found: Verification) -> str:
    """What is said first."""
    names = [_named(each) for each in found.comparisons]
    if found.agrees:
        least = min(_axes(found), key=lambda row: row[2].judgement.inside)
        told = f"{least[2].judgement.inside:.1%} or more of the differences are inside their 95 % bounds"
        return f"The monitor agrees with the reference within its stated uncertainty ({', '.join(names)}): {told}."
    said = "The monitor does not agree with the reference within its stated uncertainty"
    wrong = [row for row in _axes(found) if not row[2].judgement.agrees]
    if not wrong:
        return f"{said}: {'; '.join(_leaning(each) for each in found.comparisons if not each.stands_as_stated)}."
    each, turning, axis = max(wrong, key=lambda row: row[2].judgement.mean / row[2].judgement.most)
    judged = axis.judgement
    told = f"{judged.inside:.1%} of the differences are inside their 95 % bounds (needed {judged.needed:.1%})"
    mean = f"their mean over the turns is {_length(judged.mean)} RMS (at most {_length(judged.most)})"
    return (
        f"{said}, in {len(wrong)} of {len(list(_axes(found)))} directions. Farthest off is {_named(each)}, "
        f"{turning.name}, {axis.axis}: {told}, {mean}."
    )


def _leaning(each: ReferenceComparison) -> str:
    way = "higher" if each.higher > 0 else "lower"
    off = with_unit(abs(each.higher), "m", each.higher_expanded)
    return (
        f"the differences from {_named(each)} follow the tilt as if it stood {off} {way}: {_length(each.lean)} RMS (at "
        f"most {_length(each.lean_most)})"
    )


def notes_of(found: Verification) -> Iterator[str]:
    """What a reader should know, of each comparison and of the recording."""
    for each in found.comparisons:
        name = _named(each)
        if each.stated != "as described":
            yield f"{name}: the height is {each.stated}"
        if abs(each.higher) > _CLEARLY * each.higher_expanded:
            better = with_unit(each.height + each.higher, "m", each.higher_expanded)
            within = ", though they are within the uncertainty" if each.agrees else ""
            yield f"{name}: the differences are least for a reference at {better}{within}: check where it stands"
        apart = np.abs(each.eccentricity - np.array(each.described)) > each.expanded
        if apart.any() and any(each.described):
            yield f"{name}: the eccentricity of its target is not the one that is described"
        yield from (f"{name}: {remark}" for remark in each.remarks)
    yield from found.remarks


def text_table(found: Verification) -> str:
    """The figures as lines for a terminal."""
    parts = []
    for each in found.comparisons:
        parts += [f"{_named(each)} ({each.stated})", *aligned([_HEAD, *_rows(each)]), *_taken(each)]
    return "\n".join(parts)


def page(found: Verification, pictures: Sequence[Sequence[Drawn]], title: str, facts: Mapping[str, str]) -> str:
    """The whole page.

    Args:
        found: what is shown.
        pictures: of each comparison, as `verification_figure.draw` gives them.
        title: of the page.
        facts: what was compared, when it was recorded, and by what this was made.
    """
    tone, badge = (Tone.GOOD, "✓ Agrees") if found.agrees else (Tone.BAD, "✗ Does not agree")
    notes = list(notes_of(found))
    sections = [
        verdict(tone, badge, verdict_sentence(found)),
        section("Notes", bullets(notes)) if notes else "",
        *(_section(each, own) for each, own in zip(found.comparisons, pictures, strict=True)),
        terms(_TERMS),
        about(facts),
    ]
    return whole_page("Comparison", title, sections)


def _section(each: ReferenceComparison, pictures: Sequence[Drawn]) -> str:
    return section(
        f"{_named(each)}",
        paragraph(f"Height {each.stated}. Differences: reference less monitor."),
        table(_HEAD, _rows(each)),
        images(pictures),
        section("What was found and taken off", bullets(list(_taken(each))), level=3),
    )


def _rows(each: ReferenceComparison) -> list[list[str]]:
    """A row for each direction, lengths in µm."""
    return [
        [
            turning.name,
            axis.axis,
            f"{turning.turned:.3g}",
            *map(_micrometres, (axis.rms, axis.largest, axis.bound)),
            f"{axis.judgement.inside:.1%}",
            f"{axis.judgement.needed:.1%}",
            *map(_micrometres, (axis.judgement.mean, axis.judgement.most)),
            "✓ yes" if axis.judgement.agrees else "✗ no",
        ]
        for turning in each.turnings
        for axis in turning.axes
    ]


def _taken(each: ReferenceComparison) -> Iterator[str]:
    """What was found and taken off, in sentences."""
    x, y = (float(value) for value in each.eccentricity)
    parts = (with_unit(v, "m", float(u)) for v, u in zip((x, y), each.expanded, strict=True))
    size, angle = _length(math.hypot(x, y)), math.degrees(math.atan2(y, x))
    described = ", ".join(f"{_micrometres(float(value))} µm" for value in each.described)
    yield (
        f"taken off: eccentricity of the target, x {next(parts)}, y {next(parts)} (k = 2), that is {size} at "
        f"{angle:.1f}°; described as {described}"
    )
    zeros = "; ".join(
        f"{turning.name} {', '.join(_micrometres(float(value)) for value in turning.zero)} µm"
        for turning in each.turnings
    )
    yield f"taken off: zero of {', '.join(each.axes)}, {zeros}"
    if math.isfinite(each.higher_expanded):
        best = with_unit(each.height + each.higher, "m", each.higher_expanded)
        lean = f"by it the differences are {_length(each.lean)} RMS (at most {_length(each.lean_most)})"
        yield f"not taken off: the height that fits best, {best} (k = 2); {lean}"


def _axes(found: Verification) -> Iterator[tuple[ReferenceComparison, TurningComparison, AxisFigures]]:
    for each in found.comparisons:
        for turning in each.turnings:
            yield from ((each, turning, axis) for axis in turning.axes)


def _named(each: ReferenceComparison) -> str:
    return f"{each.reference} at {each.height * 1e3:.4g} mm"


def _length(value: float) -> str:
    """A length to three digits."""
    return with_unit(float(f"{value:.3g}"), "m")


def _micrometres(value: float) -> str:
    """A length in µm to three digits, but none below a tenth of a nanometre."""
    digits = max(0, min(4, 2 - math.floor(math.log10(max(abs(value) * MICRO, 1e-4)))))
    return f"{value * MICRO:.{digits}f}"
