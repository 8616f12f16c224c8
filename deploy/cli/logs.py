"""Commands on runs and their logs: ``tis runs``, ``info``, ``merge``, ``recover``, ``export``."""

from pathlib import Path
from typing import Annotated

import typer

from tis.common.errors import Fault, InputError
from tis.deploy.cli.group import Commands, JsonOption, RunDirArg, VerboseOption
from tis.deploy.shell.guard import ERR, OUT, guarded, words_to

app = Commands("Look at runs")


@app.command()
@guarded
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
    mode: Annotated[str | None, typer.Option(metavar="live|twin", help="Runs of this mode only.")] = None,
    valid: Annotated[
        bool | None, typer.Option("--valid/--invalid", help="Runs that are valid, or not, only.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """List the runs below a folder with their key figures: latency, loss and error."""
    from tis.deploy.tools.runs import Wanted, list_runs

    return list_runs(Wanted(base, sort, reverse, scenario, mode, valid), OUT, ERR, as_json)


@app.command()
@guarded
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


@app.command()
@guarded
def merge(run_dir: RunDirArg) -> int:
    """Merge the three logs into RUN_DIR/run.mcap, which Foxglove, PlotJuggler and Rerun open."""
    from tis.deploy.logs.merge_run import merge_again

    return merge_again(run_dir, OUT, ERR)


@app.command()
@guarded
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


@app.command()
@guarded
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
    from tis.deploy.export.export import export_run

    if not (csv or parquet or jigsaws):
        raise InputError(Fault("tis export", "--csv, --parquet or --jigsaws", "at least one is required"))
    return export_run(run_dir, out or run_dir / "export", csv, parquet, jigsaws, OUT, ERR)
