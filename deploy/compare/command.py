"""What `tis compare` does: plan, compute what is missing, pool, write."""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError
from deploy.compare import tables
from deploy.compare.cells.store import Store
from deploy.compare.plan import Plan
from deploy.compare.pool import Outcome, compute
from deploy.compare.progress import CompareProgress
from deploy.compare.result_rows import report as build_report
from deploy.shell import run_dir as folder

_SHOWN_WARNINGS: Final = 5
_SHOWN_UNSCORED: Final = 5
_FIGURE_FILES: Final = ("ratio.svg", "error_by_age.svg")


def compare(
    plan: Plan, out_dir: Path | None, json_file: Path | None, n_jobs: int | None, out: Console, err: Console
) -> int:
    """Compare, print the table, and write CSV, JSON, Markdown and figures; return the exit code.

    Cells that fail, or in which no tick could be scored, are named, and the others count; `EXIT_INVALID_RUN` says
    that there were such. Nothing is printed or written where there is no score at all. Raises `DataError`.
    """
    store = Store(out_dir or Path("runs") / "compare" / plan.name)
    outcome = run(plan, store, n_jobs, err)
    report = build_report(plan, outcome, folder.command_line())
    _print_notices(plan, outcome, report, err)
    if not outcome.cells:
        return DataError.exit_code
    if not any(row["n_scored"] for row in report["rows"]):
        return EXIT_INVALID_RUN
    written = _write(report, store.path, json_file, err)
    out.print(tables.view(report))
    out.print(escape(f"{', '.join(written)} and every cell lie in {store.path}"), soft_wrap=True)
    return EXIT_INVALID_RUN if report["failed"] or report["unscored"] else EXIT_OK


def run(plan: Plan, store: Store, n_jobs: int | None, err: Console) -> Outcome:
    """Compute what is missing and show how far it is; an interrupt says what is kept."""
    try:
        with CompareProgress(err, len(plan.cells)) as progress:
            return compute(plan, store, n_jobs, progress)
    except KeyboardInterrupt:
        err.print(escape(f"interrupted: {_stored_text(plan, store)}"), style="yellow", soft_wrap=True)
        raise


def _stored_text(plan: Plan, store: Store) -> str:
    """Return what lies in the folder, by looking there."""
    n_cells = sum(store.cell(cell.digest) is not None for cell in plan.cells)
    n_models = sum(store.training(digest) is not None for digest in plan.trainings)
    models = f"{n_models} of {len(plan.trainings)} models and " if plan.trainings else ""
    return (
        f"{models}{n_cells} of {len(plan.cells)} cells are kept in {store.path}; the same command goes on from there"
    )


def _print_notices(plan: Plan, outcome: Outcome, report: dict[str, Any], err: Console) -> None:
    """Say what was taken from before, what has to be known, and what failed."""
    if outcome.n_resumed:
        err.print(f"{outcome.n_resumed} of {len(plan.cells)} cells had been computed before", style="dim")
    for text in report["warnings"][:_SHOWN_WARNINGS]:
        err.print(escape(f"warning: {text}"), style="yellow", soft_wrap=True)
    if len(report["warnings"]) > _SHOWN_WARNINGS:
        err.print(f"and {len(report['warnings']) - _SHOWN_WARNINGS} more warnings, in table.json", style="yellow")
    for failure in outcome.failures:
        if failure.trace is not None:
            err.print(failure.trace, markup=False, highlight=False, style="dim")
    for text in report["failed"]:
        err.print(escape(f"tis: {text}"), style="red", soft_wrap=True)
    n_more = len(report["unscored"]) - _SHOWN_UNSCORED
    for text in report["unscored"][:_SHOWN_UNSCORED]:
        err.print(escape(f"tis: {text}"), style="red", soft_wrap=True)
    if n_more > 0:
        err.print(f"tis: and {n_more} more twins in which no tick could be scored", style="red")


def _write(report: dict[str, Any], path: Path, json_file: Path | None, err: Console) -> list[str]:
    """Write all forms of the report, and take away what an earlier one drew besides; return the files' names."""
    text = json.dumps(report, indent=1, allow_nan=False) + "\n"
    files: dict[str, str | bytes] = {
        "table.json": text,
        "table.csv": tables.pooled_csv(report),
        "trials.csv": tables.trials_csv(report),
        "table.md": tables.markdown(report),
    }
    if find_spec("matplotlib") is None:
        err.print(escape("no figures without matplotlib: pip install 'tis-testbed[report]'"), style="dim")
    else:
        files |= _figures(report)
    for name in _FIGURE_FILES:  # of another comparison in this folder
        if name not in files:
            (path / name).unlink(missing_ok=True)
    for name, content in files.items():
        folder.write(path / name, content)
    if json_file is not None:
        folder.write(json_file, text)
    return list(files)


def _figures(report: dict[str, Any]) -> dict[str, bytes]:
    from deploy.compare.plots import age_figure, ratio_figure  # loads matplotlib
    from deploy.report.publication.matplotlib_figures import rendered

    drawn = dict(zip(_FIGURE_FILES, (ratio_figure(report), age_figure(report)), strict=True))
    return {name: rendered(figure, "svg") for name, figure in drawn.items() if figure is not None}
