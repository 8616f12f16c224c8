"""Estimators and trials as they are named on the command line, against those that there are."""

import difflib
from collections.abc import Sequence
from typing import Final, get_args

from common.errors import Fault
from common.runtime.recordings import list_trials, no_trials
from common.scenario.patient import EstimatorName
from common.scenario.source import JigsawsSource, Source

COMMAND: Final = "tis compare"


def estimator_faults(asked: Sequence[str] | None) -> list[Fault]:
    """Return a fault for each name that is no estimator's."""
    known = get_args(EstimatorName)
    return [
        Fault(COMMAND, "--estimators", f"no such estimator{_near(name, known)}", name)
        for name in asked or ()
        if name not in known
    ]


def trial_faults(source: Source, asked: Sequence[str] | None) -> list[Fault]:
    """Return what is wrong with the trials asked for; a folder without any is another matter: `folder_faults`."""
    if source.kind != "jigsaws":
        rule = "needs a JIGSAWS source: of a synthetic one give --seeds"
        return [] if asked is None else [Fault(COMMAND, "--trials", rule)]
    there = list_trials(source)
    rule = f"no such {source.task} trial; there are {', '.join(there)}"
    return [Fault(COMMAND, "--trials", rule, trial) for trial in asked or () if there and trial not in there]


def folder_faults(source: Source) -> list[Fault]:
    """Return why a source has no trials, if it is of such a kind and has none."""
    return [no_trials(source)] if source.kind == "jigsaws" and not list_trials(source) else []


def trials_of(source: JigsawsSource, asked: Sequence[str] | None) -> tuple[str, ...]:
    """Return the trials asked for, each once; all in the task's folder when None."""
    return tuple(dict.fromkeys(list_trials(source) if asked is None else asked))


def _near(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=2, cutoff=0.6)
    if near:
        return f", did you mean {' or '.join(map(repr, near))}?"
    return f"; there are {', '.join(known)}"
