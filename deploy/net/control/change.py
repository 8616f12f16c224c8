"""Parsing of settings such as ``delay.delay_ms=50`` into a complete change of the network."""

import re
from collections.abc import Mapping, Sequence
from itertools import dropwhile
from typing import Any, Final, get_args

from pydantic import ValidationError

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.scenario.faults import faults
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.scenario.overrides import KINDS, complete_stage
from tis.common.scenario.reading import apply_settings, parse_yaml

_LENGTH: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)(us|ms|s|min|h)")
_ABOVE: Final = ("network", *get_args(Direction))
_SECONDS: Final = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}


def seconds(text: str, option: str) -> float:
    """Return a duration such as 500ms, 2s or 1.5min, in s; raises `InputError`."""
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise InputError(Fault("tis net", option, "must be a duration such as 500ms, 2s or 1.5min", text))
    return float(found[1]) * _SECONDS[found[2]]


def read_change(settings: Sequence[str], yaml_text: str | None, now: Pipeline, where: str = "tis net set") -> Change:
    """Return the change requested by ``yaml_text`` and the settings, which override it; raises `InputError`.

    A partial stage is completed from the one in force (``now``, `complete_stage`). All faults come at once.
    """
    check_paths(settings)
    raw = {} if yaml_text is None else parse_yaml(yaml_text, "--yaml")
    try:
        requested = apply_settings(raw, settings)
    except InputError as error:
        raise InputError([Fault(where, fault.field, fault.rule) for fault in error.faults]) from None
    current = now.model_dump(mode="json", exclude_none=True)
    whole = {
        stage: _completed(stage, given, current.get(stage), where) if isinstance(given, Mapping) else given
        for stage, given in requested.items()
    }
    try:
        return Change.model_validate(whole)
    except ValidationError as error:
        raise InputError(faults(error, Change, where)) from None


def check_paths(settings: Sequence[str]) -> None:
    """Raise `InputError` for settings that begin with the network or a direction, as in a scenario."""
    found = []
    for setting in settings:
        path, equals, _ = setting.partition("=")
        steps = path.split(".")
        rest = list(dropwhile(lambda step: step in _ABOVE, steps))
        if steps[0] in _ABOVE and rest and equals:
            rule = (
                f"must begin with the stage, did you mean {'.'.join(rest)!r}? The direction is an argument of its own"
            )
            found.append(Fault("tis net set", path, rule))
    if found:
        raise InputError(found)


def _completed(stage: str, given: Mapping[str, Any], current: Any, where: str) -> Mapping[str, Any]:
    if stage in KINDS:
        return complete_stage(stage, given, current, where)
    if stage == "rate" and isinstance(current, Mapping):  # one form replaces the other, and keeps the queue
        replaced = {"opportunities": {"kbit_s"}, "kbit_s": {"opportunities", "opportunity_bytes"}}
        gone = {name for form in given for name in replaced.get(form, ())}
        current = {name: value for name, value in current.items() if name not in gone}
    return _overlaid(current if isinstance(current, Mapping) else {}, given)


def _overlaid(beneath: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(beneath)
    for name, value in above.items():
        below = merged.get(name)
        both = isinstance(below, Mapping) and isinstance(value, Mapping)
        same_kind = both and value.get("kind", below.get("kind")) == below.get("kind")  # type: ignore[union-attr]
        merged[name] = _overlaid(below, value) if same_kind else value  # type: ignore[arg-type]
    return merged
