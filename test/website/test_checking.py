"""What is held against a built site: broken links and anchors, and whatever would be fetched from elsewhere."""

from __future__ import annotations

import pytest
from website.checking import complaints

WELL = (
    '<html><body><h1 id="top">x</h1><a href="other.html#there">y</a><a href="https://example.org/">z</a></body></html>'
)
OTHER = '<html><body><h2 id="there">x</h2><a href="index.html">y</a><img src="a.svg"></body></html>'


@pytest.fixture
def site(tmp_path):
    (tmp_path / "index.html").write_text(WELL)
    (tmp_path / "other.html").write_text(OTHER)
    (tmp_path / "a.svg").write_text("<svg/>")
    (tmp_path / "style.css").write_text("a { background: url(data:image/png;base64,AAAA) } b { mask: url('a.svg') }")
    return tmp_path


def test_a_site_that_is_whole_has_no_complaint(site):
    assert complaints(site) == []


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("index.html", '<a href="gone.html">x</a>', "index.html: gone.html: no such file"),
        ("index.html", '<a href="other.html#gone">x</a>', "index.html: other.html#gone: no such anchor: #gone"),
        ("index.html", '<a href="#gone">x</a>', "index.html: #gone: no such anchor: #gone"),
        ("index.html", '<img src="gone.png">', "index.html: gone.png: no such file"),
        (
            "index.html",
            '<script src="https://cdn.example.org/x.js"></script>',
            "https://cdn.example.org/x.js is",
        ),
        ("index.html", '<link rel="stylesheet" href="//fonts.example.org/x">', "//fonts.example.org/x is fetched"),
        ("index.html", '<pre class="mermaid">a</pre>', "mermaid is fetched"),
        (
            "index.html",
            '<p style="background: url(https://example.org/x.png)">',
            "https://example.org/x.png is",
        ),
        ("style.css", "@import 'https://example.org/x.css';", "style.css: https://example.org/x.css is fetched"),
        ("style.css", "a { src: url(https://example.org/x.woff) }", "style.css: https://example.org/x.woff is fetched"),
    ],
)
def test_what_is_wrong_is_named(site, file, text, told):
    (site / file).write_text(text)
    found = complaints(site)
    assert any(told in each for each in found), found


def test_a_folder_without_pages_is_no_site(tmp_path):
    assert complaints(tmp_path) == [f"{tmp_path}: no pages (*.html) here; run: make docs"]
