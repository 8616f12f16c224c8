"""JSON Schemas that viewers understand: no references, no ``anyOf``."""

import json
from functools import cache
from inspect import cleandoc
from types import ModuleType
from typing import Any

import msgspec

from tis.common.messages import Message


@cache
def flat_schema(model: type[Message]) -> bytes:
    """Return the model's JSON Schema with definitions inlined and ``X | None`` written as ``X``."""
    (schema,), definitions = msgspec.json.schema_components([model], ref_template="{name}")
    return json.dumps(_inline(schema, definitions)).encode()


def prepare_schemas(module: ModuleType) -> None:
    """Compute the schemas of all models of a module in advance: each takes milliseconds, too long for a tick."""
    for value in vars(module).values():
        if isinstance(value, type) and issubclass(value, Message) and value is not Message:
            flat_schema(value)


def _inline(node: Any, definitions: dict[str, Any]) -> Any:
    if isinstance(node, list):
        return [_inline(item, definitions) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:  # what a field says of itself stands before what its model says
        own = {key: value for key, value in node.items() if key != "$ref"}
        return _inline(definitions[node["$ref"]] | own, definitions)
    # X | None becomes X; its description and other keywords stay, a default null goes.
    if "anyOf" in node:
        chosen = next(branch for branch in node["anyOf"] if branch.get("type") != "null")
        rest = {key: value for key, value in node.items() if key not in ("anyOf", "default")}
        return _inline(chosen | rest, definitions)
    if "enum" in node and "type" not in node:  # Foxglove reads no field without a type; all of ours are words
        node = {"type": "string"} | node
    if isinstance(node.get("description"), str):  # a docstring as it stands in the code
        node = node | {"description": cleandoc(node["description"])}
    return {key: _inline(value, definitions) for key, value in node.items()}
