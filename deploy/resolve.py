"""From what a user types to a scenario: a file or a shipped name, with settings applied."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from common import scenario_io
from common.errors import Fault, InputError
from common.network_settings import apply_network_settings
from common.runtime.side_cli import read_scenario
from common.scenario import Scenario
from deploy.net.profiles import library

SHIPPED: Final = Path(__file__).parent / "scenarios"


def shipped_names() -> list[str]:
    """Return the names of the scenarios that come with the testbed."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def scenario_path(name: str) -> Path:
    """Return the file that ``name`` means: a path, or a shipped scenario; raises `InputError`."""
    path = Path(name)
    if path.is_file():
        return path
    shipped = SHIPPED / f"{name}.yaml"
    if "/" not in name and shipped.is_file():
        return shipped
    names = ", ".join(shipped_names())
    raise InputError(Fault(name, "", f"no such scenario: neither a file nor one of {names}"))


_PROFILE: Final = "network.profile"
_NOT_OF_A_LINK: Final = ("unmatched", "rules", "buffer")
"""What a network says that is not about the link: it stays when another profile is set."""


def resolve(
    name: str, settings: Sequence[str] = (), seed: int | None = None, duration_s: float | None = None
) -> Scenario:
    """Return the scenario with ``--set``, ``--seed`` and ``--duration-s`` applied; raises `InputError`.

    ``--set network.profile=NAME`` replaces the link of the file, its exceptions by key (``rules``) stay. The other
    settings come after the profile's values have been filled in, so that they can change one of these.
    """
    path = scenario_path(name)
    chosen = [setting for setting in settings if setting.partition("=")[0] == _PROFILE]
    others = [setting for setting in settings if setting not in chosen]
    raw = _with_profile(read_scenario(path), chosen)
    raw = scenario_io.expand_profile(raw, str(path), library)
    raw = apply_network_settings(raw, others, "--set", ["network"])
    if seed is not None:
        raw["seed"] = seed
    if duration_s is not None:
        raw["duration_s"] = duration_s
    return scenario_io.build_scenario(raw, str(path), library)


def _with_profile(raw: dict[str, Any], chosen: Sequence[str]) -> dict[str, Any]:
    """Return ``raw`` with the link that ``--set network.profile`` chooses, if it does."""
    if not chosen:
        return raw
    profile = scenario_io.apply_settings({}, chosen).get("network", {}).get("profile")
    given = raw.get("network")
    network = given if isinstance(given, dict) else {}
    if profile is None:
        return {**raw, "network": {key: value for key, value in network.items() if key != "profile"}}
    return {**raw, "network": {**{key: network[key] for key in _NOT_OF_A_LINK if key in network}, "profile": profile}}
