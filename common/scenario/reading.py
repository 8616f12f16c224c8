"""Conversion of scenarios from and to YAML, and the fields on which all sides of a run must agree.

All faults of a file are told at once, as ``where: field: rule (got value)``.
"""

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf
from typing import Any, Final, NamedTuple

import yaml
from pydantic import ValidationError

from tis.common.errors import Fault, InputError
from tis.common.scenario import Scenario
from tis.common.scenario.faults import faults
from tis.common.yaml_text import load_yaml

Profiles = Callable[[str], Mapping[str, Any]]
"""The profile library: returns the network of a name as its file gives it, without defaults.

Raises `LookupError` with the broken rule for an unknown name, `InputError` for an invalid file.
"""

_BY_STAGE = ("forward", "feedback")

_FORMER: Final = "loss_max_pct"
_PRESENT: Final = "p_loss_max"
"""The limit of loss as files of 0.3 have it, in per cent, and its name since, a probability like all others."""


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

    VALUE is YAML; null removes the key, except where null is a value of the field. In a list the name is an index
    from 0. ``raw`` is not modified.
    """
    result: dict[str, Any] = _without_aliases(with_present_names(raw))
    found: list[Fault] = []
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not all(path.split(".")):
            found.append(Fault("--set", setting, "must read a.b=VALUE"))
            continue
        try:
            value = load_yaml(text, "--set")
            if path == f"limits.{_FORMER}":
                path, value = f"limits.{_PRESENT}", _share(value)
            _put(result, path.split("."), value)
        except InputError as error:
            found += [Fault("--set", path, fault.rule, text) for fault in error.faults]
        except LookupError as error:
            found.append(Fault("--set", path, str(error)))
    if found:
        raise InputError(found)
    return result


def setting(path: str, value: Mapping[str, Any]) -> str:
    """Return ``a.b=VALUE`` by which `apply_settings` puts the value there. Oracle: round trips, test_reading."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=inf, allow_unicode=True)
    return f"{path}={text.strip()}"


def expand_profile(raw: Mapping[str, Any], where: str, profiles: Profiles) -> dict[str, Any]:
    """Return ``raw`` with the values of the profile that its network names, if any; raises `InputError`.

    Fields given beside the profile override it: ``forward`` and ``feedback`` stage by stage, where null removes a
    stage, all others as a whole. ``from_profile`` then names it. A malformed network is left to the validation.
    ``raw`` is not modified.
    """
    network = raw.get("network")
    if not isinstance(network, Mapping) or not isinstance(network.get("profile"), str):
        return dict(raw)
    name = network["profile"]
    try:
        beneath = profiles(name)
    except LookupError as error:
        raise InputError(Fault(where, "network.profile", str(error.args[0]), name)) from None
    # Whole fields first, then the two pipelines stage by stage; a null removes what the profile has.
    above = {key: value for key, value in network.items() if key not in ("profile", "from_profile")}
    merged = {**beneath, **{key: value for key, value in above.items() if value is not None}}
    for direction in _BY_STAGE:
        below, given = beneath.get(direction), above.get(direction)
        if isinstance(below, Mapping) and isinstance(given, Mapping):
            both = {**below, **given}
            merged[direction] = {stage: value for stage, value in both.items() if value is not None}
    removed = [key for key, value in above.items() if value is None]
    return {**raw, "network": {key: value for key, value in merged.items() if key not in removed}}


def with_present_names(raw: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return ``raw`` with the present name of a field that had another, unless it has both."""
    limits = raw.get("limits")
    if not isinstance(limits, Mapping) or _FORMER not in limits or _PRESENT in limits:
        return raw
    renamed = {
        _PRESENT if name == _FORMER else name: _share(one) if name == _FORMER else one for name, one in limits.items()
    }
    return {**raw, "limits": renamed}


def _share(per_cent: Any) -> Any:
    """Return a number of per cent as a share; anything else is left to the validation."""
    return per_cent / 100 if isinstance(per_cent, int | float) and not isinstance(per_cent, bool) else per_cent


def build_scenario(raw: Mapping[str, Any], where: str, profiles: Profiles | None = None) -> Scenario:
    """Return the scenario of a raw mapping; raises `InputError` with every fault.

    With ``profiles`` a network's profile is replaced by its values; without, a profile is refused. A dumped scenario
    holds the values, so that it can be built without a library.
    """
    if profiles is not None:
        raw = expand_profile(raw, where, profiles)
    try:
        return Scenario.model_validate(with_present_names(raw))
    except ValidationError as error:
        found = faults(error, Scenario, where)
    try:
        raise InputError(found)
    except RecursionError:  # the value cannot be printed; only a --set with a thousand dots makes such a one
        raise InputError(Fault(where, "", "is nested too deeply")) from None


def dump_scenario(scenario: Scenario) -> str:
    """Return the scenario as YAML, defaults included; `build_scenario` of it gives the same scenario."""
    return yaml.safe_dump(scenario.model_dump(mode="json", exclude_none=True), sort_keys=False)


def schema_json() -> str:
    """Return the JSON Schema of scenarios, for editors that check and complete YAML."""
    about = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:tis:scenario:1"}
    return json.dumps(about | Scenario.model_json_schema(), indent=2)


MAY_DIFFER: Final[dict[str, Any]] = {
    "hosts": True,
    "on_peer_loss": True,
    "peer_timeout_s": True,
    "on_log_loss": True,
    "network": {"from_profile": True},
    "source": {"path": True},
    "security": {"folder": True, "file": True},
}
"""Parts of a scenario that may differ between hosts."""


def digest(scenario: Scenario) -> str:
    """Return 16 hex digits that identify the parts of a scenario on which all sides must agree.

    Endpoints, the folders of trials and secrets, and the name of the profile may differ between hosts.
    """
    agreed = scenario.model_dump_json(exclude=MAY_DIFFER)
    return hashlib.blake2b(agreed.encode(), digest_size=8).hexdigest()


def _without_aliases(value: Any) -> Any:
    """Copy a tree in which YAML aliases are one object, so that each place can be changed alone."""
    if isinstance(value, Mapping):
        return {key: _without_aliases(below) for key, below in value.items()}
    if isinstance(value, list):
        return [_without_aliases(below) for below in value]
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
        raise LookupError(f"{name!r} is not an index of a list of {len(tree)}")
    return places.index(name)


MAX_FIELDS: Final = 4000
_MAX_VALUE_CHARS: Final = 60
_MAX_NAME_CHARS: Final = 200
_MAX_NAMED: Final = 4
_NAME: Final = re.compile(rf"[A-Za-z0-9_.-]{{1,{_MAX_NAME_CHARS}}}")
_HASH: Final = "#"


class Difference(NamedTuple):
    """A field, with the texts of its two values; None where a scenario has no such field."""

    field: str
    here: str | None
    there: str | None

    def __str__(self) -> str:
        texts = [_NOT_GIVEN if value is None else value for value in (self.there, self.here)]
        if any(text.startswith(_HASH) for text in texts):
            return f"{self.field} differs"
        return f"{self.field} is {texts[0]} there, {texts[1]} here"


_NOT_GIVEN: Final = "not given"


def agreed_fields(scenario: Scenario) -> dict[str, str]:
    """Return the fields on which all sides must agree: the value of each as JSON, a hash of a long one.

    Equal digests (`reading.digest`) have equal fields. Paths that may differ between hosts are not among them.
    """
    agreed = json.loads(scenario.model_dump_json(exclude=MAY_DIFFER))
    return dict(_leaves(agreed, ""))


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[Difference]:
    """Return the fields that differ, in the order of the scenario here."""
    names = dict.fromkeys((*here, *there))
    return [Difference(name, here.get(name), there.get(name)) for name in names if here.get(name) != there.get(name)]


def in_words(found: list[Difference]) -> str:
    """Return the first differences as text, and how many more there are."""
    named = "; ".join(map(str, found[:_MAX_NAMED]))
    n_more = len(found) - _MAX_NAMED
    return f"{named}; and {n_more} more" if n_more > 0 else named


def checked_fields(payload: bytes) -> dict[str, str] | None:
    """Return the fields in another side's message, None unless it is what `agreed_fields` can return."""
    try:
        found = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or len(found) > MAX_FIELDS:
        return None
    return found if all(_is_field(name, value) for name, value in found.items()) else None


def _is_field(name: str, value: object) -> bool:
    if not isinstance(value, str) or len(value) > _MAX_VALUE_CHARS or not value.isprintable():
        return False
    return _NAME.fullmatch(name) is not None


def _leaves(value: Any, path: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and value:
        for name, below in value.items():
            yield from _leaves(below, f"{path}.{name}" if path else name)
        return
    text = json.dumps(value)  # ASCII only
    if len(text) > _MAX_VALUE_CHARS:
        text = _HASH + hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
    yield path, text
