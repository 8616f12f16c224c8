"""Content of a foreign recording: its topics, and the poses and angles of those that are imported."""

from array import array
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import MASTER
from tis.common.errors import DataError, Fault
from tis.common.sources.table_columns import MAX_ROWS
from tis.deploy.logs.payloads import UNREADABLE
from tis.deploy.recordings_import.messages import Kind, Read

Ints = NDArray[np.int64]
Array = NDArray[np.float64]

DEVICES: Final = ("MTML", "PSM2", "MTMR", "PSM1")
"""Devices of a table, each master before the arm that follows it."""
MASTERS: Final = frozenset(MASTER.values())


@dataclass(frozen=True)
class Topic:
    """A topic of a recording: its name, its type, the number of messages, and what it can be imported as."""

    name: str
    type: str
    n_messages: int
    kind: Kind | None


@dataclass
class Rows:
    """Instants in ns and numbers of poses, joints or wrenches, message by message, and what had to be left out."""

    is_poses: bool
    width: int = field(default=0, kw_only=True)
    n_undecodable: int = 0
    n_unstamped: int = 0
    _ns: "array[int]" = field(default_factory=lambda: array("q"))
    _values: "array[float]" = field(default_factory=lambda: array("d"))

    def take(self, read: Callable[[], Read]) -> None:
        """Add what ``read`` returns of a message; raises `DataError` for more than `MAX_ROWS`."""
        try:
            t_ns, values, is_stamped = read()
            if len(values) != self._n_values:
                raise ValueError("a message of another kind")
            if len(self._ns) >= MAX_ROWS:
                raise DataError(Fault("tis import", "", f"a topic must have at most {MAX_ROWS} messages"))
            self._ns.append(t_ns)
        except (*UNREADABLE, AssertionError):
            self.n_undecodable += 1
            return
        self._values.extend(values)
        self.n_unstamped += not is_stamped

    @property
    def _n_values(self) -> int:
        return self.width or (8 if self.is_poses else 1)

    def arrays(self) -> tuple[Ints, Array]:
        """Return the instants (N,) and the numbers, (N, 8) of poses, (N, 6) of wrenches, (N, 1) of joints."""
        ns = np.frombuffer(self._ns, dtype=np.int64) if self._ns else np.empty(0, dtype=np.int64)
        return ns, np.asarray(self._values, dtype=np.float64).reshape(-1, self._n_values)


def rows_of(poses: Mapping[str, str], jaws: Mapping[str, str], topics: Iterable[Topic] = ()) -> dict[str, Rows]:
    """Return empty rows for the chosen topics, and for all of wrenches."""
    wrenches = {topic.name: Rows(False, width=6) for topic in topics if topic.kind == "wrench"}
    return {name: Rows(True) for name in poses.values()} | {name: Rows(False) for name in jaws.values()} | wrenches


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
class Extra:
    """Further numbers, such as forces, which no run plays: a column's name, its unit, instants (N,) in ns, values."""

    column: str
    unit: str
    t_ns: Ints
    values: Array


@dataclass(frozen=True)
class Found:
    """An imported recording: streams and grippers by device, sentences on what was found, and metadata.

    ``doubts`` are sentences on numbers that are likely in other units than those that were named.
    """

    streams: tuple[Stream, ...]
    jaws: tuple[Jaw, ...] = ()
    extras: tuple[Extra, ...] = field(default=(), kw_only=True)
    doubts: tuple[str, ...] = field(default=(), kw_only=True)
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
