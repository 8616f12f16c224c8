"""Recordings and made movements that a scenario's source names; only this package reads trials and tables.

Each kind of files is a module with the functions of `Files`, registered in `_FILES`. ``duration_s: auto``, a run that
plays all of its recording, is resolved once, where the scenario is read: sides, logs and digests then know a number
only, on which all sides must agree.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Protocol

import tis.common.runtime.recordings.jigsaws as jigsaws
import tis.common.runtime.recordings.table as table
from tis.common.errors import DataError, Fault, InputError
from tis.common.scenario import AUTO, Scenario, reading
from tis.common.scenario.identification import MIN_TRAIN_SAMPLES
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.source import RecordedSource, SyntheticSource
from tis.common.sources.provenance import digest_of_synthetic
from tis.common.sources.sensor_noise import with_noise
from tis.common.sources.synthetic import synthesise, synthetic_training, unmade_movement
from tis.common.sources.table_columns import in_few
from tis.common.sources.trajectory import Recording


class Files(Protocol):
    """One kind of recorded source: where its trials lie, and how they are read."""

    def located(self, source: Any) -> str:
        """Return the absolute path of the recordings."""

    def trials(self, source: Any) -> list[str]:
        """Return the names of the trials in the source's folder, in order."""

    def own_trial(self, source: Any) -> str:
        """Return the name of the trial that the source plays."""

    def trial_file(self, source: Any, trial: str) -> Path:
        """Return the path of a trial's file, which need not exist."""

    def person_of(self, source: Any, trial: str) -> str:
        """Return who moves in a trial."""

    def made(self, source: Any, trial: str) -> bool:
        """Tell whether a program of the testbed made a trial's movement."""

    def has_columns(self, source: Any, trial: str) -> bool:
        """Tell whether a file of the folder has the source's columns: one that lacks them is no trial of its task."""

    def no_trials(self, source: Any) -> Fault:
        """Return the fault to report where `trials` finds none."""

    def no_others(self, source: Any) -> str:
        """Return what is missing where nobody else moves in the folder."""

    def whole(self, scenario: Scenario, source: Any, start: int) -> Recording:
        """Return all of the source's own trial; raises `DataError`, or `InputError` for inputs that it lacks."""

    def training(self, scenario: Scenario, source: Any, recording: Recording, trial: str) -> Recording:
        """Return a trial as training data, paired as ``recording``; raises `DataError`."""


_FILES: Final[Mapping[str, Files]] = {"jigsaws": jigsaws, "table": table}
"""The kinds of recorded sources, by ``source.kind``."""

_FOR_CHECKS: Final = 1.0
"""Duration in s in place of ``auto`` while the other fields are checked."""


def trial_file(source: RecordedSource, trial: str) -> Path:
    """Return the path of a trial's file, which need not exist. A trial has a name like D002, or that of its file."""
    return _FILES[source.kind].trial_file(source, trial)


def own_trial(source: RecordedSource) -> str:
    """Return the name of the trial that the source plays."""
    return _FILES[source.kind].own_trial(source)


def list_trials(source: RecordedSource) -> list[str]:
    """Return the names of the trials in the source's folder, in order."""
    return _FILES[source.kind].trials(source)


def person_of(source: RecordedSource, trial: str) -> str:
    """Return who moves in a trial."""
    return _FILES[source.kind].person_of(source, trial)


def synthetic_trials(source: RecordedSource, trials: Sequence[str]) -> tuple[str, ...]:
    """Return the trials whose movement a program of the testbed made."""
    return tuple(trial for trial in trials if _FILES[source.kind].made(source, trial))


def no_trials(source: RecordedSource) -> Fault:
    """Return the fault to report where `list_trials` finds none."""
    return _FILES[source.kind].no_trials(source)


def trials_of_others(source: RecordedSource) -> list[str]:
    """Return the trials of the source's folder in which other people move."""
    own = person_of(source, own_trial(source))
    return [trial for trial in list_trials(source) if person_of(source, trial) != own]


def has_columns(source: RecordedSource, trial: str) -> bool:
    """Tell whether a file of the source's folder has its columns; also of one that cannot be read."""
    return _FILES[source.kind].has_columns(source, trial)


def located(scenario: Scenario) -> Scenario:
    """Return the scenario with the absolute path of its recordings, so that the log names the files that are read."""
    source = scenario.source
    if not isinstance(source, RecordedSource):
        return scenario
    path = _FILES[source.kind].located(source)
    return scenario.model_copy(update={"source": source.model_copy(update={"path": path})})


def load_movement(scenario: Scenario) -> Recording:
    """Return what `load_recording` does, and of a live source its hands without rows; raises as `load_recording`."""
    source = scenario.source
    return unmade_movement(source, scenario.rate_hz) if source.kind == "live" else load_recording(scenario)


def load_recording(scenario: Scenario) -> Recording:
    """Return the recording that the run plays, from row 0 on, with the row at which the run begins.

    It has at least one row more than the run sends, since truth is interpolated at the ticks. Raises `InputError`
    when the run would begin within its training rows, `DataError` when the recording is missing, damaged or too
    short. Oracle: recordings that the tests write.
    """
    start, source = scenario.first_row(), scenario.source
    if isinstance(source, SyntheticSource):
        digest = digest_of_synthetic(source, scenario.seed, scenario.rate_hz)
        n_rows = start + scenario.n_samples + 1
        return replace(synthesise(source, scenario.seed, scenario.rate_hz, n_rows, start), digest=digest)
    if isinstance(source, LiveSource):
        rule = "must be recorded or synthetic here: a live movement is known only while it is made"
        raise InputError(Fault(f"scenario {scenario.name}", "source.kind", rule, source.kind))
    recording = whole_recording(scenario, source, start)
    fault = _too_short(scenario, start, recording)
    if fault is not None:
        raise DataError(fault)
    return recording


def whole_recording(scenario: Scenario, source: RecordedSource, start: int) -> Recording:
    """Return all of the recording in the source's own file, whatever the run's duration; raises as `Files.whole`."""
    return _FILES[source.kind].whole(scenario, source, start)


def _too_short(scenario: Scenario, start: int, recording: Recording) -> Fault | None:
    """Return the fault of a recording with fewer rows than the run needs: its samples, and one for truth."""
    n_rows, needed = len(recording), start + scenario.n_samples + 1
    if n_rows >= needed:
        return None
    longest = n_rows - start - 1
    if longest < 1:
        advice = f"it is too short for any duration_s with this start and these training rows{_fewer(scenario)}"
    else:
        # rounded down, or the suggested value would be too long as well
        seconds = math.floor(1000 * longest / scenario.rate_hz) / 1000
        advice = f"duration_s can be at most {seconds:.3f}, or auto to play all of it"
    parts = f"{start} before the start + {scenario.n_samples} samples of {scenario.duration_s:g} s + 1"
    return Fault(recording.file or "", "", f"must have {needed} rows ({parts}); {advice}", n_rows)


def _fewer(scenario: Scenario) -> str:
    """Return how fewer training rows leave more to play; "" where the run has none of its own."""
    if scenario.identification.train != "own_head":
        return ""
    now = scenario.identification.train_samples
    if now <= MIN_TRAIN_SAMPLES:
        return f": the recording is too short, as identification.train_samples is at least {MIN_TRAIN_SAMPLES}"
    return f"; set identification.train_samples, now {now}, to fewer"


def check_recording(scenario: Scenario) -> None:
    """Raise what `load_recording` raises for recorded trials, before any process starts; a synthetic one is there."""
    if isinstance(scenario.source, RecordedSource):
        load_recording(scenario)


def load_training(scenario: Scenario, recording: Recording) -> Sequence[Recording]:
    """Return the training data of the arm's model; none for a model file, which the caller reads.

    ``own_head``: the first ``train_samples`` rows of ``recording``. ``others``: all trials of the same task by other
    subjects in the folder, both hands (which are pooled), with the same pairing as the run's; for a table, the tables
    of other people beside it, with its columns and hands. ``synthetic``: rows of the synthetic hand in the places of
    a live source. Damaged trials are left out; the first recording names them in ``left_out``. Raises `DataError`
    when there are none, or only damaged ones.
    """
    identification, source = scenario.identification, scenario.source
    if identification.train == "own_head":
        return [_noisy(scenario, recording.head(identification.train_samples))]
    if identification.train == "synthetic" and isinstance(source, LiveSource):
        made = synthetic_training(source, scenario.seed, scenario.rate_hz, identification.train_samples)
        return [_noisy(scenario, made)]
    if identification.train != "others" or not isinstance(source, RecordedSource):
        return []
    others = trials_of_others(source)
    if not others:
        found = ", ".join(list_trials(source)[:20]) or "no trial"
        rule = f"{_FILES[source.kind].no_others(source)}; found: {found}"
        raise DataError(Fault(f"scenario {scenario.name}", "identification.train: others", rule))
    return load_trials(scenario, recording, others)


def load_trials(scenario: Scenario, recording: Recording, trials: Sequence[str]) -> list[Recording]:
    """Return the named trials of the source's folder as training data, paired as those of ``recording``.

    Damaged trials are left out; the first recording names them in ``left_out``. Raises `DataError` when all are
    damaged.
    """
    source = scenario.source
    assert isinstance(source, RecordedSource)
    # A damaged trial costs its rows only; the faults of all are told together.
    faults: list[Fault] = []
    strange: dict[str, tuple[Fault, ...]] = {}
    recordings = []
    for trial in trials:
        try:
            recordings.append(_noisy(scenario, _FILES[source.kind].training(scenario, source, recording, trial)))
        except DataError as error:
            if has_columns(source, trial):
                faults += error.faults
            else:
                strange[trial] = error.faults
    if not recordings:
        raise DataError([*faults, *(fault for each in strange.values() for fault in each)])
    left_out = [f"trained without {fault}" for fault in faults]
    if strange:
        left_out.append(f"trained without {in_few(list(strange))}: other columns than the source's")
    return [replace(recordings[0], left_out=tuple(left_out)), *recordings[1:]]


def _noisy(scenario: Scenario, training: Recording) -> Recording:
    return with_noise(training, scenario.identification.sensor_noise_m, scenario.seed)


def plays_all(raw: Mapping[str, Any]) -> bool:
    """Tell whether a raw scenario's duration is that of its recording."""
    return raw.get("duration_s") == AUTO


def without_auto(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return a raw scenario with a number as duration, so that all its other fields can be checked."""
    return {**raw, "duration_s": _FOR_CHECKS} if plays_all(raw) else dict(raw)


def whole_run(scenario: Scenario, where: str) -> Scenario:
    """Return the scenario with the duration of all its recording, from the first row on.

    Raises `InputError` for a source without an end or where no row is left to play, `DataError` for a recording that
    cannot be read. Oracle: recordings of known length in the tests.
    """
    source = scenario.source
    if not isinstance(source, RecordedSource):
        rule = f"must be a number of seconds: auto plays all of a recording, and a {source.kind} movement has no end"
        raise InputError(Fault(where, "duration_s", rule, AUTO))
    start = scenario.first_row()
    try:
        recording = whole_recording(scenario, source, start)
    except DataError as error:
        if trial_file(source, own_trial(source)).exists():
            raise
        rule = (
            "auto needs the recording on this host; else set the number of seconds, which `tis validate SCENARIO` "
            "prints on a host that has it"
        )
        raise DataError([*error.faults, Fault(where, "duration_s", rule)]) from None
    longest = len(recording) - start - 1
    if longest < 1:
        is_asked = getattr(source, "resample", "auto") not in (False, "auto")
        at = f" at the scenario's {scenario.rate_hz} a second" if is_asked else ""
        rows = f"{recording.file} has {len(recording)} rows{at}, and the run begins at row {start}"
        rule = f"auto finds no row to play: {rows}{_fewer(scenario)}"
        raise InputError(Fault(f"scenario {scenario.name}", "duration_s", rule))
    raw = scenario.model_dump(mode="json", exclude_none=True)
    return reading.build_scenario({**raw, "duration_s": longest / scenario.rate_hz}, where)


def build_whole(raw: Mapping[str, Any], where: str, profiles: reading.Profiles | None = None) -> Scenario:
    """Return what `build_scenario` returns, also for a raw scenario whose duration is auto; raises as `whole_run`."""
    scenario = reading.build_scenario(without_auto(raw), where, profiles)
    return whole_run(scenario, where) if plays_all(raw) else scenario
