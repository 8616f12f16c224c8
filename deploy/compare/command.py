"""What `tis compare` does: plan, compute what is missing, pool, write."""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError
from deploy import run_dir as folder
from deploy.compare import tables
from deploy.compare.plan import Plan, Request, make_plan
from deploy.compare.pool import Outcome, compute
from deploy.compare.results import report as build_report
from deploy.compare.store import Store

_SHOWN_WARNINGS: Final = 5


def compare(
    request: Request, out_dir: Path | None, json_file: Path | None, n_jobs: int | None, out: Console, err: Console
) -> int:
    """Compare, print the table, and write CSV, JSON, Markdown and figures; return the exit code.

    Cells that fail are named, and the others count; `EXIT_INVALID_RUN` says that there were such. Raises `InputError`
    and `DataError`, the latter also when every cell failed.
    """
    plan = make_plan(request)
    store = Store(out_dir or Path("runs") / "compare" / plan.name)
    outcome = run(plan, store, n_jobs, err)
    report = build_report(plan, outcome, folder.command_line())
    _tell(plan, outcome, report, err)
    if not outcome.cells:
        return DataError.exit_code
    written = _write(report, store.path, json_file, err)
    out.print(tables.view(report))
    out.print(escape(f"{', '.join(written)} and every cell lie in {store.path}"), soft_wrap=True)
    return EXIT_INVALID_RUN if report["failed"] else EXIT_OK


def run(plan: Plan, store: Store, n_jobs: int | None, err: Console) -> Outcome:
    """Compute what is missing with a progress bar; an interrupt says what is kept."""
    n_done = 0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    try:
        with Progress(*columns, console=err, transient=True) as progress:
            task = progress.add_task("twins", total=len(plan.cells))

            def on_cell(n: int) -> None:
                nonlocal n_done
                n_done += n
                progress.advance(task, n)

            return compute(plan, store, n_jobs, on_cell)
    except KeyboardInterrupt:
        err.print(
            escape(
                f"interrupted: {n_done} of {len(plan.cells)} cells are kept in {store.path}; "
                "the same command goes on from there"
            ),
            style="yellow",
            soft_wrap=True,
        )
        raise


def _tell(plan: Plan, outcome: Outcome, report: dict[str, Any], err: Console) -> None:
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


def _write(report: dict[str, Any], path: Path, json_file: Path | None, err: Console) -> list[str]:
    """Write all forms of the report; return the files' names."""
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
    for name, content in files.items():
        folder.write(path / name, content)
    if json_file is not None:
        folder.write(json_file, text)
    return list(files)


def _figures(report: dict[str, Any]) -> dict[str, bytes]:
    from deploy.compare.figures import age_figure, ratio_figure  # loads matplotlib
    from deploy.report.figures import rendered

    drawn = {"ratio": ratio_figure(report), "error_by_age": age_figure(report)}
    return {f"{name}.svg": rendered(figure, "svg") for name, figure in drawn.items() if figure is not None}
