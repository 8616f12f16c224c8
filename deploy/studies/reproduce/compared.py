"""Committed tables beside those computed again, cell by cell, under a tolerance that is stated before.

A cell is words and numbers. The words must be the same. A number may differ by `RELATIVE` of itself or by one unit of
its last printed digit, whichever is more, and never by more than half the interval that is printed beside it.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from tis.common.estimators import ESTIMATORS, short_name
from tis.deploy.studies.tables import Table

Verdict = Literal["equal", "within", "differs", "machine", "gone", "left out"]

RELATIVE: Final = 0.005
TOLERANCE: Final = (
    f"within: {100 * RELATIVE:g} % or one unit of the last printed digit, whichever is more, never above half the "
    "printed interval"
)
_NUMBER: Final = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?|(?<=\d-)\d+(?:\.\d+)?")
_INTERVAL: Final = re.compile(r"^\s*-?[\d.]+ \((-?[\d.]+)(?:-| to )(-?[\d.]+)\)\s*$")
_ESTIMATOR: Final = re.compile(r"^`?([a-z][a-z0-9]*(?:_[a-z0-9]+)+)`?$")


@dataclass(frozen=True)
class Compared:
    """One cell: its place, what is committed, what was computed (None: nothing), and the verdict."""

    table: int
    heading: str
    row: str
    column: str
    committed: str
    computed: str | None
    verdict: Verdict


Machine = Callable[[Table, str, str], bool]
"""Whether a cell depends on the machine, by its table, row and column."""


def compare(committed: Sequence[Table], computed: Sequence[Table], machine: Machine) -> Iterator[Compared]:
    """Yield every cell of the committed tables but the names of rows.

    Tables match by heading and columns, columns by their names, rows by the least cells that tell them apart. Rows of
    an estimator that `tis` no longer has are *gone*; what was not computed is *left out*. Oracle: tables by hand.
    """
    unused = list(computed)
    for number, table in enumerate(committed, 1):
        found = next((one for one in unused if _kind(one) == _kind(table) and _is_part(one, table)), None)
        unused = [one for one in unused if one is not found]
        keys = n_keys(table)
        rows = {} if found is None else {_key(row, keys): row for row in found["rows"]}
        for row in table["rows"]:
            name = ", ".join(row[:keys])
            again = rows.get(_key(row, keys))
            for at, column in enumerate(table["columns"][keys:], keys):
                places = [] if found is None else [k for k, name in enumerate(found["columns"]) if name == column]
                places = places[table["columns"][:at].count(column) :]  # two columns may have one name
                text = again[places[0]] if again is not None and places else None
                verdict = _verdict(row[at], text, machine(table, name, column), _is_gone(table, row[0]))
                yield Compared(number, table["heading"], name, column, row[at], text, verdict)


def _key(row: Sequence[str], n: int) -> tuple[str, ...]:
    """Return the cells that name a row; a method of the studies has the name of its row, or that of scenarios."""
    return tuple(short_name(cell) for cell in row[:n])


def n_keys(table: Table) -> int:
    """Return how many first cells of a row tell it from all others; 1 at least, and all where nothing does."""
    for n in range(1, len(table["columns"])):
        if len({tuple(row[:n]) for row in table["rows"]}) == len(table["rows"]):
            return n
    return len(table["columns"])


def agree(committed: str, computed: str) -> Verdict:
    """Return whether two cells are equal, within the tolerance, or differ."""
    if committed == computed:
        return "equal"
    if _NUMBER.sub("#", committed) != _NUMBER.sub("#", computed):
        return "differs"
    most = _half_interval(committed)
    pairs = zip(_NUMBER.findall(committed), _NUMBER.findall(computed), strict=True)
    return "within" if all(_near(one, other, most) for one, other in pairs) else "differs"


def counted(cells: Sequence[Compared]) -> dict[Verdict, int]:
    """Return the number of cells of each verdict."""
    return dict(Counter(cell.verdict for cell in cells))


def _verdict(committed: str, computed: str | None, is_machine: bool, is_gone: bool) -> Verdict:
    if is_gone:
        return "gone"
    if computed is None:
        return "left out"
    return "machine" if is_machine else agree(committed, computed)


def _kind(table: Table) -> tuple[str, str, str]:
    """Return heading, first column, and what a cell consists of: tables of other scores have other cells."""
    rows = table["rows"]
    sample = rows[-1][-1] if rows else ""
    shape = "axes" if len(sample.split()) == 3 and "(" not in sample else "one"
    return table["heading"], table["columns"][0], shape


def _is_part(computed: Table, committed: Table) -> bool:
    return set(computed["columns"]) <= set(committed["columns"])


def _is_gone(table: Table, name: str) -> bool:
    if table["columns"][0] not in ("estimator", "method"):
        return False
    found = _ESTIMATOR.match(name)
    return found is not None and short_name(found[1]) not in ESTIMATORS


def _half_interval(text: str) -> float | None:
    found = _INTERVAL.match(text)
    return None if found is None else abs(float(found[2]) - float(found[1])) / 2


def _near(committed: str, computed: str, most: float | None) -> bool:
    value = float(committed)
    unit = 10.0 ** -len(committed.partition(".")[2].partition("e")[0]) * 10.0 ** int(committed.partition("e")[2] or 0)
    allowed = max(RELATIVE * abs(value), unit)
    return abs(float(computed) - value) <= (allowed if most is None else min(allowed, most)) * (1 + 1e-9)
