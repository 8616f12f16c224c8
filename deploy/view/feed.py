"""Data feed of a page: the rows since its last frame, thinned to the resolution of a screen.

A frame is built when the page is ready for it. A slow page gets fewer frames with more rows each, at most the rows
kept by the book; nothing is queued for it.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import hypot, nan
from typing import Final, TypeVar, get_args

from tis.common.channels import FOLLOWER, MASTER, Hand
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.watch.arms import Trail
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.forces import MJ_PER_J
from tis.deploy.watch.streams import Crossing, StreamName

Columns = dict[str, list[float]]
Row = TypeVar("Row")

SHOWN_S: Final = 10.0
BIN_S: Final = 0.5
_MIN_GAP_NS: Final = 14 * NS_PER_MS
_MASTER_OF: Final[dict[str, str]] = {FOLLOWER[hand]: MASTER[hand] for hand in get_args(Hand)}
TRACK_COLUMNS: Final = (
    "t", "tx", "ty", "tz", "ex", "ey", "ez", "hx", "hy", "hz", "error", "hold_error", "turn", "hold_turn",
)  # fmt: skip
MASTER_COLUMNS: Final = ("t", "mx", "my", "mz")
FELT_COLUMNS: Final = ("t", "hand", "tool", "put_in")


@dataclass(frozen=True)
class Frame:
    """New rows for each figure, by column.

    Places and errors are in mm, errors of the orientation in degrees, times in s of run time, delays in ms.
    """

    now_s: float
    arms: tuple[str, ...]
    arm: str | None
    master: str | None
    starts_over: bool
    track: Columns
    master_track: Columns
    age: Columns
    felt: Columns
    """Sizes of the forces in N, and the energy that the hand put in, in mJ."""
    delays: dict[StreamName, Columns] = field(default_factory=dict)
    losses: dict[StreamName, Columns] = field(default_factory=dict)


class Feed:
    """Read position of one page in the book."""

    def __init__(self) -> None:
        self.arm: str | None = None
        self._n_read: defaultdict[str, int] = defaultdict(int)
        self._last_ns: dict[str, int] = {}
        self._bins: dict[StreamName, LossBins] = {name: LossBins() for name in get_args(StreamName)}
        self._shown: tuple[str | None, str | None] = (None, None)

    def advance(self, book: LiveBook) -> Frame:
        """Return the new rows. After a change of the arm its rows begin with the oldest ones kept."""
        # the arm to show: the chosen one, else the last one, else the first
        arms = tuple(sorted(book.tracks))
        arm = next((one for one in (self.arm, self._shown[0], *arms) if one in arms), None)
        master = _master_of(arm, sorted(book.masters))
        starts_over = (arm, master) != self._shown
        if starts_over:
            self._shown = (arm, master)
            for name in ("track", "place", "age", "felt"):
                self._n_read[name] = 0
                self._last_ns.pop(name, None)
        tracks = self._new("track", book.tracks[arm], lambda row: row.t_ns) if arm else []
        places = self._new("place", book.masters[master], lambda row: row.t_ns) if master else []
        ages = self._new("age", book.ages[arm], lambda row: row.t_ns) if arm else []
        felt = self._new("felt", book.forces.rows[arm], lambda row: row.t_ns) if arm in book.forces.rows else []
        delays: dict[StreamName, Columns] = {}
        losses: dict[StreamName, Columns] = {}
        for name, trail in book.crossed.items():
            crossings = trail.since(self._n_read[name])
            self._n_read[name] = trail.n
            delays[name] = delay_columns(crossings)
            losses[name] = self._bins[name].add(crossings, book.decided_ns)
        track = [
            (
                row.t_ns / NS_PER_S,
                *(MM_PER_M * value for place in (row.truth_m, row.estimate_m, row.hold_m) for value in place),
                row.error_mm,
                row.hold_error_mm,
                nan if row.turn_error_deg is None else row.turn_error_deg,
                nan if row.hold_turn_error_deg is None else row.hold_turn_error_deg,
            )
            for row in tracks
        ]
        return Frame(
            now_s=book.now_ns / NS_PER_S,
            arms=arms,
            arm=arm,
            master=master,
            starts_over=starts_over,
            track=_columns(TRACK_COLUMNS, track),
            master_track=_columns(
                MASTER_COLUMNS, [(row.t_ns / NS_PER_S, *(MM_PER_M * v for v in row.place_m)) for row in places]
            ),
            age=_columns(("t", "age"), [(row.t_ns / NS_PER_S, row.age_ms) for row in ages]),
            felt=_columns(
                FELT_COLUMNS,
                [
                    (
                        row.t_ns / NS_PER_S,
                        hypot(*row.hand_n),
                        nan if row.tool_n is None else hypot(*row.tool_n),
                        MJ_PER_J * row.put_in_j,
                    )
                    for row in felt
                ],
            ),
            delays=delays,
            losses=losses,
        )

    def _new(self, name: str, trail: Trail[Row], at_ns: Callable[[Row], int]) -> list[Row]:
        """Return the new rows of a trail, at least `_MIN_GAP_NS` apart."""
        rows = []
        last_ns = self._last_ns.get(name, -_MIN_GAP_NS)
        for row in trail.since(self._n_read[name]):
            if at_ns(row) - last_ns >= _MIN_GAP_NS:
                rows.append(row)
                last_ns = at_ns(row)
        self._n_read[name] = trail.n
        self._last_ns[name] = last_ns
        return rows


class LossBins:
    """Loss share per half second of sending time, emitted when every packet of the bin is decided."""

    def __init__(self) -> None:
        self._counts: dict[int, list[int]] = {}
        self._next: int | None = None

    def add(self, crossings: Iterable[Crossing], decided_ns: int) -> Columns:
        """Add packets; return the bins that end by ``decided_ns``: middle in s, loss in percent.

        A bin without packets is NaN, which breaks the line. Oracle: counting by hand (test_feed).
        """
        for row in crossings:
            count = self._counts.setdefault(int(row.sent_ns // (BIN_S * NS_PER_S)), [0, 0])
            count[0] += 1
            count[1] += row.delay_ns is None
        # bins are emitted in order from the first packet on, at most a screen's width at once
        if self._next is None:
            if not self._counts:
                return {"t": [], "loss": []}
            self._next = min(self._counts)
        columns: Columns = {"t": [], "loss": []}
        last = int(decided_ns // (BIN_S * NS_PER_S))
        self._next = max(self._next, last - int(SHOWN_S / BIN_S))
        while self._next < last:
            n, n_lost = self._counts.pop(self._next, (0, 0))
            columns["t"].append((self._next + 0.5) * BIN_S)
            columns["loss"].append(100 * n_lost / n if n else nan)
            self._next += 1
        self._counts = {k: count for k, count in self._counts.items() if k >= last}
        return columns


def delay_columns(crossings: Iterable[Crossing]) -> Columns:
    """Return sending time in s, delay in ms (NaN if lost), and the marks of lost packets: at 0 ms, else NaN."""
    rows = [
        (row.sent_ns / NS_PER_S, nan, 0.0)
        if row.delay_ns is None
        else (row.sent_ns / NS_PER_S, row.delay_ns / NS_PER_MS, nan)
        for row in crossings
    ]
    return _columns(("t", "delay", "lost"), rows)


def _columns(names: Sequence[str], rows: Sequence[tuple[float, ...]]) -> Columns:
    values = list(zip(*rows, strict=True)) if rows else [()] * len(names)
    return {name: list(column) for name, column in zip(names, values, strict=True)}


def _master_of(arm: str | None, masters: Sequence[str]) -> str | None:
    """Return the master to show with an arm: the only one, or its master in the channel table."""
    if len(masters) == 1 or arm is None:
        return masters[0] if masters else None
    wanted = _MASTER_OF.get(arm)
    return wanted if wanted in masters else None
