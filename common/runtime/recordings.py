"""Loading of the recordings that a scenario names; only this module reads trials and their environment variable."""

import math
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from common.channels import FOLLOWER, MASTER, Arm, Hand
from common.errors import DataError, Fault, InputError
from common.runtime.limited_file import read_limited
from common.scenario import Scenario
from common.scenario.source import JigsawsSource, is_synthetic
from common.sources.jigsaws import MAX_TRIAL_BYTES, RATE_HZ, parse_trial, pose_track, position_m, velocity_m_s
from common.sources.pairing import Pairing, Positions, contradictions, pair_over
from common.sources.plausibility import anomalies, rate_doubts
from common.sources.provenance import digest_of_rows, digest_of_synthetic
from common.sources.sensor_noise import with_noise
from common.sources.synthetic import synthesise
from common.sources.trajectory import Array, HandRecording, Recording

JIGSAWS_VARIABLE: Final = "TIS_JIGSAWS"
_USUAL_FOLDER: Final = "data/jigsaws"

_MAX_PAIRING_ROWS: Final = 1240
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")
_ARMS: Final[tuple[Arm, ...]] = ("PSM1", "PSM2")
_ABOUT: Final = (
    "JIGSAWS (the JHU-ISI Gesture and Skill Assessment Working Set, kinematics of da Vinci trials) may not be "
    "redistributed; Johns Hopkins University (the CIRL group) provides it for research on request; "
    f"give its folder in source.path or in the environment variable {JIGSAWS_VARIABLE}"
)


def located(scenario: Scenario) -> Scenario:
    """Return the scenario with the absolute folder of its trials, so that the log names the files that are read."""
    source = scenario.source
    if source.kind != "jigsaws" or source.path is not None:
        return scenario
    return scenario.model_copy(update={"source": source.model_copy(update={"path": str(_root(source))})})


def load_recording(scenario: Scenario) -> Recording:
    """Return the recording that the run plays, from row 0 on, with the row at which the run begins.

    It has one row more than the run sends, since truth is interpolated at the ticks. The pairing of masters and arms
    is decided by rows that are not scored: for ``own_head`` the training rows, for ``others`` at most the first 1240
    of each training trial. With a model file, or where ``others`` finds no trial, these rows of the trial itself
    decide. Raises `InputError` when the run would begin within its training rows, `DataError` when the trial is
    missing, damaged or too short. Oracle: trials that the tests write.
    """
    start = _start(scenario)
    n_rows = start + scenario.n_samples + 1
    source = scenario.source
    if source.kind == "synthetic":
        digest = digest_of_synthetic(source, scenario.seed, scenario.rate_hz)
        return replace(synthesise(source, scenario.seed, scenario.rate_hz, n_rows, start), digest=digest)
    if source.kind == "live":
        rule = "must be recorded or synthetic here: a live movement is known only while it is made"
        raise InputError(Fault(f"scenario {scenario.name}", "source.kind", rule, source.kind))
    file = trial_file(source, source.trial)
    rows = _read_trial(source, file)
    if len(rows) < n_rows:
        raise DataError(_too_short(scenario, file, start, len(rows)))
    pairings = _pairings(scenario, source, rows)
    return _recording(source, source.trial, pairings, file, rows, start, scenario.identification.looks_ahead)


def _pairings(scenario: Scenario, source: JigsawsSource, rows: Array) -> tuple[Pairing, ...]:
    """Return the arms of the hands that a run plays, decided by rows that it does not score."""
    train, requested, hands = scenario.identification.train, source.pairing, source.hands
    if train == "own_head":
        return pair_over(requested, hands, [_positions(rows[: scenario.identification.train_samples])])
    played = _positions(rows[:_MAX_PAIRING_ROWS])
    if train == "others" and requested == "auto":
        heads = _heads(source)
        if heads:
            found = [
                replace(each, warnings=tuple(f"in the training trials, {text}" for text in each.warnings))
                for each in pair_over(requested, hands, heads)
            ]
            return contradictions(found, played, "in the training trials")
    return pair_over(requested, hands, [played])


def _heads(source: JigsawsSource) -> list[Positions]:
    """Return the positions in the first rows of the training trials; damaged ones are left out."""
    heads = []
    for trial in _other_subjects(source, list_trials(source)):
        with suppress(DataError):
            heads.append(_positions(_read_trial(source, trial_file(source, trial), _MAX_PAIRING_ROWS)))
    return heads


def _positions(rows: Array) -> Positions:
    return {hand: position_m(rows, MASTER[hand]) for hand in _HANDS}, {arm: position_m(rows, arm) for arm in _ARMS}


def _other_subjects(source: JigsawsSource, trials: Sequence[str]) -> list[str]:
    return [trial for trial in trials if trial[0] != source.trial[0]]


def check_recording(scenario: Scenario) -> None:
    """Raise what `load_recording` raises for recorded trials, before any process starts; a synthetic one is there."""
    if scenario.source.kind not in ("synthetic", "live"):
        load_recording(scenario)


def load_training(scenario: Scenario, recording: Recording) -> list[Recording]:
    """Return the training data of the arm's model; none for a model file, which the caller reads.

    ``own_head``: the first ``train_samples`` rows of ``recording``. ``others``: all trials of the same task by other
    subjects in the folder, both hands (which are pooled), with the same pairing as the run's. Damaged trials are left
    out; the first recording names them in ``left_out``. Raises `DataError` when there are none, or only damaged ones.
    """
    train = scenario.identification.train
    if train == "own_head":
        head = recording.head(scenario.identification.train_samples)
        return [with_noise(head, scenario.identification.sensor_noise_m, scenario.seed)]
    source = scenario.source
    if train != "others" or source.kind != "jigsaws":
        return []
    found = list_trials(source)
    others = _other_subjects(source, found)
    if not others:
        rule = f"needs {source.task} trials of other subjects than {source.trial[0]} in {_folder(source)}"
        there = ", ".join(found) or "no trial"
        raise DataError(Fault(f"scenario {scenario.name}", "identification.train: others", f"{rule}; found: {there}"))
    return load_trials(scenario, recording, others)


def load_trials(scenario: Scenario, recording: Recording, trials: Sequence[str]) -> list[Recording]:
    """Return the named trials of the scenario's task as training data, both hands, paired as those of ``recording``.

    Damaged trials are left out; the first recording names them in ``left_out``. Raises `DataError` when all are
    damaged.
    """
    source = scenario.source
    assert source.kind == "jigsaws"
    # One relation is identified from all trials, so all must have the same pairing.
    crossed = recording.hands[0].arm == FOLLOWER[recording.hands[0].hand]
    faults: list[Fault] = []
    recordings = []
    for trial in trials:
        file = trial_file(source, trial)
        try:
            rows = _read_trial(source, file)
            pairings = pair_over("cross" if crossed else "same_name", _HANDS, [_positions(rows[:_MAX_PAIRING_ROWS])])
            velocity = scenario.identification.looks_ahead
            clean = _recording(source, trial, pairings, file, rows, 0, velocity)
            recordings.append(with_noise(clean, scenario.identification.sensor_noise_m, scenario.seed))
        except DataError as error:
            faults += error.faults
    if not recordings:
        raise DataError(faults)
    left_out = tuple(f"trained without {fault}" for fault in faults)
    return [replace(recordings[0], left_out=left_out), *recordings[1:]]


def _start(scenario: Scenario) -> int:
    """Return the row that becomes sample 0; raises `InputError` when training rows would be scored."""
    identification, start = scenario.identification, scenario.source.start
    first = identification.train_samples if identification.train == "own_head" else 0
    if start == "auto":
        return first
    if start < first:
        rule = f"must be auto or at least train_samples = {first}, since own_head trains on the rows before"
        raise InputError(Fault(f"scenario {scenario.name}", "source.start", rule, start))
    return start


def _too_short(scenario: Scenario, file: Path, start: int, n_rows: int) -> Fault:
    longest = n_rows - start - 1
    if longest < 1:
        advice = "it is too short for any duration_s with this start and these training rows"
    else:
        # rounded down, or the suggested value would be too long as well
        advice = f"duration_s can be at most {math.floor(1000 * longest / RATE_HZ) / 1000:.3f}"
    needed = f"{start} before the start + {scenario.n_samples} samples of {scenario.duration_s:g} s + 1"
    rule = f"must have {start + scenario.n_samples + 1} rows ({needed}); {advice}"
    return Fault(str(file), "", rule, n_rows)


def _recording(
    source: JigsawsSource,
    trial: str,
    pairings: Sequence[Pairing],
    file: Path,
    rows: Array,
    start: int,
    velocity: bool,
) -> Recording:
    where = str(file)
    recorded = tuple(
        HandRecording(
            pairing.hand,
            pairing.arm,
            command=pose_track(rows, MASTER[pairing.hand], where),
            follower=pose_track(rows, pairing.arm, where),
            command_velocity_m_s=velocity_m_s(rows, MASTER[pairing.hand]) if velocity else None,
        )
        for pairing in pairings
    )
    mark = " (synthetic)" if is_synthetic(trial) else ""
    label = f"{source.task}_{trial}{mark}"
    return Recording(
        label=label,
        rate_hz=RATE_HZ,
        hands=recorded,
        start=start,
        pairing=", ".join(str(pairing) for pairing in pairings),
        warnings=tuple(f"{label}: {text}" for pairing in pairings for text in pairing.warnings),
        anomalies=tuple(f"{label}: {text}" for text in _anomalies(recorded, rows)),
        digest=digest_of_rows(rows),
        file=str(file),
        person=trial[0],
    )


def _anomalies(hands: Sequence[HandRecording], rows: Array) -> list[str]:
    tracks = [(MASTER[hand.hand], hand.command, True) for hand in hands]
    tracks += [(hand.arm, hand.follower, False) for hand in hands]
    found = [text for device, track, held in tracks for text in anomalies(track.position_m, RATE_HZ, device, held)]
    for device, track, _ in tracks:
        found += rate_doubts(track.position_m, velocity_m_s(rows, device), RATE_HZ, device)
    return found


def _root(source: JigsawsSource) -> Path:
    """Return the absolute folder of the tasks; the scenario's path precedes the environment variable."""
    # an empty variable counts as unset, an empty path as the working folder
    named = (os.environ.get(JIGSAWS_VARIABLE) or _USUAL_FOLDER) if source.path is None else source.path
    return Path(named).absolute()


def _folder(source: JigsawsSource) -> Path:
    """Return the absolute folder of the task's trials, in the layout of the original distribution."""
    return _root(source) / source.task / "kinematics" / "AllGestures"


def trial_file(source: JigsawsSource, trial: str) -> Path:
    """Return the path of a trial's file, which need not exist."""
    return _folder(source) / f"{source.task}_{trial}.txt"


def list_trials(source: JigsawsSource) -> list[str]:
    """Return the names of the trials in the task's folder, like D002, in order."""
    try:
        names = [path.name for path in _folder(source).iterdir()]
    except OSError:
        return []
    matches = (re.fullmatch(rf"{source.task}_([A-Z]\d{{3}})\.txt", name) for name in names)
    return sorted(match[1] for match in matches if match)


def no_trials(source: JigsawsSource) -> Fault:
    """Return the fault to report where `list_trials` finds none."""
    folder = _folder(source)
    if _root(source).is_file():
        return _missing(source, folder)
    rule = f"contains no {source.task} trial" if folder.is_dir() else "does not exist"
    return Fault(str(folder), "", f"{rule} (folder given by {_origin(source)}). {_ABOUT}")


def _origin(source: JigsawsSource) -> str:
    elsewhere = os.environ.get(JIGSAWS_VARIABLE)
    if elsewhere and Path(elsewhere).absolute() == _root(source):
        return JIGSAWS_VARIABLE
    return f"source.path, which precedes {JIGSAWS_VARIABLE}" if elsewhere else "source.path"


def _missing(source: JigsawsSource, file: Path) -> Fault:
    if _root(source).is_file():
        rule = "is a file; needed is the folder that holds TASK/kinematics/AllGestures/TASK_TRIAL.txt"
        advice = "`tis synth FOLDER` writes an example"
        return Fault(str(_root(source)), "", f"{rule} (given by {_origin(source)}); {advice}")
    found = list_trials(source)
    if found:
        rule = f"does not exist; {source.task} trials in its folder: {', '.join(found)}"
    elif file.parent.is_dir():
        rule = f"does not exist, nor does any other {source.task} trial"
    else:
        rule = "does not exist, nor does its folder"
    return Fault(str(file), "", f"{rule} (folder given by {_origin(source)}). {_ABOUT}")


def _read_trial(source: JigsawsSource, file: Path, n_rows: int | None = None) -> Array:
    """Return the rows of a trial's file, or at most its first ``n_rows``; raises `DataError`."""
    where = str(file)
    try:
        text = read_limited(file, MAX_TRIAL_BYTES).decode("utf-8-sig")  # some editors write a byte order mark
    except (FileNotFoundError, NotADirectoryError):
        raise DataError(_missing(source, file)) from None
    except OSError as error:
        raise DataError(Fault(where, "", f"cannot be read: {error.strerror}")) from None
    except UnicodeDecodeError as error:
        raise DataError(Fault(where, "", f"is not UTF-8 text (at byte {error.start})")) from None
    return parse_trial(text if n_rows is None else "\n".join(text.split("\n", n_rows)[:n_rows]), where)
