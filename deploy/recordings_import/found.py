"""Content of a foreign recording: its topics, and the poses and angles of those that are imported."""

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import MASTER
from tis.common.errors import DataError, Fault
from tis.common.sources.table_columns import MAX_ROWS

Ints = NDArray[np.int64]
Array = NDArray[np.float64]

DEVICES: Final = ("MTML", "PSM2", "MTMR", "PSM1")
"""Devices of a table, each master before the arm that follows it."""
MASTERS: Final = frozenset(MASTER.values())

Kind = Literal["pose", "joints"]


@dataclass(frozen=True)
class Topic:
    """A topic of a recording: its name, its type, the number of messages, and what it can be imported as."""

    name: str
    type: str
    n_messages: int
    kind: Kind | None


@dataclass
class Rows:
    """Instants in ns and rows of ``width`` numbers, gathered message by message, and what had to be left out."""

    width: int
    n_undecodable: int = 0
    n_unstamped: int = 0
    _ns: "array[int]" = field(default_factory=lambda: array("q"))
    _values: "array[float]" = field(default_factory=lambda: array("d"))

    def append(self, t_ns: int, values: tuple[float, ...]) -> None:
        """Add a row; raises `OverflowError` for an instant beyond 64 bits, `DataError` for more than `MAX_ROWS`."""
        if len(self._ns) >= MAX_ROWS:
            raise DataError(Fault("tis import", "", f"a topic must have at most {MAX_ROWS} messages"))
        self._ns.append(t_ns)
        self._values.extend(values)

    def arrays(self) -> tuple[Ints, Array]:
        """Return the instants (N,) and the rows (N, width)."""
        ns = np.frombuffer(self._ns, dtype=np.int64) if self._ns else np.empty(0, dtype=np.int64)
        return ns, np.asarray(self._values, dtype=np.float64).reshape(-1, self.width)


@dataclass(frozen=True)
class Stream:
    """Poses of one device: instants (N,) in ns, positions in m, quaternions x y z w; None: it has no orientation.

    ``gripper_rad`` is None where the angle comes from elsewhere or from nowhere.
    """

    device: str
    origin: str
    t_ns: Ints
    position_m: Array
    orientation: Array | None
    gripper_rad: Array | None


@dataclass(frozen=True)
class Jaw:
    """Gripper angles of one device: instants (N,) in ns, angles (N,) in rad."""

    device: str
    origin: str
    t_ns: Ints
    gripper_rad: Array


@dataclass(frozen=True)
class Found:
    """An imported recording: streams and grippers by device, sentences on what was found, and metadata."""

    streams: tuple[Stream, ...]
    jaws: tuple[Jaw, ...] = ()
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Wanted:
    """Options of an import: topics by device, the names of vectors' elements, units, and the episode.

    Messages that cannot be read are left out with ``skips_unreadable``; else they are errors.
    """

    topics: Mapping[str, str] = field(default_factory=dict)
    jaws: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    position_unit: Literal["m", "cm", "mm"] = "m"
    angle_unit: Literal["rad", "deg"] = "rad"
    gripper_unit: Literal["rad", "deg"] = "rad"
    episode: int = 0
    skips_unreadable: bool = False
