"""Trials that are measured on: recorded ones, or those of a synthetic population; and choices of some of them."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Final, get_args

from tis.common.errors import DataError, Fault
from tis.common.runtime.recordings import JIGSAWS_VARIABLE, list_trials, no_trials
from tis.common.scenario.source import JigsawsSource
from tis.deploy.methods.choice import COMMAND
from tis.deploy.tools.synth import write_trials

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
        return tuple({_letter(name): name for name in self.names}.values())[:n_people]

    def others(self, trial: str) -> tuple[str, ...]:
        """Return the trials of all other people, by turns one of each, so that the first n are of many people."""
        each = [[name for name in self.names if _letter(name) == who] for who in self.people if who != _letter(trial)]
        return tuple(name for turn in zip_longest(*each) for name in turn if name is not None)

    def own(self, trial: str) -> tuple[str, ...]:
        """Return the other trials of the person of a trial."""
        return tuple(name for name in self.names if _letter(name) == _letter(trial) and name != trial)

    def next_person(self, trial: str) -> tuple[str, ...]:
        """Return the trials of the next person after that of a trial, the first after the last."""
        people = self.people
        who = people[(people.index(_letter(trial)) + 1) % len(people)]
        return tuple(name for name in self.names if _letter(name) == who)


def find_trials(path: str | None, task: Task, folder: Path, seed: int, duration_s: float) -> Trials:
    """Return the recorded trials; without a folder of recordings those of a synthetic population, below ``folder``.

    The population is written once, four people with three trials of ``duration_s``. Raises `DataError` where a folder
    is named that has no trial of the task, or trials of one person only.
    """
    synthetic = path is None and not os.environ.get(JIGSAWS_VARIABLE) and not list_trials(_source(None, task))
    if synthetic:
        path = str(_population(folder, task, seed, duration_s))
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


def _population(folder: Path, task: Task, seed: int, duration_s: float) -> Path:
    """Write a population, unless an earlier call did; return its folder."""
    path = folder / f"population_{task}_{seed}_{duration_s:g}s"
    if not list_trials(_source(str(path), task)):
        write_trials(path, _N_TRIALS, task, seed, duration_s, COMMAND, _N_PEOPLE)
    return path


def _letter(trial: str) -> str:
    """Return the letter of the person who moves in a trial of JIGSAWS."""
    return trial[0]


def _letters(trials: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(map(_letter, trials)))
