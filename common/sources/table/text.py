"""Text of a table: a line of names, then a line of numbers per row, separated by commas, semicolons or tabs."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.sources.table.limits import MAX_COLUMNS, MAX_ROWS, MIN_ROWS, capped
from tis.common.sources.trajectory import Array

_MAX_LINE_CHARS: Final = 200_000
_MAX_DIAGNOSED: Final = 200_000
_SEPARATORS: Final = ",;\t"


@dataclass(frozen=True)
class TableText:
    """Names of the columns, in order and possibly repeated, and the lines of the rows."""

    names: tuple[str, ...]
    separator: str
    lines: Sequence[str]


def split_table(text: str, where: str) -> TableText:
    """Return the names and lines of a table's text; raises `DataError` when it is none.

    The separator is the one that the first line has most of. Oracle: tables that the tests write.
    """
    n_lines = text.count("\n") + text.count("\r")
    if n_lines > 2 * MAX_ROWS:  # counted first: as a list, empty lines take many times their size
        raise DataError(Fault(where, "", f"must have at most {MAX_ROWS} rows", n_lines))
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.rstrip().split("\n")
    if not lines[0].strip():
        raise DataError(Fault(where, "line 1", "must hold the names of the columns", lines[0]))
    longest = max(range(len(lines)), key=lambda i: len(lines[i]))
    if len(lines[longest]) > _MAX_LINE_CHARS:
        rule = f"must have at most {_MAX_LINE_CHARS} characters"
        raise DataError(Fault(where, f"line {longest + 1}", rule, len(lines[longest])))
    separator = max(_SEPARATORS, key=lines[0].count)
    names = tuple(name.strip() for name in next(csv.reader([lines[0]], delimiter=separator)))
    faults = []
    if len(names) > MAX_COLUMNS:
        faults.append(Fault(where, "line 1", f"must name at most {MAX_COLUMNS} columns", len(names)))
    if len(lines) - 1 < MIN_ROWS:
        faults.append(Fault(where, "", f"must have at least {MIN_ROWS} rows", len(lines) - 1))
    if len(lines) - 1 > MAX_ROWS:
        faults.append(Fault(where, "", f"must have at most {MAX_ROWS} rows", len(lines) - 1))
    if all(_number(name) is not None for name in names):
        faults.append(Fault(where, "line 1", "must hold the names of the columns, not numbers", lines[0][:60]))
    if faults:
        raise DataError(faults)
    return TableText(names, separator, lines[1:])


def read_columns(table: TableText, wanted: Sequence[str], where: str) -> Mapping[str, Array]:
    """Return the wanted columns, each there once; raises `DataError` with the faults of every kind at once.

    Kinds are the number of cells of a line and what is no number; at most five lines of each are shown, and the
    others counted. NaN is a number here. Oracle: round trips and damaged tables in the tests.
    """
    places = [table.names.index(name) for name in wanted]
    quoted = any('"' in line for line in table.lines)
    even = quoted or all(line.count(table.separator) + 1 == len(table.names) for line in table.lines)
    if even and all(table.lines):
        try:
            values = np.loadtxt(
                table.lines, delimiter=table.separator, usecols=places, comments=None, ndmin=2, quotechar='"'
            )
        except ValueError:
            pass  # told below, line by line
        else:
            if len(values) == len(table.lines):
                return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(wanted)}
    raise DataError(_diagnose(table, wanted, places, where))


def _diagnose(table: TableText, wanted: Sequence[str], places: Sequence[int], where: str) -> list[Fault]:
    width_rule, number_rule = f"must have {len(table.names)} cells, as line 1", "must be a number"
    of_width: list[Fault] = []
    of_number: list[Fault] = []
    for number, line in enumerate(table.lines[:_MAX_DIAGNOSED], start=2):
        cells = next(csv.reader([line], delimiter=table.separator), [])
        if len(cells) != len(table.names):
            of_width.append(Fault(where, f"line {number}", width_rule, len(cells)))
            continue
        bad = [(name, cells[k]) for name, k in zip(wanted, places, strict=True) if _number(cells[k]) is None]
        if bad:
            rest = f" and {len(bad) - 1} more" if len(bad) > 1 else ""
            of_number.append(Fault(where, f"line {number}, column {bad[0][0]}{rest}", number_rule, bad[0][1]))
    found = [
        *capped(of_width, len(of_width), where, width_rule),
        *capped(of_number, len(of_number), where, number_rule),
    ]
    return found or [Fault(where, f"a line after {_MAX_DIAGNOSED}", f"{width_rule}, each a number")]


def _number(cell: str) -> float | None:
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None
