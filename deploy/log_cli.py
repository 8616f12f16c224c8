"""What can be done with logs: ``tis info``, ``merge``, ``recover``, ``export``."""

from pathlib import Path
from typing import Annotated

import typer

from common.errors import Fault, InputError
from deploy.guard import ERR, OUT, guarded

app = typer.Typer(no_args_is_help=True)

RunDirArg = Annotated[Path, typer.Argument(metavar="RUN_DIR", help="Folder of a run.")]


@app.command()
@guarded
def info(
    path: Annotated[
        Path, typer.Argument(metavar="RUN_DIR|FILE.mcap", help="Folder of a run, or an MCAP file, anybody's.")
    ],
) -> int:
    """Show what a run folder or an MCAP file holds, and the state of each log."""
    if path.is_dir():
        from deploy.info import print_info
        from deploy.standalone.command import info as info_of_netem
        from deploy.standalone.run import is_standalone

        if is_standalone(path):
            return info_of_netem(path, OUT, ERR)
        return print_info(path, OUT, ERR)
    from deploy.logs.describe import print_file

    return print_file(path, OUT, ERR)


@app.command()
@guarded
def merge(run_dir: RunDirArg) -> int:
    """Write RUN_DIR/run.mcap: the three logs as one file that Foxglove, PlotJuggler and Rerun open."""
    from deploy.logs.merge_run import merge_again

    return merge_again(run_dir, OUT, ERR)


@app.command()
@guarded
def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE.mcap", help="A damaged MCAP file.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="FILE_recovered.mcap when not given.")] = None,
) -> int:
    """Write all that can be read of a damaged log to a new file; exit code 3 when something was lost."""
    from deploy.logs.recover import recover_and_print

    return recover_and_print(file, out or file.with_name(f"{file.stem}_recovered.mcap"), OUT, ERR)


@app.command()
@guarded
def export(
    run_dir: RunDirArg,
    csv: Annotated[bool, typer.Option("--csv", help="One text table (.csv) for each kind of record.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="The same tables as .parquet; needs pyarrow.")] = False,
    jigsaws: Annotated[
        bool, typer.Option("--jigsaws", help="Text in the columns of the JIGSAWS data set, a row per sample.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="A new or empty folder; RUN_DIR/export when not given.")
    ] = None,
) -> int:
    """Write a run's records as tables for other tools."""
    from deploy.logs.export import export_run

    if not (csv or parquet or jigsaws):
        raise InputError(Fault("tis export", "--csv, --parquet or --jigsaws", "at least one is required"))
    return export_run(run_dir, out or run_dir / "export", csv, parquet, jigsaws, OUT, ERR)
