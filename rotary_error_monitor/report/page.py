"""What all pages have in common: one self-contained HTML file with style, verdict, tables, pictures and lists."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from enum import StrEnum

from rotary_error_monitor import __version__
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import BLUE, GREY, ORANGE, VERMILION
from rotary_error_monitor.report.wording import power_of_ten

_STYLE = f"""
:root {{ color-scheme: light dark; --paper: #fff; --ink: #222; --soft: #f4f4f4; --line: #d0d0d0; }}
@media screen and (prefers-color-scheme: dark) {{
  :root {{ --paper: #16181b; --ink: #e8e8e8; --soft: #24272b; --line: #4a4e54; }} }}
* {{ box-sizing: border-box; }}
body {{ font: 16px/1.45 system-ui, sans-serif; max-width: 72rem; margin: 1.5rem auto; padding: 0 1rem;
  color: var(--ink); background: var(--paper); overflow-wrap: break-word; }}
h1 {{ font-size: 1.25rem; margin: 0 0 .8rem; }} h2 {{ font-size: 1.15rem; margin: 2.2rem 0 .6rem; }}
h3 {{ font-size: 1rem; margin: 1.2rem 0 .4rem; }}
.verdict {{ padding: .8rem 1rem; border-left: .5rem solid var(--tone); background: var(--soft); }}
.verdict p, .verdict ul {{ font-size: 1.1rem; margin: .6rem 0 0; }}
.badge {{ display: inline-block; font-size: 1.35rem; font-weight: 700; padding: .15rem .8rem; border-radius: .3rem;
  color: var(--on); background: var(--tone); }}
.good {{ --tone: {BLUE}; --on: #fff; }} .bad {{ --tone: {VERMILION}; --on: #000; }}
.open {{ --tone: {ORANGE}; --on: #000; }} .plain {{ --tone: {GREY}; --on: #fff; }}
.wide {{ overflow-x: auto; max-width: 100%; margin: .4rem 0 1rem; }} table {{ border-collapse: collapse; }}
td, th {{ padding: .25rem .8rem .25rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); }}
th {{ vertical-align: bottom; }} td {{ font-variant-numeric: tabular-nums; }} td.n {{ white-space: nowrap; }}
td.text {{ min-width: 9rem; }}
dt {{ font-weight: 600; }} dd {{ margin: 0 0 .4rem 1.2rem; overflow-wrap: anywhere; }}
.pictures {{ display: flex; flex-wrap: wrap; gap: .8rem 1rem; margin: .8rem 0; }}
.pictures img {{ max-width: 100%; height: auto; background: #fff; }}
@media (max-width: 30rem) {{ body {{ font-size: 15px; }} .badge {{ font-size: 1.2rem; }} }}
@media print {{ body {{ margin: 0; max-width: none; font-size: 10pt; }} .wide {{ overflow: visible; }}
  pre {{ font-size: 8pt; white-space: pre-wrap; overflow-wrap: anywhere; }}
  table {{ font-size: 8.5pt; }} td, th {{ padding-right: .5rem; }} td {{ overflow-wrap: anywhere; }}
  td.n {{ white-space: normal; }} td.text {{ min-width: 0; }} .pictures img.narrow {{ max-width: 48.5%; }}
  .verdict, .badge {{ print-color-adjust: exact; -webkit-print-color-adjust: exact; }}
  .verdict, tr, img, li {{ break-inside: avoid; }} h2, h3 {{ break-after: avoid; }} }}
"""

_NUMBER = re.compile(r"\(?[-+<]?\s?\d[^A-Za-z]*(\s?[^\s\d]{1,8}){0,2}")
"""A number with its uncertainty and unit, which no line break shall part."""


_WITHIN = re.compile(r"(?<=[\d)]) (?=±|[nµm]?(?:m|rad|rad/s|s|N)\b|arcsec|Hz|%)|(?<=±) ")
"""Spaces within a value with uncertainty and unit."""


_POWER = re.compile(r"(?<=[\d)])e([-+]\d+)\b")


class Tone(StrEnum):
    """How good news is; the badge says it in words, so that nobody needs the colour."""

    GOOD = "good"
    BAD = "bad"
    OPEN = "open"
    PLAIN = "plain"


def whole_page(kind: str, title: str, sections: Iterable[str]) -> str:
    """The page: `kind` stands before the title; nothing comes from elsewhere."""
    name = f"{kind}: {html.escape(title)}"
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{name}</title><style>{_STYLE}</style></head>"
        f"<body><main><h1>{name}</h1>{''.join(sections)}</main></body></html>\n"
    )


def verdict(tone: Tone, badge: str, sentence: str, items: Sequence[str] = ()) -> str:
    """What is said first: the verdict in a word or two, a sentence, and what belongs to it as a list."""
    more = bullets(items) if items else ""
    return (
        f"<div class='verdict {tone}'><span class='badge'>{html.escape(badge)}</span>"
        f"<p>{_unbroken(sentence)}</p>{more}</div>"
    )


def section(title: str, *parts: str, level: int = 2) -> str:
    """Parts below a heading of a level, 2 or 3; nothing where there are none."""
    content = "".join(parts)
    return f"<h{level}>{html.escape(title)}</h{level}>{content}" if content else ""


def paragraph(text: str) -> str:
    """A paragraph."""
    return f"<p>{html.escape(text)}</p>"


def images(pictures: Iterable[Drawn]) -> str:
    """PNGs within the page, side by side where it is wide enough; each with what it shows in words."""
    shown = "".join(_image(each) for each in pictures)
    return f"<div class='pictures'>{shown}</div>" if shown else ""


def _image(picture: Drawn) -> str:
    encoded = base64.b64encode(picture.png).decode("ascii")
    width, height = picture.size
    alt = html.escape(picture.alt, quote=True)
    narrow = " class='narrow'" if width < _NARROW else ""
    return f"<img{narrow} width='{width}' height='{height}' alt='{alt}' src='data:image/png;base64,{encoded}'>"


_NARROW = 400
"""Pictures below this width (pixels) stand side by side on paper."""


def about(facts: Mapping[str, str]) -> str:
    """What the page is of, when, and by what it was made."""
    rows = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(text)}</dd>" for name, text in facts.items() if text)
    return section("About", f"<dl>{rows}</dl>" if rows else "")


def made_by() -> str:
    """By what, and when, a page is made."""
    return f"rotary_error_monitor {__version__}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with a head; wider than the page it scrolls by itself, also by the keyboard. Nothing without rows."""
    if not rows:
        return ""
    first = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    others = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f"<div class='wide' tabindex='0'><table><thead><tr>{first}</tr></thead><tbody>{others}</tbody></table></div>"


_LONG = 24
"""Characters from which a cell needs room, or it becomes a column of words."""


def _cell(text: str) -> str:
    shown = _POWER.sub(_power, text)
    is_number = _NUMBER.fullmatch(shown) and ", " not in text
    kind = " class='n'" if is_number else " class='text'" if len(text) > _LONG else ""
    return f"<td{kind}>{_unbroken(text)}</td>"


def _unbroken(text: str) -> str:
    """The text with no line break between a value, its uncertainty and its unit."""
    return _WITHIN.sub("\u00a0", html.escape(_POWER.sub(_power, text)))


def _power(found: re.Match[str]) -> str:
    """A power of ten as it is written by hand: `×10⁻⁶`."""
    return f"×{power_of_ten(int(found[1]))}"


def bullets(items: Sequence[str]) -> str:
    """A list."""
    return "<ul>" + "".join(f"<li>{_unbroken(item)}</li>" for item in items) + "</ul>"


def terms(words: Mapping[str, str]) -> str:
    """What the words mean."""
    return section(
        "What the words mean", "<dl>" + "".join(f"<dt>{t}</dt><dd>{m}</dd>" for t, m in words.items()) + "</dl>"
    )
