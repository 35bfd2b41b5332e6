"""The page of a commissioning: what is there, what is wrong, what was found, what the recording cannot tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rotary_error_monitor.commissioning.commission import Commissioning
from rotary_error_monitor.commissioning.report import found_lines, stream_lines, untold
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.report.page import bullets, image, table, verdict, whole_page

_STYLE = """
.good { border-color: #0072b2; } .wrong { border-color: #d55e00; }
"""

_ALT = "heads round the ring as described and as found, the rotation over time, what the heads differ in over the angle"


def page(stage: StageDescription, result: Commissioning, picture: bytes, title: str, about: Mapping[str, str]) -> str:
    """The page, one self-contained file.

    Args:
        stage: as described before.
        result: of the commissioning.
        picture: PNG.
        title: of the page.
        about: what was commissioned, when and by what, by words.
    """
    return whole_page("commission", title, _STYLE, _sections(stage, result, picture, about))


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


def _sections(
    stage: StageDescription, result: Commissioning, picture: bytes, about: Mapping[str, str]
) -> Iterator[str]:
    yield verdict("good" if result.settled else "wrong", sentence(result))
    if result.findings:
        rows = [[finding.text, "yes" if finding.settled else "no", finding.advice or ""] for finding in result.findings]
        yield "<h2>What is wrong</h2>" + table(["", "put right in the stage file", "what to do"], rows)
    yield image(picture, _ALT)
    yield "<h2>What is there</h2>" + bullets([*stream_lines(stage, result), *result.remarks])
    yield "<h2>What was found (± standard uncertainty)</h2>" + bullets(list(found_lines(result)))
    yield "<h2>What this recording cannot tell</h2>" + bullets(list(untold(stage, result)))
    yield "<h2>About</h2>" + table([], [[name, value] for name, value in about.items()])
