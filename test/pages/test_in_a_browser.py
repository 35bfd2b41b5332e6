"""Every page that the package writes, opened in a browser: nothing is fetched, nothing overflows, all can be read."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pages.conftest import KINDS
from pages.seeing import SEEING

from rotary_error_monitor.report.palette import PALETTE

BROWSER = Path("/usr/bin/chromium-headless-shell")

WIDTHS = (1280, 800, 390)
"""Of a window: a desk, half of one, a telephone, pixels."""

SCHEMES = ("light", "dark")
READABLE = 4.5
"""Contrast of text, at least (WCAG 2.2, 1.4.3)."""

SMALLEST = 12.0
"""Size of text, pixels, at least."""

LARGEST = 3_000_000
"""Of a file, bytes."""

WITHOUT_PICTURES = ("analysis_of_less_than_a_turn", "diagnosis_of_a_folder")

UNIT = r"(?:[nµm]?(?:m|rad|s|N)(?:/K|/day)?|rad/s|Hz|°|°C|arcsec|%|counts?)"
NUMBER = re.compile(r"[(<]?[-+]?\d[\d.e+-]*(?: ± [\d.]+)?\)?")
DATE = re.compile(r"\d{4}-\d\d-\d\d\b")
PLAIN = {"recordings", "steps", "samples", "lost", "disordered", "turns", "sign", "out of order or not finite"}
"""Heads of columns that are counted."""

IN_NOISE = {"before", "after", "noise floor", "gap with it, held out", "scatter"}
"""Heads of columns in standard deviations of the noise, which their headings or the list of words say."""


@dataclass
class Seen:
    """What a browser made of one page."""

    at: dict[tuple[int, str], dict[str, Any]] = field(default_factory=dict)
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    printed: bytes = b""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One for all pages; it ends with this module, for its loop of events would be in the way of other tests."""
    if not BROWSER.exists():
        pytest.skip(f"no browser: {BROWSER}")
    sync_api = pytest.importorskip("playwright.sync_api", reason="no browser without playwright")
    with sync_api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def opened(browser: Any, pages: dict[str, Path]) -> dict[str, Seen]:
    return {kind: look(browser, path) for kind, path in pages.items()}


def look(browser: Any, path: Path) -> Seen:
    """Open a page at each width in each scheme, and print it."""
    seen = Seen()
    page = browser.new_page(viewport={"width": WIDTHS[0], "height": 900})
    page.on("request", lambda request: seen.requests.append(request.url))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.goto(path.as_uri())
    for width in WIDTHS:
        for scheme in SCHEMES if width == WIDTHS[0] else SCHEMES[:1]:
            page.set_viewport_size({"width": width, "height": 900})
            page.emulate_media(color_scheme=scheme)
            seen.at[width, scheme] = page.evaluate(SEEING)
    page.set_viewport_size({"width": 718, "height": 900})  # between the margins of A4
    page.emulate_media(media="print", color_scheme="dark")
    seen.at[718, "print"] = page.evaluate(SEEING)
    seen.printed = page.pdf(format="A4")
    page.close()
    return seen


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_fetched_and_nothing_complains(opened: dict[str, Seen], pages: dict[str, Path], kind: str) -> None:
    assert [url for url in opened[kind].requests if not url.startswith("data:")] == [pages[kind].as_uri()]
    assert opened[kind].complaints == []
    assert pages[kind].stat().st_size < LARGEST


@pytest.mark.parametrize("kind", KINDS)
def test_the_verdict_is_seen_first_and_told_in_words(opened: dict[str, Seen], kind: str) -> None:
    for (width, _), seen in opened[kind].at.items():
        badge = seen["badge"]
        assert badge["first"] and badge["bottom"] < 200, width
        assert re.search(r"[A-Za-z]{4}", badge["text"]) and len(seen["sentence"]) > 20
        assert badge["larger"] > 1.1 * min(text["size"] for text in seen["texts"])
        assert "#{:02x}{:02x}{:02x}".format(*map(int, badge["colour"])) in PALETTE


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_does_not_scroll_sideways(opened: dict[str, Seen], kind: str) -> None:
    for place, seen in opened[kind].at.items():
        assert not seen["page_scrolls"], place
        for table in seen["tables"]:
            assert table["may_scroll"] or place[1] == "print", table["head"]
            assert not (table["scrolls"] and place[1] == "print"), table["head"]
            assert not (table["scrolls"] and place[0] == max(WIDTHS)), table["head"]


@pytest.mark.parametrize("kind", KINDS)
def test_pictures_show_something_and_say_what(opened: dict[str, Seen], kind: str) -> None:
    alts = [image["alt"] for image in opened[kind].at[WIDTHS[0], "light"]["images"]]
    assert len(set(alts)) == len(alts), "each says what it alone shows"
    assert kind in WITHOUT_PICTURES or len(alts) >= 3
    for (width, _), seen in opened[kind].at.items():
        for image in seen["images"]:
            assert image["complete"] and image["width"] > 0 and image["colours"] > 1
            assert len(image["alt"]) > 30
            assert abs(image["ratio"] - 1) < 0.02, "not distorted"
            assert image["shown"] <= width
            assert image["width"] >= 1.9 * image["shown"], "sharp on dense screens"


@pytest.mark.parametrize("kind", KINDS)
def test_text_is_readable(opened: dict[str, Seen], kind: str) -> None:
    for place, seen in opened[kind].at.items():
        assert len(seen["texts"]) > 20
        faint = [text for text in seen["texts"] if text["contrast"] < READABLE]
        assert faint == [], place
        assert place[1] == "print" or min(text["size"] for text in seen["texts"]) >= SMALLEST


def test_dark_is_dark(opened: dict[str, Seen], browser: Any, pages: dict[str, Path]) -> None:
    """Who set a dark scheme gets one, and on paper it is light again."""
    page = browser.new_page(color_scheme="dark")
    page.goto(pages["commissioning"].as_uri())
    ground = "getComputedStyle(document.body).backgroundColor"
    assert max(map(int, re.findall(r"\d+", page.evaluate(ground)))) < 64
    page.emulate_media(media="print")
    assert min(map(int, re.findall(r"\d+", page.evaluate(ground)))) == 255
    page.close()


@pytest.mark.parametrize("kind", KINDS)
def test_language_title_and_headings(opened: dict[str, Seen], kind: str) -> None:
    seen = opened[kind].at[WIDTHS[0], "light"]
    assert seen["language"] == "en"
    assert seen["title"].lower().startswith(f"{kind.partition('_')[0]}: ")
    levels = seen["headings"]
    assert levels[0] == 1 and levels.count(1) == 1 and len(levels) > 3
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))


@pytest.mark.parametrize("kind", KINDS)
def test_tables_have_heads_and_numbers_their_units(opened: dict[str, Seen], kind: str) -> None:
    tables = opened[kind].at[WIDTHS[0], "light"]["tables"]
    assert tables
    for table in tables:
        assert table["head"] and all(table["head"]) and table["rows"]
        for row in table["rows"]:
            assert len(row) == len(table["head"])
        for head, *cells in zip(table["head"], *table["rows"], strict=True):
            for cell in cells:
                assert has_unit(head, cell), f"{head}: {cell}"


def has_unit(head: str, cell: str) -> bool:
    """Whether a number of a table tells its unit, in the cell or in the head; True for words."""
    if not NUMBER.match(cell) or DATE.match(cell) or head in PLAIN | IN_NOISE or re.search(rf", {UNIT}$", head):
        return True
    return re.fullmatch(rf"\(?[-+\d., ±e]+\)?(?:e-\d+)? ?{UNIT}(?: \(.*\))?", cell) is not None


@pytest.mark.parametrize(
    ("head", "cell", "told"),
    [
        ("total, µm", "1.72 ± 0.05", True),
        ("total", "1.72 ± 0.05", False),
        ("value", "(1.1 ± 0.2, -3.1 ± 0.4) µrad", True),
        ("value", "(1.1 ± 0.2, -3.1 ± 0.4)", False),
        ("value", "2.4 µm/K", True),
        ("share", "42.8%", True),
        ("share", "42.8", False),
        ("signal", "radial x at 0 mm", True),
        ("change", "1.2 ± 0.3 nm/day", True),
        ("when", "2026-03-01 08:00:00, day_3", True),
        ("when", "2026.3", False),
    ],
)
def test_a_number_without_a_unit_is_noticed(head: str, cell: str, told: bool) -> None:
    assert has_unit(head, cell) == told


@pytest.mark.parametrize("kind", KINDS)
def test_it_can_be_printed(opened: dict[str, Seen], kind: str) -> None:
    assert opened[kind].printed.startswith(b"%PDF") and len(opened[kind].printed) > 10_000
    assert len(re.findall(rb"/Type\s*/Page\b", opened[kind].printed)) <= 12


def test_a_page_that_is_not_as_it_should_be_is_noticed(browser: Any, tmp_path: Path) -> None:
    """What is looked for is seen where it is."""
    path = tmp_path / "page.html"
    wide = "<table><tr><td>1</td></tr></table><div style='width: 2000px'>wide</div><img src='data:,'>"
    fetched = "<img src='http://127.0.0.1:9/x.png' alt='gone'>"
    path.write_text(
        f"<h3>x</h3><p style='color: #888; background: #999; font-size: 8px'>faint</p>{wide}{fetched}"
        "<script>throw new Error('oops')</script>",
        encoding="utf-8",
    )
    seen = look(browser, path)
    at = seen.at[1280, "light"]
    assert any("127.0.0.1" in url for url in seen.requests) and any("oops" in each for each in seen.complaints)
    assert at["page_scrolls"] and at["headings"] == [3] and not at["language"] and not at["badge"]
    assert at["tables"][0]["head"] == [] and not at["tables"][0]["may_scroll"]
    assert at["images"][0]["width"] == 0 and at["images"][0]["alt"] == ""
    faint = next(text for text in at["texts"] if text["text"] == "faint")
    assert faint["size"] == 8 and faint["contrast"] == pytest.approx(1.244, abs=0.002)
