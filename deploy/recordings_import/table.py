"""Tables of imported recordings: canonical columns, as CSV or Parquet, and their metadata."""

import csv
import io
import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from common.errors import Fault, InputError
from common.extras import GET_PARQUET
from common.runtime.recordings.table_file import METADATA
from common.sources.table.layout import TIME, canonical_names
from deploy.recordings_import.found import Array
from deploy.recordings_import.one_clock import Rows
from deploy.shell import run_dir as folder


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
    return columns


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
