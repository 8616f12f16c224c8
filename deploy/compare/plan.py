"""Plan of a comparison: trainings and cells of a request, with all its faults found before any computation."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Final, TypeVar

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.recordings import (
    list_trials,
    no_trials,
    own_trial,
    person_of,
    synthetic_trials,
    trial_file,
    whole_recording,
)
from tis.common.runtime.user_code import load_user_code
from tis.common.scenario import Scenario, virtual_time_faults
from tis.common.scenario.estimator_names import fault_of, is_user_defined
from tis.common.scenario.identification import is_model_file
from tis.common.scenario.reading import apply_settings, build_scenario
from tis.common.scenario.source import RecordedSource, Source
from tis.common.scenario.table_source import TableSource
from tis.deploy.compare.cells.cell import Cell, Training, first_row
from tis.deploy.compare.cells.identity import cell_of, dump, training_of, trial_facts
from tis.deploy.compare.grid import COMMAND, Point, Sweep, grid_faults, points_of
from tis.deploy.run.resolve import resolve

Value = TypeVar("Value")

DEFAULT_SYNTHETIC_SEEDS: Final = 6
"""The fewest people of which a 95 % interval can tell estimators apart."""
MAX_SEEDS: Final = 1_000_000
MAX_TWINS: Final = 200_000
"""Some 4 GB of memory for the plan, and as much for the results."""
_MOST_FAULTS: Final = 200


@dataclass(frozen=True)
class Request:
    """Request to `tis compare`; `make_plan` chooses the values that are None.

    The settings compared are all combinations of the values of ``sweeps``, or those side by side where ``zipped``.
    """

    scenario: str
    settings: tuple[str, ...] = ()
    estimators: tuple[str, ...] | None = None
    trials: tuple[str, ...] | None = None
    people: tuple[str, ...] | None = None
    n_seeds: int | None = None
    seed: int | None = None
    duration_s: float | None = None
    sweeps: tuple[Sweep, ...] = ()
    zipped: bool = False


@dataclass(frozen=True)
class Plan:
    """All units of work, with the description for the report."""

    name: str
    source: str
    estimators: tuple[str, ...]
    trials: tuple[str, ...]
    synthetic: tuple[str, ...]
    """Trials whose movement no person made."""
    n_seeds: int
    trained_on: str
    axes: tuple[str, ...]
    zipped: bool
    points: tuple[Point, ...]
    trainings: Mapping[str, Training]
    cells: tuple[Cell, ...]
    refused: tuple[Fault, ...]
    """Trials without a cell, each with the reason."""


def make_plan(request: Request) -> Plan:
    """Return trainings and cells; raises `InputError` and `DataError`, each with all faults.

    A table is one trial, trained on as the scenario says. JIGSAWS: all trials in the task's folder, each from row 0
    (``own_head``: from the end of its training rows) to its end, or for ``duration_s``. With several subjects the
    models are trained on the others, unless a setting names ``identification.train`` or the scenario names a model
    file. Synthetic: a seed is a trial. All random numbers follow from the scenario's seed and the next ones.
    """
    # scenarios, one per point of the grid, and the code of user-defined estimators
    grid_is_wrong = grid_faults(request.sweeps, request.zipped)
    if grid_is_wrong:
        raise InputError(grid_is_wrong)
    points = points_of(request.sweeps, request.zipped)
    scenarios = _scenarios(request, points)
    names = dict.fromkeys(name for each in scenarios for name in each.estimators if is_user_defined(name))
    own = load_user_code(list(names), COMMAND)
    # one unit of work per trial and seed
    base = scenarios[0]
    files = base.source if isinstance(base.source, RecordedSource) else None
    by_others = base.identification.train == "others"
    recorded = () if files is None else trials_of(files, request.trials, request.people, by_others)
    several = files is not None and len(people_of(files, list_trials(files))) > 1
    seeds = request.n_seeds or (DEFAULT_SYNTHETIC_SEEDS if files is None else 1)
    _check_size(len(points), seeds * max(1, len(recorded)))
    all_seeds = range(base.seed, base.seed + seeds)
    trials = recorded if files else tuple(f"synthetic {seed}" for seed in all_seeds)
    units = list(product(recorded, all_seeds) if files else zip(trials, all_seeds, strict=True))
    keep = _names_training(request) or is_model_file(base.identification.train) or base.source.kind == "table"
    train = None if keep else "others" if several else "own_head"
    # cells share a training where everything that decides its models is equal
    trainings: dict[str, Training] = {}
    cells = []
    refused: dict[str, Fault] = {}
    for point, scenario in zip(points, scenarios, strict=True):
        for trial, seed in units:
            try:
                complete = _complete(scenario, trial, seed, train, request.duration_s)
            except DataError as error:
                refused |= {str(fault): fault for fault in error.faults}
                continue
            training = training_of(complete)
            if training is not None:
                # one timed training is enough
                trainings.setdefault(training.digest, replace(training, timed=not trainings))
            cells.append(cell_of(complete, point.label, trial, training, own))
    return Plan(
        name=base.name,
        source=base.source.kind,
        estimators=(*base.estimators, *(() if "hold" in base.estimators else ("hold",))),
        trials=trials,
        synthetic=trials if files is None else synthetic_trials(files, trials),
        n_seeds=seeds,
        trained_on=_trained_on(cells),
        axes=tuple(sweep.path for sweep in request.sweeps),
        zipped=request.zipped,
        points=points,
        trainings=trainings,
        cells=tuple(cells),
        refused=tuple(refused.values()),
    )


def _check_size(n_points: int, n_units: int) -> None:
    """Raise `InputError` for more twins than can be listed."""
    if n_points * n_units > MAX_TWINS:
        rule = f"at most {MAX_TWINS:,} twins can be compared at once: settings times trials times seeds"
        raise InputError(Fault(COMMAND, "--seeds", rule, f"{n_points * n_units:,}"))


def _scenarios(request: Request, points: Sequence[Point]) -> list[Scenario]:
    """Return the scenario at each point; raises `InputError` with all faults of all of them, and `DataError`."""
    faults = estimator_faults(request.estimators)
    scenarios = []
    for point in points:
        try:
            scenarios.append(
                resolve(request.scenario, request.settings, request.seed, request.duration_s, swept=point.settings)
            )
        except InputError as error:
            faults += error.faults
            if len(faults) > _MOST_FAULTS:
                break
    source = scenarios[0].source if scenarios else _source(request)
    faults += [fault for each in scenarios[:1] for fault in virtual_time_faults(request.scenario, each)]
    missing = [] if source is None else folder_faults(source)
    faults += [] if source is None else trial_faults(source, request.trials, request.people)
    if faults:
        # One of each kind: a field that is misspelt is so at each of its values.
        raise InputError(list({(one.where, one.field, one.rule): one for one in [*faults, *missing]}.values()))
    if missing:
        raise DataError(missing)
    return [_with_estimators(scenario, request) for scenario in scenarios]


def _source(request: Request) -> Source | None:
    """Return the source of a request whose other parts may be invalid; None when the source is invalid."""
    with suppress(InputError):
        settings = [setting for setting in request.settings if setting.startswith("source")]
        return resolve(request.scenario, settings).source
    return None


def _with_estimators(scenario: Scenario, request: Request) -> Scenario:
    if request.estimators is None:
        return scenario
    raw = dump(scenario) | {"estimators": list(dict.fromkeys(request.estimators))}
    if scenario.active_estimator not in request.estimators:
        raw["active_estimator"] = request.estimators[0]
    return build_scenario(raw, request.scenario)


def _names_training(request: Request) -> bool:
    """Tell whether a setting or a sweep names the training."""
    if any(sweep.path == "identification.train" for sweep in request.sweeps):
        return True
    raw = apply_settings({}, [setting for setting in request.settings if setting.startswith("identification")])
    identification = raw.get("identification")
    return isinstance(identification, dict) and "train" in identification


def _complete(scenario: Scenario, trial: str, seed: int, train: str | None, duration_s: float | None) -> Scenario:
    """Return a cell's complete scenario, whose training is not resolved yet."""
    raw = dump(scenario) | {"seed": seed}
    if train is not None:
        raw["identification"] |= {"train": train}
    source = scenario.source
    if not isinstance(source, RecordedSource):
        return build_scenario(raw | ({} if duration_s is None else {"duration_s": duration_s}), scenario.name)
    file = trial_file(source, trial)
    raw["source"] |= {"trial": trial} if source.kind == "jigsaws" else _at(source, file)
    placed = build_scenario(raw, scenario.name)
    start, n_rows = first_row(placed), _n_rows(placed, file)
    longest_s = (n_rows - 1 - start) / scenario.rate_hz
    if longest_s <= 0:
        rule = f"is too short to compare on: {n_rows} rows, and the run begins at row {start}"
        raise DataError(Fault(str(file), "", rule))
    raw["duration_s"] = longest_s if duration_s is None else min(duration_s, longest_s)
    return build_scenario(raw, scenario.name)


def _at(source: TableSource, file: Path) -> dict[str, str | None]:
    """Return the fields of a table's source that change with its file."""
    own = file == Path(source.path)
    return {"path": str(file)} if own else {"path": str(file), "person": None}


def _n_rows(scenario: Scenario, file: Path) -> int:
    """Return the rows of a recording at the scenario's rate; raises `DataError` for a table that cannot be read."""
    source = scenario.source
    if source.kind == "table":
        return len(whole_recording(scenario, source, first_row(scenario)))
    return trial_facts(file).n_rows


def _trained_on(cells: Sequence[Cell]) -> str:
    named = {cell.scenario.identification.train for cell in cells}
    words = {"others": "the same task by all other subjects", "own_head": "the rows of each trial before its start"}
    return " / ".join(sorted(words.get(train, train) for train in named))


def names_given(command: str, given: Mapping[str, Any], faults: list[Fault]) -> dict[str, Any]:
    """Return estimators, trials and people by name, None for an option that is not given or invalid."""

    def names(option: str, text: str) -> tuple[str, ...]:
        found = tuple(name.strip() for name in text.split(","))
        if not all(found):
            raise InputError(Fault(command, option, "must be names, separated by commas", text))
        return found

    lists = {name: [] if given[name] is None else [given[name]] for name in ("estimators", "trials", "people")}
    found = {name: read_all(partial(names, f"--{name}"), texts, faults) for name, texts in lists.items()}
    return {name: each[0] if each else None for name, each in found.items()}


def read_all(read: Callable[[str], Value], texts: Iterable[str] | None, faults: list[Fault]) -> list[Value]:
    """Return the parsed texts of an option; appends the faults of the others to ``faults``."""
    found = []
    for text in texts or ():
        try:
            found.append(read(text))
        except InputError as error:
            faults += error.faults
    return found


def estimator_faults(names: Sequence[str] | None) -> list[Fault]:
    """Return a fault for each name that cannot be an estimator's, judged by the text alone."""
    found = ((name, fault_of(name)) for name in names or ())
    return [Fault(COMMAND, "--estimators", fault, name) for name, fault in found if fault is not None]


def trial_faults(source: Source, trials: Sequence[str] | None, people: Sequence[str] | None) -> list[Fault]:
    """Return the faults of the named trials and people; `folder_faults` covers a folder without trials."""
    named = {"--trials": trials, "--people": people}
    if not isinstance(source, RecordedSource):
        rule = "requires recordings: for a synthetic source use --seeds"
        return [Fault(COMMAND, option, rule) for option, names in named.items() if names is not None]
    found = list_trials(source)
    if not found:
        return []
    faults = []
    task = f"{source.task} " if source.kind == "jigsaws" else ""
    for option, kind, available in (("--trials", "trial", found), ("--people", "person", people_of(source, found))):
        rule = f"no such {task}{kind}; there are {', '.join(available)}"
        faults += [Fault(COMMAND, option, rule, name) for name in named[option] or () if name not in available]
    if trials is not None and people is not None:
        faults.append(Fault(COMMAND, "--people", "must be given without --trials"))
    return faults


def people_of(source: RecordedSource, trials: Sequence[str]) -> list[str]:
    """Return the people of recorded trials, each once."""
    return list(dict.fromkeys(person_of(source, trial) for trial in trials))


def folder_faults(source: Source) -> list[Fault]:
    """Return a fault if the source is a folder of trials without any trial, or a table that is not there."""
    if not isinstance(source, RecordedSource):
        return []
    found = list_trials(source)
    lacks = not found or (source.kind == "table" and own_trial(source) not in found)
    return [no_trials(source)] if lacks else []


def trials_of(
    source: RecordedSource, trials: Sequence[str] | None, people: Sequence[str] | None, by_others: bool = False
) -> tuple[str, ...]:
    """Return the named trials, each once, or those of the named people.

    Without either: all in the folder. Of tables it is the source's own, as a folder of tables need not hold one task,
    unless each person is estimated ``by_others``: then the folder does.
    """
    if people is not None:
        return tuple(trial for trial in list_trials(source) if person_of(source, trial) in people)
    everything = list_trials(source) if source.kind == "jigsaws" or by_others else [own_trial(source)]
    return tuple(dict.fromkeys(everything if trials is None else trials))
