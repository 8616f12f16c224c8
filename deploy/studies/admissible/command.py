"""Command `tis admissible`: reads its options, runs the study and writes its report, tables and figure."""

import json
import shlex
import time
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.common.extras import GET_REPORT
from tis.common.runtime.process import command_line
from tis.common.runtime.recordings import has_columns, list_trials, person_of
from tis.common.scenario import Scenario
from tis.common.scenario.source import RecordedSource
from tis.deploy.compare.cells.identity import dump
from tis.deploy.compare.cells.store import Store, resumable
from tis.deploy.compare.engine.compute import workers_of
from tis.deploy.compare.grid import COMMAND as COMPARE
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Request, make_plan, names_given, people_of, read_all
from tis.deploy.run.resolve import resolve
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs_in, print_json, print_warnings
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.admissible import tables
from tis.deploy.studies.admissible.criterion import COMMAND, MIN_PERSONS, parse_limit
from tis.deploy.studies.admissible.evaluation import Evaluation, Network, check_persons, fault_of
from tis.deploy.studies.admissible.profiles import profile_names, redundancies
from tis.deploy.studies.admissible.region import Axis, axis_faults, parse_axis, whole_fault
from tis.deploy.studies.admissible.study import Effort, Order, Study

DEFAULT_SYNTHETIC_SEEDS = 16
"""With fewer people the bound of skewed figures lies far above their mean, and the region is too small."""
DEFAULT_RECORDED_SEEDS = 4
_N_SWEPT: Final = 5
"""Values of each axis in the comparison that a refusal offers for one person."""


def order_of(given: dict[str, Any]) -> Order:
    """Return what the options order; raises `InputError` with all faults, and `DataError`."""
    faults: list[Fault] = []
    limits = read_all(parse_limit, given["limits"], faults)
    axes = read_all(parse_axis, given["over"], faults)
    profiles = read_all(profile_names, [given["profiles"]], faults)
    if not limits and not given["limits"]:
        faults.append(Fault(COMMAND, "--limit", "is required: NAME=VALUE, such as rmse_3d_mm=2"))
    if axes or not given["over"]:
        faults += axis_faults(tuple(axes))
    request = Request(
        scenario=given["scenario"],
        settings=tuple(given["settings"] or ()),
        **names_given(COMMAND, given, faults),
        n_seeds=given["n_seeds"],
        seed=given["seed"],
        duration_s=given["duration_s"],
    )
    if faults:
        # The scenario's own faults come at the same time.
        raise InputError([*faults, *_faults_of(request)])
    scenario, trials, corner = _scenario(request, axes)
    placed = tuple(replace(axis, whole=_is_whole(scenario, axis.path)) for axis in axes)
    source = scenario.source
    recorded = isinstance(source, RecordedSource)
    n_seeds = request.n_seeds or (DEFAULT_RECORDED_SEEDS if recorded else DEFAULT_SYNTHETIC_SEEDS)
    asked, request = request, replace(request, n_seeds=n_seeds)
    if isinstance(source, RecordedSource):
        people = people_of(source, trials)
        others = [one for one in list_trials(source) if person_of(source, one) not in people]
        # Columns are looked at for a refusal alone, as each table must be read.
        others = [one for one in others if has_columns(source, one)] if len(people) < MIN_PERSONS else []
        option = "--people" if request.people else "--trials" if request.trials else "source"
        check_persons(people, True, others, option, _for_one_person(asked, placed, corner))
    else:
        check_persons(trials * n_seeds, False)
    if found := [fault for fault in map(whole_fault, placed) if fault is not None]:
        raise InputError(found)
    return Order(
        name=scenario.name,
        request=request,
        axes=placed,
        limits=tuple(dict.fromkeys(limits)),
        estimators=tuple(dict.fromkeys(request.estimators or scenario.estimators)),
        effort=Effort(given["tolerance"], given["max_points"], given["n_checks"]),
        fresh_seed=scenario.seed + n_seeds,
        profiles=profiles[0],
        candidates=redundancies(
            scenario.rate_hz, len(scenario.source.hands), given["max_copies"], given["cheapest_by"]
        ),
    )


def _for_one_person(request: Request, axes: Sequence[Axis], corner: Network) -> str:
    """Return the command that answers the question for one person's recordings: a comparison along the axes."""
    words = ["tis", "compare", request.scenario]
    for setting in request.settings:
        words += ["--set", setting]
    for option, names in (
        ("--estimators", request.estimators), ("--trials", request.trials), ("--people", request.people),
    ):  # fmt: skip
        words += [option, ",".join(names)] if names else []
    for axis in axes:
        values = dict.fromkeys(axis.text(i / (_N_SWEPT - 1)) for i in range(_N_SWEPT))
        valid = [value for value in values if fault_of(request, {**corner, axis.path: value}) is None]
        words += ["--sweep", f"{axis.path}={','.join(valid)}"]
    for option, number in (
        ("--seeds", request.n_seeds), ("--seed", request.seed), ("--duration-s", request.duration_s),
    ):  # fmt: skip
        words += [option, f"{number:.15g}"] if number is not None else []
    return shlex.join(words)


def _scenario(request: Request, axes: Sequence[Axis]) -> tuple[Scenario, tuple[str, ...], Network]:
    """Return the scenario at the first valid corner, the trials, that corner; raises `InputError` and `DataError`.

    The plan of that corner finds the faults of estimators, trials and people.
    """
    refused: list[InputError] = []
    for corner in product((0.0, 1.0), repeat=len(axes)):
        sweeps = tuple(Sweep(axis.path, (axis.text(share),)) for axis, share in zip(axes, corner, strict=True))
        try:
            settings = [f"{sweep.path}={sweep.values[0]}" for sweep in sweeps]
            scenario = resolve(request.scenario, request.settings, request.seed, request.duration_s, swept=settings)
            plan = make_plan(replace(request, sweeps=sweeps, zipped=True, n_seeds=1))
        except InputError as error:
            refused.append(error)
            continue
        return scenario, plan.trials, {sweep.path: sweep.values[0] for sweep in sweeps}
    raise InputError([_renamed(fault) for fault in refused[0].faults])


def _faults_of(request: Request) -> list[Fault]:
    """Return the faults of the scenario, estimators, trials and people without any axis."""
    try:
        make_plan(replace(request, n_seeds=1))
    except (InputError, DataError) as error:
        return [_renamed(fault) for fault in error.faults]
    return []


def _renamed(fault: Fault) -> Fault:
    """Return a fault under this command's name and option; one of the network says how it gets stages."""
    of_axis = "--sweep" in fault.where
    hint = "; --set gives the network the stages" if of_axis and "network" in f"{fault.field} {fault.rule}" else ""
    where = fault.where.replace(COMPARE, COMMAND).replace("--sweep", "--over")
    return replace(fault, where=where, rule=f"{fault.rule}{hint}")


def _is_whole(scenario: Scenario, path: str) -> bool:
    """Tell whether a field takes integers only."""
    here: Any = dump(scenario)
    for step in path.split("."):
        try:
            here = here[int(step)] if isinstance(here, list) else here[step]
        except (LookupError, TypeError, ValueError):
            return False
    return isinstance(here, int) and not isinstance(here, bool)


_FORMATS: Final = ("svg", "pdf")
_ALWAYS: Final = ("admissible.json", "border.csv", "points.csv")
_FIGURES: Final = tuple(f"admissible.{form}" for form in _FORMATS)
_PAGE: Final = "admissible.html"


def admissible(
    given: dict[str, Any],
    out_dir: Path | None,
    as_json: bool,
    n_jobs: int | None,
    scheduler: str | None,
    out: Console,
    err: Console,
) -> int:
    """Find the regions, print the tables, and write JSON, CSV and figures; return the exit code.

    Raises `InputError`, `DataError` and `PeerError`.
    """
    workers = workers_of(n_jobs, scheduler, lambda text: err.print(escape(text), style="dim", soft_wrap=True))
    order = order_of(given)
    begun_s = time.monotonic()
    with workers:
        store = Store(out_dir or Path("runs") / "admissible" / order.name)
        check_outputs_in(store.path, *_ALWAYS, *_FIGURES, _PAGE)
        with resumable(store, err), PhaseProgress(err, in_rounds=True) as progress:
            evaluation = Evaluation(order.estimators, order.limits, store, workers, progress)
            study = Study(order, evaluation)
            try:
                report = study.run(command_line())
            except KeyboardInterrupt:
                if study.points:
                    progress.tell(study.so_far())
                raise
    print_warnings(err, *tables.warnings(report))
    written = _write(report, store.path, err)
    out.print(tables.view(report))
    resumed = f", {evaluation.n_resumed:,} of them stored before" if evaluation.n_resumed else ""
    took_s = time.monotonic() - begun_s
    took = f"{report['n_points']:,} networks, {report['n_twins']:,} twins{resumed}, {took_s:.0f} s"
    out.print(escape(f"\n{took}; {', '.join(written)} and every twin's result lie in {store.path}"), soft_wrap=True)
    if as_json:
        print_json(report)
    return EXIT_OK


def _write(report: dict[str, Any], path: Path, err: Console) -> list[str]:
    """Write all forms of the report; return their names. A figure of an earlier study is deleted."""
    files: dict[str, str | bytes] = {
        "admissible.json": json.dumps(report, indent=1, allow_nan=False) + "\n",
        "border.csv": tables.border_csv(report),
        "points.csv": tables.points_csv(report),
    }
    if find_spec("matplotlib") is None or find_spec("bokeh") is None:
        err.print(escape(f"no figure and no page without matplotlib and Bokeh: {GET_REPORT}"), style="dim")
    else:
        from tis.deploy.studies.admissible.plots import admissible_html

        files |= _figures(report)
        files[_PAGE] = admissible_html(report, files.get("admissible.svg"))
    for name in (*_FIGURES, _PAGE):
        if name not in files:
            folder.remove(path / name)
    for name, content in files.items():
        folder.write(path / name, content)
    return list(files)


def _figures(report: dict[str, Any]) -> dict[str, bytes]:
    from tis.deploy.report.publication.matplotlib_figures import rendered
    from tis.deploy.studies.admissible.plots import region_figure  # loads matplotlib

    figure = region_figure(report)
    return {} if figure is None else {f"admissible.{form}": rendered(figure, form) for form in _FORMATS}
