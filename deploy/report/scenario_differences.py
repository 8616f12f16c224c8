"""Differences between the scenarios of several runs, field by field, and their meaning."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tis.common.scenario import Scenario

_ABSENT: Final = "-"
_NOT_A_DIFFERENCE: Final = ("name", "version")


@dataclass(frozen=True)
class Differences:
    """``fields`` maps the path of each field that differs to its value in each run, as text."""

    fields: dict[str, tuple[str, ...]]
    modes: tuple[str, ...]

    @property
    def same_movement(self) -> bool:
        """Tell whether all runs show the same movement, so that their errors compare."""
        moving = [name for name in self.fields if name.startswith("source.") or name == "rate_hz"]
        return not set(moving) - {"source.hands"}

    def statement(self, changed_live: bool = False) -> str:
        """Return the differences and their meaning for the figures, in a sentence or two.

        After changes ``changed_live`` to the network of any run, nothing else can be the only cause.
        """
        names = list(self.fields)
        mixed = " Live and virtual time are mixed: their accuracy agrees statistically only."
        is_mixed = len(set(self.modes)) > 1
        tail = mixed if is_mixed else ""
        if changed_live:
            text = _beside_live_changes(names)
        elif not names:
            text = "All runs have the same scenario and seed: what differs comes from the host they ran on."
        elif names == ["seed"]:
            text = "The runs differ in nothing but the seed: they are repetitions, and what differs is chance."
        elif len(names) == 1:
            cause = "it, or from the kind of time" if is_mixed else "it"
            text = f"The runs differ in one field of the scenario, {names[0]}: what differs comes from {cause}."
        else:
            shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
            text = (
                f"The runs have different scenarios. They differ in {len(names)} fields ({shown}); what differs in "
                "the figures may come from any of them."
            )
        if not self.same_movement:
            text += " The movement or its rate is not the same, so errors in mm do not compare."
        return text + tail


def _beside_live_changes(names: Sequence[str]) -> str:
    if not names:
        return "All runs have the same scenario and seed: what differs comes from these changes, or from the host."
    fields = f"one field of the scenario, {names[0]}," if len(names) == 1 else f"{len(names)} fields of the scenario"
    return f"The runs differ in {fields} as well; what differs in the figures may come from either."


def scenario_differences(scenarios: Sequence[Scenario], modes: Sequence[str]) -> Differences:
    """Return the fields in which scenarios differ, names aside (oracle: edits by hand, test_scenario_differences)."""
    flat = [_flat(scenario.model_dump(mode="json", exclude_none=True)) for scenario in scenarios]
    paths = dict.fromkeys(path for one in flat for path in one)
    found = {path: tuple(one.get(path, _ABSENT) for one in flat) for path in paths}
    differing = {path: values for path, values in found.items() if len(set(values)) > 1}
    return Differences(differing, tuple(modes))


def _flat(value: Mapping[str, Any], path: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for name, item in value.items():
        here = f"{path}.{name}" if path else name
        if here in _NOT_A_DIFFERENCE:
            continue
        if isinstance(item, Mapping) and item:
            found |= _flat(item, here)
        # lists of parts, as rules and states, are compared entry by entry
        elif isinstance(item, list) and any(isinstance(part, Mapping) for part in item):
            for i, part in enumerate(item):
                found |= _flat(part, f"{here}[{i}]") if isinstance(part, Mapping) else {f"{here}[{i}]": str(part)}
        else:
            found[here] = item if isinstance(item, str) else json.dumps(item)
    return found
