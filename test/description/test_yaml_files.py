"""YAML from anywhere: what is read, and what is refused with its line before it costs anything."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from rotary_error_monitor.description.yaml_files import DEEPEST, MOST_BYTES, MOST_NODES, parse_yaml, read_yaml
from rotary_error_monitor.errors import InputError

ROOT = Path(__file__).parents[2]
SHIPPED = sorted([*(ROOT / "config").rglob("*.yaml"), *(ROOT / "msg_defs").glob("*.yaml")])
TEN = ",".join(["*{0}"] * 10)
LAUGHS = "a: &a [1]\n" + "".join(f"{b}: &{b} [{TEN.format(a)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_files_are_read_as_any_yaml_reader_reads_them(path: Path) -> None:
    found = read_yaml(path)
    assert found.content == yaml.safe_load(path.read_text(encoding="utf-8"))
    assert found.text == path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "content"),
    [
        ("", None),
        ("# nothing\n", None),
        ("[1, -2, 1.5, .5, 1.0e-6, -1.0E+3]", [1, -2, 1.5, 0.5, 1e-6, -1e3]),
        ("[~, null, true, off, a, 'b', 1e-6]", [None, None, True, False, "a", "b", "1e-6"]),
        ("{1: a, yes: b, ~: c, 2020-01-01: d}", {"1": "a", "yes": "b", "~": "c", "2020-01-01": "d"}),
        ("[2026-11-21, 2020-13-45, =, 2026-11-21T10:00:00]", ["2026-11-21", "2020-13-45", "=", "2026-11-21T10:00:00"]),
        ("a: &x {k: [1]}\nb: *x\nc: {<<: *x, l: 3}", {"a": {"k": [1]}, "b": {"k": [1]}, "c": {"k": [1], "l": 3}}),
    ],
)  # fmt: skip
def test_what_is_read(text: str, content: Any) -> None:
    assert parse_yaml(text, "here").content == content


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: !!python/object:os.system {}", "here:2: tag tag:yaml.org,2002:python/object:os.system: tags"),
        ("a: 1\nb: !mine 1", "here:2: tag !mine: tags are not read; write the value without one"),
        ("a: !!int abc", "here:1: tag tag:yaml.org,2002:int: tags"),
        ("a: !!timestamp abc", "here:1: tag"),
        ("a: ! 1", "here:1: tag"),
        ("!!map {a: 1}", "here:1: tag"),
        ("a:\n  - " + "9" * 5000, "here:2: a number of 5000 characters; expected at most 64"),
        ("a: " + "9" * 65 + ".0", "here:1: a number of 67 characters"),
        ("a: .nan", "here:1: .nan is no finite number"),
        ("a: -.INF", "here:1: -.INF is no finite number"),
        ("a: 1\nb: 1.0e+999", "here:2: 1.0e[+]999 is no finite number"),
        ("a: 12:30", "here:1: YAML takes 12:30 for a number that is not decimal; write 1234 or 1.0e-6, or quote it"),
        ("a: 0o17\nb: 017", "here:2: YAML takes 017"),
        ("a: 0x1F", "here:1: YAML takes 0x1F"),
        ("a: 1_000", "here:1: YAML takes 1_000"),
        ("a: &x [*x]", r"here:1: \*x stands within what it names"),
        ("&x a: 1\nb: &y {c: {d: *y}}", r"here:2: \*y stands within what it names"),
        ("a: *x", "here:1: no valid YAML: found undefined alias"),
        (LAUGHS, "here:6: more than 100000 keys and values, aliases resolved"),
        ("[" * 100_000, f"here:1: (nested more than {DEEPEST} deep|.*maximum nesting depth)"),  # libyaml has one too
        ("- " * 100_000, f"here:1: (nested more than {DEEPEST} deep|.*maximum nesting depth)"),
        ("\n".join(" " * i + "a:" for i in range(2000)), f"here:{DEEPEST + 1}: nested more than {DEEPEST} deep"),
        ("[" + "a," * (MOST_NODES + 1) + "]", f"here:1: more than {MOST_NODES} keys and values"),
        ("a: 1\na: 2", "here:2: key 'a' stands twice; keep one"),
        ("{1: a, '1': b}", "here:1: key '1' stands twice"),
        ("b: {c: 1,\n c: 2}", "here:2: key 'c' stands twice"),
        ("? [a]\n: b", "here:1: a list or mapping as a key; expected a name"),
        ("? {a: 1}\n: b", "here:1: a list or mapping as a key"),
        ("a: [1, 2\n", "here:2: no valid YAML: "),
        ("a: 1\n\tb: 2", "here:2: no valid YAML: "),
        ("a: 1\n---\nb: 2", "here:2: no valid YAML: expected a single document"),
        ('a: "\x00"', "here:1: no valid YAML: "),
        ("{<<: 1}", "here:1: no valid YAML: "),
        ("? " + "k" * 9000 + "\n? " + "k" * 9000, "here:2: key 'k{100} … k{100}' stands twice"),
    ],
)  # fmt: skip
def test_what_is_refused(text: str, message: str) -> None:
    began = time.process_time()
    with pytest.raises(InputError, match=message) as error:
        parse_yaml(text, "here")
    assert len(str(error.value)) < 600 and "\n" not in str(error.value)
    assert time.process_time() - began < 2.0


def test_a_few_laughs_are_read() -> None:
    """Aliases are bounded, not forbidden: ten thousand values of a hundred written ones."""
    content = parse_yaml("\n".join(LAUGHS.splitlines()[:4]), "here").content
    assert content["d"][9][9][9] == [1]


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # takes no disk
    with pytest.raises(InputError, match=rf"large.yaml: larger than {MOST_BYTES} bytes; a YAML file is expected"):
        read_yaml(path)


def test_what_is_no_file_is_named(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero"), tmp_path / "none", tmp_path / "z\0"):
        with pytest.raises(InputError, match=r"cannot be read .*; give the path of a YAML file"):
            read_yaml(path)
    (tmp_path / "latin").write_bytes("größe: 1".encode("latin-1"))
    with pytest.raises(InputError, match=r"latin: cannot be read .*utf-8"):
        read_yaml(tmp_path / "latin")
