"""Hold a built site to what is promised of it: each link and anchor is there, and nothing is fetched from elsewhere.

python -m website.checking FOLDER
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_FETCHED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "object": "data",
    "image": "href",
}
_RELATIONS = ("stylesheet", "icon", "preload", "modulepreload", "prefetch", "preconnect", "dns-prefetch", "manifest")
_IN_STYLE = re.compile(r"(?:url\(\s*['\"]?|@import\s+['\"])((?:https?:)?//[^'\")]+)")


@dataclass
class Page:
    """What a page of HTML has: anchors, links to follow, and files that a browser fetches to show it."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.page = Page()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the tag names."""
        given = {name: value or "" for name, value in attrs}
        self.page.anchors |= {given[name] for name in ("id", "name") if given.get(name)}
        if "mermaid" in given.get("class", "").split():
            self.page.fetched.append("https://unpkg.com/mermaid")  # which the theme's script then loads
        if tag == "link" and any(relation in given.get("rel", "").split() for relation in _RELATIONS):
            self.page.fetched.append(given.get("href", ""))
        if tag in _FETCHED and given.get(_FETCHED[tag]):
            self.page.fetched.append(given[_FETCHED[tag]])
        if tag == "a" and given.get("href"):
            self.page.links.append(given["href"])
        self.page.fetched += _IN_STYLE.findall(given.get("style", ""))


def read_page(text: str) -> Page:
    """What a page of HTML has."""
    reader = _Reader()
    reader.feed(text)
    return reader.page


def complaints(site: Path) -> list[str]:
    """What is wrong with the site in a folder, a line each; none where all is well."""
    site = site.resolve()
    pages = {path: read_page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        name = path.relative_to(site)
        found += [f"{name}: {url} is fetched from elsewhere" for url in page.fetched if _is_elsewhere(url)]
        if path.name == "404.html":  # its addresses are those of a server
            continue
        for link in sorted({*page.links, *page.fetched}):
            if not _is_elsewhere(link) and not link.startswith(("mailto:", "data:")):
                wrong = _wrong(link, path, pages)
                found += [f"{name}: {link}: {wrong}"] if wrong else []
    for style in sorted(site.rglob("*.css")):
        urls = _IN_STYLE.findall(style.read_text(encoding="utf-8"))
        found += [f"{style.relative_to(site)}: {url} is fetched from elsewhere" for url in urls]
    return found if pages else [f"{site}: no pages (*.html) here; run: make docs"]


def _is_elsewhere(url: str) -> bool:
    return urlsplit(url).scheme in ("http", "https") or url.startswith("//")


def _wrong(link: str, page: Path, pages: dict[Path, Page]) -> str:
    parts = urlsplit(link)
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    if target.is_dir():
        target /= "index.html"
    if not target.is_file():
        return "no such file"
    known = pages.get(target)
    anchor = unquote(parts.fragment)
    return f"no such anchor: #{anchor}" if anchor and known and anchor not in known.anchors else ""


if __name__ == "__main__":
    told = complaints(Path(sys.argv[1]))
    print(*told, sep="\n", end="\n" if told else "")
    sys.exit(1 if told else 0)
