"""YAML files checked against a JSON schema; errors name file, line, value and what would be right."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError, best_match

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The safe loader, in C where PyYAML was built with libyaml: ten times as fast, felt at the start of every node."""


def load(path: Path | str, schema: str) -> dict[str, Any]:
    """Content of the YAML file `path`, valid by `config/schema/<schema>.yaml`.

    Raises:
        InputError: the file is missing, is no YAML, repeats a key, holds a non-finite number, or breaks the schema.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); give the path of a YAML file") from error
    try:
        node = yaml.compose(text, LOADER)
        content = yaml.load(text, LOADER)
    except yaml.YAMLError as error:
        raise InputError(f"{path}: no valid YAML: {error}") from error
    if node is None:
        raise InputError(f"{path}: the file is empty; a {schema} description is expected")
    _check_keys_once(node, path)
    check(content, schema, str(path), node)
    assert isinstance(content, dict)
    return content


def check(content: object, schema: str, origin: str, node: yaml.Node | None = None) -> None:
    """Hold `content` against the schema; `origin` and the YAML `node` say in the message where it came from.

    Raises:
        InputError: naming origin, line, place, value and what is expected there.
    """
    error = best_match(_validator(schema).iter_errors(content))
    if error is not None:
        raise InputError(_message(error, origin, node))


def section(content: dict[str, Any], name: str, origin: str) -> dict[str, Any]:
    """The mapping under key `name`.

    Raises:
        InputError: there is none; the message lists the sections that are there.
    """
    found = content.get(name)
    if not isinstance(found, dict):
        raise InputError(f"{origin}: no section '{name}'; it has {sorted(map(str, content)) or 'nothing'}")
    return found


def locate(path: Path | str, place: list[str | int]) -> str:
    """`file:line: key.key` of a `place` in the YAML file `path`, to begin a message about its value with."""
    node = yaml.compose(Path(path).read_text(encoding="utf-8"), LOADER)
    return f"{path}:{_line(node, place)}: {'.'.join(map(str, place))}"


@functools.cache
def _validator(schema: str) -> Draft202012Validator:
    with config(f"schema/{schema}.yaml").open(encoding="utf-8") as file:
        return Draft202012Validator(yaml.load(file, LOADER))


def _message(error: ValidationError, origin: str, node: yaml.Node | None) -> str:
    place = ".".join(map(str, error.absolute_path)) or "(top level)"
    line = _line(node, list(error.absolute_path))
    where = f"{origin}:{line}" if line else origin
    expected = error.schema.get("description") if isinstance(error.schema, dict) else None
    if isinstance(error.instance, str) and _is_number(error.instance):
        expected = "a number; YAML takes 1e-6 for text, write 1.0e-6"
    return f"{where}: {place}: {error.message}" + (f"; expected: {expected}" if expected else "")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _line(node: yaml.Node | None, path: list[str | int]) -> int | None:
    """Line of the deepest node of `path`, counted from 1."""
    if node is None:
        return None
    line = node.start_mark.line + 1
    for step in path:
        if isinstance(node, yaml.MappingNode):
            pair = next(((key, value) for key, value in node.value if key.value == str(step)), None)
            if pair is None:
                break
            line, node = pair[0].start_mark.line + 1, pair[1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
            node = node.value[step]
            line = node.start_mark.line + 1
    return int(line)


def _check_keys_once(node: yaml.Node, path: Path) -> None:
    """YAML readers keep the last of two equal keys in silence; here that is an error, and so is `.nan`."""
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            if key.value in seen:
                raise InputError(f"{path}:{key.start_mark.line + 1}: key '{key.value}' stands twice; keep one")
            seen.add(key.value)
            _check_keys_once(value, path)
    elif isinstance(node, yaml.SequenceNode):
        for value in node.value:
            _check_keys_once(value, path)
    elif node.tag == "tag:yaml.org,2002:float" and node.value.lower().lstrip("+-") in (".nan", ".inf"):
        raise InputError(f"{path}:{node.start_mark.line + 1}: {node.value} is no finite number")
