"""Trials that are measured on: recorded ones, or those of a synthetic population; and choices of some of them."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Final, get_args

from tis.common.errors import DataError, Fault, InputError
from tis.common.estimators import ESTIMATORS
from tis.common.runtime.recordings import list_trials, no_trials
from tis.common.runtime.recordings.jigsaws import JIGSAWS_VARIABLE
from tis.common.scenario.estimator_names import fault_of
from tis.common.scenario.source import JigsawsSource
from tis.deploy.tools.synth import write_trials

# Choice of the methods, and the extent of what is computed for each.

COMMAND: Final = "tis paper --methods"

DEFAULT_METHODS: Final = (
    "hold",
    "moesp_kf",
    "paper",
    "arx_kf",
    "innovations_kf",
    "direct_ls",
    "transformer",
    "informer",
    "cnn",
    "gpr",
    "srlsmf",
    "srlsmf_l1",
    "drmf",
)
"""The yardstick, the linear estimators, and those of the paper's other columns."""


@dataclass(frozen=True)
class Extent:
    """How much is computed for each method; ``n_people`` None: all trials of all people for the accuracy."""

    delays_ms: tuple[float, ...] = (33, 100, 200, 500, 1000)
    losses_pct: tuple[float, ...] = (0, 1, 5, 10, 20, 30)
    noises_mm: tuple[float, ...] = (0, 0.5, 1, 2, 5)
    n_training_trials: tuple[int, ...] = (1, 2, 4, 8)
    block_rows: tuple[int, ...] = (5, 10, 20, 40)
    n_seeds: int = 3
    n_people: int | None = None
    duration_s: float | None = None
    n_rounds: int = 5
    n_ticks: int = 900


WHOLE: Final = Extent()
QUICK: Final = Extent(
    delays_ms=(100, 500),
    losses_pct=(0, 20),
    noises_mm=(0, 2),
    n_training_trials=(1,),
    block_rows=(5, 10),
    n_seeds=1,
    n_people=2,
    duration_s=12.0,
    n_rounds=2,
    n_ticks=300,
)
DELAY_MS: Final = 100.0
"""Constant delay at which all but accuracy and reliability is measured."""
MEAN_BURST: Final = 8.0
"""Mean length of the bursts of loss, in messages: a quarter of a second at 30 Hz."""
RELIABILITY_NETWORK: Final = (
    "network={forward: {loss: {kind: burst, p_loss: 0.05, mean_burst: 4}, delay: {kind: uniform, low_ms: 50, "
    "high_ms: 150}, ordering: reorder}}"
)


def methods_of(text: str | None) -> tuple[str, ...]:
    """Return the methods of a list separated by commas, `hold` first; `DEFAULT_METHODS` for None.

    Raises `InputError` with all faults. Estimators of users are refused: which models they need is unknown.
    """
    names: Sequence[str] = DEFAULT_METHODS if text is None else [name.strip() for name in text.split(",")]
    faults = [
        Fault(COMMAND, "--estimators", fault_of(name) or "must be a built-in estimator", name)
        for name in names
        if name not in ESTIMATORS
    ]
    if faults:
        raise InputError(faults)
    return tuple(dict.fromkeys(("hold", *names)))


Task = str
TASKS: Final = get_args(JigsawsSource.model_fields["task"].annotation)
_N_PEOPLE: Final = 4
_N_TRIALS: Final = 3


@dataclass(frozen=True)
class Trials:
    """Trials of one task, by name, in a folder, None for the usual one; and those of the other tasks there."""

    path: str | None
    task: Task
    names: tuple[str, ...]
    elsewhere: dict[Task, tuple[str, ...]]
    synthetic: bool = False

    @property
    def people(self) -> list[str]:
        """The letters of the people."""
        return _letters(self.names)

    def few(self, n_people: int | None) -> tuple[str, ...]:
        """Return the last trial of each person, of the first ``n_people`` ones: all trials would take hours."""
        return tuple({name[0]: name for name in self.names}.values())[:n_people]

    def others(self, trial: str) -> tuple[str, ...]:
        """Return the trials of all other people, by turns one of each, so that the first n are of many people."""
        each = [[name for name in self.names if name[0] == who] for who in self.people if who != trial[0]]
        return tuple(name for turn in zip_longest(*each) for name in turn if name is not None)

    def own(self, trial: str) -> tuple[str, ...]:
        """Return the other trials of the person of a trial."""
        return tuple(name for name in self.names if name[0] == trial[0] and name != trial)

    def next_person(self, trial: str) -> tuple[str, ...]:
        """Return the trials of the next person after that of a trial, the first after the last."""
        people = self.people
        who = people[(people.index(trial[0]) + 1) % len(people)]
        return tuple(name for name in self.names if name[0] == who)


def find_trials(path: str | None, task: Task, folder: Path, seed: int, duration_s: float) -> Trials:
    """Return the recorded trials; without a folder of recordings those of a synthetic population, below ``folder``.

    The population is written once, four people with three trials of ``duration_s``. Raises `DataError` where a folder
    is named that has no trial of the task, or trials of one person only.
    """
    synthetic = path is None and not os.environ.get(JIGSAWS_VARIABLE) and not list_trials(_source(None, task))
    if synthetic:
        path = str(folder / f"population_{task}_{seed}_{duration_s:g}s")
        if not list_trials(_source(path, task)):
            write_trials(Path(path), _N_TRIALS, task, seed, duration_s, COMMAND, _N_PEOPLE)
    source = _source(path, task)
    names = tuple(list_trials(source))
    if not names:
        raise DataError(no_trials(source))
    if len(_letters(names)) < 2:
        found = ", ".join(names)
        raise DataError(Fault(COMMAND, "", f"needs trials of at least two people; found: {found}"))
    others = {other: tuple(list_trials(_source(path, other))) for other in TASKS if other != task}
    return Trials(path, task, names, {other: found for other, found in others.items() if found}, synthetic)


def _source(path: str | None, task: Task) -> JigsawsSource:
    return JigsawsSource.model_validate({"kind": "jigsaws", "path": path, "task": task})


def _letters(trials: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(trial[0] for trial in trials))
