"""Options of `tis admissible`: parsing into a study, with all faults before any computation."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

from tis.common.errors import DataError, Fault, InputError
from tis.common.scenario import Scenario
from tis.common.scenario.source import RecordedSource
from tis.deploy.compare.cells.identity import dump
from tis.deploy.compare.grid import COMMAND as COMPARE
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Request, make_plan, names_given, people_of, read_all
from tis.deploy.run.resolve import resolve
from tis.deploy.studies.admissible.criterion import COMMAND, parse_limit
from tis.deploy.studies.admissible.evaluation import check_persons
from tis.deploy.studies.admissible.profiles import profile_names, redundancies
from tis.deploy.studies.admissible.region import Axis, axis_faults, parse_axis, whole_fault
from tis.deploy.studies.admissible.study import Effort, Order

DEFAULT_SYNTHETIC_SEEDS = 8
DEFAULT_RECORDED_SEEDS = 4


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
    scenario, trials = _scenario(request, axes)
    source = scenario.source
    recorded = isinstance(source, RecordedSource)
    n_seeds = request.n_seeds or (DEFAULT_RECORDED_SEEDS if recorded else DEFAULT_SYNTHETIC_SEEDS)
    request = replace(request, n_seeds=n_seeds)
    check_persons(people_of(source, trials) if isinstance(source, RecordedSource) else trials * n_seeds, recorded)
    placed = tuple(replace(axis, whole=_is_whole(scenario, axis.path)) for axis in axes)
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


def _scenario(request: Request, axes: Sequence[Axis]) -> tuple[Scenario, tuple[str, ...]]:
    """Return the scenario at the first valid corner, and the trials; raises `InputError` and `DataError`.

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
        return scenario, plan.trials
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
