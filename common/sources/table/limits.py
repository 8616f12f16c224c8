"""Limits of tables, and faults of many rows in few words."""

from collections.abc import Sequence
from typing import Final

from tis.common.errors import Fault

MAX_TABLE_BYTES: Final = 500_000_000
"""Size of a Parquet file."""
MAX_TEXT_BYTES: Final = 200_000_000
"""Size of a CSV file, which takes five times as much memory: an hour of two devices at 150 Hz, with all digits."""
MAX_ROWS: Final = 4_000_000
"""Rows of a table: an hour at 1 kHz."""
MAX_VALUES: Final = 64_000_000
"""Numbers that are read of a table: 512 MB in memory."""
MAX_COLUMNS: Final = 10_000
MIN_ROWS: Final = 2
"""Truth is interpolated between rows, so at least two are needed."""
MAX_SHOWN: Final = 5
"""Faults of a kind that are shown."""


def capped(found: Sequence[Fault], count: int, where: str, rule: str) -> list[Fault]:
    """Return the first faults of a kind, and one that counts the other rows."""
    shown = list(found[:MAX_SHOWN])
    if count > len(shown):
        shown.append(Fault(where, f"and {count - len(shown)} more rows", rule))
    return shown


def in_few(names: Sequence[str], most: int = 12) -> str:
    """Return names, at most so many, and the count of the others."""
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + rest
