"""Command `tis compare`: computes missing cells, pools the scores and writes the results."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError, Fault, InputError
from tis.common.runtime.process import command_line
from tis.common.runtime.scenario_files import lines_told
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import Outcome, compute
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.grid import COMMAND, parse_sweep
from tis.deploy.compare.plan import Plan, Request, make_plan, names_given, read_all
from tis.deploy.compare.results import tables
from tis.deploy.compare.results.files import check_files, files_of, results_of, write_files
from tis.deploy.compare.study import plan_study, read_study
from tis.deploy.shell.guard import print_faults, print_json, print_warnings
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.shell.shipped_scenarios import shipped_names

_OF_THE_STUDY: Final = {"scenario": "SCENARIO", "settings": "--set", "sweeps": "--sweep", "zipped": "--zip"}
"""Options that a study file takes the place of, by their name among those given."""
_SHOWN_UNSCORED: Final = 5


def compare(plan: Plan, out_dir: Path | None, as_json: bool, workers: Workers, out: Console, err: Console) -> int:
    """Compare, print the table, and write CSV, JSON, Markdown and figures; return the exit code.

    Failed cells, and cells without a scored tick, are listed and cause `EXIT_INVALID_RUN`; the others count. Without
    any score no table is printed or written. With ``as_json`` the table's data go to standard output. Raises
    `DataError`.
    """
    with workers:  # first, as a cluster may not be there, and then nothing is written
        store = Store(out_dir or Path("runs") / "compare" / plan.name)
        check_files(store.path)
        outcome = run(plan, store, workers, err)
    results = results_of(plan, outcome, command_line())
    report = results.report
    _print_notices(plan, outcome, report, err)
    if not outcome.cells:
        return DataError.exit_code
    if not any(row["n_scored"] for row in report["rows"]):
        return EXIT_INVALID_RUN
    files = files_of(results)
    for text in files.left_out:
        err.print(escape(text), style="dim")
    write_files(files, store.path)
    out.print(tables.view(report))
    if as_json:
        print_json(report)
    out.print(escape(f"{', '.join(files.contents)} and every twin's result lie in {store.path}"), soft_wrap=True)
    return EXIT_INVALID_RUN if report["failed"] or report["unscored"] else EXIT_OK


def run(plan: Plan, store: Store, workers: Workers, err: Console) -> Outcome:
    """Say how much there is, and compute what is missing, with progress; an interrupt prints what is stored."""
    err.print(escape(_size_text(plan)), style="dim", soft_wrap=True)
    try:
        with PhaseProgress(err) as progress:
            return compute(plan.cells, plan.trainings, store, workers, progress)
    except KeyboardInterrupt:
        err.print(escape(f"interrupted: {_stored_text(plan, store)}"), style="yellow", soft_wrap=True)
        raise


def _size_text(plan: Plan) -> str:
    """Return a text on the size of a comparison."""
    seconds = sum(cell.scenario.duration_s for cell in plan.cells)
    of = f"{seconds / 3600:.1f} h" if seconds > 3600 else f"{seconds / 60:.1f} min"
    trainings = f", {len(plan.trainings):,} trainings" if plan.trainings else ""
    return f"{len(plan.cells):,} twins, {of} of movement in all{trainings}"


def _stored_text(plan: Plan, store: Store) -> str:
    """Return a text on the results stored in the folder."""
    n_cells = sum(store.cell(cell.digest) is not None for cell in plan.cells)
    n_models = sum(store.training(digest) is not None for digest in plan.trainings)
    models = f"{n_models} of {len(plan.trainings)} models and " if plan.trainings else ""
    return f"{models}{n_cells} of {len(plan.cells)} twins are stored in {store.path}; the same command resumes there"


def _print_notices(plan: Plan, outcome: Outcome, report: dict[str, Any], err: Console) -> None:
    """Print the number of resumed cells, warnings and failures."""
    if outcome.n_resumed:
        err.print(f"{outcome.n_resumed} of {len(plan.cells)} twins were computed before", style="dim")
    print_warnings(err, *tables.warnings(report))
    for failure in outcome.failures:
        if failure.trace is not None:
            err.print(failure.trace, markup=False, highlight=False, style="dim")
    print_faults(err, *report["failed"], *report["unscored"][:_SHOWN_UNSCORED])
    n_more = len(report["unscored"]) - _SHOWN_UNSCORED
    if n_more > 0:
        print_faults(err, f"and {n_more} more twins without a scored tick")


def compare_given(
    given: dict[str, Any], out_dir: Path | None, as_json: bool, workers: Workers, out: Console, err: Console
) -> int:
    """Run the comparison that the options give; return the exit code.

    Raises `InputError`, `DataError` and `PeerError`.
    """
    if given["study"] is not None:
        file: Path = given["study"]
        plan = plan_of_study_file(file, given)
        return compare(plan, out_dir or Path("runs") / "compare" / file.stem, as_json, workers, out, err)
    if given["scenario"] is None:
        names = ", ".join(shipped_names())
        raise InputError(Fault(COMMAND, "SCENARIO", f"is required: a file, or one of {names}; or --study FILE"))
    return compare(plan_of(given), out_dir, as_json, workers, out, err)


def plan_of(given: Mapping[str, Any]) -> Plan:
    """Return the plan given by the options; raises `InputError` and `DataError`.

    All faults come at once: an unreadable option is skipped while the others are checked.
    """
    faults: list[Fault] = []
    request = Request(
        scenario=given["scenario"],
        settings=tuple(given["settings"] or ()),
        **_chosen(given, faults),
        sweeps=tuple(read_all(parse_sweep, given["sweeps"], faults)),
        zipped=bool(given["zipped"]),
    )
    return _planned(lambda: make_plan(request), faults)


def plan_of_study_file(file: Path, given: Mapping[str, Any]) -> Plan:
    """Return the plan of a study file; options that say which part of it is computed override it.

    Raises `InputError` and `DataError`.
    """
    faults = [
        Fault(COMMAND, option, f"must be given without --study: {file} says it")
        for name, option in _OF_THE_STUDY.items()
        if given[name] is not None
    ]
    overrides = {name: value for name, value in _chosen(given, faults).items() if value is not None}

    def plan() -> Plan:
        with lines_told(file):
            return plan_study(*read_study(file), overrides)

    return _planned(plan, faults)


def _chosen(given: Mapping[str, Any], faults: list[Fault]) -> dict[str, Any]:
    """Return the fields of a `Request` that say which part is computed; appends what is wrong to ``faults``."""
    return names_given(COMMAND, given, faults) | {name: given[name] for name in ("n_seeds", "seed", "duration_s")}


def _planned(plan_it: Callable[[], Plan], faults: Sequence[Fault]) -> Plan:
    """Return the plan; raises `InputError` with its faults and these, and `DataError`."""
    try:
        plan = plan_it()
    except (InputError, DataError) as error:
        if not faults and isinstance(error, DataError):
            raise
        raise InputError([*faults, *error.faults]) from None
    if faults:
        raise InputError(faults)
    return plan
