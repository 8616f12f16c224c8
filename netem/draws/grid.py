"""The grid of run time: cell c is [c, c + 1) ms. Conditions change at the edges of cells only."""

from math import gcd
from typing import Final, NamedTuple, Protocol

from tis.common.units import NS_PER_MS

CELL_NS: Final = NS_PER_MS
LAST_CELL: Final = (2**63 - 1) // CELL_NS
"""The end of a stretch without an end; its edge in ns still fits an int64."""

_HALF_NS: Final = CELL_NS // 2


class Stretch(NamedTuple):
    """Cells ``begin`` .. ``end - 1`` and the value that holds in them."""

    begin: int
    end: int
    value: int


class Path(Protocol):
    """A piecewise constant value over run time."""

    def at(self, cell: int) -> Stretch:
        """Return the stretch that contains ``cell`` >= 0; neighbours may have the same value."""
        ...


def cell_of(now_ns: int) -> int:
    """Return the cell of an instant; instants before the run are in cell 0."""
    return max(0, now_ns // CELL_NS)


def nearest_cell(instant_ns: int) -> int:
    """Return the cell that begins nearest to an instant; of two, the later."""
    return (instant_ns + _HALF_NS) // CELL_NS


def deciding_ns(cell: int) -> int:
    """Return the latest instant that `nearest_cell` maps to ``cell`` or an earlier one."""
    return cell * CELL_NS + _HALF_NS - 1


def mean_cells(begin_ns: int, length_ns: int, every_ns: int) -> float:
    """Return the mean length, in cells, of a window with period ``every_ns`` after both edges move to the grid.

    The beginnings k * every_ns + begin_ns visit a lattice of gcd(every_ns, 1 ms) within a cell evenly, so rounding
    moves an edge x by a constant minus (x + half a cell) mod gcd on average (oracle: counted, test_outage).
    """
    lattice_ns = gcd(every_ns, CELL_NS)
    before_ns = (begin_ns + _HALF_NS) % lattice_ns
    behind_ns = (begin_ns + length_ns + _HALF_NS) % lattice_ns
    return (length_ns + before_ns - behind_ns) / CELL_NS
