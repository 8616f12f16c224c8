"""Command `tis import`: a foreign recording as a table that `source: {kind: table}` plays."""

import csv
import hashlib
import io
import json
import re
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.markup import escape

from tis.common.channels import FOLLOWER, MASTER, Hand
from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.common.extras import GET_PARQUET
from tis.common.runtime.process import command_line
from tis.common.runtime.recordings import build_whole, load_recording
from tis.common.runtime.recordings.jigsaws import rows_in
from tis.common.runtime.recordings.table_file import METADATA, open_table
from tis.common.runtime.run_folders import RUNS
from tis.common.runtime.scenario_files import read_scenario
from tis.common.scenario.identification import MIN_TRAIN_SAMPLES, Identification
from tis.common.scenario.patient import PatientPart
from tis.common.scenario.reading import apply_settings, setting
from tis.common.scenario.source import is_synthetic
from tis.common.scenario.table_source import TABLE_SUFFIXES
from tis.common.sources.jigsaws import RATE_HZ, pose_track
from tis.common.sources.plausibility import anomalies
from tis.common.sources.table_clock import other_unit, played, row_clock
from tis.common.sources.table_columns import TIME, canonical_names, in_few
from tis.common.units import NS_PER_S
from tis.common.yaml_text import load_yaml
from tis.deploy.recordings_import.files import read_bag, read_mcap
from tis.deploy.recordings_import.found import DEVICES, MASTERS, Array, Found, Stream, Wanted
from tis.deploy.recordings_import.lerobot import INFO, read_lerobot
from tis.deploy.recordings_import.one_clock import Rows, on_one_clock
from tis.deploy.recordings_import.trajectories import form_of, read_trajectory, text_of
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_warnings
from tis.deploy.shell.shipped_scenarios import SHIPPED
from tis.patient_side.models import models_for

# Commands that play an imported table, with the settings that its rows need; only those that run are named.

_SCENARIO: Final = SHIPPED / "default.yaml"
_NOISE: Final = "identification.sensor_noise_mm=0.01"
"""Without it no model learns from an axis that rests, as z of a rover, or from an ideal sine."""
_DELAYS: Final = "network.forward.delay.delay_ms=30,100,200"
"""One delay would not show how far ahead an estimator carries; those of the manual."""
_MAX_HZ: Final = 10_000
_MAX_NAME_CHARS: Final = 40
_SCORED_S: Final = 3  # ticks are scored from 2 s after the first arrival on
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")


def next_commands(file: Path, columns: Mapping[str, Array]) -> list[str]:
    """Return lines with a command that plays the table and one that compares estimators on it, or why none can.

    The settings are tried, up to the identification of the arm's model, before they are printed. Oracle: the printed
    commands run, test_next_commands.
    """
    rate_hz, n_rows, settings = _settings(file, columns)
    needed = MIN_TRAIN_SAMPLES + _SCORED_S * rate_hz
    if n_rows < needed:
        there = f"{file} has {len(columns[TIME])} rows"
        there += "" if n_rows == len(columns[TIME]) else f", {n_rows} after resampling to {rate_hz} a second"
        rule = f"a run needs {needed} at {rate_hz} a second, {needed / rate_hz:.1f} s"
        parts = f"{MIN_TRAIN_SAMPLES} to learn from, and {_SCORED_S} s to be scored"
        return [f"it cannot be played, as the recording is too short: {there}; {rule}: {parts}"]
    for tried in (settings, [*settings, _NOISE]):
        whole = [*tried, "duration_s=auto"]
        try:
            scenario = build_whole(apply_settings(read_scenario(_SCENARIO), whole), str(_SCENARIO))
            models_for(scenario, load_recording(scenario))
        except (DataError, InputError) as error:
            faults = error.faults
            continue
        own = [*tried, "identification.train=own_head"]  # the folder's other tables may have other columns
        name = f"name={_run_name(file)}"
        more = ("--sweep", _DELAYS, "--out", str(RUNS / "compare" / file.stem))
        return [
            f"play it with: {_command('twin', [name, *whole])}",
            f"compare estimators on it with: {_command('compare', [name, *own], *more)}",
        ]
    return [f"it cannot be played yet: {fault}" for fault in faults]


def own_table(file: Path) -> list[str]:
    """Return lines on why a table needs no import, and how it is played; raises `DataError` for what is none."""
    table = open_table(file)
    axes = {device: canonical_names(device)[:3] for device in DEVICES}
    names = [TIME, *(name for three in axes.values() if set(three) <= set(table.names) for name in three)]
    if TIME not in table.names or len(names) == 1:
        rule = "is a table, which needs no import: source.columns names what to read"
        return [f"{rule}, as examples/own_recording.yaml does; its columns: {in_few(table.names)}"]
    return ["has the columns of tis, so that it needs no import", *next_commands(file, table.read(names, TIME))]


def _command(name: str, settings: list[str], *more: str) -> str:
    return command_line([name, _SCENARIO.stem, *(word for each in settings for word in ("--set", each)), *more])


def _run_name(file: Path) -> str:
    """Return the file's name as a scenario may have it, and as YAML takes it for a text."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem).strip("_-")[:_MAX_NAME_CHARS]
    return name if isinstance(load_yaml(name, "name"), str) else f"recording_{name}".strip("_")


def _settings(file: Path, columns: Mapping[str, Array]) -> tuple[int, int, list[str]]:
    """Return the rows a second, their number, and settings for them.

    Gaps and uneven rows are interpolated, at the nearest rate of whole Hz. At most half of the rows train.
    """
    t_s = columns[TIME] - columns[TIME][0]
    clock, faults = row_clock(t_s, str(file), TIME)
    if clock is None:
        raise DataError(faults)
    rate_hz = min(max(round(clock.found_hz), 1), _MAX_HZ)
    play, faults = played(clock, rate_hz, False, "bridge", "")
    is_resampled = bool(faults or play.warnings)
    n_rows = int(t_s[-1] * rate_hz) + 1 if is_resampled else len(t_s)
    usual = Identification().train_samples
    n_training = max(MIN_TRAIN_SAMPLES, min(usual, n_rows // 2, n_rows - _SCORED_S * rate_hz))
    axes = [name for device in DEVICES for name in canonical_names(device)[:3] if name in columns]
    hands = [
        h for h in _HANDS if not {canonical_names(MASTER[h])[0], canonical_names(FOLLOWER[h])[0]}.isdisjoint(axes)
    ]
    source: dict[str, object] = {"kind": "table", "path": str(file), "hands": hands}
    source |= {"resample": True} if is_resampled else {}
    source |= {"gaps": "bridge"} if clock.gaps else {}
    rate = [] if rate_hz == 30 else [f"rate_hz={rate_hz}"]
    training = [] if n_training == usual else [f"identification.train_samples={n_training}"]
    phase = [f"patient.tick_phase_ms={500 / rate_hz:g}"] if PatientPart().tick_phase_ms * rate_hz >= 1000 else []
    return rate_hz, n_rows, [setting("source", source), *rate, *phase, *training]


# Tables of imported recordings: canonical columns, as CSV or Parquet, and their metadata.


def columns_of(rows: Rows) -> dict[str, Array]:
    """Return the canonical columns; a device without orientation or gripper lacks those. Oracle: round trips."""
    columns: dict[str, Array] = {TIME: rows.t_s}
    for device in rows.devices:
        names, track = canonical_names(device.name), device.track
        columns |= {name: track.position_m[:, k] for k, name in enumerate(names[:3])}
        if device.turns:
            columns |= {name: track.orientation[:, k] for k, name in enumerate(names[3:7])}
        if device.grips:
            columns[names[7]] = track.gripper_rad
    return {**columns, **{name: values for name, values in rows.extras.items() if name not in columns}}


def check_table(path: Path) -> None:
    """Raise `InputError` where a table of this name cannot be written."""
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise InputError(Fault("tis import", "--out", "must end in .csv or .parquet", str(path)))
    if suffix == ".parquet" and find_spec("pyarrow") is None:
        raise InputError(Fault("tis import", "--out", f"a .parquet file needs pyarrow: {GET_PARQUET}"))


def write_table(path: Path, columns: Mapping[str, Array], metadata: Mapping[str, Any]) -> None:
    """Write a table completely or not at all; raises `DataError`. A CSV file holds every digit, but no metadata."""
    if path.suffix.lower() == ".csv":
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        folder.write(path, text.getvalue())
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(dict(columns)).replace_schema_metadata({METADATA: json.dumps(metadata, allow_nan=False)})
    content = io.BytesIO()
    pq.write_table(table, content, compression="zstd")
    folder.write(path, content.getvalue())


# Poses from a trial of JIGSAWS: all four devices, at the 30 rows a second of the data set.


def read_jigsaws(file: Path) -> Found:
    """Return the poses of a trial's file, like Suturing_D002.txt; raises `DataError`.

    Task and person are read off its name. Oracle: trials of `tis synth`, played from either file.
    """
    where = str(file)
    rows = rows_in(file)
    t_ns = np.arange(len(rows), dtype=np.int64) * NS_PER_S // RATE_HZ
    streams = []
    for device in DEVICES:
        track = pose_track(rows, device, where)
        streams.append(
            Stream(device, f"columns of {device}", t_ns, track.position_m, track.orientation, track.gripper_rad)
        )
    about: dict[str, Any] = {"kind": "jigsaws"}
    named = re.fullmatch(r"([A-Za-z_]+)_([A-Z]\d{3})\.txt", file.name)
    if named:
        about |= {"task": named[1], "person": named[2][0]}
        about |= {"synthetic": True} if is_synthetic(named[2]) else {}
    return Found(tuple(streams), (), (f"{len(rows)} rows of four devices, {RATE_HZ} a second",), about)


_KINDS: Final = (
    "an .mcap file, a rosbag2 folder (with metadata.yaml), a .bag, a LeRobot data set, "
    "a trajectory of TUM (.txt, .tum) or EuRoC (.csv), or a JIGSAWS trial (.txt)"
)


def import_recording(
    source: Path, out_file: Path, wanted: Wanted, rate_hz: float | None, stated: dict[str, str],
    out: Console, err: Console,
) -> int:  # fmt: skip
    """Write the table and print what was found; return the exit code.

    ``stated`` are the task and person that the user names. Raises `InputError` and `DataError`; nothing is written
    then.
    """
    check_table(out_file)
    found = read(source, wanted)
    rows = on_one_clock(found, rate_hz, str(source))
    about = _metadata(source, found, rows) | stated
    columns = columns_of(rows)
    write_table(out_file, columns, about)
    for note in (*found.notes, *rows.notes):
        out.print(escape(note), soft_wrap=True, highlight=False)
    print_warnings(err, *found.doubts, *_doubts(rows))
    if about.get("synthetic") and out_file.suffix.lower() == ".csv":
        print_warnings(err, "the movement is synthetic, which a .csv file cannot say: write a .parquet file")
    devices = ", ".join(device.name for device in rows.devices)
    out.print(
        escape(f"{out_file}: {len(rows.t_s)} rows of {devices}, {rows.t_s[-1]:.3f} s at {rows.rate_hz:g} a second"),
        soft_wrap=True,
    )
    there = {device.name for device in rows.devices}
    if not there - set(MASTERS):
        out.print("no arm is among them: it is taken to follow the hand exactly", highlight=False)
    if there.isdisjoint(MASTERS):
        out.print("no master is among them: the arm's pose is taken for its command", highlight=False)
    for line in next_commands(out_file, columns):
        out.print(escape(line), soft_wrap=True, highlight=False)
    return EXIT_OK


def read(source: Path, wanted: Wanted) -> Found:
    """Return the poses of a recording, by what it is; raises `InputError` and `DataError`."""
    if not source.exists():
        raise DataError(Fault(str(source), "", "does not exist"))
    if source.is_dir():
        if (source / INFO).is_file():
            return read_lerobot(source, wanted)
        if (source / "metadata.yaml").is_file():
            return read_bag(source, wanted)
        raise InputError(Fault("tis import", "SOURCE", f"must be {_KINDS}", str(source)))
    readers = {".mcap": read_mcap, ".bag": read_bag}
    suffix = source.suffix.lower()
    if suffix in readers:
        return readers[suffix](source, wanted)
    if suffix in (".txt", ".tum", ".csv"):
        text = text_of(source)
        form = form_of(text)
        if form is not None:
            return read_trajectory(source, text, form, wanted)
    if suffix == ".txt":
        return read_jigsaws(source)
    if suffix in TABLE_SUFFIXES:
        raise InputError([Fault(str(source), "", line) for line in own_table(source)])
    raise InputError(Fault("tis import", "SOURCE", f"must be {_KINDS}", str(source)))


def _metadata(source: Path, found: Found, rows: Rows) -> dict[str, Any]:
    about: dict[str, Any] = {"version": 1, "from": source.name, **found.about}
    if source.is_file():
        with source.open("rb") as content:
            about["sha256"] = hashlib.file_digest(content, "sha256").hexdigest()
    about["streams"] = {stream.device: stream.origin for stream in found.streams}
    about["grippers"] = {jaw.device: jaw.origin for jaw in found.jaws}
    about |= {"units": {extra.column: extra.unit for extra in found.extras}} if found.extras else {}
    return about | {"rate_hz": rows.rate_hz, "notes": list(rows.notes)}


def _doubts(rows: Rows) -> list[str]:
    """Return warnings of rows that look wrong, and of what their devices lack."""
    _, question = other_unit(rows.rate_hz, float(rows.t_s[-1]), "s")
    found = [f"{rows.rate_hz:g} rows a second: {question}"] if question else []
    for device in rows.devices:
        held = device.name in MASTERS
        found += anomalies(device.track.position_m, rows.rate_hz, device.name, hand_held=held, unit_named=True)
        found += [] if device.turns else [f"{device.name} has no orientation: it does not turn"]
        found += [] if device.grips else [f"{device.name} has no gripper: its angle is 0"]
    return found
