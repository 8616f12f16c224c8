"""Files of JIGSAWS: the run's own trial, and the trials of its task's folder, named like D002."""

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tis.common.channels import FOLLOWER, MASTER, Arm, Hand
from tis.common.errors import DataError, Fault
from tis.common.runtime.scenario_files import read_limited
from tis.common.scenario import Scenario
from tis.common.scenario.source import JigsawsSource, is_synthetic
from tis.common.sources.jigsaws import MAX_TRIAL_BYTES, RATE_HZ, parse_trial, pose_track, position_m, velocity_m_s
from tis.common.sources.pairing import Pairing, Positions, contradictions, pair_over
from tis.common.sources.plausibility import anomalies, rate_doubts
from tis.common.sources.provenance import SYNTHETIC, digest_of_rows
from tis.common.sources.recorder_clock import RecorderClock, even_hand, find_clock
from tis.common.sources.trajectory import Array, HandRecording, Recording

JIGSAWS_VARIABLE: Final = "TIS_JIGSAWS"
_USUAL_FOLDER: Final = "data/jigsaws"

HEAD_ROWS: Final = 1240
"""First rows, at most, by which it is judged which arm follows a master."""
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")
_ARMS: Final[tuple[Arm, ...]] = ("PSM1", "PSM2")
_ABOUT: Final = (
    "JIGSAWS (the JHU-ISI Gesture and Skill Assessment Working Set, kinematics of da Vinci trials) may not be "
    "redistributed; Johns Hopkins University (the CIRL group) provides it for research on request; "
    f"give its folder in source.path or in the environment variable {JIGSAWS_VARIABLE}"
)


def whole(scenario: Scenario, source: JigsawsSource, start: int) -> Recording:
    """Return the scenario's trial, all of it; raises `DataError`.

    The pairing of masters and arms is decided by rows that are not scored: for ``own_head`` the training rows, for
    ``others`` at most the first 1240 of each training trial. With a model file, or where ``others`` finds no trial,
    these rows of the trial itself decide. Oracle: trials that the tests write.
    """
    file = trial_file(source, source.trial)
    rows = _read_trial(source, file)
    pairings = _pairings(scenario, source, rows)
    return _recording(source, source.trial, pairings, file, rows, start, scenario.identification.looks_ahead)


def has_columns(source: JigsawsSource, trial: str) -> bool:  # noqa: ARG001
    """Return True: all trials of JIGSAWS have the same columns."""
    return True


def training(scenario: Scenario, source: JigsawsSource, recording: Recording, trial: str) -> Recording:
    """Return a trial of the task with both hands, paired as those of ``recording``; raises `DataError`."""
    # One relation is identified from all trials, so all must have the same pairing.
    crossed = recording.hands[0].arm == FOLLOWER[recording.hands[0].hand]
    file = trial_file(source, trial)
    rows = _read_trial(source, file)
    pairings = pair_over("cross" if crossed else "same_name", _HANDS, [_positions(rows[:HEAD_ROWS])])
    return _recording(source, trial, pairings, file, rows, 0, scenario.identification.looks_ahead)


def _pairings(scenario: Scenario, source: JigsawsSource, rows: Array) -> tuple[Pairing, ...]:
    """Return the arms of the hands that a run plays, decided by rows that it does not score."""
    train, requested, hands = scenario.identification.train, source.pairing, source.hands
    if train == "own_head":
        return pair_over(requested, hands, [_positions(rows[: scenario.identification.train_samples])])
    played = _positions(rows[:HEAD_ROWS])
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
    for trial in (each for each in trials(source) if each[0] != source.trial[0]):
        with suppress(DataError):
            heads.append(_positions(_read_trial(source, trial_file(source, trial), HEAD_ROWS)))
    return heads


def _positions(rows: Array) -> Positions:
    return {hand: position_m(rows, MASTER[hand]) for hand in _HANDS}, {arm: position_m(rows, arm) for arm in _ARMS}


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
    clock = None if source.clock == "as_recorded" else _clock(rows)
    played = recorded if clock is None else tuple(even_hand(hand, clock) for hand in recorded)
    mark = SYNTHETIC if is_synthetic(trial) else ""
    label = f"{source.task}_{trial}{mark}"
    return Recording(
        label=label,
        rate_hz=RATE_HZ,
        hands=played,
        start=start,
        pairing=", ".join(str(pairing) for pairing in pairings),
        warnings=tuple(f"{label}: {text}" for pairing in pairings for text in pairing.warnings),
        anomalies=tuple(f"{label}: {text}" for text in _anomalies(recorded, rows)),
        digest=digest_of_rows(rows if clock is None else np.vstack([rows, [clock.samples_a_row] * rows.shape[1]])),
        file=str(file),
        person=trial[0],
    )


_clocks: Final[dict[str, RecorderClock | None]] = {}  # to find one takes as long as a few thousand ticks of a twin


def _clock(rows: Array) -> RecorderClock | None:
    """Return the clock behind a trial's rows, sought once in a process: a comparison reads each trial many times."""
    key = digest_of_rows(rows)
    if key not in _clocks:
        _clocks[key] = find_clock([position_m(rows, arm) for arm in _ARMS])
    return _clocks[key]


def _anomalies(hands: Sequence[HandRecording], rows: Array) -> list[str]:
    tracks = [(MASTER[hand.hand], hand.command, True) for hand in hands]
    tracks += [(hand.arm, hand.follower, False) for hand in hands]
    found = [text for device, track, held in tracks for text in anomalies(track.position_m, RATE_HZ, device, held)]
    for device, track, _ in tracks:
        found += rate_doubts(track.position_m, velocity_m_s(rows, device), RATE_HZ, device)
    return found


def located(source: JigsawsSource) -> str:
    """Return the absolute folder of the tasks; a path in the scenario stays as it is."""
    return str(root(source)) if source.path is None else source.path


def root(source: JigsawsSource) -> Path:
    """Return the absolute folder of the tasks; the scenario's path precedes the environment variable."""
    # an empty variable counts as unset, an empty path as the working folder
    named = (os.environ.get(JIGSAWS_VARIABLE) or _USUAL_FOLDER) if source.path is None else source.path
    return Path(named).absolute()


def folder(source: JigsawsSource) -> Path:
    """Return the absolute folder of the task's trials, in the layout of the original distribution."""
    return root(source) / source.task / "kinematics" / "AllGestures"


def trial_file(source: JigsawsSource, trial: str) -> Path:
    """Return the path of a trial's file, which need not exist."""
    return folder(source) / f"{source.task}_{trial}.txt"


def own_trial(source: JigsawsSource) -> str:
    """Return the trial that the source plays."""
    return source.trial


def person_of(source: JigsawsSource, trial: str) -> str:  # noqa: ARG001  (of `Files`)
    """Return the subject of a trial: the letter in its name."""
    return trial[0]


def made(source: JigsawsSource, trial: str) -> bool:  # noqa: ARG001  (of `Files`)
    """Tell whether a program of the testbed made a trial."""
    return is_synthetic(trial)


def no_others(source: JigsawsSource) -> str:
    """Return what is missing where the folder holds no other subject."""
    return f"needs {source.task} trials of other subjects than {source.trial[0]} in {folder(source)}"


def trials(source: JigsawsSource) -> list[str]:
    """Return the names of the trials in the task's folder, like D002, in order."""
    try:
        names = [path.name for path in folder(source).iterdir()]
    except OSError:
        return []
    matches = (re.fullmatch(rf"{source.task}_([A-Z]\d{{3}})\.txt", name) for name in names)
    return sorted(match[1] for match in matches if match)


def no_trials(source: JigsawsSource) -> Fault:
    """Return the fault to report where `trials` finds none."""
    there = folder(source)
    if root(source).is_file():
        return _missing(source, there)
    rule = f"contains no {source.task} trial" if there.is_dir() else "does not exist"
    return Fault(str(there), "", f"{rule} (folder given by {_origin(source)}). {_ABOUT}")


def _origin(source: JigsawsSource) -> str:
    elsewhere = os.environ.get(JIGSAWS_VARIABLE)
    if elsewhere and Path(elsewhere).absolute() == root(source):
        return JIGSAWS_VARIABLE
    return f"source.path, which precedes {JIGSAWS_VARIABLE}" if elsewhere else "source.path"


def _missing(source: JigsawsSource, file: Path) -> Fault:
    if root(source).is_file():
        rule = "is a file; needed is the folder that holds TASK/kinematics/AllGestures/TASK_TRIAL.txt"
        advice = "`tis synth FOLDER` writes an example"
        return Fault(str(root(source)), "", f"{rule} (given by {_origin(source)}); {advice}")
    found = trials(source)
    if found:
        rule = f"does not exist; {source.task} trials in its folder: {', '.join(found)}"
    elif file.parent.is_dir():
        rule = f"does not exist, nor does any other {source.task} trial"
    else:
        rule = "does not exist, nor does its folder"
    return Fault(str(file), "", f"{rule} (folder given by {_origin(source)}). {_ABOUT}")


def _read_trial(source: JigsawsSource, file: Path, n_rows: int | None = None) -> Array:
    """Return the rows of a trial's file, or at most its first ``n_rows``; raises `DataError`."""
    try:
        return rows_in(file, n_rows)
    except (FileNotFoundError, NotADirectoryError):
        raise DataError(_missing(source, file)) from None


def rows_in(file: Path, n_rows: int | None = None) -> Array:
    """Return the rows (N, 76) of a trial's file, or at most its first ``n_rows``.

    Raises `FileNotFoundError` or `NotADirectoryError` where there is none, `DataError` for one that is no trial.
    """
    where = str(file)
    try:
        text = read_limited(file, MAX_TRIAL_BYTES).decode("utf-8-sig")  # some editors write a byte order mark
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        raise DataError(Fault(where, "", f"cannot be read: {error.strerror}")) from None
    except UnicodeDecodeError as error:
        raise DataError(Fault(where, "", f"is not UTF-8 text (at byte {error.start})")) from None
    return parse_trial(text if n_rows is None else "\n".join(text.split("\n", n_rows)[:n_rows]), where)
