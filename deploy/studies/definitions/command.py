"""Command `tis compare --definitions`: computes missing cells, prints the tables, and optionally writes the page."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, DataError, Fault, InputError
from tis.common.runtime.recordings import load_recording, load_trials
from tis.common.scenario.reading import build_scenario
from tis.deploy.compare.cells.identity import dump
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.command import run
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.grid import COMMAND
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, print_faults, print_json
from tis.deploy.studies.definitions.readings import N_AHEAD, plan_splits
from tis.deploy.studies.definitions.report import build, of_split, page_text, view
from tis.deploy.studies.definitions.velocity_inputs import INPUTS, leave_user_out, window_rows

_ALLOWED: Final = ("settings", "duration_s")


def compare_definitions(
    given: Mapping[str, Any],
    page: Path | None,
    out_dir: Path | None,
    as_json: bool,
    workers: Workers,
    out: Console,
    err: Console,
) -> int:
    """Compare definitions, print the tables and write them as JSON, and as the page; return the exit code.

    Failed cells are listed and cause `EXIT_INVALID_RUN`. Raises `InputError`, and `DataError` where there are no
    trials of at least two people, or none that can be forecast.
    """
    if any(value is not None for name, value in given.items() if name not in _ALLOWED):
        rule = "must be given without a scenario or other options than --set, --duration-s, --page, --out and --jobs"
        raise InputError(Fault(COMMAND, "--definitions", rule))
    check_outputs(page)
    settings = tuple(given["settings"] or ())
    plan = plan_splits(settings, given["duration_s"])
    with workers:
        store = Store(out_dir or Path("runs") / "compare" / "definitions")
        outcome = run(plan, store, workers, err)
    if not any(result["forecasts"] for result in outcome.cells.values()):
        raise DataError([Fault("", "", f"{each.label}: {each.reason}") for each in outcome.failures] or plan.refused)
    # all trials that can be read, with their velocities; no estimator runs in this scenario
    raw = dump(plan.cells[0].scenario)
    raw["identification"] |= {"inputs": ["position", "velocity"], "allow_lookahead": True}
    scenario = build_scenario(raw, plan.name)
    recordings = list(load_trials(scenario, load_recording(scenario), plan.trials))
    least_squares = {inputs: leave_user_out(recordings, inputs, N_AHEAD) for inputs in INPUTS}
    report = build(plan, outcome, least_squares, command_of(settings, given["duration_s"]))
    report["windows"] = window_rows(of_split(plan, outcome, "user"), recordings)
    print_faults(err, *report["failed"])
    if not report["rows"]:
        rule = f"needs trials of more than {2 + N_AHEAD / 30:g} s, training rows not counted"
        raise DataError(Fault(COMMAND, "--definitions", rule))
    folder.write_json(store.path / "definitions.json", report)
    if page is not None:
        folder.write(page, page_text(report))
    out.print(view(report))
    if as_json:
        print_json(report)
    written = "" if page is None else f"written to {page}; "
    out.print(escape(f"{written}definitions.json and every twin's result lie in {store.path}"), soft_wrap=True)
    return EXIT_INVALID_RUN if report["failed"] else EXIT_OK


def command_of(settings: Sequence[str], duration_s: float | None) -> str:
    """Return the command that repeats the comparison; the folder of the trials is everybody's own."""
    words = ["tis", "compare", "--definitions"]
    words += [] if duration_s is None else ["--duration-s", f"{duration_s:g}"]
    for setting in settings:
        words += [] if setting.startswith("source.path") else ["--set", setting]
    return shlex.join(words)
