"""Scenarios from YAML and back; every fault of a file at once, each as ``where: field: rule (got value)``."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import yaml
from pydantic import ValidationError

from common.errors import Fault, InputError
from common.scenario import Scenario
from common.scenario.faults import faults
from common.scenario.source import NULL_IS_A_VALUE
from common.scenario.yaml_text import load_yaml

Profiles = Callable[[str], Mapping[str, Any]]
"""The profile library: a name's network, as partial as its file has it.

Raises `LookupError` with a rule in words when there is none, `InputError` when its file is not valid.
"""

_BY_STAGE = ("forward", "feedback")


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """Return the top-level mapping of a YAML text; raises `InputError`."""
    raw = load_yaml(text, where)
    if raw is None:
        raise InputError(Fault(where, "", "is empty: must be a mapping of keys to values"))
    if not isinstance(raw, dict):
        raise InputError(Fault(where, "", "must be a mapping of keys to values", raw))
    return raw


def apply_settings(raw: Mapping[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return ``raw`` with each ``a.b=VALUE`` applied; raises `InputError` with every bad setting.

    VALUE is YAML; null removes the key, but where it is a value of its own. In a list the name is a place, counted
    from 0. ``raw`` is not modified.
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


def expand_profile(raw: Mapping[str, Any], where: str, profiles: Profiles) -> dict[str, Any]:
    """Return ``raw`` with the values of the profile that its network names, if any; raises `InputError`.

    The profile lies beneath what is given beside it: a stage of ``forward`` or ``feedback`` that is given replaces
    the profile's, null removes it; anything else is replaced whole. ``from_profile`` then says where the rest comes
    from. What is not even a network is left to the validation. ``raw`` is not modified.
    """
    network = raw.get("network")
    if not isinstance(network, Mapping) or not isinstance(network.get("profile"), str):
        return dict(raw)
    name = network["profile"]
    try:
        beneath = profiles(name)
    except LookupError as error:
        raise InputError(Fault(where, "network.profile", str(error.args[0]), name)) from None
    above = {key: value for key, value in network.items() if key not in ("profile", "from_profile")}
    merged = {**beneath, **{key: value for key, value in above.items() if value is not None}}
    for direction in _BY_STAGE:
        below, given = beneath.get(direction), above.get(direction)
        if isinstance(below, Mapping) and isinstance(given, Mapping):
            both = {**below, **given}
            merged[direction] = {stage: value for stage, value in both.items() if value is not None}
    removed = [key for key, value in above.items() if value is None]
    return {**raw, "network": {key: value for key, value in merged.items() if key not in removed}}


def build_scenario(raw: Mapping[str, Any], where: str, profiles: Profiles | None = None) -> Scenario:
    """Validate a raw mapping; raises `InputError` with every fault.

    With ``profiles`` the values of a network's profile are filled in; without, a name is refused. What is dumped
    has them filled in, and builds the same scenario without a library.
    """
    if profiles is not None:
        raw = expand_profile(raw, where, profiles)
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
    """Return 16 hex digits that name what was agreed on.

    Where netem listens does not count, nor where a host keeps its trials, nor the name of the profile that the
    network's values come from.
    """
    agreed = scenario.model_dump_json(
        exclude={"hosts": True, "on_peer_loss": True, "network": {"from_profile": True}, "source": {"path": True}}
    )
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
    if value is not None or last in NULL_IS_A_VALUE:
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
