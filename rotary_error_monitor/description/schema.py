"""YAML files checked against a JSON schema; errors name file, line, value and what would be right."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError, best_match

from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.resources import config

_MANY = 10
"""Entries of a list that is too long, above which their number says more than they themselves."""


def load(path: Path | str, schema: str) -> dict[str, Any]:
    """Content of the YAML file `path`, valid by `config/schema/<schema>.yaml`.

    Raises:
        InputError: what `read_yaml` raises, or the file is empty or breaks the schema.
    """
    found = read_yaml(Path(path))
    if found.node is None:
        raise InputError(f"{path}: the file is empty; a {schema} description is expected")
    check(found.content, schema, str(path), found.node)
    assert isinstance(found.content, dict)
    return found.content


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
    return f"{path}:{_line(read_yaml(Path(path)).node, place)}: {'.'.join(map(str, place))}"


def schema_content(schema: str) -> dict[str, Any]:
    """A schema as it stands in `config/schema/`, with the kinds of sensor that have a file of their own there."""
    path = config(f"schema/{schema}.yaml")
    content: dict[str, Any] = read_yaml(path).content
    if "sensor" in content.get("$defs", {}):
        content["$defs"]["sensor"] = _of_kinds(content["$defs"]["sensor"])
    return content


@functools.cache
def sensor_kinds() -> Mapping[str, Mapping[str, Any]]:
    """Content of `config/schema/sensors/<kind>.yaml` of each kind of listed sensor.

    `required` and `properties` beside and in the place of those that all kinds state, `false` without one; `fields` of
    a sample and their SI `unit`, which are one displacement in m where the file names none; `input: true` of a kind
    that measures what acts on the stage, and nothing of how the rotor stands.
    """
    folder = config("schema/stage.yaml").parent / "sensors"
    return {path.stem: read_yaml(path).content for path in sorted(folder.glob("*.yaml"))}


@functools.cache
def _validator(schema: str) -> Draft202012Validator:
    return Draft202012Validator(schema_content(schema))


def _of_kinds(common: dict[str, Any]) -> dict[str, Any]:
    """Schema of a sensor of any kind that has a file: what all state, and what its own file says."""
    kinds = sensor_kinds()
    stated = {
        kind: {n: p for n, p in (common["properties"] | own["properties"]).items() if p} for kind, own in kinds.items()
    }
    known = {"enum": list(kinds), "description": f"one of {', '.join(kinds)}"}
    choices = [
        {
            "if": {"properties": {"kind": {"const": kind}}},
            "then": {
                "type": "object",
                "additionalProperties": False,
                "description": f"of kind {kind}: {', '.join(stated[kind])}",
                "required": ["kind", *common["required"], *own["required"]],
                "properties": {"kind": {"const": kind}, **stated[kind]},
            },
        }
        for kind, own in kinds.items()
    ]
    # without its kind nothing else of a sensor can be judged
    return {
        "type": "object",
        "required": ["kind"],
        "properties": {"kind": known},
        "if": {"properties": {"kind": known}, "required": ["kind"]},
        "then": {"allOf": choices},
    }


def _message(error: ValidationError, origin: str, node: yaml.Node | None) -> str:
    place = excerpt(".".join(map(str, error.absolute_path))) or "(top level)"
    line = _line(node, list(error.absolute_path))
    where = f"{origin}:{line}" if line else origin
    expected = error.schema.get("description") if isinstance(error.schema, dict) else None
    if isinstance(error.instance, str) and _is_number(error.instance):
        expected = "a number; YAML takes 1e-6 for text, write 1.0e-6"
    problem = excerpt(error.message)
    if error.validator == "maxItems" and isinstance(error.instance, list) and len(error.instance) > _MANY:
        problem = f"{len(error.instance)} entries"
    return f"{where}: {place}: {problem}" + (f"; expected: {expected}" if expected else "")


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
