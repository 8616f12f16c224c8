"""`tis export`: records of a run as files for other tools, all or none."""

import csv
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_LOSSY_RECOVERY, EXIT_OK, Fault, InputError, file_faults
from tis.common.extras import GET_PARQUET
from tis.deploy.export.jigsaws import jigsaws_files
from tis.deploy.export.tables import Columns, Pieces, readme, tables
from tis.deploy.logs.read.load import models_in
from tis.deploy.logs.viewer.drawn import RunTopics
from tis.deploy.report.run_data import Run, load

_CSV_ROWS: Final = 65_536
_README: Final = "README.md"


class Formats(NamedTuple):
    """What is written: tables as text and as Parquet, and trials of JIGSAWS."""

    csv: bool
    parquet: bool
    jigsaws: bool


class Exported(NamedTuple):
    """What is written of a folder: the ``title`` of its README.md, tables, and files by their path and text.

    ``problems`` has a sentence for each missing or damaged log.
    """

    title: str
    problems: Sequence[str]
    tables: Iterable[tuple[str, Pieces]]
    files: Iterable[tuple[Path, str]] = ()


def export_run(run_dir: Path, out_dir: Path, formats: Formats, out: Console, err: Console) -> int:
    """Write the requested formats of a run as `export` does; raises `DataError` when the run cannot be read."""

    def read() -> Exported:
        run = load(run_dir)
        title = f"Run of {run.scenario.name}, seed {run.scenario.seed}"
        return Exported(title, run.problems, tables(run), _trials(run) if formats.jigsaws else ())

    return export(run_dir, out_dir, formats, read, out, err)


def _trials(run: Run) -> Iterator[tuple[Path, str]]:
    topics = RunTopics.of(run.scenario, {model.hand: model.arm for model in models_in(run.logs)})
    yield from jigsaws_files(run.run_dir, run.scenario, topics)


def export(
    run_dir: Path, out_dir: Path, formats: Formats, read: Callable[[], Exported], out: Console, err: Console
) -> int:
    """Write what ``read`` returns into a new or empty folder and print the files.

    Its README.md explains columns and trials. Returns `EXIT_LOSSY_RECOVERY` when a log is missing or damaged. Raises
    `InputError` without pyarrow or for a folder with content.
    """
    if formats.parquet and find_spec("pyarrow") is None:
        raise InputError(Fault("tis export", "--parquet", f"needs pyarrow: {GET_PARQUET}"))
    if out_dir.exists() and (not out_dir.is_dir() or any(out_dir.iterdir())):
        rule = "must be a new or an empty folder: give --csv, --parquet and --jigsaws at once, or choose --out"
        raise InputError(Fault(str(out_dir), "", rule))
    exported = read()
    with file_faults(out_dir, "cannot be written"):
        files = _write(exported, out_dir, formats)
    for file in files:
        size_kb = (out_dir / file).stat().st_size / 1000
        out.print(escape(f"{out_dir / file}  {size_kb:.0f} kB"), soft_wrap=True)
    for problem in exported.problems:
        err.print(escape(f"tis: {run_dir}: {problem}; the rest was exported"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY if exported.problems else EXIT_OK


def _write(exported: Exported, out_dir: Path, formats: Formats) -> list[Path]:
    """Write all files or none; return their paths below ``out_dir``."""
    out_dir.parent.mkdir(parents=True, exist_ok=True)
    # built beside the target and renamed at the end, so that an export is complete or absent
    partial = Path(tempfile.mkdtemp(dir=out_dir.parent, prefix=".export-"))
    try:
        writers: dict[str, Callable[[Path, Pieces], tuple[str, ...]]] = {}
        writers |= {".csv": write_csv} if formats.csv else {}
        writers |= {".parquet": write_parquet} if formats.parquet else {}
        columns: dict[str, tuple[str, ...]] = {}
        if writers:
            for name, pieces in exported.tables:
                for suffix, write in writers.items():
                    columns[name] = write(partial / f"{name}{suffix}", pieces)
        for path, text in exported.files:
            (partial / path).parent.mkdir(parents=True, exist_ok=True)
            (partial / path).write_text(text, encoding="utf-8")
        text = readme(exported.title, exported.problems, columns, tuple(writers), formats.jigsaws)
        (partial / _README).write_text(text, encoding="utf-8")
        files = sorted(path.relative_to(partial) for path in partial.rglob("*") if path.is_file())
        partial.chmod(0o755)  # mkdtemp makes a private folder
        partial.replace(out_dir)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return files


def write_csv(path: Path, pieces: Pieces) -> tuple[str, ...]:
    """Write a table as CSV with a header, NaN as an empty field; return the names of its columns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        names: tuple[str, ...] = ()
        for make in pieces:
            piece = make()
            columns = list(piece.values())
            if not names:
                names = tuple(piece)
                writer.writerow(names)
            for first in range(0, len(columns[0]), _CSV_ROWS):
                writer.writerows(zip(*(_texts(values[first : first + _CSV_ROWS]) for values in columns), strict=True))
    return names


def write_parquet(path: Path, pieces: Pieces) -> tuple[str, ...]:
    """Write a table as Parquet, with dictionary-encoded text; return the names of its columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with ExitStack() as stack:
        writer: Any = None
        for make in pieces:
            piece: Columns = make()
            part = pa.table(
                {
                    name: pa.array(values).dictionary_encode() if values.dtype.kind == "U" else pa.array(values)
                    for name, values in piece.items()
                }
            )
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(path, part.schema, compression="zstd"))
            writer.write_table(part)
        return tuple(piece)


def _texts(values: np.ndarray[Any, Any]) -> list[Any]:
    plain = values.tolist()
    if values.dtype.kind == "b":
        return [int(value) for value in plain]
    return ["" if value != value else value for value in plain] if values.dtype.kind == "f" else plain
