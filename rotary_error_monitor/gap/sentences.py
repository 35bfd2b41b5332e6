"""A diagnosis in sentences."""

from __future__ import annotations

from rotary_error_monitor.gap.diagnosis import DiagnosisResult, FoundCause, Group
from rotary_error_monitor.gap.quantities import quantity
from rotary_error_monitor.gap.verdict import Verdict


def verdict_sentence(diagnosis: DiagnosisResult) -> str:
    """The verdict and its causes with their sizes, in one or two sentences."""
    gap = diagnosis.gap
    if diagnosis.verdict is Verdict.NO_GAP:
        return "No gap: twin and recording agree to the noise."
    if diagnosis.verdict is Verdict.UNKNOWN:
        left = _left(diagnosis)
        return f"Unknown: there is a gap ({gap.before:.3g} times the noise) that no known effect explains. {left}"
    causes = " and ".join(describe_cause(found) for found in diagnosis.causes)
    said = "Explained by" if diagnosis.verdict is Verdict.EXPLAINED else "Partly explained by"
    sentences = (f"{said} {causes}: {what_shrinks(diagnosis)}.", what_is_left(diagnosis))
    return " ".join(filter(None, sentences))


def what_shrinks(diagnosis: DiagnosisResult) -> str:
    """How far the gap shrinks by the causes."""
    gap = diagnosis.gap
    textbook = "" if gap.textbook_shrink is None else f", {gap.textbook_shrink:.1%} by textbook forms alone"
    return f"the gap shrinks from {gap.before:.3g} to {gap.after:.3g} times the noise ({gap.shrink:.1%}{textbook})"


def what_is_left(diagnosis: DiagnosisResult) -> str:
    """Sentences on what the causes leave, or on what else the recording does not tell from them; empty of neither."""
    if diagnosis.verdict is not Verdict.EXPLAINED:
        return _left(diagnosis)
    return " ".join(f"This recording does not tell {_told_from(group)}." for group in diagnosis.indistinguishable)


def describe_cause(found: FoundCause) -> str:
    """What it is, its name and place, size, probability, and how it departs from its textbook form."""
    effect = found.cause.effect
    place = f" at {found.cause.location}" if found.cause.location else ""
    units = effect.units(found.cause.location)
    sizes = ", ".join(f"{name} {quantity(value, units.get(name, '1'))}" for name, value in found.parameters.items())
    held = ", ".join(found.at_bounds)
    sizes += f"; {held} at the bound of what is physically sensible" if held else ""
    told = "".join(f"; {row.pattern} ({row.share:.1%} of it)" for row in found.departures)
    title = f"{effect.title}, " if effect.title else ""
    return f"{title}{effect.name}{place} ({sizes}; probability {found.probability:.0%}{told})"


def _told_from(group: Group) -> str:
    named, *others = (" at ".join(filter(None, key)) for key in group.effects)
    return f"{named} from {' or '.join(others)}"


def _left(diagnosis: DiagnosisResult) -> str:
    if not diagnosis.remainder:
        return "What remains has no structure that was looked for."
    first = diagnosis.remainder[:3]
    return "What remains: " + "; ".join(f"{finding.channel}: {finding.pattern}" for finding in first) + "."
