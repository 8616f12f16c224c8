"""Loading of the recordings that a scenario names; only this package reads trials and tables."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.recordings.jigsaws_recording import (
    HEAD_ROWS,
    JIGSAWS_VARIABLE,
    folder,
    jigsaws_recording,
    other_subjects,
    root,
    training_trial,
)
from tis.common.runtime.recordings.run_length import first_row, too_short
from tis.common.runtime.recordings.table_recording import table_recording
from tis.common.runtime.recordings.trials import list_trials, no_trials, own_trial, person_of, trial_file
from tis.common.scenario import Scenario
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.source import JigsawsSource, RecordedSource, SyntheticSource
from tis.common.scenario.table_source import TableSource
from tis.common.sources.provenance import digest_of_synthetic
from tis.common.sources.sensor_noise import with_noise
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Recording


def located(scenario: Scenario) -> Scenario:
    """Return the scenario with the absolute path of its recordings, so that the log names the files that are read."""
    source = scenario.source
    if isinstance(source, TableSource):
        path = str(Path(source.path).absolute())
    elif isinstance(source, JigsawsSource) and source.path is None:
        path = str(root(source))
    else:
        return scenario
    return scenario.model_copy(update={"source": source.model_copy(update={"path": path})})


def load_recording(scenario: Scenario) -> Recording:
    """Return the recording that the run plays, from row 0 on, with the row at which the run begins.

    It has at least one row more than the run sends, since truth is interpolated at the ticks. Raises `InputError`
    when the run would begin within its training rows, `DataError` when the recording is missing, damaged or too
    short. Oracle: recordings that the tests write.
    """
    start = first_row(scenario)
    source = scenario.source
    if isinstance(source, SyntheticSource):
        digest = digest_of_synthetic(source, scenario.seed, scenario.rate_hz)
        n_rows = start + scenario.n_samples + 1
        return replace(synthesise(source, scenario.seed, scenario.rate_hz, n_rows, start), digest=digest)
    if isinstance(source, LiveSource):
        rule = "must be recorded or synthetic here: a live movement is known only while it is made"
        raise InputError(Fault(f"scenario {scenario.name}", "source.kind", rule, source.kind))
    recording = whole_recording(scenario, source, start)
    fault = too_short(scenario, Path(recording.file or ""), len(recording))
    if fault is not None:
        raise DataError(fault)
    return recording


def whole_recording(scenario: Scenario, source: RecordedSource, start: int) -> Recording:
    """Return all of the recording in the source's own file, whatever the run's duration; raises `DataError`."""
    if isinstance(source, JigsawsSource):
        return jigsaws_recording(scenario, source, start)
    own_head = scenario.identification.train == "own_head"
    head_rows = scenario.identification.train_samples if own_head else HEAD_ROWS
    if scenario.identification.looks_ahead:
        rule = "must be position: a table has no columns of velocities"
        raise InputError(Fault(f"scenario {scenario.name}", "identification.inputs", rule))
    return table_recording(source, Path(source.path), scenario.rate_hz, head_rows, start)


def check_recording(scenario: Scenario) -> None:
    """Raise what `load_recording` raises for recorded trials, before any process starts; a synthetic one is there."""
    if isinstance(scenario.source, RecordedSource):
        load_recording(scenario)


def load_training(scenario: Scenario, recording: Recording) -> list[Recording]:
    """Return the training data of the arm's model; none for a model file, which the caller reads.

    ``own_head``: the first ``train_samples`` rows of ``recording``. ``others``: all trials of the same task by other
    subjects in the folder, both hands (which are pooled), with the same pairing as the run's; for a table, the tables
    of other people beside it, with its columns and hands. Damaged ones are left out; the first recording names them
    in ``left_out``. Raises `DataError` when there are none, or only damaged ones.
    """
    train = scenario.identification.train
    if train == "own_head":
        head = recording.head(scenario.identification.train_samples)
        return [with_noise(head, scenario.identification.sensor_noise_m, scenario.seed)]
    source = scenario.source
    if train != "others" or not isinstance(source, RecordedSource):
        return []
    others = trials_of_others(source)
    if not others:
        raise DataError(_no_others(scenario, source))
    return load_trials(scenario, recording, others)


def trials_of_others(source: RecordedSource) -> list[str]:
    """Return the trials of the source's folder in which other people move."""
    trials = list_trials(source)
    if isinstance(source, JigsawsSource):
        return other_subjects(source, trials)
    own = person_of(source, Path(source.path).name)
    return [trial for trial in trials if person_of(source, trial) != own]


def _no_others(scenario: Scenario, source: RecordedSource) -> Fault:
    found = ", ".join(list_trials(source)[:20]) or "no trial"
    if isinstance(source, JigsawsSource):
        rule = f"needs {source.task} trials of other subjects than {source.trial[0]} in {folder(source)}"
    else:
        own, there = person_of(source, Path(source.path).name), Path(source.path).parent
        rule = (
            f"needs tables of other people than {own} in {there} (a table's person is in its metadata, or its name "
            "up to the first _); own_head trains on the recording's own first rows, a model file on none"
        )
    return Fault(f"scenario {scenario.name}", "identification.train: others", f"{rule}; found: {found}")


def load_trials(scenario: Scenario, recording: Recording, trials: Sequence[str]) -> list[Recording]:
    """Return the named trials of the source's folder as training data, paired as those of ``recording``.

    Damaged trials are left out; the first recording names them in ``left_out``. Raises `DataError` when all are
    damaged.
    """
    source = scenario.source
    assert isinstance(source, RecordedSource)
    faults: list[Fault] = []
    recordings = []
    for trial in trials:
        try:
            if isinstance(source, JigsawsSource):
                clean = training_trial(scenario, source, recording, trial)
            else:
                clean = table_recording(source, trial_file(source, trial), scenario.rate_hz, HEAD_ROWS, 0)
            recordings.append(with_noise(clean, scenario.identification.sensor_noise_m, scenario.seed))
        except DataError as error:
            faults += error.faults
    if not recordings:
        raise DataError(faults)
    left_out = tuple(f"trained without {fault}" for fault in faults)
    return [replace(recordings[0], left_out=left_out), *recordings[1:]]


__all__ = [
    "JIGSAWS_VARIABLE",
    "check_recording",
    "list_trials",
    "load_recording",
    "load_training",
    "load_trials",
    "located",
    "no_trials",
    "own_trial",
    "person_of",
    "trial_file",
    "trials_of_others",
    "whole_recording",
]
