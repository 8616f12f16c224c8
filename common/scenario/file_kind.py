"""Kind of a YAML file by its keys: a scenario, a network of its own, or a profile, so that commands name its use."""

from collections.abc import Mapping
from typing import Any, Final, Literal

from tis.common.errors import Fault, InputError
from tis.common.scenario.network import NetworkPart

FileKind = Literal["scenario", "network", "profile"]

_OF_A_PROFILE: Final = frozenset(("title", "sources", "numbers", "notes"))
_OF_A_SCENARIO: Final = frozenset(("version", "source", "network"))


def kind_of(raw: Mapping[str, Any]) -> FileKind:
    """Return what a file's keys at top level belong to; a file of other keys counts as a scenario.

    A network stands at the top, or alone below ``network``, as a part copied from a scenario does.
    Oracle: the shipped scenarios and profiles, test_file_kind.
    """
    keys = raw.keys()
    if not keys & {"version", "source"} and "network" in keys and keys & _OF_A_PROFILE:
        return "profile"
    is_bare = keys & NetworkPart.model_fields.keys() and not keys & (_OF_A_SCENARIO | _OF_A_PROFILE)
    return "network" if is_bare or keys == {"network"} else "scenario"


def refuse_network(raw: Mapping[str, Any], where: str, wanted: Literal["scenario", "profile"]) -> None:
    """Raise `InputError` for a network that stands where something else is wanted."""
    if kind_of(raw) == "network":
        rule = (
            f"is a network, not a {wanted}: `tis validate` checks it, `tis netem --scenario-network` uses it, and a "
            "scenario has it below `network`, beside `version`, `name` and `source`"
        )
        raise InputError(Fault(where, "", rule))
