"""Trials of a recorded source: a JIGSAWS name like D002, or the name of a table's file."""

from pathlib import Path

from tis.common.errors import Fault
from tis.common.runtime.recordings.jigsaws_recording import jigsaws_file, jigsaws_trials, no_jigsaws_trials
from tis.common.runtime.recordings.table_recording import person_in, tables_beside
from tis.common.scenario.source import JigsawsSource, RecordedSource


def trial_file(source: RecordedSource, trial: str) -> Path:
    """Return the path of a trial's file, which need not exist."""
    if isinstance(source, JigsawsSource):
        return jigsaws_file(source, trial)
    return Path(source.path).parent / trial


def own_trial(source: RecordedSource) -> str:
    """Return the name of the trial that the source plays."""
    return source.trial if isinstance(source, JigsawsSource) else Path(source.path).name


def list_trials(source: RecordedSource) -> list[str]:
    """Return the names of the trials in the source's folder, in order."""
    return jigsaws_trials(source) if isinstance(source, JigsawsSource) else tables_beside(source)


def person_of(source: RecordedSource, trial: str) -> str:
    """Return who moves in a trial."""
    if isinstance(source, JigsawsSource):
        return trial[0]
    return person_in(source, trial_file(source, trial))


def no_trials(source: RecordedSource) -> Fault:
    """Return the fault to report where `list_trials` finds none."""
    if isinstance(source, JigsawsSource):
        return no_jigsaws_trials(source)
    return Fault(source.path, "", "does not exist (given by source.path)")
