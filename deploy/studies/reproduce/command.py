"""Command `tis reproduce`: computes committed tables again, and says of each cell whether it is what is committed."""

import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.present.table import Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults
from tis.deploy.studies.reproduce.compared import TOLERANCE, Compared, compare, counted
from tis.deploy.studies.reproduce.recompute import STUDIES, Job
from tis.deploy.studies.tables import committed

PLACE: Final = Path("runs") / "reproduce"
_SHOWN: Final = 20
_MEANING: Final = {
    "equal": "the same text",
    "within": "within the tolerance",
    "differs": "neither",
    "machine": "times of a machine, which are not compared",
    "gone": "of an estimator that no longer exists",
    "left out": "not computed now",
}


def reproduce(name: str, quick: bool, place: Path | None, n_jobs: int | None, out: Console, err: Console) -> int:
    """Compute the tables of a study, compare, print and write; a cell that differs causes `EXIT_INVALID_RUN`.

    Raises `DataError`.
    """
    study = STUDIES[name]
    tables = committed(study.tables)
    where = folder.made((place or PLACE) / name)
    out.print(f"{name}: docs/studies/{study.tables}.json, {len(tables)} tables; {study.cost}", soft_wrap=True)
    out.print(TOLERANCE, soft_wrap=True)
    begun_s = time.monotonic()
    computed = study.recompute(Job(where, quick, n_jobs, workers_of(n_jobs, None, err.print), out, err))
    hours = (time.monotonic() - begun_s) / 3600
    cells = list(compare(tables, computed, study.is_machine))
    _write(where / "cells.json", cells)
    out.print(_summary(cells).terminal())
    differing = [cell for cell in cells if cell.verdict == "differs"]
    print_faults(err, *map(_words, differing[:_SHOWN]))
    if len(differing) > _SHOWN:
        print_faults(err, f"and {len(differing) - _SHOWN} more cells that differ")
    cores = n_jobs or os.cpu_count()
    text = f"{len(cells)} cells, {hours:.2f} h on {cores} cores; every cell lies in {where / 'cells.json'}"
    out.print(escape(text), soft_wrap=True)
    none_compared = not any(cell.verdict in ("equal", "within", "differs") for cell in cells)
    return EXIT_INVALID_RUN if differing or none_compared else EXIT_OK


def _summary(cells: Sequence[Compared]) -> Table:
    found = counted(cells)
    return Table("", ("cells", "verdict", "meaning"), [[found.get(v, 0), v, text] for v, text in _MEANING.items()])  # type: ignore[call-overload]


def _words(cell: Compared) -> str:
    return f"table {cell.table}, {cell.heading}: {cell.row}, {cell.column}: {cell.committed}, now {cell.computed}"


def _write(file: Path, cells: Sequence[Compared]) -> None:
    folder.write(file, "[\n" + ",\n".join(json.dumps(asdict(cell), ensure_ascii=False) for cell in cells) + "\n]\n")
