"""Checks of the estimators and trials named on the command line."""

from collections.abc import Sequence
from typing import Final

from common.errors import Fault
from common.runtime.recordings import list_trials, no_trials
from common.scenario.estimator_names import fault_of
from common.scenario.source import JigsawsSource, Source

COMMAND: Final = "tis compare"


def estimator_faults(names: Sequence[str] | None) -> list[Fault]:
    """Return a fault for each name that cannot be an estimator's, judged by the text alone."""
    found = ((name, fault_of(name)) for name in names or ())
    return [Fault(COMMAND, "--estimators", fault, name) for name, fault in found if fault is not None]


def trial_faults(source: Source, names: Sequence[str] | None) -> list[Fault]:
    """Return the faults of the named trials; `folder_faults` covers a folder without trials."""
    if source.kind != "jigsaws":
        rule = "requires a JIGSAWS source: for a synthetic one use --seeds"
        return [] if names is None else [Fault(COMMAND, "--trials", rule)]
    available = list_trials(source)
    rule = f"no such {source.task} trial; there are {', '.join(available)}"
    return [Fault(COMMAND, "--trials", rule, trial) for trial in names or () if available and trial not in available]


def folder_faults(source: Source) -> list[Fault]:
    """Return a fault if the source is a folder of trials without any trial."""
    return [no_trials(source)] if source.kind == "jigsaws" and not list_trials(source) else []


def trials_of(source: JigsawsSource, names: Sequence[str] | None) -> tuple[str, ...]:
    """Return the named trials, each once; all in the task's folder when None."""
    return tuple(dict.fromkeys(list_trials(source) if names is None else names))
