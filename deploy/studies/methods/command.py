"""Command `tis paper --methods`: twins of all methods, times of their steps, and the page with its files."""

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError, Fault, TisError
from tis.deploy.compare.cells.store import Store, resumable
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, check_outputs_in, print_faults
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.methods.claims import MEMBERS, verdicts
from tis.deploy.studies.methods.computing import Computed, compute_methods
from tis.deploy.studies.methods.figures import figures_of
from tis.deploy.studies.methods.page import NAMES, Files, files_of, page_text
from tis.deploy.studies.methods.plans import ALL, HOLD, Measure, Subject
from tis.deploy.studies.methods.steps import Stepped, play_rounds, stepped
from tis.deploy.studies.methods.trials import (
    COMMAND,
    DEFAULT_METHODS,
    DELAY_MS,
    MEAN_BURST,
    QUICK,
    WHOLE,
    Extent,
    Trials,
    find_trials,
    methods_of,
)

_SYNTHETIC_S: Final = 60.0
_QUICK_SYNTHETIC_S: Final = 12.0
_SWEPT: Final[tuple[Measure, ...]] = ("data", "size")


@dataclass(frozen=True)
class Options:
    """Options of the command; ``out_dir`` holds the twins, where a second call resumes, and the files."""

    path: str | None
    task: str
    seed: int
    estimators: str | None
    page: Path
    out_dir: Path
    quick: bool
    n_jobs: int | None


def write_methods(options: Options, out: Console, err: Console) -> int:
    """Compute what the folder lacks, write page and files, and return the exit code.

    Gaps are listed, in the page too; those of methods that were asked for by name cause `EXIT_INVALID_RUN`. Raises
    `InputError` and `DataError`.
    """
    methods = methods_of(options.estimators)
    store = Store(options.out_dir)
    check_outputs(options.page)
    check_outputs_in(store.path, *NAMES)
    extent = QUICK if options.quick else WHOLE
    duration_s = _QUICK_SYNTHETIC_S if options.quick else _SYNTHETIC_S
    trials = find_trials(options.path, options.task, store.path, options.seed, duration_s)
    subjects = [Subject(method, trials, extent, options.seed) for method in methods]
    with resumable(store, err):
        computed = compute_methods(subjects, store, workers_of(options.n_jobs, None, err.print), err)
        if all(each.gaps for each in computed):
            raise DataError([Fault(COMMAND, each.subject.method, gap) for each in computed for gap in each.gaps])
        steps = _timed(computed, store, extent, err)
    report = report_of(options, trials, extent, computed, steps)
    files = files_of(report)
    for text in files.left_out:
        err.print(escape(text), style="dim")
    _write_page(options.page, report, files)
    for name, content in files.contents.items():
        folder.write(options.out_dir / name, content)
    gaps = [f"{each.subject.method}: {gap}" for each in computed for gap in each.gaps]
    print_faults(err, *gaps)
    where = f"written to {options.page}; {', '.join(files.contents)} and every twin's result lie in {store.path}"
    out.print(escape(where), soft_wrap=True)
    return EXIT_INVALID_RUN if gaps and options.estimators is not None else EXIT_OK


def _write_page(page: Path, report: dict[str, Any], files: Files) -> None:
    """Write the page, and its figures into a folder beside it, if they could be drawn."""
    drawn = {name: content for name, content in files.contents.items() if name.endswith(".svg")}
    pictures = page.with_name(f"{page.stem}_figures")
    for name, content in drawn.items():
        folder.write(folder.made(pictures) / name, content)
    folder.write(page, page_text(report, pictures.name if drawn else None))


def report_of(
    options: Options, trials: Trials, extent: Extent, computed: Sequence[Computed], steps: Sequence[Stepped]
) -> dict[str, Any]:
    """Return everything that was found, as plain JSON: the content of the page and of all files."""
    methods = [figures_of(each, steps) for each in computed]
    known = {name for members in MEMBERS.values() for name in members}
    return {
        "command": command_of(options, trials.synthetic),
        "quick": options.quick,
        "trials": {
            "task": trials.task,
            "names": list(trials.names),
            "people": trials.people,
            "elsewhere": {task: list(names) for task, names in trials.elsewhere.items()},
            "synthetic": trials.synthetic,
        },
        "extent": asdict(extent),
        "settings": {
            "delay_ms": DELAY_MS,
            "mean_burst": MEAN_BURST,
            "delays": " / ".join(f"{each:g}" for each in extent.delays_ms),
        },
        "methods": methods,
        "absent": sorted(known - {each.subject.method for each in computed}),
        "verdicts": verdicts(methods),
    }


def command_of(options: Options, synthetic: bool) -> str:
    """Return the command that repeats the comparison; the folder of the recordings is everybody's own."""
    words = ["tis", "paper", "--methods", "--seed", str(options.seed)]
    words += [] if options.task == "Suturing" else ["--task", options.task]
    chosen = methods_of(options.estimators)
    words += [] if chosen == tuple(dict.fromkeys((HOLD, *DEFAULT_METHODS))) else ["--estimators", ",".join(chosen)]
    recordings = "" if synthetic else "TIS_JIGSAWS=/path/to/jigsaws "
    return recordings + shlex.join([*words, *(["--quick"] if options.quick else [])])


def _timed(computed: Sequence[Computed], store: Store, extent: Extent, err: Console) -> list[Stepped]:
    """Return all methods with the models of each training that is measured, after playing the rounds."""
    entries = []
    for each in computed:
        for measure in _SWEPT:
            entries += _entries(each, measure, store)
    if entries and computed[0].subject.method == HOLD:
        entries += _hold_beside(computed, store)
    with PhaseProgress(err) as progress:
        play_rounds(entries, extent, progress)
    return entries


def _entries(computed: Computed, measure: Measure, store: Store, method: str | None = None) -> list[Stepped]:
    """Return a method with the models for the first trial at each setting; one that cannot be built is left out."""
    if measure not in computed.plans:
        return []
    found: dict[str, Stepped] = {}
    for cell in computed.plans[measure].cells:
        setting = cell.setting or ALL
        if setting in found or cell.training not in computed.outcome.trainings:
            continue
        model_file = store.model_file(cell.training)
        try:
            found[setting] = stepped(method or computed.subject.method, measure, setting, cell.scenario, model_file)
        except TisError:  # the twins, which failed for the same reason, have told it
            continue
    return list(found.values())


def _hold_beside(computed: Sequence[Computed], store: Store) -> list[Stepped]:
    """Return `hold` beside the first method that has models: it needs none."""
    for each in computed:
        found = [entry for entry in _entries(each, "data", store, HOLD) if entry.setting == ALL]
        if found:
            return found
    return []
