"""The network of an emulator between any two networks: a profile, a file, and what was set over it."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from tis.common.errors import Fault, InputError
from tis.common.runtime.scenario_files import lines_told, read_scenario
from tis.common.scenario import reading
from tis.common.scenario.faults import faults
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.overrides import Override, apply_overrides, blamed


def read_network(
    file: Path | None,
    profile: str | None,
    settings: list[str],
    unmatched: str | None,
    profiles: reading.Profiles | None,
) -> tuple[str, NetworkPart]:
    """Return where a network comes from and the network itself; raises `InputError` with every fault.

    A file may hold a network, or a scenario of which only the network counts. ``settings`` (``a.b=VALUE``, with
    ``network.`` before it or not) come after the values of the profile or the file.
    """
    bare = [setting.removeprefix("network.") for setting in settings]
    chosen = [setting for setting in bare if setting.partition("=")[0] == "profile"]
    name = reading.apply_settings({"profile": profile}, chosen).get("profile")
    if file is not None and name is not None:
        rule = "must not stand beside --scenario-network: name it in the file, as `profile`"
        raise InputError(Fault("netem", "--profile", rule, name))
    with nullcontext() if file is None else lines_told(file):
        return _read(file, name, bare, chosen, unmatched, profiles)


def _read(
    file: Path | None,
    name: Any,
    bare: list[str],
    chosen: list[str],
    unmatched: str | None,
    profiles: reading.Profiles | None,
) -> tuple[str, NetworkPart]:
    raw: Mapping[str, Any] = {} if file is None else read_scenario(file)
    where = "netem" if file is None else str(file)
    is_scenario = "network" in raw or "version" in raw
    part = raw.get("network", {}) if is_scenario else raw
    if name is not None:
        part = {"profile": name}
    if profiles is not None:
        part = _expanded(part, where, "--profile" if file is None else "profile", profiles)
    overrides = [Override("--set", setting) for setting in bare if setting not in chosen]
    overrides += [] if unmatched is None else [Override("--unmatched", f"unmatched={unmatched}")]
    changed, found = apply_overrides(part, overrides, []) if isinstance(part, Mapping) else (part, [])
    network, invalid = _validated(changed, where)
    if network is not None and not found:
        return where, network
    faulty = blamed([*found, *invalid], where, _validated(part, where)[1], overrides)
    if is_scenario:
        faulty = [replace(one, field=f"network.{one.field}") if one.where == where else one for one in faulty]
    raise InputError(faulty)


def _validated(part: Any, where: str) -> tuple[NetworkPart | None, list[Fault]]:
    """Return a network, None when it is not valid, and all that is wrong."""
    try:
        return NetworkPart.model_validate(part), []
    except ValidationError as error:
        return None, faults(error, NetworkPart, where)


def _expanded(part: Any, where: str, field: str, profiles: reading.Profiles) -> Any:
    """Return a network with its profile's values; a name that is none is blamed on ``field``."""
    try:
        return reading.expand_profile({"network": part}, where, profiles)["network"]
    except InputError as error:
        found = [replace(one, field=field) if one.field == "network.profile" else one for one in error.faults]
    raise InputError(found)
