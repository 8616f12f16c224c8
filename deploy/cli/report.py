"""Command `tis report`: one run as a page, several side by side, or figures for papers."""

from pathlib import Path
from typing import Annotated

import typer

from tis.common.errors import Fault, InputError
from tis.deploy.cli.group import Commands
from tis.deploy.shell.guard import OUT, guarded

app = Commands("Look at runs")


@app.command()
@guarded
def report(
    run_dirs: Annotated[list[Path], typer.Argument(metavar="RUN_DIR", help="Folder of a run; several to compare.")],
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Show the runs side by side on one page: compare.html in the current directory, or --out.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="With --compare: the page (.html) to write or replace; by default compare.html."
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write figures for papers to this folder instead of the page."),
    ] = None,
    file_format: Annotated[
        str | None, typer.Option("--format", help="Format of the figures: svg, pdf or png; by default pdf.")
    ] = None,
) -> int:
    """Write RUN_DIR/report.html: the run as a self-contained page; with --compare, several runs on one page.

    To compare estimators on equal terms, see tis compare.
    """
    from tis.deploy.report.command import compare_runs, draw_figures, report_again
    from tis.deploy.standalone.command import report as report_of_netem
    from tis.deploy.standalone.standalone_run import is_standalone

    _check(run_dirs, compare, out, figures, file_format)
    if compare:
        return compare_runs(run_dirs, out, OUT)
    if figures is not None:
        return draw_figures(run_dirs[0], figures, file_format or "pdf", OUT)
    if is_standalone(run_dirs[0]):
        return report_of_netem(run_dirs[0], OUT)
    return report_again(run_dirs[0], OUT)


def _check(
    run_dirs: list[Path], compare: bool, out: Path | None, figures: Path | None, file_format: str | None
) -> None:
    """Raise `InputError` with all options that contradict each other."""
    where, faults = "tis report", []
    if len(run_dirs) > 1 and not compare:
        faults.append(Fault(where, "RUN_DIR", "must be a single run unless --compare is given", len(run_dirs)))
    if compare and figures is not None:
        faults.append(Fault(where, "--figures", "draws a single run and excludes --compare"))
    if out is not None and not compare:
        faults.append(
            Fault(where, "--out", "requires --compare; the report of a single run lies in its folder", str(out))
        )
    if file_format is not None and figures is None:
        faults.append(Fault(where, "--format", "requires --figures", file_format))
    if faults:
        raise InputError(faults)
