"""Options of `tis compare`: parsing into a plan."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.markup import escape

from common.errors import DataError, Fault, InputError
from deploy.compare.choices import COMMAND
from deploy.compare.command import compare
from deploy.compare.definitions.command import compare_definitions
from deploy.compare.engine.cluster import Cluster
from deploy.compare.engine.processes import Processes
from deploy.compare.engine.workers import Workers
from deploy.compare.estimators_page import write_page
from deploy.compare.grid import parse_sweep
from deploy.compare.plan import Plan, Request, make_plan
from deploy.shell.shipped_scenarios import shipped_names

Value = TypeVar("Value")


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
    workers = workers_of(n_jobs, scheduler, err)
    if definitions:
        return compare_definitions(given, page, out_dir, as_json, workers, out, err)
    if page is not None:
        if as_json or any(value is not None for value in given.values()):
            raise InputError(Fault(COMMAND, "--page", "must be given without a scenario or other options"))
        return write_page(page, out_dir, workers, out, err)
    if given["scenario"] is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault(COMMAND, "SCENARIO", f"is required: a file, or one of {names}"))
    return compare(plan_of(given), out_dir, as_json, workers, out, err)


def workers_of(n_jobs: int | None, scheduler: str | None, err: Console) -> Workers:
    """Return the workers of a cluster where a scheduler is named, otherwise processes; raises `InputError`."""
    if scheduler is None:
        return Processes(n_jobs)
    if n_jobs is not None:
        rule = "must be given without --scheduler: the number of Dask's workers decides"
        raise InputError(Fault(COMMAND, "--jobs", rule, n_jobs))
    return Cluster(scheduler, lambda text: err.print(escape(text), style="dim", soft_wrap=True))


def plan_of(given: dict[str, Any]) -> Plan:
    """Return the plan given by the options; raises `InputError` and `DataError`.

    All faults come at once: an unreadable option is skipped while the others are checked.
    """
    faults: list[Fault] = []
    request = Request(
        scenario=given["scenario"],
        settings=tuple(given["settings"] or ()),
        estimators=_read(partial(_names, "--estimators"), given["estimators"], faults),
        trials=_read(partial(_names, "--trials"), given["trials"], faults),
        n_seeds=given["n_seeds"],
        seed=given["seed"],
        duration_s=given["duration_s"],
        sweeps=tuple(
            sweep for text in given["sweeps"] or () if (sweep := _read(parse_sweep, text, faults)) is not None
        ),
        zipped=bool(given["zipped"]),
    )
    try:
        plan = make_plan(request)
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


def _names(option: str, text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise InputError(Fault(COMMAND, option, "must be names, separated by commas", text))
    return names
