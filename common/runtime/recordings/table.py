"""Recordings in tables: the source's own one, and those of other people in its folder, each named by its file."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tis.common.channels import MASTER
from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.recordings.jigsaws import HEAD_ROWS
from tis.common.runtime.recordings.table_file import TableFile, absent, open_table
from tis.common.scenario import Scenario
from tis.common.scenario.table_source import TABLE_SUFFIXES, TableSource
from tis.common.sources.pairing import follows
from tis.common.sources.plausibility import anomalies
from tis.common.sources.provenance import SYNTHETIC
from tis.common.sources.table_clock import SECONDS_PER, Played, RowClock, played, row_clock, smoother_at
from tis.common.sources.table_columns import (
    DeviceLayout,
    HandLayout,
    TableLayout,
    layout_of,
)
from tis.common.sources.table_poses import Columns, finite_faults, following, pose_track, resampled, unit_doubts
from tis.common.sources.trajectory import Array, HandRecording, PoseTrack, Recording

_MAX_NAME_CHARS: Final = 100
_MAX_FILES: Final = 10_000


def whole(scenario: Scenario, source: TableSource, start: int) -> Recording:
    """Return the recording in the source's own table; raises `DataError`, or `InputError` for lacking inputs."""
    identification = scenario.identification
    if identification.looks_ahead:
        rule = "must be position: a table has no columns of velocities"
        raise InputError(Fault(f"scenario {scenario.name}", "identification.inputs", rule))
    head_rows = identification.train_samples if identification.train == "own_head" else HEAD_ROWS
    return table_recording(source, Path(source.path), scenario.rate_hz, head_rows, start)


def training(scenario: Scenario, source: TableSource, recording: Recording, trial: str) -> Recording:  # noqa: ARG001
    """Return the recording in a table beside the source's own, whose columns pair masters and arms."""
    return table_recording(source, trial_file(source, trial), scenario.rate_hz, HEAD_ROWS, 0)


_FEWEST_LAST: Final = 0.2
"""Share of the first rows that the last ones must number to be judged."""


def table_recording(source: TableSource, file: Path, rate_hz: int, head_rows: int, start: int) -> Recording:
    """Return the recording in a table at ``rate_hz`` rows per second, all of it; raises `DataError`.

    The pairing is the map's; whether the arm follows its master is judged by the first ``head_rows`` rows and by the
    last, and told. Oracle: tables of known movements in the tests.
    """
    where = str(file)
    table = open_table(file)
    layout = layout_of(source, table.names, where)
    columns = table.read(layout.names, layout.time, SECONDS_PER[layout.time_unit])
    faults = finite_faults(columns, where)
    if faults:
        raise DataError(faults)
    tracks, found = {}, []
    for device in _devices(layout):
        tracks[device.name], more = pose_track(columns, device, where)
        found += more
    paths = [track.position_m for track in tracks.values()]
    clock, play, more = _clock(source, layout, columns, rate_hz, where, paths)
    found = [*more, *found]
    if found:
        raise DataError(found)
    if play.at_s is not None:
        tracks = {name: resampled(track, clock.t_s, play.at_s) for name, track in tracks.items()}
    hands = tuple(_hand(hand, tracks) for hand in layout.hands)
    about = _about(source, file, table)
    pairings = [
        _pairing(hand, recorded, head_rows, rate_hz) for hand, recorded in zip(layout.hands, hands, strict=True)
    ]
    doubts = [text for device in _devices(layout) for text in unit_doubts(columns, device)]
    doubts += [text for device in _devices(layout) for text in _implausible(device, tracks[device.name], rate_hz)]
    warnings = [*play.warnings, *(text for hand in layout.hands for text in _lacking(hand))]
    warnings += [text for _, texts in pairings for text in texts]
    return Recording(
        label=about.label,
        rate_hz=rate_hz,
        hands=hands,
        start=start,
        pairing=", ".join(text for text, _ in pairings),
        warnings=tuple(f"{about.label}: {text}" for text in warnings),
        anomalies=tuple(f"{about.label}: {text}" for text in doubts),
        digest=_digest(file, rate_hz if play.at_s is not None else None),
        file=where,
        person=about.person,
    )


def located(source: TableSource) -> str:
    """Return the absolute path of the table."""
    return str(Path(source.path).absolute())


def own_trial(source: TableSource) -> str:
    """Return the name of the table."""
    return Path(source.path).name


def trial_file(source: TableSource, trial: str) -> Path:
    """Return the path of a table in the source's folder."""
    return Path(source.path).parent / trial


def no_trials(source: TableSource) -> Fault:
    """Return the fault to report where there is no table."""
    return absent(Path(source.path))


def no_others(source: TableSource) -> str:
    """Return what is missing where the folder holds no table of another person."""
    own, there = person_of(source, own_trial(source)), Path(source.path).parent
    return (
        f"needs tables of other people than {own} in {there} (a table's person is in its metadata, or its name "
        "up to the first _); own_head trains on the recording's own first rows, a model file on none"
    )


def trials(source: TableSource) -> list[str]:
    """Return the names of the tables in the folder of the source's file, of the same kind, in order."""
    file = Path(source.path)
    try:
        found = sorted(path.name for path in file.parent.iterdir() if path.suffix.lower() == file.suffix.lower())
    except OSError:
        return []
    return [name for name in found if Path(name).suffix.lower() in TABLE_SUFFIXES][:_MAX_FILES]


def person_of(source: TableSource, trial: str) -> str:
    """Return who moves in a table: as the source says of its own file, as the file says, or as its name begins."""
    file = trial_file(source, trial)
    if file == Path(source.path) and source.person is not None:
        return source.person
    return _stated(_metadata(file), "person") or file.stem.split("_")[0]


def made(source: TableSource, trial: str) -> bool:
    """Tell whether a table says that a program of the testbed made its movement, which a CSV file cannot."""
    return _says_synthetic(_metadata(trial_file(source, trial)))


def has_columns(source: TableSource, trial: str) -> bool:
    """Tell whether a table has the columns that the source names; also of one that cannot be read."""
    try:
        names = open_table(trial_file(source, trial)).names
    except DataError:
        return True
    try:
        layout_of(source, names, trial)
    except DataError:
        return False
    return True


def _metadata(file: Path) -> dict[str, Any]:
    try:
        return {} if file.suffix.lower() == ".csv" else _parsed(open_table(file).metadata)
    except DataError:
        return {}


def _says_synthetic(stated: dict[str, Any]) -> bool:
    return stated.get("synthetic") is True


@dataclass(frozen=True)
class _About:
    label: str
    person: str


def _about(source: TableSource, file: Path, table: TableFile) -> _About:
    """Return what to call a table, and who moves in it; a foreign file's metadata count as far as they are texts."""
    stated = _parsed(table.metadata)
    is_own = file == Path(source.path)
    task = source.task or _stated(stated, "task")
    person = (source.person if is_own else None) or _stated(stated, "person") or file.stem.split("_")[0]
    label = f"{task} {file.stem}" if task else file.stem
    return _About(f"{label}{SYNTHETIC}" if _says_synthetic(stated) else label, person)


def _parsed(metadata: bytes) -> dict[str, Any]:
    try:
        found = json.loads(metadata or b"{}")
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _stated(stated: dict[str, Any], name: str) -> str:
    value = stated.get(name)
    return value if isinstance(value, str) and value.isprintable() and len(value) <= _MAX_NAME_CHARS else ""


def _devices(layout: TableLayout) -> list[DeviceLayout]:
    return [device for hand in layout.hands for device in (hand.master, hand.follower) if device is not None]


def _clock(
    source: TableSource, layout: TableLayout, columns: Columns, rate_hz: int, where: str, paths: Sequence[Array]
) -> tuple[RowClock, Played, list[Fault]]:
    if layout.time is None:
        assert source.rate_hz is not None
        t_s = np.arange(len(next(iter(columns.values())))) / source.rate_hz
    else:
        t_s = (columns[layout.time] - columns[layout.time][0]) * SECONDS_PER[layout.time_unit]
    clock, faults = row_clock(t_s, where, layout.time or "source.rate_hz")
    if clock is None:
        return RowClock(t_s, 0.0, ()), Played(None), faults
    time_unit = None if layout.time is None else layout.time_unit
    smoother = source.resample == "auto" and smoother_at(clock.t_s, paths)
    play, faults = played(clock, rate_hz, source.resample, source.gaps, where, time_unit, smoother)
    return clock, play, faults


def _hand(layout: HandLayout, tracks: dict[str, PoseTrack]) -> HandRecording:
    if layout.master is None:
        assert layout.follower is not None
        arm = tracks[layout.follower.name]
        return HandRecording(layout.hand, layout.arm, following(arm, 1.0 / layout.gain), arm)
    command = tracks[layout.master.name]
    arm = following(command, layout.gain) if layout.follower is None else tracks[layout.follower.name]
    return HandRecording(layout.hand, layout.arm, command, arm)


def _pairing(layout: HandLayout, hand: HandRecording, head_rows: int, rate_hz: float) -> tuple[str, list[str]]:
    """Return the pairing in words, and warnings where the arm does not follow, not even late.

    The first rows tell it, and as many of the last: clocks that drift apart agree at first.
    """
    named = f"{MASTER[hand.hand]} -> {hand.arm}"
    if layout.master is None or layout.follower is None:
        return f"{named} ({_by_gain(layout)})", []
    n = len(hand.follower.position_m)
    head, tail = range(min(head_rows, n)), range(max(head_rows, n - head_rows), n)
    text, warnings = follows(hand, head, rate_hz)
    if not warnings and len(tail) >= _FEWEST_LAST * len(head):
        _, found = follows(hand, tail, rate_hz)
        warnings = [f"{one}, though it does at first: a clutch, or clocks that drift apart?" for one in found]
    return f"{named} (by the table; {text})", warnings


def _by_gain(layout: HandLayout) -> str:
    """Return how the device without columns follows the other one."""
    if layout.master is None:
        return f"by gain {layout.gain:g}"
    scaled = "" if layout.gain == 1 else f", positions times {layout.gain:g}"
    return (
        f"the table has the hand alone: the arm is taken to follow it exactly{scaled}, so each position is sent twice"
    )


def _lacking(layout: HandLayout) -> list[str]:
    """Return a warning where a table lacks the command, and of what stands in its place.

    A table of the hand alone is no fault; the pairing tells it.
    """
    master, arm = MASTER[layout.hand], layout.arm
    if layout.master is None:
        return [
            f"it has no columns of {master}: the command is the pose of {arm}, positions times {1 / layout.gain:g}"
        ]
    return []


def _implausible(device: DeviceLayout, track: PoseTrack, rate_hz: int) -> Sequence[str]:
    held, named = device.name in MASTER.values(), device.units.position is not None
    return anomalies(track.position_m, rate_hz, device.name, hand_held=held, unit_named=named)


def _digest(file: Path, rate_hz: int | None) -> str:
    """Return 16 hex digits that identify a table by its content, whichever hands are read, and its new rate."""
    try:
        with file.open("rb") as content:
            found = hashlib.file_digest(content, lambda: hashlib.blake2b(digest_size=8))
    except OSError as error:
        raise DataError(Fault(str(file), "", f"cannot be read: {error.strerror}")) from None
    if rate_hz is not None:
        found.update(f"at {rate_hz} Hz".encode())
    return found.hexdigest()
