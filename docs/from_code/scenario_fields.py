"""Page of the scenario's fields, read off the JSON Schema of the models that check a scenario."""

from collections.abc import Iterator, Mapping
from typing import Any

from from_code.markdown import code, prose, table, unit_of
from from_code.sources import Scenario, shipped_names

_HEAD = """# Scenario

A scenario is a YAML file that decides everything in a run except the machine's own timing. The tables are read off
the models that check it. `tis validate --schema` prints the models as a JSON Schema, `tis validate default` prints a
complete scenario. Fields marked *required* must be given; all others have a default. `--set a.b=VALUE` sets the field
`b` of the part `a`.

Shipped scenarios: {shipped}.
"""
_NETWORK = "NetworkPart"
"""The part that has a page of its own, network.md, which is read off the same models."""

_MAX_CHOICE = 8
"""Names that the column of the values holds; a longer choice goes with the meaning."""

Schema = Mapping[str, Any]


def page() -> str:
    """Return the page."""
    schema = Scenario.model_json_schema(mode="validation")
    parts: Schema = schema["$defs"]
    shipped = ", ".join(map(code, shipped_names()))
    sections = [_HEAD.format(shipped=shipped), "## The top level", "", fields_table(schema, parts, ""), ""]
    for title, names in _below(schema, parts, ""):
        sections += [f"(scenario-{title})=", f"## {title}", ""]
        for name in names:
            sections += _part(parts[name], parts, f"{title}.", len(names) > 1)
    return "\n".join(sections) + "\n"


def _below(schema: Schema, parts: Schema, path: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the path of every field that holds parts, and the parts that may stand there, depth first."""
    for field, of in schema["properties"].items():
        names = [name for name in _references(of) if name != _NETWORK and "properties" in parts[name]]
        if names:
            yield f"{path}{field}", names
            for name in names:
                yield from _below(parts[name], parts, f"{path}{field}.")


def _part(part: Schema, parts: Schema, path: str, is_variant: bool) -> list[str]:
    kind = part["properties"].get("kind", {}).get("const")
    described = [prose(part.get("description", "")), ""]
    if not is_variant or not kind:
        return [*described, fields_table(part, parts, path), ""]
    fields = {name: of for name, of in part["properties"].items() if name != "kind"}
    table_of = [fields_table({**part, "properties": fields}, parts, path), ""] if fields else []
    return [f"### kind: {kind}", "", *described, *table_of]


def fields_table(schema: Schema, parts: Schema, path: str) -> str:
    """Return the table of a part's fields; ``path`` is that of the part, with its dot."""
    required = schema.get("required", ())
    rows = (_row(name, of, parts, path, name in required) for name, of in schema["properties"].items())
    return table(("field", "values", "unit", "default", "meaning"), rows)


def _row(name: str, of: Schema, parts: Schema, path: str, required: bool) -> tuple[str, ...]:
    default = "*required*" if required else _default(of)
    values = _values(of, parts)
    if values.startswith("part"):
        values = f"[{values}](#scenario-{path}{name})"
    names = _long_choice(of, parts)
    meaning = prose(of.get("description", "")) + (f" Names: {', '.join(map(code, names))}." if names else "")
    return code(name), values, unit_of(name), default, meaning


def _default(of: Schema) -> str:
    value = of.get("default")
    if value is None or value in ({}, []):
        return "none" if value is None else "empty"
    if isinstance(value, Mapping):
        return code(f"kind: {value['kind']}") if "kind" in value else "as below"
    if isinstance(value, list):
        return code(f"[{', '.join(map(str, value))}]")
    return code(_plain(value))


def _references(of: Schema) -> list[str]:
    if "$ref" in of:
        return [str(of["$ref"]).rpartition("/")[2]]
    below = [*of.get("anyOf", ()), *of.get("oneOf", ()), *([of["items"]] if "items" in of else [])]
    return [name for one in below for name in _references(one)]


def _long_choice(of: Schema, parts: Schema) -> list[str]:
    """Return the names of a choice that is too long for the column of the values."""
    found = [*of.get("enum", ())]
    below = [*of.get("anyOf", ()), *([of["items"]] if "items" in of else [])]
    found += [name for one in below for name in _long_choice(one, parts)]
    return found if len(found) > _MAX_CHOICE else []


def _values(of: Schema, parts: Schema) -> str:
    """Return what may stand in a field: a type with its range, or the names to choose from."""
    if _NETWORK in _references(of):
        return "[network](network.md)"
    if "$ref" in of:
        name = str(of["$ref"]).rpartition("/")[2]
        return "part" if "properties" in parts[name] else _values(parts[name], parts)
    for union in ("anyOf", "oneOf"):
        if union in of:
            members = [_values(one, parts) for one in of[union] if one.get("type") != "null"]
            return "part, by kind" if set(members) == {"part"} and len(members) > 1 else " or ".join(members)
    if "enum" in of:
        return "name" if len(of["enum"]) > _MAX_CHOICE else ", ".join(map(code, of["enum"]))
    if "const" in of:
        return code(of["const"])
    if "prefixItems" in of:  # a tuple, as a place in space
        places = of["prefixItems"]
        return f"list of {len(places)}: {_values(places[0], parts)}"
    if of.get("type") == "array":
        if "prefixItems" in of:
            return f"list of {len(of['prefixItems'])} x {_values(of['prefixItems'][0], parts)}"
        return f"list of {_values(of['items'], parts)}"
    words = {"boolean": "`true`, `false`", "string": "text", "object": "mapping"}
    return words.get(of.get("type", "string")) or _range(of)


def _range(of: Schema) -> str:
    low, high = of.get("minimum"), of.get("maximum")
    noun = "integer" if of["type"] == "integer" else "number"
    if low is not None and high is not None:
        return f"{noun}, {_plain(low)} to {_plain(high)}"
    signs = {"exclusiveMinimum": "\\>", "minimum": "≥", "exclusiveMaximum": "\\<", "maximum": "≤"}
    return ", ".join([noun, *(f"{sign} {_plain(of[bound])}" for bound, sign in signs.items() if bound in of)])


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)
