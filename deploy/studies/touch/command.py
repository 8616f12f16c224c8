"""Command `tis touch`: up to which stiffness and delay a wall can be touched, as a table, JSON and a figure."""

import json
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, get_args

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.extras import GET_REPORT
from tis.common.runtime.process import command_line
from tis.common.scenario.touch import CouplingKind
from tis.deploy.compare.cells.store import Store, resumable
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.compare.plan import Request, names_given
from tis.deploy.present.numbers import significant
from tis.deploy.present.table import Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs_in, print_json
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.touch.study import COMMAND, Border, Twin, checked, find_borders, loops_of, twins_by

_FORMATS: Final = ("svg", "pdf")
_REPORT: Final = "touch.json"
_MOST_DELAYS: Final = 50


def touch(
    given: dict[str, Any], out_dir: Path | None, as_json: bool, n_jobs: int | None, out: Console, err: Console
) -> int:
    """Find the borders, print the table, and write JSON and figures; return the exit code.

    Raises `InputError` with all faults of the options, and `DataError`.
    """
    faults: list[Fault] = []
    delays_ms = _numbers("--delays", given["delays"], faults)
    walls = _numbers("--walls", given["walls"], faults)
    if not faults and (len(walls) != 2 or not 1 <= walls[0] < walls[1]):
        faults.append(Fault(COMMAND, "--walls", "must be the softest and the stiffest wall in N/m, like 30,3000"))
    couplings = [one.strip() for one in given["couplings"].split(",")]
    if unknown := [one for one in couplings if one not in get_args(CouplingKind)]:
        rule = f"must be among {', '.join(get_args(CouplingKind))}"
        faults.append(Fault(COMMAND, "--couplings", rule, ", ".join(unknown)))
    names = names_given(COMMAND, {**given, "trials": None, "people": None}, faults)
    if faults:
        raise InputError(faults)
    settings, estimators = [*(given["settings"] or ())], names["estimators"]
    if estimators:  # all twins have them all, so that models are identified once
        settings += [
            f"estimators=[{','.join(dict.fromkeys(('hold', *estimators)))}]",
            f"active_estimator={estimators[0]}",
        ]
    request = Request(given["scenario"], tuple(settings), seed=given["seed"], duration_s=given["duration_s"])
    scenario = checked(request)
    loops = loops_of(couplings, estimators or scenario.estimators)
    begun_s = time.monotonic()
    store = Store(out_dir or Path("runs") / "touch" / scenario.name)
    check_outputs_in(store.path, _REPORT, *(f"touch.{form}" for form in _FORMATS))
    with (
        workers_of(n_jobs, None, lambda text: err.print(escape(text), style="dim")) as workers,
        resumable(store, err), PhaseProgress(err) as progress,
    ):  # fmt: skip
        run = twins_by(request, store, workers, progress)
        borders, twins = find_borders(loops, delays_ms, (walls[0], walls[1]), given["steps"], run)
    report = report_of(borders, twins, (walls[0], walls[1]))
    written = _write(report, store.path, err)
    out.print(table_of(borders).terminal())
    took = f"{len(twins)} twins, {time.monotonic() - begun_s:.0f} s"
    out.print(escape(f"\n{took}; {', '.join(written)} and every twin's result lie in {store.path}"), soft_wrap=True)
    if as_json:
        print_json(report)
    return EXIT_OK


def _numbers(option: str, text: str, faults: list[Fault]) -> list[float]:
    try:
        found = sorted({float(one) for one in text.split(",")})
    except ValueError:
        found = []
    if not found or len(found) > _MOST_DELAYS or not all(0 <= one <= 1e6 for one in found):
        faults.append(Fault(COMMAND, option, f"must be at most {_MOST_DELAYS} numbers from 0 on, with commas", text))
    return found


def report_of(borders: Sequence[Border], twins: Sequence[Twin], walls_n_m: tuple[float, float]) -> dict[str, Any]:
    """Return the study as JSON values."""
    return {
        "command": command_line(),
        "walls_n_m": list(walls_n_m),
        "borders": [{**one._asdict(), "loop": one.loop.name} for one in borders],
        "twins": [{**one._asdict(), "loop": one.loop.name} for one in twins],
    }


def table_of(borders: Sequence[Border]) -> Table:
    """Return a row for each delay, a column for each loop, and theory's limit."""
    delays, loops = (dict.fromkeys(getattr(one, name) for one in borders) for name in ("delay_ms", "loop"))
    at = {(one.loop, one.delay_ms): one for one in borders}
    limits = {one.delay_ms: one.limit_n_m for one in borders if one.limit_n_m is not None}
    rows = [
        (f"{ms:g}", *(_cell(at[loop, ms]) for loop in loops), significant(limits[ms]) if ms in limits else "-")
        for ms in delays
    ]
    note = "Stiffest wall that was stable in its twin; >: none stiffer was tried. Theory: for the newest sample"
    columns = ("delay, ms", *(loop.name.removeprefix("position_force, ") for loop in loops), "theory")
    return Table("Stiffness that can be touched, N/m, by the delay of each way", columns, rows, note)


def _cell(border: Border) -> str:
    if border.stable_n_m is None:
        return "none"
    return f"{'> ' if border.not_stable_n_m is None else ''}{significant(border.stable_n_m)}"


def _write(report: dict[str, Any], path: Path, err: Console) -> list[str]:
    files: dict[str, str | bytes] = {_REPORT: json.dumps(report, indent=1, allow_nan=False) + "\n"}
    if find_spec("matplotlib") is None:
        err.print(escape(f"no figure without matplotlib: {GET_REPORT}"), style="dim")
    else:
        from tis.deploy.report.publication.matplotlib_figures import rendered
        from tis.deploy.studies.touch.plots import touch_figure

        figure = touch_figure(report)
        files |= {f"touch.{form}": rendered(figure, form) for form in _FORMATS}
    for name, content in files.items():
        folder.write(path / name, content)
    return list(files)
