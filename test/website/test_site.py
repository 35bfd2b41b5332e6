"""The site's pages before they are built: each node, topic and parameter is there, and links lead somewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from checkout import node_names
from website.flowcharts import BLOCK, parse

ROOT = Path(__file__).parents[2]
WITHOUT_SECTION = {"mock_controller", "stage_follower"}
"""Nodes that `config/cell.yaml` does not start."""

LINK = re.compile(r"\]\(([^)\s]+)\)")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """All pages as mkdocs gets them, by their path."""
    folder = tmp_path_factory.mktemp("site")
    environment = {
        **os.environ,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
        "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'doc'}",
    }
    command = [sys.executable, "-W", "error::UserWarning", "-m", "website.staging", str(folder)]
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    return folder


def text(pages, name):
    return (pages / "pages" / name).read_text(encoding="utf-8")


def unfenced(markdown):
    return re.sub(r"```.*?```", "", markdown, flags=re.DOTALL)


def anchors(markdown):
    """Those of the headings, as the site's reader of Markdown makes them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", unfenced(markdown), re.MULTILINE):
        given = re.search(r"\{#([\w-]+)\}", heading)
        words = re.sub(r"[^\w\s-]", "", re.sub(r"[`*]|\[|\]\([^)]*\)", "", heading)).strip().lower()
        found.add(given[1] if given else re.sub(r"[-\s]+", "-", words))
    return found


def navigation(entries):
    for entry in entries:
        for value in entry.values():
            yield from navigation(value) if isinstance(value, list) else [value]


@pytest.mark.parametrize("node", node_names())
def test_each_node_has_a_page_with_all_that_a_cell_may_set(node, pages):
    """`config/cell.yaml` shows the parameters with their defaults, written apart from the nodes."""
    content = yaml.safe_load((ROOT / "config" / "cell.yaml").read_text(encoding="utf-8"))
    page = text(pages, f"nodes/{node}.md")
    rows = dict(re.findall(r"^\| `([\w.]+)` \| \w+ \| (\S+|`[^`]*`) \|", page, re.MULTILINE))
    assert {"autostart", "security", "stage"} <= set(rows)
    sections = [key for key in content if re.fullmatch(rf"{node}(_[a-z]+)?", key.split("/")[-1])]
    assert sections or node in WITHOUT_SECTION
    shown = {name for key in sections for name in flat(content[key]["ros__parameters"])}
    code = (ROOT / "rotary_error_monitor" / "nodes" / f"{node}.py").read_text(encoding="utf-8")
    assert shown | set(re.findall(r'Setting\(\s*"([\w.]+)"', code)) <= set(rows)
    for line in page.splitlines():
        if line.startswith("| `"):
            assert all(cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:4]), line


def flat(tree, prefix=""):
    """Parameters by their dotted names."""
    found = {}
    for key, value in tree.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def test_topics_are_told_with_all_their_fields(pages):
    page = text(pages, "nodes/topics.md")
    count = 0
    for path in sorted((ROOT / "msg_defs").glob("*.yaml")):
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        for key, topic in content.get("topics", {}).items():
            part = page.partition(f"## `{topic['name']}` {{#{key}}}\n")[2].partition("\n## ")[0]
            assert f"`{topic['type']}`" in part, key
            for field in topic.get("columns", topic.get("fields")):
                assert f"| `{field['name']}` | {field['unit']} |" in part, (key, field)
            for node in {*topic["publishers"], *topic.get("subscribers", ())} & set(node_names()):
                assert f"topics.md#{key})" in text(pages, f"nodes/{node}.md"), (key, node)
            count += 1
        for service in content.get("services", {}).values():
            for node in service["servers"]:
                assert f"| `{service['name']}` |" in text(pages, f"nodes/{node}.md")
                assert f"`/{node}{service['name'][1:]}`" in page
    assert count > 20


def test_every_module_is_in_the_reference(pages):
    told = {
        name
        for path in (pages / "pages" / "api").glob("*.md")
        for name in re.findall(r"^::: (\S+)$", path.read_text(), re.M)
    }
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in (ROOT / "rotary_error_monitor").rglob("*.py")
        if path.name != "__init__.py"
    }
    assert modules - told == set()
    assert "::: rotary_error_monitor\n" in text(pages, "api/package.md"), "what notebooks import from it"


def test_every_page_is_in_the_navigation_and_is_there(pages):
    told = set(navigation(yaml.safe_load((pages / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    assert all((pages / "pages" / name).is_file() for name in told)
    written = {path.relative_to(pages / "pages").as_posix() for path in (pages / "pages").rglob("*.md")}
    assert {name for name in written - told if not name.endswith("/index.md")} == set()


def test_every_link_and_anchor_is_there(pages):
    checked = 0
    for path in sorted((pages / "pages").rglob("*.md")):
        for link in LINK.findall(unfenced(path.read_text(encoding="utf-8"))):
            if "://" in link:
                continue
            name, _, anchor = link.partition("#")
            target = path.parent / name if name else path
            assert target.is_file(), f"{path.name}: {link}"
            if anchor:
                assert anchor in anchors(target.read_text(encoding="utf-8")), f"{path.name}: {link}"
            checked += 1
    assert checked > 300


def test_code_stays_as_it_is_written(pages):
    count = 0
    for path in sorted((ROOT / "doc").glob("*.md")):
        blocks = re.findall(r"```.*?```", path.read_text(encoding="utf-8"), re.DOTALL)
        assert blocks == re.findall(r"```.*?```", text(pages, f"doc/{path.name}"), re.DOTALL)
        count += len(blocks)
    assert count > 30


def test_flowcharts_can_be_drawn():
    blocks = [
        block
        for path in (ROOT / "README.md", *(ROOT / "doc").glob("*.md"))
        for block in BLOCK.findall(path.read_text())
    ]
    assert len(blocks) >= 2
    for block in blocks:
        chart = parse(block)
        assert len(chart.arrows) >= block.count("-->")
        assert {name for a, b, _ in chart.arrows for name in (a, b)} == set(chart.labels)


def test_a_flowchart_is_read():
    chart = parse('flowchart LR\n  a[one × 4] -- told --> b & c\n  b --> d\n  c -- "x, y" --> d\n')
    assert chart.labels == {"a": "one × 4", "b": "b", "c": "c", "d": "d"}
    assert chart.arrows == [("a", "b", "told"), ("a", "c", "told"), ("b", "d", ""), ("c", "d", "x, y")]
    with pytest.raises(ValueError, match="sequenceDiagram"):
        parse("sequenceDiagram\n a-->b")
    with pytest.raises(ValueError, match="no name"):
        parse("flowchart LR\n a --> {b}")
