"""Checks of the estimators and trials named on the command line."""

from collections.abc import Sequence
from typing import Final

from tis.common.errors import Fault, InputError
from tis.common.runtime.recordings import list_trials, no_trials, own_trial, person_of
from tis.common.scenario.estimator_names import fault_of
from tis.common.scenario.source import RecordedSource, Source

COMMAND: Final = "tis compare"


def names_of(command: str, option: str, text: str) -> tuple[str, ...]:
    """Return the names, separated by commas, that an option of a command holds; raises `InputError`."""
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise InputError(Fault(command, option, "must be names, separated by commas", text))
    return names


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


def trials_of(source: RecordedSource, trials: Sequence[str] | None, people: Sequence[str] | None) -> tuple[str, ...]:
    """Return the named trials, each once, or those of the named people.

    Without either: all in the task's folder, of a table itself, as a folder of tables need not hold one task.
    """
    if people is not None:
        return tuple(trial for trial in list_trials(source) if person_of(source, trial) in people)
    everything = list_trials(source) if source.kind == "jigsaws" else [own_trial(source)]
    return tuple(dict.fromkeys(everything if trials is None else trials))
