"""Resolution of a scenario from the command line: a file or a shipped name, with settings applied."""

import difflib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tis.common.errors import Fault, InputError
from tis.common.runtime.process import command_line
from tis.common.runtime.recordings import located, plays_all, whole_run, without_auto
from tis.common.runtime.scenario_files import lines_told, read_scenario
from tis.common.scenario import Scenario
from tis.common.scenario import reading as scenario_io
from tis.common.scenario.file_kind import refuse_network
from tis.common.scenario.overrides import Override, apply_overrides, blamed
from tis.deploy.net.profiles import library
from tis.deploy.shell.shipped_scenarios import SHIPPED, shipped_names


def is_file(path: Path) -> bool:
    """Tell whether there is such a file; a name that is too long for one is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:
        return False


def scenario_path(name: str) -> Path:
    """Return the file that ``name`` means: a path, or a shipped scenario; raises `InputError`."""
    path = Path(name)
    if is_file(path):
        return path
    shipped = SHIPPED / f"{name}.yaml"
    if "/" not in name and is_file(shipped):
        return shipped
    if _is_folder(path):
        command = command_line(["import", name, "--out", f"{path.name or 'recording'}_table.csv"])
        rule = f"is a folder, not a scenario: of a recording `{command}` makes a table; a run has its scenario.yaml"
        raise InputError(Fault(name, "", rule))
    beside = (f"{path.name}.yaml", f"{path.stem}.yaml", f"{path.stem}.yml") if path.name else ()
    here = [str(path.with_name(each)) for each in beside]
    near = [each for each in dict.fromkeys(here) if is_file(Path(each))]
    near += difflib.get_close_matches(name, shipped_names(), n=2, cutoff=0.6)
    hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
    names = ", ".join(shipped_names())
    raise InputError(Fault(name, "", f"no such scenario: neither a file nor one of {names}{hint}"))


_PROFILE: Final = "network.profile"
_NOT_OF_A_LINK: Final = ("unmatched", "rules", "buffer")
"""Parts of a network that are independent of the link: they stay when another profile is set."""


def resolve(
    name: str,
    settings: Sequence[str] = (),
    seed: int | None = None,
    duration_s: float | None = None,
    swept: Sequence[str] = (),
) -> Scenario:
    """Return the scenario with ``--set``, ``--sweep``, ``--seed`` and ``--duration-s`` applied.

    ``--set network.profile=NAME`` replaces the link of the file but keeps its exceptions by key (``rules``). Other
    settings apply after the profile's values and can override them. A recorded source names the folder that is read.
    Raises `InputError` with all faults, each under the option that caused it, or under the file; `DataError` for
    ``duration_s: auto`` of a recording that cannot be read.
    """
    path = scenario_path(name)
    raw, where = read_scenario(path), str(path)
    refuse_network(raw, where, "scenario")
    overrides = [Override("--set", setting) for setting in settings]
    repeated = [name for name, n in Counter(one.path for one in overrides).items() if n > 1]
    overrides += [Override("--sweep", setting) for setting in swept]
    given = {"seed": seed, "duration_s": duration_s}
    values = {field: value for field, value in given.items() if value is not None}
    scenario, found = _overridden(raw, where, overrides, values, is_final=True)
    found = [*(Fault("--set", name, "is set more than once") for name in repeated), *found]
    if scenario is not None and not found:
        return located(scenario)
    _, own = _overridden(raw, where, (), {})
    overrides += [Override(f"--{field.replace('_', '-')}", field) for field in values]
    with lines_told(path):
        raise InputError(blamed(found, where, own, overrides))


def _overridden(
    raw: dict[str, Any], where: str, overrides: Sequence[Override], values: Mapping[str, Any], is_final: bool = False
) -> tuple[Scenario | None, list[Fault]]:
    """Return a raw scenario with overrides and the fields ``values``, None when it is not valid, and the faults.

    Where ``is_final``, a duration of auto is resolved; raises `DataError` where its recording cannot be read.
    """
    chosen = [one for one in overrides if one.path == _PROFILE]
    others = [one for one in overrides if one not in chosen]
    found: list[Fault] = []
    try:
        raw = scenario_io.expand_profile(_with_profile(raw, [one.setting for one in chosen]), where, library)
    except InputError as error:
        found += error.faults
        raw = {**raw, "network": {}}  # check the other parts as well
        others = [one for one in others if one.path.partition(".")[0] != "network"]
    raw, refused = apply_overrides(raw, others, ["network"])
    found += refused
    try:
        complete = {**raw, **values}
        scenario = scenario_io.build_scenario(without_auto(complete), where, library)
        # the recording's length is looked up once the rest is valid
        return whole_run(scenario, where) if is_final and plays_all(complete) and not found else scenario, found
    except InputError as error:
        return None, [*found, *error.faults]


def _with_profile(raw: dict[str, Any], chosen: Sequence[str]) -> dict[str, Any]:
    """Return ``raw`` with the link that ``--set network.profile`` selects, if given."""
    if not chosen:
        return raw
    profile = scenario_io.apply_settings({}, chosen).get("network", {}).get("profile")
    given = raw.get("network")
    network = given if isinstance(given, dict) else {}
    if profile is None:
        return {**raw, "network": {key: value for key, value in network.items() if key != "profile"}}
    return {**raw, "network": {**{key: network[key] for key in _NOT_OF_A_LINK if key in network}, "profile": profile}}
