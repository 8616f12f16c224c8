"""Reference of a network's sections, kinds and parameters, generated from the models."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any, Final, NamedTuple

from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Pipeline
from tis.deploy.present.table import Column, Table
from tis.netem.build import build_links
from tis.netem.control.control import Control

_WHOLE: Final = {"Pipeline": "stages", "Change": "stages and more"}
"""Parts with a separate section; elsewhere only their name is shown."""


class Parameter(NamedTuple):
    """One value of a kind: path, allowed values, default ("" if required), meaning."""

    name: str
    values: str
    default: str
    meaning: str
    required: bool

    @property
    def default_words(self) -> str:
        """Return the default, or that there is none."""
        return "required" if self.required else self.default


class Kind(NamedTuple):
    """One form of a part; ``name`` is "" for a part with a single form."""

    name: str
    parameters: tuple[Parameter, ...]


class Section(NamedTuple):
    """A part of a network and its kinds."""

    name: str
    meaning: str
    kinds: tuple[Kind, ...]


def sections() -> list[Section]:
    """Return the stages in the order in which they act, then the sections that change and select them.

    Generated from the JSON Schema of `NetworkPart`, so that it is complete (oracle: the fields of the models'
    classes, tests/deploy/net/test_stage_reference).
    """
    schema = NetworkPart.model_json_schema()
    parts: Mapping[str, Any] = schema["$defs"]
    pipeline, change = (parts[model.__name__]["properties"] for model in (Pipeline, Change))
    found = [_section(name, pipeline[name], parts) for name in Pipeline.model_fields]
    more = {name: of for name, of in change.items() if name not in pipeline}
    words = "What a state or an entry of the timeline may set beside the stages above."
    found.append(Section("change", words, (Kind("", tuple(_parameters(more, (), parts))),)))
    living = ("rules", "outages", "steps", "states", "timeline", "buffer", "unmatched")
    return [*found, *(_section(name, schema["properties"][name], parts) for name in living)]


def _section(name: str, of: Mapping[str, Any], parts: Mapping[str, Any]) -> Section:
    kinds = []
    for model in _objects(of, parts):
        fields = model["properties"]
        inner = {field: below for field, below in fields.items() if field != "kind"}
        kind = fields.get("kind", {}).get("const", "")
        found = sorted(_parameters(inner, model.get("required", ()), parts), key=lambda one: not one.required)
        kinds.append(Kind(kind, tuple(found)))
    if not kinds:
        kinds = [Kind("", (_parameter(name, of, parts, False),))]
    return Section(name, of.get("description", ""), tuple(kinds))


def _parameters(
    fields: Mapping[str, Any], required: Sequence[str], parts: Mapping[str, Any], above: str = ""
) -> Iterator[Parameter]:
    for name, of in fields.items():
        objects = _objects(of, parts)
        if not objects or any(one["title"] in _WHOLE for one in objects):
            yield _parameter(f"{above}{name}", of, parts, name in required)
            continue
        inside = f"{above}{name}[]." if _is_list(of) else f"{above}{name}."
        for one in objects:
            kind = one["properties"].get("kind", {}).get("const")
            if kind is not None:
                yield Parameter(f"{inside}kind", kind, "", one["description"].split("\n")[0], name in required)
            # parameters of an optional part are optional themselves
            rest = {field: below for field, below in one["properties"].items() if field != "kind"}
            yield from _parameters(rest, one.get("required", ()) if name in required else (), parts, inside)


def _parameter(name: str, of: Mapping[str, Any], parts: Mapping[str, Any], required: bool) -> Parameter:
    default = of.get("default")
    shown = "" if required or default is None or isinstance(default, dict | list) else _plain(default)
    return Parameter(name, _values(of, parts), shown, of.get("description", ""), required)


def _objects(of: Mapping[str, Any], parts: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the object schemas allowed here, also as items of a list."""
    if "$ref" in of:
        return _objects(parts[of["$ref"].rpartition("/")[2]], parts)
    if "items" in of:
        return _objects(of["items"], parts)
    variants = [*of.get("anyOf", ()), *of.get("oneOf", ())]
    if variants:
        return [one for variant in variants for one in _objects(variant, parts)]
    return [of] if "properties" in of else []


def _is_list(of: Mapping[str, Any]) -> bool:
    return "items" in of or any("items" in one for one in of.get("anyOf", ()))


def _values(of: Mapping[str, Any], parts: Mapping[str, Any]) -> str:
    if "$ref" in of:
        title = str(parts[of["$ref"].rpartition("/")[2]]["title"])
        return _WHOLE.get(title, title)
    if "items" in of:
        return f"list of {_values(of['items'], parts)}"
    if "anyOf" in of or "oneOf" in of:
        variants = [*of.get("anyOf", ()), *of.get("oneOf", ())]
        return " or ".join(_values(one, parts) for one in variants if one.get("type") != "null")
    if "enum" in of:
        return ", ".join(map(str, of["enum"]))
    if "const" in of:
        return str(of["const"])
    if of.get("type") == "boolean":
        return "true, false"
    return _range(of) if of.get("type") in ("number", "integer") else "text"


def _range(of: Mapping[str, Any]) -> str:
    noun = "integer " if of["type"] == "integer" else ""
    if "minimum" in of and "maximum" in of:
        return f"{noun}{_plain(of['minimum'])} to {_plain(of['maximum'])}"
    signs = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    bounds = [f"{sign} {_plain(of[bound])}" for bound, sign in signs.items() if bound in of]
    return noun + (", ".join(bounds) or "number")


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:,.10g}" if isinstance(value, int | float) else str(value)


# Page on networks: syntax and control of a network, with tables generated from the models.

EXAMPLE: Final = """\
forward:                      # west to east; in a scenario all this stands below `network:`
  loss: {kind: burst, p_loss: 0.01, mean_burst: 3}
  delay: {kind: gamma, shift_ms: 20, mean_ms: 12, std_ms: 4}
  correlation: {half_life_s: 0.5}
feedback:                     # east to west
  delay: {kind: constant, delay_ms: 25}
rules:                        # keys with a pipeline of their own; the most specific rule wins
  - {key: demo/video/**, direction: forward, pipeline: {rate: {kbit_s: 2000, queue: {kind: codel}}}}
  - {key: demo/alarm, direction: both, pipeline: {}}       # nothing happens to it
outages:                      # half a second every 30 s, both ways
  - {kind: periodic, every_s: 30, for_s: 0.5}
steps:                        # up to 20 ms more, another value every 15 s, both ways
  - {every_s: 15, delay: {kind: uniform, low_ms: 0, high_ms: 20}}
states:                       # conditions that change delay, loss and rate together
  kind: markov
  states:
    - {name: good, mean_s: 20, next: [{to: bad}]}
    - {name: bad, mean_s: 2, next: [{to: good}], forward: {scale_delay: 3, add_p_loss: 0.1}}
timeline:                     # after a minute, for 20 s, 100 ms more, in ramps of 5 s
  - {at_s: 60, for_s: 20, ramp_s: 5, direction: forward, set: {add_delay_ms: 100}}
"""
REQUESTS: Final[tuple[tuple[str, Any], ...]] = (
    (
        "set",
        {
            "direction": "forward",
            "change": {"delay": {"kind": "constant", "delay_ms": 80}, "add_p_loss": 0.05},
            "for_s": 10,
            "id": "a",
        },
    ),
    ("outage", {"direction": "both", "for_ms": 500}),
    ("profile", {"profile": "mine", "network": {"forward": {"delay": {"kind": "constant", "delay_ms": 40}}}}),
    ("reset", {}),
)
"""Requests that a running emulator accepts, whatever its network."""

_PAGE: Final = Path(__file__).with_name("network_page.md")
_NOW_NS: Final = 2_000_400_000


def network_page() -> str:
    """Return the page (oracle: the file in the repository and its examples, test_network_page)."""
    words = Template(_PAGE.read_text(encoding="utf-8"))
    tables = "\n".join(map(_table, sections()))
    return words.substitute(example=EXAMPLE.rstrip(), tables=tables, requests=_requests())


def _table(section: Section) -> str:
    rows = []
    explained: set[Parameter] = set()
    for kind in section.kinds:
        for place, one in enumerate(kind.parameters):
            name = f"`{kind.name}`" if kind.name and place == 0 else ""
            meaning = "as above" if one in explained else one.meaning
            rows.append((name, f"`{one.name}`", one.values, one.default_words, meaning))
            explained.add(one)
    columns = [Column(head, words=True) for head in ("kind", "parameter", "values", "default", "meaning")]
    return f"### {section.name}\n\n{section.meaning}\n\n{Table('', columns, rows).markdown()}\n"


def _requests() -> str:
    operation, request = REQUESTS[0]
    links = build_links(NetworkPart(), ["**"], 0, {}, "docs")
    answer, _ = Control(links).handle(operation, json.dumps(request).encode(), _NOW_NS)
    lines = ["```", *(f"tis/netem/control/{name:8} {json.dumps(one)}" for name, one in REQUESTS), "```", ""]
    lines += [f"The answer to the first, at {_NOW_NS * 1e-9:.4f} s of run time:", "", "```"]
    return "\n".join([*lines, answer.model_dump_json(exclude_none=True, exclude_defaults=True), "```"])
