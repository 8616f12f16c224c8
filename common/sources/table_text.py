"""Text of a table: a line of names, then a line of numbers for each row, separated by commas, semicolons or tabs."""

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tis.common.errors import MAX_SHOWN, DataError, Fault, capped
from tis.common.sources.table_columns import MAX_COLUMNS, MAX_ROWS, MIN_ROWS
from tis.common.sources.trajectory import Array
from tis.common.units import NS_PER_S

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


def _with_points(table: TableText, wanted: Sequence[str]) -> TableText:
    """Return the table with points for decimal commas, where most decimals of the wanted columns have commas.

    A cell of theirs with a point gets a comma then: it is told as what it is, no number of this table.
    """
    if table.separator == "," or not any("," in line for line in table.lines):
        return table
    if not any("." in _DATE.sub("", line) for line in table.lines):
        return replace(table, lines=[line.replace(",", ".") for line in table.lines])
    rows = list(csv.reader(table.lines, delimiter=table.separator))
    wanted_places = [table.names.index(name) for name in wanted]
    places = {k for k in wanted_places if len(rows[0]) > k and _DATE.fullmatch(rows[0][k].strip()) is None}
    n_of = Counter(mark for row in rows for k, cell in enumerate(row) if k in places for mark in ",." if mark in cell)
    if n_of[","] <= n_of["."] or len(rows) != len(table.lines):
        return table
    swap, swapped = str.maketrans(",.", ".,"), io.StringIO()
    csv.writer(swapped, delimiter=table.separator, lineterminator="\n").writerows(
        [cell.translate(swap) if k in places else cell for k, cell in enumerate(row)] for row in rows
    )
    return replace(table, lines=swapped.getvalue().split("\n")[:-1])


_DATE: Final = re.compile(r"((?:19|20|21)\d\d-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d{1,9})?)(Z|[+-]\d\d:?\d\d)?")


def _dates(table: TableText, name: str, where: str) -> Array | None:
    """Return times of ISO 8601, all of one offset, in s from the first; None where the first one is no date."""
    place = table.names.index(name)
    cells = [row[place].strip() for row in csv.reader(table.lines, delimiter=table.separator)]
    first = _DATE.fullmatch(cells[0])
    if first is None:
        return None
    dates = [_DATE.fullmatch(cell) for cell in cells]
    rule = f"must be a time like {cells[0]}, with the same offset from UTC"
    bad = [i for i, date in enumerate(dates) if date is None or date[2] != first[2]]
    if not bad:
        try:
            instants = np.array([date[1] for date in dates if date is not None], dtype="datetime64[ns]")
        except ValueError as error:
            raise DataError(Fault(where, f"column {name}", f"must hold times that there are: {error}")) from None
        return np.asarray((instants - instants[0]).astype(np.int64) / NS_PER_S, dtype=np.float64)
    found = [Fault(where, f"line {i + 2}, column {name}", rule, cells[i]) for i in bad[:MAX_SHOWN]]
    raise DataError(capped(found, len(bad), where, rule))


def read_columns(
    table: TableText, wanted: Sequence[str], where: str, time: str | None = None, unit_s: float = 1.0
) -> Mapping[str, Array]:
    """Return the wanted columns, each there once; raises `DataError` with the faults of every kind at once.

    Of ``time`` the cells may be dates, which are returned in the unit of times, of ``unit_s``, from the first.
    Kinds are the number of cells of a line and what is no number; at most five lines of each are shown, and the
    others counted. NaN is a number here. Oracle: round trips and damaged tables in the tests.
    """
    given, table = table, _with_points(table, wanted)
    if time is not None and time in wanted and len(wanted) > 1:
        of_first = next(csv.reader(table.lines[:1], delimiter=table.separator), [])
        place = table.names.index(time)
        if len(of_first) > place and _number(of_first[place]) is None:
            others = read_columns(given, [name for name in wanted if name != time], where)
            dates = _dates(table, time, where)
            if dates is None:
                rule = "must be a number, or a time like 2026-03-29T14:00:00.5+02:00"
                raise DataError(Fault(where, f"line 2, column {time}", rule, of_first[place]))
            return {**others, time: dates / unit_s}
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
    raise DataError(_diagnose(table, given, wanted, where))


def _diagnose(table: TableText, given: TableText, wanted: Sequence[str], where: str) -> list[Fault]:
    """Return the faults of a table, which shows the cells as they were given."""
    places = [table.names.index(name) for name in wanted]
    width_rule, number_rule = f"must have {len(table.names)} cells, as line 1", "must be a number"
    if table.separator == "," and table.lines[0].count(",") == 2 * len(table.names) - 1:
        width_rule += " (where the comma is the decimal mark, separate cells by semicolons)"
    if table.separator != "," and any("," in line for line in given.lines[:_MAX_DIAGNOSED]):
        number_rule += " (decimals must all have points, or all commas)"
    of_width: list[Fault] = []
    of_number: list[Fault] = []
    for i, line in enumerate(table.lines[:_MAX_DIAGNOSED]):
        number, cells = i + 2, next(csv.reader([line], delimiter=table.separator), [])
        if len(cells) != len(table.names):
            of_width.append(Fault(where, f"line {number}", width_rule, len(cells)))
            continue
        bad = [(name, k) for name, k in zip(wanted, places, strict=True) if _number(cells[k]) is None]
        if bad:
            shown = next(csv.reader([given.lines[i]], delimiter=table.separator))[bad[0][1]]
            rest = f" and {len(bad) - 1} more" if len(bad) > 1 else ""
            of_number.append(Fault(where, f"line {number}, column {bad[0][0]}{rest}", number_rule, shown))
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
