"""Options of `tis compare`: parsing into a plan."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from rich.console import Console
from rich.markup import escape

from tis.common.errors import DataError, Fault, InputError
from tis.deploy.compare.choices import COMMAND, names_of
from tis.deploy.compare.command import compare
from tis.deploy.compare.definitions.command import compare_definitions
from tis.deploy.compare.engine.choice import workers_of
from tis.deploy.compare.estimators_page import write_page
from tis.deploy.compare.grid import parse_sweep
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.compare.study_plan import plan_study, read_study
from tis.deploy.shell.shipped_scenarios import shipped_names

Value = TypeVar("Value")

_OF_THE_STUDY: Final = {"scenario": "SCENARIO", "settings": "--set", "sweeps": "--sweep", "zipped": "--zip"}
"""Options that a study file takes the place of, by their name among those given."""


def compare_or_page(
    given: dict[str, Any],
    definitions: bool,
    page: Path | None,
    out_dir: Path | None,
    as_json: bool,
    n_jobs: int | None,
    scheduler: str | None,
    out: Console,
    err: Console,
) -> int:
    """Run the comparison, that of definitions, or write a page; return the exit code.

    Raises `InputError`, `DataError` and `PeerError`.
    """
    workers = workers_of(n_jobs, scheduler, lambda text: err.print(escape(text), style="dim", soft_wrap=True))
    if definitions:
        return compare_definitions(given, page, out_dir, as_json, workers, out, err)
    if page is not None:
        if as_json or any(value is not None for value in given.values()):
            raise InputError(Fault(COMMAND, "--page", "must be given without a scenario or other options"))
        return write_page(page, out_dir, workers, out, err)
    if given["study"] is not None:
        file: Path = given["study"]
        plan = plan_of_study_file(file, given)
        return compare(plan, out_dir or Path("runs") / "compare" / file.stem, as_json, workers, out, err)
    if given["scenario"] is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault(COMMAND, "SCENARIO", f"is required: a file, or one of {names}; or --study FILE"))
    return compare(plan_of(given), out_dir, as_json, workers, out, err)


def plan_of(given: dict[str, Any]) -> Plan:
    """Return the plan given by the options; raises `InputError` and `DataError`.

    All faults come at once: an unreadable option is skipped while the others are checked.
    """
    faults: list[Fault] = []
    request = Request(
        scenario=given["scenario"],
        settings=tuple(given["settings"] or ()),
        **_chosen(given, faults),
        sweeps=tuple(
            sweep for text in given["sweeps"] or () if (sweep := _read(parse_sweep, text, faults)) is not None
        ),
        zipped=bool(given["zipped"]),
    )
    return _planned(lambda: make_plan(request), faults)


def plan_of_study_file(file: Path, given: Mapping[str, Any]) -> Plan:
    """Return the plan of a study file; options that say which part of it is computed override it.

    Raises `InputError` and `DataError`.
    """
    faults = [
        Fault(COMMAND, option, f"must be given without --study: {file} says it")
        for name, option in _OF_THE_STUDY.items()
        if given[name] is not None
    ]
    overrides = {name: value for name, value in _chosen(given, faults).items() if value is not None}
    return _planned(lambda: plan_study(*read_study(file), overrides), faults)


def _chosen(given: Mapping[str, Any], faults: list[Fault]) -> dict[str, Any]:
    """Return the fields of a `Request` that say which part is computed; appends what is wrong to ``faults``."""
    lists = {
        name: _read(partial(names_of, COMMAND, f"--{name}"), given[name], faults)
        for name in ("estimators", "trials", "people")
    }
    return lists | {name: given[name] for name in ("n_seeds", "seed", "duration_s")}


def _planned(plan_it: Callable[[], Plan], faults: Sequence[Fault]) -> Plan:
    """Return the plan; raises `InputError` with its faults and these, and `DataError`."""
    try:
        plan = plan_it()
    except InputError as error:
        raise InputError([*faults, *error.faults]) from None
    except DataError as error:
        if not faults:
            raise
        raise InputError([*faults, *error.faults]) from None
    if faults:
        raise InputError(faults)
    return plan


def _read(read: Callable[[str], Value], text: str | None, faults: list[Fault]) -> Value | None:
    """Return a parsed option, None when it is not given or invalid; appends its faults to ``faults``."""
    if text is None:
        return None
    try:
        return read(text)
    except InputError as error:
        faults += error.faults
        return None
