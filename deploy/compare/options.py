"""The options of `tis compare` as they are typed, made into a request."""

from pathlib import Path
from typing import Any

from rich.console import Console

from common.errors import Fault, InputError
from deploy.compare.command import compare
from deploy.compare.page import write_page
from deploy.compare.plan import Request, parse_sweep
from deploy.resolve import shipped_names


def compare_or_page(
    asked: dict[str, Any],
    page: Path | None,
    out_dir: Path | None,
    json_file: Path | None,
    n_jobs: int | None,
    out: Console,
    err: Console,
) -> int:
    """Compare as asked, or write the page; return the exit code. Raises `InputError`."""
    if page is not None:
        given = sorted(name for name, value in asked.items() if value is not None)
        if given or json_file is not None:
            raise InputError(Fault("tis compare", "--page", "computes what it needs: no scenario or other options"))
        return write_page(page, out_dir, n_jobs, out, err)
    if asked["scenario"] is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault("tis compare", "SCENARIO", f"is required: a file, or one of {names}"))
    return compare(request_of(asked), out_dir, json_file, n_jobs, out, err)


def request_of(asked: dict[str, Any]) -> Request:
    """Return the request that the options stand for; raises `InputError`."""
    return Request(
        scenario=asked["scenario"],
        settings=tuple(asked["settings"] or ()),
        estimators=_names("--estimators", asked["estimators"]),
        trials=_names("--trials", asked["trials"]),
        n_seeds=asked["n_seeds"],
        seed=asked["seed"],
        duration_s=asked["duration_s"],
        sweep=None if asked["sweep"] is None else parse_sweep(asked["sweep"]),
    )


def _names(option: str, text: str | None) -> tuple[str, ...] | None:
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise InputError(Fault("tis compare", option, "must be names, separated by commas", text))
    return names
