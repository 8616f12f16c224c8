"""Command `tis admissible`: runs the study and writes its report, tables and figure."""

import json
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, GET_REPORT
from tis.common.runtime.process import command_line
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.early_checks import check_outputs
from tis.deploy.shell.guard import print_json, print_warnings
from tis.deploy.studies.admissible import tables
from tis.deploy.studies.admissible.evaluation import Evaluation
from tis.deploy.studies.admissible.options import order_of
from tis.deploy.studies.admissible.study import Study

_SHOWN_WARNINGS: Final = 6
_FORMATS: Final = ("svg", "pdf")
_ALWAYS: Final = ("admissible.json", "border.csv", "points.csv")
_FIGURES: Final = tuple(f"admissible.{form}" for form in _FORMATS)


def admissible(
    given: dict[str, Any],
    out_dir: Path | None,
    as_json: bool,
    n_jobs: int | None,
    scheduler: str | None,
    out: Console,
    err: Console,
) -> int:
    """Find the regions, print the tables, and write JSON, CSV and figures; return the exit code.

    Raises `InputError`, `DataError` and `PeerError`.
    """
    workers = workers_of(n_jobs, scheduler, lambda text: err.print(escape(text), style="dim", soft_wrap=True))
    order = order_of(given)
    begun_s = time.monotonic()
    with workers:
        store = Store(out_dir or Path("runs") / "admissible" / order.name)
        check_outputs(*(store.path / name for name in (*_ALWAYS, *_FIGURES)))
        evaluation = Evaluation(order.estimators, order.limits, store, workers, err)
        report = Study(order, evaluation).run(command_line())
    print_warnings(err, *report["warnings"][:_SHOWN_WARNINGS])
    if len(report["warnings"]) > _SHOWN_WARNINGS:
        more = len(report["warnings"]) - _SHOWN_WARNINGS
        err.print(f"and {more} more warnings, in admissible.json", style="yellow")
    written = _write(report, store.path, err)
    out.print(tables.view(report))
    resumed = f", {evaluation.n_resumed:,} of them stored before" if evaluation.n_resumed else ""
    took_s = time.monotonic() - begun_s
    took = f"{report['n_points']:,} networks, {report['n_twins']:,} twins{resumed}, {took_s:.0f} s"
    out.print(escape(f"\n{took}; {', '.join(written)} and every twin's result lie in {store.path}"), soft_wrap=True)
    if as_json:
        print_json(report)
    return EXIT_OK


def _write(report: dict[str, Any], path: Path, err: Console) -> list[str]:
    """Write all forms of the report; return their names. A figure of an earlier study is deleted."""
    files: dict[str, str | bytes] = {
        "admissible.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "border.csv": tables.border_csv(report),
        "points.csv": tables.points_csv(report),
    }
    if find_spec("matplotlib") is None:
        err.print(escape(f"no figure without matplotlib: {GET_REPORT}"), style="dim")
    else:
        files |= _figures(report)
    for name in _FIGURES:
        if name not in files:
            folder.remove(path / name)
    for name, content in files.items():
        folder.write(path / name, content)
    return list(files)


def _figures(report: dict[str, Any]) -> dict[str, bytes]:
    from tis.deploy.report.publication.matplotlib_figures import rendered
    from tis.deploy.studies.admissible.plots import region_figure  # loads matplotlib

    figure = region_figure(report)
    return {} if figure is None else {f"admissible.{form}": rendered(figure, form) for form in _FORMATS}
