"""Page of ``summary.json``: its keys and their meaning, from the JSON schema of its models."""

from collections.abc import Iterator
from typing import Any, Final

from from_code.markdown import code, prose, table, unit_of
from from_code.sources import Summary

_HEAD: Final = """# summary.json

The figures of a run. The keys are an interface: they keep their meaning from version to version. `tis summarize
--schema` prints the JSON schema that these tables are made from. Capitals stand for names: of a direction (`forward`,
`feedback`), a hand, an estimator, a side, a key. *Statistics* are an object with the keys listed. `null` stands for a
figure that cannot be known, such as one of a log that is missing; an *optional* key is absent where a run has no such
thing.
"""
_TYPES: Final = {"integer": "integer", "number": "number", "string": "text", "boolean": "boolean", "null": "null"}
_HEADS: Final = ("key", "type", "unit", "meaning")

Schema = dict[str, Any]


def page() -> str:
    """Return the page: the run's own keys, then a section for each key that holds others."""
    schema = Summary.model_json_schema()
    rows = {name: list(_rows(schema, part, name)) for name, part in schema["properties"].items()}
    parts = [_HEAD, "## The run", "", table(_HEADS, [found[0] for found in rows.values() if len(found) == 1]), ""]
    for name, found in rows.items():
        if len(found) > 1:
            parts += [f"## {name}", "", found[0][3], "", table(_HEADS, found[1:]), ""]
    return "\n".join(parts)


def _rows(schema: Schema, part: Schema, path: str) -> Iterator[tuple[str, str, str, str]]:
    """Yield the row of a key, and those of the keys below it."""
    below, further, kinds = _below(schema, part)
    optional = "optional " if "default" in part else ""
    last = path.rpartition(".")[2]
    unit = unit_of(last) or next((unit_of(one) for one in reversed(path.split(".")[:-1]) if unit_of(one)), "")
    shown = optional + " or ".join(kinds)
    wordy = not {"number", "list"} & {word for kind in kinds for word in kind.replace(":", " ").split()}
    unit = "" if wordy and not unit_of(last) and "statistics" not in shown else unit
    yield code(path), shown, unit, prose(part.get("description") or (below or {}).get("description", ""))
    # the figures of a link are those of its keys again
    if below is not None and not path.endswith(".KEY"):
        for name, one in below["properties"].items():
            yield from _rows(schema, one, f"{path}{further}.{name}")


def _below(schema: Schema, part: Schema, further: str = "") -> tuple[Schema | None, str, list[str]]:
    """Return the object below a key, the names on the way to it, and the types of the key."""
    if "$ref" in part:
        found = schema["$defs"][part["$ref"].rpartition("/")[2]]
        return found, further, ["object"]
    if "anyOf" in part:
        each = [_below(schema, one, further) for one in part["anyOf"]]
        inner = next((one for one in each if one[0] is not None), each[0])
        return inner[0], inner[1], list(dict.fromkeys(kind for one in each for kind in one[2]))
    if part.get("type") == "array":
        found, names, kinds = _below(schema, part["items"], f"{further}[]")
        return found, names, [f"list of {kinds[0]}" if kinds[0] != "object" else "list"]
    if part.get("type") == "object":
        if "required" in part:
            return None, further, [f"statistics: {', '.join(part['required'])}"]
        values = part.get("additionalProperties")
        if not isinstance(values, dict):
            return None, further, ["object"]
        name = part.get("propertyNames", {}).get("description", "NAME")
        found, names, _ = _below(schema, values, f"{further}.{name}")
        return found, names, ["object"]
    return None, further, [_TYPES.get(part.get("type", ""), "text")]
