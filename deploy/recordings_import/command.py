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

from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.common.extras import GET_PARQUET
from tis.common.runtime.recordings.jigsaws import rows_in
from tis.common.runtime.recordings.table_file import METADATA
from tis.common.scenario.source import is_synthetic
from tis.common.scenario.table_source import TABLE_SUFFIXES
from tis.common.sources.jigsaws import RATE_HZ, pose_track
from tis.common.sources.plausibility import anomalies
from tis.common.sources.table_columns import TIME, canonical_names
from tis.common.sources.table_poses import other_unit
from tis.common.units import NS_PER_S
from tis.deploy.recordings_import.files import read_bag, read_mcap
from tis.deploy.recordings_import.found import DEVICES, MASTERS, Array, Found, Stream, Wanted
from tis.deploy.recordings_import.lerobot import INFO, read_lerobot
from tis.deploy.recordings_import.next_commands import next_commands, own_table
from tis.deploy.recordings_import.one_clock import Rows, on_one_clock
from tis.deploy.recordings_import.trajectories import form_of, read_trajectory, text_of
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_warnings

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
    print_warnings(err, *_doubts(rows))
    if about.get("synthetic") and out_file.suffix.lower() == ".csv":
        print_warnings(err, "the movement is synthetic, which a .csv file cannot say: write a .parquet file")
    devices = ", ".join(device.name for device in rows.devices)
    out.print(
        escape(f"{out_file}: {len(rows.t_s)} rows of {devices}, {rows.t_s[-1]:.3f} s at {rows.rate_hz:g} a second"),
        soft_wrap=True,
    )
    if not {device.name for device in rows.devices} - set(MASTERS):
        out.print("no arm was recorded: it is taken to follow the hand exactly", highlight=False)
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
