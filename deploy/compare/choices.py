"""Estimators and trials as they are named on the command line, against those that there are."""

from collections.abc import Sequence
from typing import Final

from common.errors import Fault
from common.runtime.recordings import list_trials, no_trials
from common.scenario.estimator_names import fault_of
from common.scenario.source import JigsawsSource, Source

COMMAND: Final = "tis compare"


def estimator_faults(names: Sequence[str] | None) -> list[Fault]:
    """Return a fault for each name that is no estimator's, as far as its text tells."""
    found = ((name, fault_of(name)) for name in names or ())
    return [Fault(COMMAND, "--estimators", fault, name) for name, fault in found if fault is not None]


def trial_faults(source: Source, names: Sequence[str] | None) -> list[Fault]:
    """Return what is wrong with the trials asked for; a folder without any is another matter: `folder_faults`."""
    if source.kind != "jigsaws":
        rule = "needs a JIGSAWS source: of a synthetic one give --seeds"
        return [] if names is None else [Fault(COMMAND, "--trials", rule)]
    available = list_trials(source)
    rule = f"no such {source.task} trial; there are {', '.join(available)}"
    return [Fault(COMMAND, "--trials", rule, trial) for trial in names or () if available and trial not in available]


def folder_faults(source: Source) -> list[Fault]:
    """Return why a source has no trials, if it is of such a kind and has none."""
    return [no_trials(source)] if source.kind == "jigsaws" and not list_trials(source) else []


def trials_of(source: JigsawsSource, names: Sequence[str] | None) -> tuple[str, ...]:
    """Return the trials asked for, each once; all in the task's folder when None."""
    return tuple(dict.fromkeys(list_trials(source) if names is None else names))
