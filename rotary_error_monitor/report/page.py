"""What all pages have in common: one self-contained HTML file with style, tables and lists."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime

from rotary_error_monitor import __version__

_STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { font-size: 1.25rem; } h2 { font-size: 1.05rem; margin-top: 2rem; }
.verdict { font-size: 1.15rem; padding: .8rem 1rem; border-left: .4rem solid #444; background: #f4f4f4; }
.wide { overflow-x: auto; } table { border-collapse: collapse; }
td, th { padding: .25rem .7rem; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd; }
td { overflow-wrap: break-word; } dt { font-weight: 600; } dd { margin: 0 0 .4rem 1.2rem; } img { max-width: 100%; }
@media print { body { margin: 0; max-width: none; font-size: 11pt; } h2, tr, img, li { break-inside: avoid; } }
"""


def whole_page(kind: str, title: str, style: str, sections: Iterable[str]) -> str:
    """The page: `kind` stands before the title in the window, `style` is its own CSS; nothing comes from elsewhere."""
    return (
        "<!doctype html><html lang='en'><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{kind}: {html.escape(title)}</title><style>{_STYLE}{style}</style>"
        f"<h1>{html.escape(title)}</h1>{''.join(sections)}</html>\n"
    )


def verdict(kind: str, sentence: str) -> str:
    """What is said first, in the colours of its kind."""
    return f"<p class='verdict {kind}'>{html.escape(sentence)}</p>"


def image(content: bytes, alt: str) -> str:
    """A PNG within the page; `alt` says what it shows."""
    encoded = base64.b64encode(content).decode("ascii")
    return f"<img alt='{html.escape(alt, quote=True)}' src='data:image/png;base64,{encoded}'>"


def made_by() -> str:
    """By what, and when, a page is made."""
    return f"rotary_error_monitor {__version__}, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with or without a head; wider than the page it scrolls by itself."""

    def cells(row: Sequence[str], tag: str) -> str:
        return "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row)

    lines = [*([cells(head, "th")] if head else []), *(cells(row, "td") for row in rows)]
    return f"<div class='wide'><table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table></div>"


def bullets(items: Sequence[str]) -> str:
    """A list."""
    return "<ul>" + "".join(f"<li>{html.escape(item)}</li>" for item in items) + "</ul>"


def terms(words: Mapping[str, str]) -> str:
    """What the words mean."""
    return "<h2>What the words mean</h2><dl>" + "".join(f"<dt>{t}</dt><dd>{m}</dd>" for t, m in words.items()) + "</dl>"
