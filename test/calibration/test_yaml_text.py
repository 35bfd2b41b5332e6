"""What is not meant stays byte for byte: random edits of all shipped files, as they are and as others write them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.calibration.yaml_text import LOADER, CannotChangeError, YamlRows, YamlText
from rotary_error_monitor.resources import share

FILES = ["stage.yaml", "machines/pan2013.yaml", "machines/xyzac_trt.yaml", "machines/grinder_zhou2023.yaml"]
SHIPPED = {name: (share() / "config" / name).read_text(encoding="utf-8") for name in FILES}
NUMBER = re.compile(r"(?<![\w.'\"])-?\d+\.\d+(e[-+]\d+)?(?![\w.])")


def odd_numbers(text: str) -> str:
    """The same numbers as people write them: 1.50E-06, +3.00, 0.001_000."""
    found = iter(range(10**6))

    def other(match: re.Match[str]) -> str:
        value, mantissa = match.group(), match.group().partition("e")[0]
        return {0: value, 1: value.replace(mantissa, mantissa + "00").replace("e", "E"), 2: value.replace(".", "._")}[
            next(found) % 3
        ]

    return "\n".join(line if "#" in line else NUMBER.sub(other, line) for line in text.split("\n"))


def commented(text: str) -> str:
    """A comment with tabs behind every line that ends an entry, one before it, and empty lines."""
    lines = []
    for line in text.split("\n"):
        if line and "#" not in line and not line.rstrip().endswith(","):
            lines += [f"# before\t{len(lines)}", f"{line}  # beside\tit, {len(lines)}: {{}}", "", "   # indented"]
        else:
            lines.append(line)
    return "\n".join(lines)


def dumped(text: str, flow: bool | None, indent: int) -> str:
    return yaml.safe_dump(yaml.safe_load(text), default_flow_style=flow, indent=indent, sort_keys=False, width=200)


def anchored(text: str) -> str:
    """Two lists that stand in the file by a name only, and one mapping that is merged in."""
    base = "spare: &bow [0.0, 0.0, 1.25e-06] # a bow\nplain: &plain {noise: 0.5, more: {of: it}}\n"
    return base + text + "other: {bow: *bow}\nmerged:\n  <<: *plain\n  own: 1 # its own\n"


WAYS = {
    "as it is": lambda text: text,
    "crlf": lambda text: text.replace("\n", "\r\n"),
    "cr": lambda text: text.replace("\n", "\r"),
    "mark": lambda text: "\ufeff" + text,
    "no last line break": lambda text: text.rstrip("\n"),
    "document": lambda text: "%YAML 1.1\n---\n" + text + "...\n",
    "numbers": odd_numbers,
    "comments": commented,
    "comments, crlf": lambda text: commented(text).replace("\n", "\r\n"),
    "block": lambda text: dumped(text, False, 2),
    "block, wide": lambda text: dumped(text, False, 5),
    "mixed": lambda text: dumped(text, None, 2),
    "flow": lambda text: dumped(text, True, 2),
    "one long line": lambda text: yaml.safe_dump(yaml.safe_load(text), default_flow_style=True, width=10**6),
    "quoted keys": lambda text: re.sub(r"^( *)([a-zA-Z_]+):", r'\1"\2" :', text, flags=re.MULTILINE),
    "anchors": anchored,
}
TEXTS = {(name, way): change(text) for name, text in SHIPPED.items() for way, change in WAYS.items()}


def places(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if path:
        yield path
    for key, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(part, (*path, key))


def own_lines(text: str, path: tuple[str | int, ...]) -> range:
    """Lines, counted from 0, of the innermost entry in block style that `path` stands in."""
    node = yaml.compose(text, LOADER)
    first, last = 0, len(text.splitlines()) - 1
    for step in path:
        if isinstance(node, yaml.SequenceNode):
            if not isinstance(step, int) or step >= len(node.value):
                break
            start, value, block = node.value[step], node.value[step], not node.flow_style
        else:
            found = [(key, value) for key, value in node.value if key.value == step]
            if not found:
                break
            (start, value), block = found[0], not node.flow_style
        if block:
            first, last = start.start_mark.line, value.end_mark.line
            if isinstance(value, yaml.CollectionNode) and not value.flow_style:
                last = max(leaf.end_mark.line for leaf in leaves(value))
        node = value
    return range(first, last + 1)


def leaves(node: yaml.Node) -> Iterator[yaml.Node]:
    if isinstance(node, yaml.ScalarNode) or node.flow_style:
        yield node
        return
    for part in node.value:
        for child in part if isinstance(part, tuple) else (part,):
            yield from leaves(child)


def check_only_there(before: str, after: str, allowed: range, kept: bool) -> None:
    """All lines outside of those `allowed` stay as they are; where old ones are `kept`, lines are added only."""
    assert before.startswith("\ufeff") == after.startswith("\ufeff")
    assert set(re.findall("\r\n|\r|\n", after)) <= set(re.findall("\r\n|\r|\n", before))
    old, new = (text.removeprefix("\ufeff").splitlines(keepends=True) for text in (before, after))
    rest = len(old) - allowed.stop
    assert new[: allowed.start] == old[: allowed.start]
    assert new[len(new) - rest :] == old[allowed.stop :]
    if kept:
        bare = [[line.rstrip("\r\n") for line in lines] for lines in (old, new)]
        changes = difflib.SequenceMatcher(None, *bare, autojunk=False).get_opcodes()
        assert {kind for kind, *_ in changes} <= {"equal", "insert"}


VALUES = st.one_of(
    st.floats(-1e-2, 1e-2),
    st.lists(st.floats(-1e-2, 1e-2), max_size=60),
    st.builds(
        lambda rows: YamlRows({"table": {"positions": rows, "values": rows}}), st.lists(st.floats(-1, 1), max_size=60)
    ),
    st.builds(
        lambda rows: YamlRows([{"order": k, "cos": v, "sin": -v} for k, v in enumerate(rows)]),
        st.lists(st.floats(-1, 1), max_size=8),
    ),
    st.builds(
        lambda name, old: YamlRows(
            {"date": "2026-11-21", "source": name, "history": YamlRows([{"values": {"a.b": old}}])}
        ),
        st.text("abcXYZ µ-:#'\"{}[],&*!|>%@_.0123456789", max_size=40),
        st.lists(st.floats(-1, 1), max_size=30),
    ),
)


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(st.data())
def test_only_the_lines_of_what_is_set_change(data: st.DataObject) -> None:
    key = data.draw(st.sampled_from(sorted(TEXTS)))
    document = YamlText(TEXTS[key])
    for _ in range(data.draw(st.integers(1, 3))):
        before, content = document.text, document.content
        if not content:
            return
        path = data.draw(st.sampled_from(list(places(content))))
        kind = data.draw(st.sampled_from(["set", "set", "add", "remove"]))
        lines = own_lines(before.removeprefix("\ufeff"), path)
        try:
            if kind == "remove":
                if isinstance(path[-1], int):
                    continue
                on_a_dash = before.removeprefix("\ufeff").splitlines()[lines.start].lstrip().startswith("-")
                if on_a_dash or len(document.get(path[:-1])) == 1:  # the entry around it changes its form
                    lines = own_lines(before.removeprefix("\ufeff"), path[:-1])
                document.remove(path)
            elif kind == "set":
                document.set(path, data.draw(VALUES))
            else:
                while not isinstance(document.get(path), dict):
                    path = path[:-1]
                new = data.draw(st.sampled_from([("calibration", "EXX"), ("new",), ("a", "b", "c")]))
                if not isinstance(document.get((*path, new[0])), dict | None):
                    continue
                lines = own_lines(before.removeprefix("\ufeff"), (*path, *new))
                document.set((*path, *new), data.draw(VALUES))
        except CannotChangeError as error:
            assert key[1] == "anchors", error
            assert document.text == before
            return
        after = document.text
        assert yaml.load(after, LOADER) == document.content
        check_only_there(before, after, lines, kind == "add" and "block" in key[1] and before == TEXTS[key])


def test_a_new_entry_changes_no_line_in_block_style() -> None:
    before = TEXTS["machines/pan2013.yaml", "comments"]
    document = YamlText(before)
    document.set(("machine", "calibration", "EXX"), YamlRows({"date": "2026-11-21"}))
    added = [line for line in difflib.ndiff(before.splitlines(), document.text.splitlines()) if line[0] in "+-?"]
    assert added == ["+   calibration:", "+     EXX:", "+       date: '2026-11-21'"]


def test_the_comment_beside_an_old_value_goes_with_it() -> None:
    document = YamlText("a:\n  b: [1.0] # measured in 2019\n  # of c\n  c: 2 # stays\n")
    assert document.set(("a", "b"), [2.0]) == "# measured in 2019"
    assert document.text == "a:\n  b: [2.0]\n  # of c\n  c: 2 # stays\n"
    assert document.set(("a", "d"), 1) is None
    assert document.text.endswith("  c: 2 # stays\n  d: 1\n")


def test_what_another_place_needs_is_not_changed() -> None:
    text = "a: {x: &bow [1.0], y: *bow}\nb: {<<: &base {k: 1}}\nc: {<<: *base}\n"
    document = YamlText(text)
    with pytest.raises(CannotChangeError, match="line 1: what is to be changed is named &bow and used again"):
        document.set(("a", "x"), [2.0])
    document = YamlText(text)
    with pytest.raises(CannotChangeError, match=r"line 3: c.k is merged in"):
        document.remove(("c", "k"))
    document = YamlText(text)
    document.set(("a", "y"), [2.0])
    document.set(("c", "k"), 2)
    assert document.text == "a: {x: &bow [1.0], y: [2.0]}\nb: {<<: &base {k: 1}}\nc: {<<: *base, k: 2}\n"
    assert yaml.safe_load(document.text) == document.content


def test_a_part_of_what_stands_elsewhere_is_written_out() -> None:
    document = YamlText("base: &base {poly: [1.0], more: {a: 1}}\nx: *base\ny: {<<: *base}\n")
    document.set(("x", "poly"), [2.0])
    document.set(("y", "more", "a"), 3)
    assert yaml.safe_load(document.text) == document.content
    assert document.content["base"] == {"poly": [1.0], "more": {"a": 1}}
    assert document.content["x"] == {"poly": [2.0], "more": {"a": 1}}
    assert document.content["y"] == {"poly": [1.0], "more": {"a": 3}}
    document.remove(("x", "more"))
    assert document.text.startswith("base: &base {poly: [1.0], more: {a: 1}}\nx: {poly: [2.0]}\n")
