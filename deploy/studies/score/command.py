"""Command `tis score`: a row of the scoreboard, or how stable its ranking is, computed and written."""

import json
import re
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, Fault, InputError
from tis.deploy.compare.cells.cell import Training
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import Outcome, compute, workers_of
from tis.deploy.present.table import Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults, print_json
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.score import foreign, population, stability
from tis.deploy.studies.score.plan import COMMAND, Asked, Work, subject_of, work_of
from tis.deploy.studies.score.protocol import NAME, Track, content
from tis.deploy.studies.score.rows import Row, failed_row, row_of

PLACE: Final = Path("runs") / "score"


class _TrainingsOnly(Store):
    """A store that keeps models, and no twin: the cost of a step is that of this run."""

    def cell(self, digest: str) -> dict[str, Any] | None:
        """Return None: nothing is kept."""
        del digest
        return None

    def save_cell(self, digest: str, result: dict[str, Any]) -> None:
        """Keep nothing."""


def score(
    texts: Sequence[str],
    track: Track,
    quick: bool,
    seed: int | None,
    n_seeds: int | None,
    path: Path | None,
    place: Path | None,
    n_jobs: int | None,
    as_json: bool,
    out: Console,
    err: Console,
) -> int:
    """Compute, print and write a row for each estimator; a failed one causes `EXIT_INVALID_RUN`.

    With ``n_seeds``, instead how stable the ranking is. ``path`` is the folder of JIGSAWS. Raises `InputError` and
    `DataError`.
    """
    subjects = tuple(dict.fromkeys(map(subject_of, texts)))
    if sum(bool(subject.command) for subject in subjects) > 1:
        raise InputError(Fault(COMMAND, "ESTIMATOR", "at most one can be a command"))
    if path is not None and track == "open":
        raise InputError(Fault(COMMAND, "--path", "must be given with --track jigsaws"))
    if n_seeds is not None and (seed is not None or len(subjects) < 2):
        raise InputError(Fault(COMMAND, "--seeds", "must be given without --seed, for two estimators or more"))
    where = place or PLACE
    first = content()["tracks"][track]["seed"] if seed is None else seed

    def asked(its_seed: int) -> Asked:
        return Asked(subjects, track, quick, its_seed, where / f"population_{its_seed}" if track == "open" else path)

    if n_seeds is not None:
        # What a process of its own computes depends on code that no digest knows: its twins are not kept.
        kept = _TrainingsOnly(where) if any(subject.command for subject in subjects) else Store(where)
        by_seed = (_rows(asked(each), kept, n_jobs, err, each == first) for each in range(first, first + n_seeds))
        return _stability(by_seed, where, as_json, out, err)
    rows = _rows(asked(first), _TrainingsOnly(where), n_jobs, err)
    files = [_write(row, where) for row in rows]
    failed = _told(rows, err)
    if as_json:
        print_json(rows)
    out.print(_table(rows).terminal())
    if any("failed" not in row for row in rows):
        out.print(_settings(rows).terminal())
        out.print(escape(_words(rows)), soft_wrap=True)
    seconds = max(row["machine"]["seconds"] for row in rows)
    out.print(escape(f"{seconds:.0f} s; written to {', '.join(map(str, files))}"), soft_wrap=True)
    return EXIT_INVALID_RUN if failed else EXIT_OK


def _rows(asked: Asked, store: Store, n_jobs: int | None, err: Console, rehearses: bool = True) -> list[Row]:
    """Compute the rows of one seed; a command that ``rehearses`` shows first that it knows the protocol."""
    err.print(f"{NAME}, {asked.track} track, seed {asked.seed}: preparing movements and twins", style="dim")
    begun_s = time.monotonic()
    for subject in asked.subjects:
        if subject.command:
            foreign.announce(subject.command, _training_tables(asked))
    work = work_of(asked)
    failed = _rehearsed(asked) if rehearses else None
    if failed is not None:
        others = tuple(subject for subject in asked.subjects if not subject.command)
        return [failed] + (_rows(replace(asked, subjects=others), store, n_jobs, err) if others else [])
    outcome = _computed(work, store, n_jobs, err)
    seconds = time.monotonic() - begun_s
    return [row_of(subject, asked, work, outcome, seconds) for subject in asked.subjects]


def _rehearsed(asked: Asked) -> Row | None:
    """Return the failed row of a process that breaks the protocol at once; it may train, so its tables are there."""
    for subject in asked.subjects:
        reason = foreign.rehearsed(subject.command, _training_tables(asked)) if subject.command else None
        if reason is not None:
            return failed_row(subject, asked, reason, foreign.digest_of_files(subject.command))
    return None


def _told(rows: Sequence[Row], err: Console) -> bool:
    """Print why rows failed; return whether any did."""
    failed = [f"{row['estimator']}: failed: {row['failed']}, seed {row['seed']}" for row in rows if "failed" in row]
    print_faults(err, *failed)
    return bool(failed)


def _stability(by_seed: Iterable[list[Row]], where: Path, as_json: bool, out: Console, err: Console) -> int:
    """Print and write how stable the ranking is, from the rows of each seed; the first that failed ends it."""
    rows = []
    for each in by_seed:
        if _told(each, err):
            return EXIT_INVALID_RUN
        rows.append(each)
    found = stability.stability_of(rows)
    file = where / f"stability_{found['track']}{'_quick' if found['quick'] else ''}.json"
    folder.made(where)
    folder.write(file, stability.as_text(found))
    if as_json:
        print_json(found)
    for table in stability.tables(found):
        out.print(table.terminal())
    out.print(escape(f"{stability.words(found)}. Written to {file}"), soft_wrap=True)
    return EXIT_OK


def _training_tables(asked: Asked) -> list[str]:
    """Return the tables that a foreign process may train on: those of people who are not scored."""
    if asked.place is None or asked.track != "open":
        return []
    return [str((asked.place / "direct" / name).absolute()) for name in population.trained().files]


def _computed(work: Work, store: Store, n_jobs: int | None, err: Console) -> Outcome:
    """Compute the trainings that are not there yet, and all twins."""
    trainings: dict[str, Training] = dict(work.trainings)
    n = len(work.cells)
    err.print(f"{n} twins, {len(trainings)} trainings (kept for the next call)", style="dim")
    with workers_of(n_jobs, None, err.print) as workers, PhaseProgress(err) as progress:
        outcome = compute(work.cells, trainings, store, workers, progress)
    outcome_faults = [Fault(failure.label, "", failure.reason) for failure in outcome.failures]
    if outcome_faults:
        raise InputError(outcome_faults)
    return outcome


def _write(row: Row, where: Path) -> Path:
    name = re.sub(r"\W+", "_", row["estimator"]).strip("_")
    seed = row["seed"]
    usual = seed == content()["tracks"][row["track"]]["seed"]
    kind = f"{row['track']}{'_quick' * row['quick']}{'' if usual else f'_seed_{seed}'}"
    file = where / kind / f"{name}.json"
    folder.made(file.parent)
    folder.write(file, as_text(row))
    return file


def as_text(row: Row) -> str:
    """Return a row as the text of its file: a line for each setting, so that differences can be read."""
    parts = []
    for name, value in row.items():
        if name == "settings":
            lines = ",\n".join(f"  {json.dumps(each)}: {json.dumps(scores)}" for each, scores in value.items())
            parts.append(f' "settings": {{\n{lines}\n }}')
        else:
            parts.append(f" {json.dumps(name)}: {json.dumps(value, ensure_ascii=False)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _table(rows: Sequence[Row]) -> Table:
    heads = ("estimator", "score", "95 %", "cover", "step")
    return Table("", heads, [_cells(row) for row in rows])


def _cells(row: Row) -> list[Any]:
    if "failed" in row:
        return [row["estimator"], "failed", None, None, None]
    low, high = row["score_interval_95"]
    covered = "none" if row["coverage_pct"] is None else f"{row['coverage_pct']:.1f}"
    return [
        row["estimator"],
        f"{row['score']:.3f}",
        f"{low:.3f}-{high:.3f}",
        covered,
        f"{row['machine']['step_ratio']:.3g}",
    ]


def _settings(rows: Sequence[Row]) -> Table:
    """Return the ratio to hold in each setting, a column for each estimator that has a row."""
    known = [row for row in rows if "failed" not in row]
    names = list(known[0]["settings"])
    cells = [[name, *(f"{row['settings'][name]['ratio_to_hold']:.3f}" for row in known)] for name in names]
    return Table("error over hold's", ("setting", *(row["estimator"] for row in known)), cells)


def _words(rows: Sequence[Row]) -> str:
    lines = [
        "score: error over hold's, geometric mean over the settings, with its 95 % interval over people",
        "cover: truths within the 95 % ellipsoid, in %",
        "step: its time over that of a reference loop in the same twins; on a busy machine, or beside a "
        "command, twice as long",
    ]
    if any(row["machine"].get("timed_by") == "the clock" for row in rows):
        lines.append("the step of a command is timed by the clock, with the way there and back: for a quiet machine")
    if rows[0]["quick"]:
        lines.append("quick: a sample of people and settings, whose scores do not stand beside the published rows")
    return "\n".join(lines)
