"""Whatever a schema of the package allows, drawn by hypothesis."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from rotary_error_monitor.description.schema import schema_content

Schema = dict[str, Any]


def load(name: str) -> Schema:
    return schema_content(name)


def contents(schema: Schema, root: Schema | None = None) -> st.SearchStrategy[Any]:
    """Contents that the schema allows, for the words of it that the package's schemas use.

    What a schema says across keys (`oneOf`, `if`) is met by drawing one of its cases.
    """
    root = schema if root is None else root
    if "$ref" in schema:
        return st.deferred(lambda: contents(_resolved(schema["$ref"], root), root))
    if "if" in schema:
        then, other = (schema.get(word, {}) for word in ("then", "else"))
        if "allOf" in then:  # a sensor of one of several kinds
            return st.one_of([contents(case["then"], root) for case in then["allOf"]])
        if "$ref" in then:
            return contents(then, root) | contents(other, root)
        return _by_type(schema, root)  # a topic: of sample blocks and of others
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if "const" in schema:
        return st.just(schema["const"])
    if "not" in schema:
        drawn = contents({key: value for key, value in schema.items() if key != "not"}, root)
        return drawn.filter(Draft202012Validator({"not": schema["not"]}).is_valid)
    kinds = schema.get("type", "object")
    if isinstance(kinds, list):
        return st.one_of([contents(schema | {"type": kind}, root) for kind in kinds])
    return _KINDS[kinds](schema, root)


def _resolved(reference: str, root: Schema) -> Schema:
    found: Any = root
    for step in reference.removeprefix("#/").split("/"):
        found = found[step]
    return dict(found)


def _by_type(schema: Schema, root: Schema) -> st.SearchStrategy[Any]:
    rest = {key: value for key, value in schema.items() if key not in ("if", "then", "else")}

    def case(part: Schema, other: str) -> st.SearchStrategy[Any]:
        properties = {name: value for name, value in rest["properties"].items() if name != other}
        if part["required"] == ["columns"]:
            properties["type"] = {"const": "sensor_msgs/msg/PointCloud2"}
        return contents(rest | {"properties": properties, "required": [*rest["required"], *part["required"]]}, root)

    return case(schema["then"], "fields") | case(schema["else"], "columns")


def _object(schema: Schema, root: Schema) -> st.SearchStrategy[Any]:
    properties = dict(schema.get("properties", {}))
    if "oneOf" in schema:  # a table: values, or forward and backward
        cases = [set(each["required"]) for each in schema["oneOf"]]
        every = set().union(*cases)
        return st.one_of([
            _object({
                **{key: value for key, value in schema.items() if key != "oneOf"},
                "properties": {name: value for name, value in properties.items() if name not in every - case},
                "required": [*schema.get("required", ()), *case],
            }, root)
            for case in cases
        ])  # fmt: skip
    required = set(schema.get("required", ()))
    known = {name: contents(part, root) for name, part in properties.items() if part is not False}
    fixed = st.fixed_dictionaries(
        {name: known[name] for name in known if name in required},
        optional={name: known[name] for name in known if name not in required},
    )
    more = schema.get("additionalProperties", {})
    if more is False or (properties and not isinstance(more, dict)):
        return _filled(fixed, schema)
    if properties or not isinstance(more, dict) or not more:
        return _filled(fixed, schema)
    names = contents({"type": "string", **schema.get("propertyNames", {"pattern": "^[a-z]+$"})}, root)
    size = {"min_size": schema.get("minProperties", 0), "max_size": min(schema.get("maxProperties", 6), 6)}
    return st.dictionaries(names, contents(more, root), **size)


def _filled(drawn: st.SearchStrategy[Any], schema: Schema) -> st.SearchStrategy[Any]:
    least = schema.get("minProperties", 0)
    return drawn.filter(lambda found: len(found) >= least) if least else drawn


def _array(schema: Schema, root: Schema) -> st.SearchStrategy[Any]:
    least = schema.get("minItems", 0)
    most = min(schema.get("maxItems", least + 3), least + 3)
    items = contents(schema.get("items", {"type": "object"}), root)
    return st.lists(items, min_size=least, max_size=most, unique=schema.get("uniqueItems", False))


def _number(schema: Schema, root: Schema) -> st.SearchStrategy[Any]:
    low, high = schema.get("minimum", schema.get("exclusiveMinimum")), schema.get("maximum")
    floats = st.floats(low, high, allow_nan=False, allow_infinity=False, exclude_min="exclusiveMinimum" in schema)
    ordinary = st.floats(-1e3, 1e3).filter(lambda x: (low is None or x > low) and (high is None or x <= high))
    if low is not None and high is not None and low <= 0 <= high:
        ordinary = st.floats(low / 100, high / 100, exclude_min="exclusiveMinimum" in schema)
    return ordinary | floats


def _integer(schema: Schema, root: Schema) -> st.SearchStrategy[Any]:
    return st.integers(schema.get("minimum"), schema.get("maximum"))


def _string(schema: Schema, root: Schema) -> st.SearchStrategy[Any]:
    if "pattern" in schema:
        pattern = schema["pattern"].removesuffix("$") + r"\Z"  # $ alone lets a line break follow
        return st.from_regex(pattern, alphabet=st.characters(codec="ascii") | st.just("°"))
    return st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=schema.get("minLength", 0))


_KINDS = {
    "object": _object,
    "array": _array,
    "number": _number,
    "integer": _integer,
    "string": _string,
    "boolean": lambda schema, root: st.booleans(),
    "null": lambda schema, root: st.none(),
}
