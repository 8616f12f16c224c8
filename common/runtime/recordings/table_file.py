"""Files of tables: names, numbers and metadata of a CSV or Parquet file, in bounded memory."""

import codecs
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.extras import GET_PARQUET
from tis.common.runtime.scenario_files import read_limited
from tis.common.sources.table_columns import (
    MAX_COLUMNS,
    MAX_ROWS,
    MAX_TABLE_BYTES,
    MAX_TEXT_BYTES,
    MAX_VALUES,
    MIN_ROWS,
)
from tis.common.sources.table_text import TableText, read_columns, split_table
from tis.common.sources.trajectory import Array

METADATA: Final = b"tis"
"""Key of the metadata that `tis import` writes into a Parquet file."""

_BATCH_ROWS: Final = 65_536
_MAX_METADATA_BYTES: Final = 100_000
_BYTE_ORDER_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_TICKS_PER_S: Final = {"s": 1, "ms": 1000, "us": 1_000_000, "ns": 1_000_000_000}


class TableFile(Protocol):
    """An opened table: its columns' names, in order and possibly repeated, and the text of its metadata."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""

    @property
    def metadata(self) -> bytes:
        """JSON that `tis import` wrote, empty if there is none."""

    def read(self, wanted: Sequence[str], time: str | None, unit_s: float = 1.0) -> Mapping[str, Array]:
        """Return the wanted columns; ``time`` may hold dates, which are returned in s from its first one."""


def open_table(path: Path) -> TableFile:
    """Return an opened table; raises `DataError` for what is none.

    A file may have `MAX_TABLE_BYTES` (text `MAX_TEXT_BYTES`), `MAX_ROWS` rows and `MAX_VALUES` numbers in the columns
    that are read, so that compressed columns take bounded memory. Oracle: files that the tests write.
    """
    where = str(path)
    try:
        if path.suffix.lower() == ".csv":
            return _Csv(where, split_table(decoded(path), where))
        if find_spec("pyarrow") is None:
            raise DataError(Fault(where, "", f"needs pyarrow: {GET_PARQUET}"))
        if path.stat().st_size > MAX_TABLE_BYTES:
            raise DataError(Fault(where, "", f"must have at most {MAX_TABLE_BYTES} bytes", path.stat().st_size))
        return _opened_parquet(path)
    except FileNotFoundError:
        raise DataError(absent(path)) from None
    except OSError as error:
        raise DataError(Fault(where, "", f"cannot be read: {error.strerror or error}")) from None


def absent(path: Path) -> Fault:
    """Return the fault of a table that is not there."""
    rule = "does not exist (given by source.path, which counts from the current folder, not from the scenario's file)"
    return Fault(str(path), "", rule)


def decoded(path: Path) -> str:
    """Return a file's text, UTF-8 or UTF-16; raises `OSError`, and `DataError` for other text."""
    content = read_limited(path, MAX_TEXT_BYTES)
    encoding = next((name for mark, name in _BYTE_ORDER_MARKS if content.startswith(mark)), "utf-8")
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        rule = f"is not {encoding.removesuffix('-sig').upper()} text (at byte {error.start}): save it as UTF-8"
        raise DataError(Fault(str(path), "", rule)) from None


@dataclass(frozen=True)
class _Csv:
    where: str
    table: TableText
    metadata: bytes = b""

    @property
    def names(self) -> tuple[str, ...]:
        return self.table.names

    def read(self, wanted: Sequence[str], time: str | None, unit_s: float = 1.0) -> Mapping[str, Array]:
        return read_columns(self.table, wanted, self.where, time, unit_s)


@dataclass(frozen=True)
class _Parquet:
    where: str
    file: Any

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.file.schema_arrow.names)

    @property
    def metadata(self) -> bytes:
        found: bytes = (self.file.schema_arrow.metadata or {}).get(METADATA, b"")
        return found if len(found) <= _MAX_METADATA_BYTES else b""

    def read(self, wanted: Sequence[str], time: str | None, unit_s: float = 1.0) -> Mapping[str, Array]:
        """Return the columns, read in batches, as the file may hold more rows than it states."""
        import pyarrow as pa

        faults, units = self._type_faults(wanted, time)
        n_rows = self.file.metadata.num_rows
        most = min(MAX_ROWS, MAX_VALUES // max(1, len(wanted)))
        if not MIN_ROWS <= n_rows <= most:
            faults.append(Fault(self.where, "", f"must have {MIN_ROWS} to {most} rows", n_rows))
        if faults:
            raise DataError(faults)
        parts: dict[str, list[Any]] = {name: [] for name in wanted}
        n_read = 0
        try:
            for batch in self.file.iter_batches(_BATCH_ROWS, columns=list(wanted)):
                n_read += batch.num_rows
                if n_read > n_rows:
                    raise DataError(Fault(self.where, "", f"holds more rows than the {n_rows} that it states"))
                for name in wanted:
                    parts[name].append(_plain(batch.column(name), name in units))
        except (pa.ArrowException, OSError, MemoryError) as error:
            raise DataError(Fault(self.where, "", f"is damaged: {_short(error)}")) from None
        if n_read < MIN_ROWS:
            raise DataError(Fault(self.where, "", f"must have at least {MIN_ROWS} rows", n_read))
        columns = {name: np.concatenate(arrays) for name, arrays in parts.items()}
        for name, ticks_per_s in units.items():
            columns[name] = (columns[name] - columns[name][0]) / (ticks_per_s * unit_s)
        return {name: _as_floats(values, name == time) for name, values in columns.items()}

    def _type_faults(self, wanted: Sequence[str], time: str | None) -> tuple[list[Fault], dict[str, int]]:
        """Return the faults of columns that hold no numbers, and the ticks per s of the one that holds dates."""
        import pyarrow as pa

        faults, units = [], {}
        for name in wanted:
            kind = self.file.schema_arrow.field(name).type
            if name == time and pa.types.is_timestamp(kind):
                units[name] = _TICKS_PER_S[kind.unit]
            elif not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
                faults.append(Fault(self.where, f"column {name}", "must hold numbers", str(kind)))
        return faults, units


def _opened_parquet(path: Path) -> TableFile:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path, thrift_string_size_limit=10_000_000, thrift_container_size_limit=1_000_000)
        if file.metadata.num_columns > MAX_COLUMNS:
            rule = f"must have at most {MAX_COLUMNS} columns"
            raise DataError(Fault(str(path), "", rule, file.metadata.num_columns))
    except (pa.ArrowException, ValueError, OSError) as error:
        if isinstance(error, FileNotFoundError | PermissionError | IsADirectoryError):
            raise
        raise DataError(Fault(str(path), "", f"is no Parquet file, or damaged: {_short(error)}")) from None
    return _Parquet(str(path), file)


def _plain(column: Any, is_date: bool) -> Any:
    import pyarrow as pa

    if is_date:
        column = column.cast(pa.int64())
    if column.null_count:
        column = column.cast(pa.float64(), safe=False)  # missing values become NaN, which is told with its row
    return column.to_numpy(zero_copy_only=False)


def _as_floats(values: Any, is_time: bool) -> Array:
    # integers of ns since 1970 have more digits than a float: only their differences are needed
    whole = is_time and np.issubdtype(values.dtype, np.integer)
    return np.asarray(values - values[0] if whole else values, dtype=np.float64)


def _short(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text[:200]
