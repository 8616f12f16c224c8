"""Clocks of the sides against netem's, the reference, with their uncertainty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, get_args

import numpy as np

from tis.common.channels import Side, direction_of
from tis.common.clocks import PPM, SHARED, ClockModel, Exchanges, Ints, fit_clock
from tis.common.errors import DataError, Fault
from tis.common.host_records import CLOCK, DISCIPLINE, EXCHANGES
from tis.common.topic import Topic
from tis.common.units import NS_PER_MS, NS_PER_US
from tis.deploy.logs.payloads import Row
from tis.deploy.logs.read.frame import Frame

Clocks = Mapping[Side, ClockModel]
"""Models of the sides' clocks against netem's, the reference; a side without one uses it."""

Kind = Literal["reference", "shared", "exchanged", "unknown"]

CLOCK_TOPICS: Final = (CLOCK, EXCHANGES, DISCIPLINE)

_STAMPS: Final = ("asked_ns", "received_ns", "replied_ns", "answered_ns")
_N_INSTANTS: Final = 1000


@dataclass(frozen=True)
class SideClock:
    """One side's clock: the kind of comparison with the reference, and the fitted model.

    ``host`` is the boot id. ``ahead_ns`` is the reference's epoch minus this side's, each on its own monotonic clock.
    ``discipline`` is the kernel's last report on the clock, None when there is none.
    """

    kind: Kind = "unknown"
    model: ClockModel = SHARED
    host: str = ""
    exchanges: Exchanges = field(default_factory=lambda: Exchanges.of(()))
    ahead_ns: int = 0
    discipline: Row | None = None
    last_ns: int = 0

    def summary(self) -> dict[str, Any]:
        """Return the summary's entry; the offset is at run time 0, positive when the reference is ahead.

        ``uncertainty_us`` is the largest of the run, None for an unknown clock.
        """
        measured = self.kind == "exchanged"
        # uncertainty grows between exchanges: sampled over the run, its maximum counts
        over_ns = np.linspace(0, max(self.last_ns, 1), _N_INSTANTS).astype(np.int64)
        offset_ns = self.ahead_ns + float(self.model.offset_at(np.zeros(1, dtype=np.int64))[0])
        known = self.kind != "unknown"
        return {
            "kind": self.kind,
            "offset_ms": offset_ns / NS_PER_MS if known else None,
            "drift_ppm": self.model.drift / PPM if known else None,
            "drift_uncertainty_ppm": self.model.drift_bound / PPM if known else None,
            "uncertainty_us": float(self.model.uncertainty_ns(over_ns).max()) / NS_PER_US if known else None,
            "n_exchanges": len(self.exchanges),
            "min_round_trip_us": float(self.exchanges.round_trip_ns.min()) / NS_PER_US if measured else None,
            "discipline": self.discipline,
        }


@dataclass(frozen=True)
class RunClocks:
    """The clocks of a run's sides; a side that is not listed uses the reference, as all do in virtual time."""

    sides: Mapping[Side, SideClock] = field(default_factory=dict)

    def model(self, side: Side) -> ClockModel:
        """Return the model that converts a side's stamps to the reference clock."""
        clock = self.sides.get(side)
        return SHARED if clock is None else clock.model

    def models(self) -> Clocks:
        """Return the model of each side."""
        return {side: self.model(side) for side in get_args(Side)}

    @property
    def all_shared(self) -> bool:
        """Tell whether every side uses the reference clock, as far as known."""
        return all(clock.model.shared for clock in self.sides.values())

    @property
    def all_known(self) -> bool:
        """Tell whether every clock was compared with the reference."""
        return all(clock.kind != "unknown" for clock in self.sides.values())

    def uncertainty_ns(self, begin: Side, begin_ns: Ints, end: Side, end_ns: Ints) -> Ints | None:
        """Return the error bounds (N,) in ns of durations between aligned stamps of two sides.

        The bounds of both clocks add up. Durations on one host are exact, whatever its offset. None when one of the
        clocks is unknown. Oracle: tests/deploy/logs/read/test_clocks.
        """
        one, other = (self.sides.get(side, SideClock("shared")) for side in (begin, end))
        if begin == end or (one.host and one.host == other.host):
            return np.zeros(len(begin_ns), dtype=np.int64)
        if "unknown" in (one.kind, other.kind):
            return None
        return one.model.uncertainty_at_ns(begin_ns) + other.model.uncertainty_at_ns(end_ns)

    def hosts(self) -> dict[Side, dict[str, Any]]:
        """Return by side the boot id of its host and the kernel's report on the clock (adjtimex)."""
        return {
            side: {"boot_id": clock.host or None, "discipline": clock.discipline}
            for side, clock in self.sides.items()
        }

    def summary(self) -> dict[str, Any]:
        """Return the summary's ``clocks``, by side."""
        return {side: clock.summary() for side, clock in self.sides.items()}


def run_clocks(rows: Mapping[Side, Mapping[str, Sequence[Row]]], last_ns: Mapping[Side, int], mode: str) -> RunClocks:
    """Return the clocks of a run from the rows of its sides by topic; a twin has one clock.

    Sides on one host share a clock, so their exchanges are pooled. Raises `DataError` for rows of another version.
    Oracle: tests/deploy/logs/read/test_clocks.
    """
    if mode == "twin":
        return RunClocks()
    try:
        return _run_clocks(rows, last_ns)
    except (LookupError, TypeError, ValueError, OverflowError):
        raise DataError(Fault(CLOCK, "", "holds records that this version does not know")) from None


def _run_clocks(rows: Mapping[Side, Mapping[str, Sequence[Row]]], last_ns: Mapping[Side, int]) -> RunClocks:
    notes = {side: topics[CLOCK][0] for side, topics in rows.items() if topics.get(CLOCK)}
    clocks: dict[Side, SideClock] = {}
    for side, topics in rows.items():
        # the last report of the kernel counts
        discipline = next((_discipline(row) for row in reversed(topics.get(DISCIPLINE, ()))), None)
        clock = SideClock(discipline=discipline, last_ns=last_ns[side])
        if side == "netem":
            host = next((note["reference_boot_id"] for note in notes.values()), "")
            clock = replace(clock, kind="reference", host=host)
        elif side in notes:
            clock = _compared_clock(clock, notes[side], notes, rows)
        clocks[side] = clock
    return RunClocks(clocks)


def _compared_clock(
    clock: SideClock, note: Row, notes: Mapping[Side, Row], rows: Mapping[Side, Mapping[str, Sequence[Row]]]
) -> SideClock:
    clock = replace(clock, host=note["boot_id"], ahead_ns=note["reference_epoch_ns"] - note["epoch_ns"])
    if note["shared"]:
        return replace(clock, kind="shared")
    stamps = []
    for mate, other in notes.items():
        if other is not note and not _one_clock(note, other):
            continue
        # the mate counts run time from its own epoch, on the same clock
        later_ns = other["epoch_ns"] - note["epoch_ns"]
        for row in rows[mate].get(EXCHANGES, ()):
            asked_ns, received_ns, replied_ns, answered_ns = (row[name] for name in _STAMPS)
            stamps.append((asked_ns + later_ns, received_ns, replied_ns, answered_ns + later_ns))
    exchanges = Exchanges.of(stamps)
    if not len(exchanges):
        return clock
    return replace(clock, kind="exchanged", model=fit_clock(exchanges), exchanges=exchanges)


def _one_clock(note: Row, other: Row) -> bool:
    same = ("boot_id", "reference_boot_id", "reference_epoch_ns", "shared")
    return bool(note["boot_id"]) and all(note[name] == other[name] for name in same)


def _discipline(row: Row) -> Row:
    return {name: value for name, value in row.items() if name != "at_ns"}


def sender_of(key: str) -> Side | None:
    """Return the side that publishes on a key of the testbed, whose clock stamps it; None for any other key."""
    session = key.rsplit("/", 2)[0]
    direction = direction_of(key, session)
    return None if direction is None else "surgeon" if direction == "forward" else "patient"


def aligned_rows(topic: Topic | None, frame: Frame, own: ClockModel, surgeons: ClockModel) -> Frame:
    """Return a side's records of a topic with every stamp on the reference clock.

    ``own`` is the side's clock; stamps that are copied from a sample are on the surgeon's.
    """
    clocks = () if topic is None else ((topic.stamps, own), (topic.samples, surgeons))
    moved = {
        name: clock.to_reference_ns(frame.column(name))
        for names, clock in clocks
        if not clock.shared
        for name in names
    }
    return frame.with_columns(**moved) if moved else frame
