"""Scenarios from YAML and back; every fault of a file at once, each as ``where: field: rule (got value)``."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import yaml
from pydantic import ValidationError

from common.errors import Fault, InputError
from common.scenario import Scenario
from common.scenario.faults import faults
from common.yaml_text import load_yaml


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """Return the top-level mapping of a YAML text; raises `InputError`."""
    raw = load_yaml(text, where)
    if not isinstance(raw, dict):
        raise InputError(Fault(where, "", "must be a mapping of keys to values", raw))
    return raw


def apply_settings(raw: Mapping[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return ``raw`` with each ``a.b=VALUE`` applied; raises `InputError` with every bad setting.

    VALUE is YAML, null removes the key. In a list the name is a place, counted from 0. ``raw`` is not
    modified.
    """
    result: dict[str, Any] = _unshared(raw)
    found: list[Fault] = []
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not all(path.split(".")):
            found.append(Fault("--set", setting, "must read a.b=VALUE"))
            continue
        try:
            _put(result, path.split("."), load_yaml(text, "--set"))
        except InputError as error:
            found += [Fault("--set", path, fault.rule, text) for fault in error.faults]
        except LookupError as error:
            found.append(Fault("--set", path, str(error)))
    if found:
        raise InputError(found)
    return result


def build_scenario(raw: Mapping[str, Any], where: str) -> Scenario:
    """Validate a raw mapping; raises `InputError` with every fault."""
    try:
        return Scenario.model_validate(raw)
    except ValidationError as error:
        found = faults(error, Scenario, where)
    try:
        raise InputError(found)
    except RecursionError:  # a value that no file but a --set with a thousand dots can hold, and that cannot be shown
        raise InputError(Fault(where, "", "is nested too deeply")) from None


def dump_scenario(scenario: Scenario) -> str:
    """Return the scenario as YAML, defaults included; `build_scenario` of it gives the same scenario."""
    return yaml.safe_dump(scenario.model_dump(mode="json", exclude_none=True), sort_keys=False)


def schema_json() -> str:
    """Return the JSON Schema of scenarios, for editors that check and complete YAML."""
    return json.dumps(Scenario.model_json_schema(), indent=2)


def digest(scenario: Scenario) -> str:
    """Return 16 hex digits that name what was agreed on; where netem listens does not count."""
    agreed = scenario.model_dump_json(exclude={"hosts", "on_peer_loss"})
    return hashlib.blake2b(agreed.encode(), digest_size=8).hexdigest()


def _unshared(value: Any) -> Any:
    """Copy a tree so that no two places are the same object, as YAML's aliases make them."""
    if isinstance(value, Mapping):
        return {key: _unshared(below) for key, below in value.items()}
    if isinstance(value, list):
        return [_unshared(below) for below in value]
    return value


def _put(tree: dict[str, Any], path: Sequence[str], value: Any) -> None:
    *parents, last = path
    here: Any = tree
    for name in parents:
        place = _place(here, name)
        below = here[place] if isinstance(here, list) else here.get(place)
        if not isinstance(below, dict | list):
            below = here[place] = {}
        here = below
    place = _place(here, last)
    if value is not None:
        here[place] = value
    elif isinstance(here, list):
        del here[place]
    else:
        here.pop(place, None)


def _place(tree: dict[str, Any] | list[Any], name: str) -> Any:
    if isinstance(tree, dict):
        return name
    places = [str(place) for place in range(len(tree))]
    if name not in places:
        raise LookupError(f"{name!r} is not a place in a list of {len(tree)}")
    return places.index(name)
