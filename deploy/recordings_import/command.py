"""Command `tis import`: a foreign recording as a table that `source: {kind: table}` plays."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_OK, DataError, Fault, InputError
from common.sources.plausibility import anomalies
from deploy.recordings_import.found import MASTERS, Found, Wanted
from deploy.recordings_import.jigsaws_trial import read_jigsaws
from deploy.recordings_import.lerobot import INFO, read_lerobot
from deploy.recordings_import.mcap_file import read_mcap
from deploy.recordings_import.one_clock import Rows, on_one_clock
from deploy.recordings_import.ros import read_bag
from deploy.recordings_import.table import check_table, columns_of, write_table
from deploy.shell.messages import print_warnings

_KINDS: Final = (
    "an .mcap file, a rosbag2 folder (with metadata.yaml), a .bag, a LeRobot data set or a JIGSAWS trial (.txt)"
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
    devices = ", ".join(device.name for device in rows.devices)
    out.print(
        escape(f"{out_file}: {len(rows.t_s)} rows of {devices}, {rows.t_s[-1]:.3f} s at {rows.rate_hz:g} a second"),
        soft_wrap=True,
    )
    out.print(escape(f"play it with: {_setting(out_file, rows)}"), soft_wrap=True)
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
    if suffix == ".txt":
        return read_jigsaws(source)
    raise InputError(Fault("tis import", "SOURCE", f"must be {_KINDS}", str(source)))


def _metadata(source: Path, found: Found, rows: Rows) -> dict[str, Any]:
    about: dict[str, Any] = {"version": 1, "from": source.name, **found.about}
    if source.is_file():
        with source.open("rb") as content:
            about["sha256"] = hashlib.file_digest(content, "sha256").hexdigest()
    about["streams"] = {stream.device: stream.origin for stream in found.streams}
    about["grippers"] = {jaw.device: jaw.origin for jaw in found.jaws}
    return about | {"rate_hz": rows.rate_hz, "notes": list(rows.notes)}


def _doubts(rows: Rows) -> list[str]:
    found: list[str] = []
    for device in rows.devices:
        found += anomalies(device.track.position_m, rows.rate_hz, device.name, hand_held=device.name in MASTERS)
        found += [] if device.turns else [f"{device.name} has no orientation: it does not turn"]
        found += [] if device.grips else [f"{device.name} has no gripper: its angle is 0"]
    return found


def _setting(file: Path, rows: Rows) -> str:
    names = {device.name for device in rows.devices}
    hands: Sequence[str] = [
        hand for hand, devices in (("left", {"MTML", "PSM2"}), ("right", {"MTMR", "PSM1"})) if names & devices
    ]
    source = f"{{kind: table, path: {file}, hands: [{', '.join(hands)}]}}"
    rate = "" if rows.rate_hz == 30 else f" --set rate_hz={rows.rate_hz:g}"
    if rows.rate_hz != int(rows.rate_hz):
        rate = " --set source.resample=true"
    return f"tis twin default --set 'source={source}'{rate} --set duration_s=auto"
