"""Profile library: the shipped networks and user-defined profile files."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import ValidationError

from tis.common.errors import Fault, InputError
from tis.common.runtime.scenario_files import lines_told, read_scenario
from tis.common.scenario.faults import faults
from tis.common.scenario.file_kind import refuse_network
from tis.common.scenario.profile import Profile

SUFFIXES: Final = (".yaml", ".yml")
SHIPPED: Final = Path(__file__).parents[1] / "profiles"


def shipped_names() -> list[str]:
    """Return the names of the shipped profiles."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def build_profile(raw: Mapping[str, Any], where: str) -> Profile:
    """Validate a raw mapping; raises `InputError` with every fault."""
    try:
        return Profile.model_validate(raw)
    except ValidationError as error:
        found = faults(error, Profile, where)
    raise InputError(found)


def read_profile(path: Path) -> Profile:
    """Read a profile's file; raises `InputError` with all its faults."""
    with lines_told(path):
        raw = read_scenario(path)
        refuse_network(raw, str(path), "profile")
        return build_profile(raw, str(path))


def profile_path(name: str) -> Path:
    """Return the file that ``name`` means: a shipped profile, or a path; raises `LookupError` with a rule."""
    shipped = SHIPPED / f"{name}.yaml"
    if "/" not in name and shipped.is_file():
        return shipped
    path = Path(name)
    if path.suffix in SUFFIXES and path.is_file():
        return path
    near = difflib.get_close_matches(name, shipped_names(), n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}?" if near else "`tis net profiles` lists them"
    raise LookupError(f"must be a profile of the library or a file (.yaml); {hint}")


def find_profile(name: str) -> Profile:
    """Return a profile by name or path; raises `InputError`."""
    try:
        path = profile_path(name)
    except LookupError as error:
        raise InputError(Fault("profile", "", str(error), name)) from None
    return read_profile(path)


def library(name: str) -> Mapping[str, Any]:
    """Return a profile's network as `tis.common.scenario.reading.expand_profile` takes it, labelled with its name."""
    profile = read_profile(profile_path(name))
    return {"from_profile": profile.name, **profile.partial()}


def dump_profile(profile: Profile) -> str:
    """Return a profile as YAML; `build_profile` of it gives the same profile."""
    raw = profile.model_dump(mode="json", exclude_defaults=True) | {"network": profile.partial()}
    ordered = {name: raw[name] for name in Profile.model_fields if name in raw}
    return yaml.safe_dump(ordered, sort_keys=False, allow_unicode=True, width=110)
