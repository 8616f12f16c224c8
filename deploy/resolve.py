"""From what a user types to a scenario: a file or a shipped name, with settings applied."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from common import scenario_io
from common.errors import Fault, InputError
from common.runtime.side_cli import read_scenario
from common.scenario import Scenario

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


def resolve(
    name: str, settings: Sequence[str] = (), seed: int | None = None, duration_s: float | None = None
) -> Scenario:
    """Return the scenario with ``--set``, ``--seed`` and ``--duration-s`` applied; raises `InputError`."""
    path = scenario_path(name)
    raw = scenario_io.apply_settings(read_scenario(path), settings)
    if seed is not None:
        raw["seed"] = seed
    if duration_s is not None:
        raw["duration_s"] = duration_s
    return scenario_io.build_scenario(raw, str(path))
