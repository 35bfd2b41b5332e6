"""The page of a commissioning: what is wrong, what is there, what was found, what the recording cannot tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rotary_error_monitor.commissioning.commission import Commissioning
from rotary_error_monitor.commissioning.report import found_lines, head_rows, stream_rows, untold
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.page import Tone, about, bullets, images, section, table, verdict, whole_page


def page(
    stage: StageDescription, result: Commissioning, pictures: Sequence[Drawn], title: str, facts: Mapping[str, str]
) -> str:
    """The page, one self-contained file.

    Args:
        stage: as described before.
        result: of the commissioning.
        pictures: as `commissioning_figure.draw` gives them.
        title: of the page.
        facts: what was commissioned, when and by what, by words.
    """
    return whole_page("Commissioning", title, _sections(stage, result, pictures, facts))


def sentence(result: Commissioning) -> str:
    """What it comes to."""
    count = len(result.findings)
    if not count:
        return "Nothing is wrong."
    left = [finding for finding in result.findings if not finding.settled]
    found = f"{count} thing{'s are' if count > 1 else ' is'} otherwise than described"
    if not left:
        return f"{found}; the stage file puts {'all of them' if count > 1 else 'it'} right."
    return f"{found}; {len(left)} of that the stage file does not put right: {left[0].text}."


def _badge(result: Commissioning) -> tuple[Tone, str]:
    if not result.settled:
        return Tone.BAD, "✗ Not settled"
    return Tone.GOOD, "✓ Put right" if result.findings else "✓ Nothing wrong"


def _sections(
    stage: StageDescription, result: Commissioning, pictures: Sequence[Drawn], facts: Mapping[str, str]
) -> Iterator[str]:
    yield verdict(*_badge(result), sentence(result))
    wrong = [
        [finding.text, "✓ yes" if finding.settled else "✗ no", finding.advice or "–"] for finding in result.findings
    ]
    yield section("What is wrong", table(["what", "put right in the stage file", "what to do"], wrong))
    yield images(pictures)
    streams = table(*stream_rows(stage, result))
    yield section("What is there", streams, bullets(result.remarks) if result.remarks else "")
    found = list(found_lines(result, heads=False))
    yield section("What was found (± standard uncertainty)", table(*head_rows(result)), bullets(found))
    yield section("What this recording cannot tell", bullets(list(untold(stage, result))))
    yield about(facts)
