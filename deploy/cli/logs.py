"""Commands that look at runs: ``tis runs``, ``info``, ``merge``, ``recover``, ``export``, ``report``."""

from pathlib import Path
from typing import Annotated

import typer

from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.deploy.cli.group import Commands, JsonOption, RunDirArg, VerboseOption
from tis.deploy.shell.guard import ERR, OUT, print_json, words_to

app = Commands("Look at runs")
audit_app = Commands(no_args_is_help=True, help="Check the audit log: who connected, was refused, and changed what.")


@app.command(example="tis runs --sort error --scenario default")
def runs(
    base: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where to look, in all folders below.")] = Path(
        "runs"
    ),
    sort: Annotated[
        str,
        typer.Option(metavar="COLUMN", help="written, run, scenario, mode, valid, median, p99, loss, error or hold."),
    ] = "written",
    reverse: Annotated[bool, typer.Option("--reverse", help="Largest or latest first.")] = False,
    scenario: Annotated[str | None, typer.Option(metavar="NAME", help="Runs of this scenario only.")] = None,
    mode: Annotated[str | None, typer.Option(metavar="live|twin|netem", help="Runs of this mode only.")] = None,
    valid: Annotated[
        bool | None, typer.Option("--valid/--invalid", help="Runs that are valid, or not, only.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """List the runs below a folder, also of `tis netem` alone, with their key figures: latency, loss and error."""
    from tis.deploy.tools.runs import Wanted, list_runs

    return list_runs(Wanted(base, sort, reverse, scenario, mode, valid), OUT, ERR, as_json)


@app.command(example="tis info RUN_DIR -v")
def info(
    path: Annotated[Path, typer.Argument(metavar="RUN_DIR|FILE.mcap", help="Folder of a run, or any MCAP file.")],
    verbose: VerboseOption = False,
    as_json: JsonOption = False,
) -> int:
    """Show the content of a run folder or an MCAP file and the state of each log; exit code 4: damaged or missing."""
    if path.is_dir():
        from tis.deploy.standalone.command import info as info_of_netem
        from tis.deploy.standalone.standalone_run import is_standalone
        from tis.deploy.tools.info import print_info

        if is_standalone(path):
            return info_of_netem(path, words_to(as_json), ERR, as_json)
        return print_info(path, words_to(as_json), ERR, verbose, as_json)
    from tis.deploy.logs.describe import print_file

    return print_file(path, words_to(as_json), ERR, as_json)


@audit_app.command(example="tis audit verify RUN_DIR")
def verify(run_dir: RunDirArg) -> int:
    """Check the audit log of a run or a `tis netem`: whole, cut, or changed at line n; exit code 4 unless whole.

    Each line has the hash of the one before, and netem's log the number of
    lines and the hash of the last one.
    """
    from tis.deploy.report.subjects.audit import verify_run

    OUT.print(verify_run(run_dir), soft_wrap=True, highlight=False)
    return EXIT_OK


@app.command(example="tis merge RUN_DIR")
def merge(run_dir: RunDirArg) -> int:
    """Merge the three logs into RUN_DIR/run.mcap, which Foxglove, PlotJuggler and Rerun open."""
    from tis.deploy.logs.merge_run import merge_again

    return merge_again(run_dir, OUT, ERR)


@app.command(example="tis recover RUN_DIR/netem.mcap")
def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE.mcap", help="A damaged MCAP file.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Output file; by default FILE_recovered.mcap.")
    ] = None,
) -> int:
    """Copy the readable part of a damaged log to a new file; exit code 3 if data was lost.

    In a run folder, the file with the default name replaces the damaged one for
    all commands. It lists its gaps, and figures exclude them.
    """
    from tis.deploy.logs.log_paths import recovered_name
    from tis.deploy.logs.recover import recover_and_print

    return recover_and_print(file, out or recovered_name(file), OUT, ERR)


@app.command(example="tis export RUN_DIR --csv")
def export(
    run_dir: RunDirArg,
    csv: Annotated[
        bool,
        typer.Option("--csv", help="Write a text table (.csv) per kind of record; README.md explains the columns."),
    ] = False,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="Write the same tables as .parquet; needs pyarrow.")
    ] = False,
    jigsaws: Annotated[
        bool,
        typer.Option(
            "--jigsaws",
            help="Write two trials in the 76 columns of JIGSAWS, a row per sample: R001 as the surgeon sent it, R002 "
            "with the arms as the patient estimated them.",
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="A new or empty folder; by default RUN_DIR/export.")
    ] = None,
) -> int:
    """Export a run's records as tables for other tools, with a README.md that explains every column."""
    from tis.deploy.export.export import Formats, export_run
    from tis.deploy.standalone.command import export as export_of_netem
    from tis.deploy.standalone.standalone_run import is_standalone

    if not (csv or parquet or jigsaws):
        raise InputError(Fault("tis export", "--csv, --parquet or --jigsaws", "at least one is required"))
    write = export_of_netem if is_standalone(run_dir) else export_run
    return write(run_dir, out or run_dir / "export", Formats(csv, parquet, jigsaws), OUT, ERR)


@app.command(example="tis report --compare RUN_DIR OTHER_RUN_DIR")
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
    as_json: JsonOption = False,
) -> int:
    """Write RUN_DIR/report.html: the run as a self-contained page; with --compare, several runs on one page.

    To compare estimators on equal terms, see tis compare.
    """
    from tis.deploy.report.command import COMPARED_FILE, compare_runs, draw_figures, report_again
    from tis.deploy.shell.run_dir import REPORT_FILE
    from tis.deploy.standalone.command import draw_figures as figures_of_netem
    from tis.deploy.standalone.command import report as report_of_netem
    from tis.deploy.standalone.standalone_run import is_standalone

    _check(run_dirs, compare, out, figures, file_format)
    words, form = words_to(as_json), file_format or "pdf"
    alone = [run_dir for run_dir in run_dirs if is_standalone(run_dir)]
    if compare and alone:
        rule = "is the folder of a standalone netem: it has no estimates to compare; tis report makes its own page"
        raise DataError([Fault(str(run_dir), "", rule) for run_dir in alone])
    if compare:
        code = compare_runs(run_dirs, out, words)
    elif figures is not None:
        code = (figures_of_netem if alone else draw_figures)(run_dirs[0], figures, form, words)
    elif alone:
        code = report_of_netem(run_dirs[0], words)
    else:
        code = report_again(run_dirs[0], words)
    if as_json:
        page = (out or COMPARED_FILE) if compare else run_dirs[0] / REPORT_FILE
        files = [page] if figures is None else sorted(figures.glob(f"*.{form}"))
        print_json({"files": [str(file) for file in files], "complete": code == EXIT_OK})
    return code


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
