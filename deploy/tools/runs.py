"""`tis runs`: the run folders below a folder, with their key figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.measure import Measurement

from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.deploy.present.table import OPEN, Column, Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_json

Listed = dict[str, Any]


class Wanted(NamedTuple):
    """The runs to list: below ``base``, of a scenario, mode or validity if one is given, in an order."""

    base: Path
    sort: str
    reverse: bool
    scenario: str | None
    mode: str | None
    valid: bool | None


COLUMNS: Final = {
    "run_dir": Column("run", words=True, wraps=True),
    "mode": Column("mode", words=True),
    "valid": Column("valid", words=True),
    "end_to_end_p50_ms": Column("median"),
    "end_to_end_p99_ms": Column("p99 ms"),
    "loss_pct": Column("loss %"),
    "rmse_3d_mm": Column("error mm"),
    "ratio_to_hold": Column("/ hold"),
}
"""Columns of the table by key in ``--json``."""

_NETEM_LOG: Final = "netem.mcap"
_MAX_WIDTH: Final = 1000
SORTED_BY: Final[Mapping[str, str]] = {
    "written": "written",
    "run": "run_dir",
    "scenario": "scenario",
    "mode": "mode",
    "valid": "valid",
    "median": "end_to_end_p50_ms",
    "p99": "end_to_end_p99_ms",
    "loss": "loss_pct",
    "error": "rmse_3d_mm",
    "hold": "ratio_to_hold",
}
"""Key by the word for it in ``--sort``; the key itself is understood as well."""
_MAX_FIGURE: Final = 1e300  # integers beyond cannot be compared with floats


def list_runs(wanted: Wanted, out: Console, err: Console, as_json: bool) -> int:
    """Print the runs below a folder, as a table or as JSON; raises `InputError` and `DataError`.

    The folder of a netem between two networks has the mode netem, and figures after ``tis summarize``. A folder whose
    summary cannot be read is named on standard error and left out.
    """
    if wanted.sort not in (*SORTED_BY, *SORTED_BY.values()):
        raise InputError(Fault("tis runs", "--sort", f"must be one of {', '.join(SORTED_BY)}", wanted.sort))
    if not wanted.base.is_dir():
        raise DataError(Fault(str(wanted.base), "", "is no folder"))
    found: list[Listed] = []
    for run_dir in sorted(_run_dirs(wanted.base)):
        try:
            found.append(_listed(run_dir, wanted.base))
        except DataError as error:
            err.print(escape(f"warning: {error.faults[0]}"), style="yellow", soft_wrap=True)
    chosen = _ordered([run for run in found if _is_wanted(run, wanted)], wanted)
    if as_json:
        print_json(chosen)
    elif chosen:
        rows = [[run[name] for name in COLUMNS] for run in chosen]
        _print_whole(Table("", list(COLUMNS.values()), rows).terminal(OPEN), out)
    text = f"{len(chosen)} of {len(found)} runs below {wanted.base}"
    if found and not chosen:
        text += f"; there are {_kinds(found, 'scenario')}; {_kinds(found, 'mode')}"
    err.print(escape(text), style="dim", highlight=False, soft_wrap=True)
    return EXIT_OK


def _run_dirs(base: Path) -> set[Path]:
    """Return the folders of runs below a folder, and of netem between two networks, which has no scenario."""
    of_netem = {path.parent for path in base.rglob(folder.NETWORK_FILE) if (path.parent / _NETEM_LOG).exists()}
    return of_netem | {path.parent for path in base.rglob(folder.SCENARIO_FILE)}


def _print_whole(table: RenderableType, out: Console) -> None:
    """Print a table at its own width, so that names of runs stay whole in a narrow terminal."""
    width = out.width
    out.width = max(width, Measurement.get(out, out.options.update(max_width=_MAX_WIDTH), table).maximum)
    out.print(table, crop=False)
    out.width = width


def _kinds(runs: Sequence[Listed], name: str) -> str:
    """Return the values of a key: ``scenarios default, lossy``."""
    return f"{name}s {', '.join(sorted({run[name] for run in runs if run[name] is not None}))}"


def _listed(run_dir: Path, base: Path) -> Listed:
    """Return a run's key figures; those that its summary does not have are None."""
    summary = folder.read_json(run_dir / folder.SUMMARY_FILE) or {}
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    active = _at(summary, str, "active_estimator")
    is_run = (run_dir / folder.SCENARIO_FILE).exists()
    return {
        "run_dir": str(run_dir.relative_to(base)),
        "scenario": _at(summary, str, "scenario"),
        "written": _at(manifest, str, "written"),
        "mode": _at(summary, str, "mode") if is_run else "netem",
        "valid": _at(summary, bool, "valid"),
        "end_to_end_p50_ms": _at(summary, float, "latency_ms", "end_to_end", "p50"),
        "end_to_end_p99_ms": _at(summary, float, "latency_ms", "end_to_end", "p99"),
        "loss_pct": _at(summary, float, "links", "forward", "loss_pct"),
        "active_estimator": active,
        "rmse_3d_mm": _at(summary, float, "accuracy", active, "rmse_3d_mm"),
        "ratio_to_hold": _at(summary, float, "accuracy", active, "ratio_to_hold"),
    }


def _at(content: Any, kind: type, *names: Any) -> Any:
    """Return the value of a kind at a path of names, None without one: a summary may be of another version."""
    for name in names:
        content = content.get(name) if isinstance(content, dict) else None
    is_number = kind is float and type(content) in (int, float) and abs(content) <= _MAX_FIGURE
    return content if is_number or type(content) is kind else None


def _is_wanted(run: Listed, wanted: Wanted) -> bool:
    asked = {"scenario": wanted.scenario, "mode": wanted.mode, "valid": wanted.valid}
    return all(value is None or run[name] == value for name, value in asked.items())


def _ordered(runs: Sequence[Listed], wanted: Wanted) -> list[Listed]:
    """Return the runs by the wanted column; those without a value come last either way."""
    key = SORTED_BY.get(wanted.sort, wanted.sort)
    known = [run for run in runs if run[key] is not None]
    unknown = [run for run in runs if run[key] is None]
    return sorted(known, key=lambda run: run[key], reverse=wanted.reverse) + unknown
