"""Lay out the pages of the site: those of the repository, and those that are made of code.

    python -m website.staging FOLDER

The folder mirrors the repository, so that links between files stay as they are written.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from website.nodes import ROOT, node_pages, node_text, topics_text

PACKAGE = ROOT / "rotary_error_monitor"
TOP = ("README.md", "SECURITY.md", "QUALITY_DECLARATION.md")
LINK = re.compile(r"(\]\()([^)\s#]*)(#[^)\s]*)?(\))")
_CHANGES = "CHANGELOG.rst", "CHANGELOG.md"
_FENCED = re.compile(r"(^```.*?^```)", re.DOTALL | re.MULTILINE)


class Staging:
    """The folder of pages as it grows.

    Attributes:
        pages: folder of the pages, below which the tree is that of the repository.
    """

    def __init__(self, folder: Path) -> None:
        """Begin with an empty folder `pages` in `folder`."""
        self.pages = folder / "pages"
        if self.pages.exists():
            shutil.rmtree(self.pages)
        self.pages.mkdir(parents=True)

    def write(self, name: str, text: str) -> None:
        """Write a page by its path below `pages`."""
        target = self.pages / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")

    def page(self, name: str) -> None:
        """Take a Markdown page of the repository, with all files that it links to."""
        text = (ROOT / name).read_text(encoding="utf-8")
        self.write(name, self.linked(nested(text), ROOT / name))

    def linked(self, text: str, page: Path) -> str:
        """Text of a page with links that the site can follow; what is linked to is taken along.

        Raises:
            FileNotFoundError: a link leads nowhere.
        """

        def replaced(match: re.Match[str]) -> str:
            opened, target, anchor, closed = (part or "" for part in match.groups())
            if "://" in target or not target:
                return match[0]
            path = (page.parent / target).resolve()
            if not path.exists():
                raise FileNotFoundError(f"{page.relative_to(ROOT)}: link to {target}, which is not there")
            if path.is_dir():
                self._list(path)
                target = f"{target.rstrip('/')}/index.md"
            elif path == ROOT / _CHANGES[0]:
                target = target.replace(*_CHANGES)
            elif path.suffix != ".md":
                self._copy(path)
            return f"{opened}{target}{anchor}{closed}"

        return LINK.sub(replaced, text)

    def _copy(self, path: Path) -> None:
        target = self.pages / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)

    def _list(self, folder: Path) -> None:
        files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix != ".md")
        for path in files:
            self._copy(path)
        name = folder.relative_to(ROOT).as_posix()
        rows = "\n".join(f"- [{path.name}]({path.name})" for path in files)
        self.write(f"{name}/index.md", f"# {name}\n\n{rows}\n")


def nested(text: str) -> str:
    """Markdown whose nested lists are indented by four, as the site's reader of Markdown asks."""
    parts = _FENCED.split(text)  # every other one is code, which stays as it is
    parts[::2] = [re.sub(r"^ {2,3}(?=- )", "    ", part, flags=re.MULTILINE) for part in parts[::2]]
    return "".join(parts)


def changes_text() -> str:
    """The changelog in Markdown."""
    text = (ROOT / _CHANGES[0]).read_text(encoding="utf-8").replace("``", "`")
    text = re.sub(r"^(\^+)\n(.*)\n\1\n", r"# \2\n", text)
    return re.sub(r"^(.+)\n-{3,}\n", r"## \1\n\n", text, flags=re.MULTILINE)


def api_pages() -> Iterable[tuple[str, str]]:
    """Name and text of each page of the API, a room a page; mkdocstrings fills them from docstrings."""
    own = sorted(path for path in PACKAGE.glob("*.py") if path.stem != "__init__")
    rooms = {path.parent.name: path.parent for path in sorted(PACKAGE.glob("*/__init__.py"))}
    pages = {"package": [PACKAGE / "__init__.py", *own]}
    pages |= {
        name: sorted(p for p in room.rglob("*.py") if p.name != "__init__.py" or p.parent == room)
        for name, room in rooms.items()
    }
    for name, files in pages.items():
        modules = (".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in files)
        yield name, f"# {name}\n\n" + "".join(f"::: {module}\n\n" for module in modules)


def settings(nodes: Iterable[str], rooms: Iterable[str]) -> dict[str, Any]:
    """Settings of mkdocs, with the pages that are made in its navigation."""
    found: dict[str, Any] = yaml.safe_load((Path(__file__).parent / "mkdocs.yml").read_text(encoding="utf-8"))
    made = {
        "Nodes": [{"Topics and services": "nodes/topics.md"}, *({name: f"nodes/{name}.md"} for name in nodes)],
        "API": [{name: f"api/{name}.md"} for name in rooms],
    }
    for entry in found["nav"]:
        (name,) = entry
        entry[name] = made.get(name, entry[name])
    (plugin,) = (entry for entry in found["plugins"] if isinstance(entry, dict))
    plugin["mkdocstrings"]["handlers"]["python"]["paths"] = [str(ROOT)]
    return found


def stage(folder: Path) -> None:
    """Write all pages and the settings of mkdocs below `folder`."""
    staging = Staging(folder)
    for name in (*TOP, *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "doc").glob("*.md"))):
        staging.page(name)
    staging.write(_CHANGES[1], changes_text())
    staging.write("nodes/topics.md", topics_text())
    nodes = {page.name: node_text(page) for page in node_pages()}
    for name, text in nodes.items():
        staging.write(f"nodes/{name}.md", text)
    rooms = dict(api_pages())
    for name, text in rooms.items():
        staging.write(f"api/{name}.md", text)
    written = yaml.safe_dump(settings(nodes, rooms), sort_keys=False, allow_unicode=True)
    (folder / "mkdocs.yml").write_text(written, encoding="utf-8")


if __name__ == "__main__":
    stage(Path(sys.argv[1]).resolve())
