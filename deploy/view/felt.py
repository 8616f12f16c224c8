"""The force that a hand feels, its loop's stability, and the stiffness from which theory expects it to swing now."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from math import isfinite
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.coupling.stability import Arm, Limb, loop_limit
from tis.common.scenario.control import EmulatorState
from tis.common.scenario.network.conditions import TimelineEntry
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.frame import Frame
from tis.deploy.report.subjects.touch import Stability, stability
from tis.deploy.view.hold_reason import RunAbout
from tis.deploy.watch.arms import Place
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.forces import MJ_PER_J, FeltRow

_NEW_NS: Final = NS_PER_S
_JUDGED_NS: Final = 15 * NS_PER_S
_YOUNG_S: Final = 5.0
"""A loop is called stable once it has been watched for so long in one network: a swing grows from small."""
_FREE_NS: Final = 2 * NS_PER_S
"""A hand that feels nothing for so long has left what it touched: a swing leaves it for less."""
_RESTS_M_S: Final = 1e-3
_SETTLES_S: Final = 0.5
_FEWEST_ROWS: Final = 50
_FEWEST_PERIODS: Final = 3
_LEAST_MM: Final = 1e-3
_GROWS: Final = 0.01
_STEADILY: Final = 0.9
"""Least growth of a swing in a period, and least correlation of its logarithm with time."""
_SEEN_MM: Final = 0.5
"""Size from which a swing is seen in the picture, some three pixels."""
_STEP_MS: Final = 5.0
"""Resolution of the round trip for which theory is asked."""


class LoopLimit:
    """Theory's limit at a round trip. It takes a third of a second: found in a thread of its own, one at a time."""

    def __init__(self, about: RunAbout | None) -> None:
        self._about: Final = about
        self._pool: Final = ThreadPoolExecutor(max_workers=1, thread_name_prefix="theory")
        self._found: Final[dict[int, Future[float]]] = {}

    def at(self, trip_ms: float | None) -> float | None:
        """Return the limit, in N/m; None while it is not found yet, and where theory tells none."""
        about = self._about
        if trip_ms is None or about is None or about.loop is None:
            return None
        step = max(round(trip_ms / _STEP_MS), 1)
        if step not in self._found and all(one.done() for one in self._found.values()):
            limb, arm = about.loop
            self._found[step] = self._pool.submit(
                loop_limit, Limb(*limb), Arm(*arm), step * _STEP_MS / 1000.0, 1.0 / about.rate_hz
            )
        found = self._found.get(step)
        return round(found.result()) if found is not None and found.done() and isfinite(found.result()) else None


def felt_of(row: FeltRow | None, now_ns: int) -> dict[str, Any] | None:
    """Return what a hand feels, on the arm's axes; None without touch, and where nothing newer is known."""
    if row is None or now_ns - row.t_ns > _NEW_NS:
        return None
    return {
        "hand_n": [round(value, 3) for value in row.hand_n],
        "tool_n": row.tool_n and [round(value, 3) for value in row.tool_n],
        "late_ms": None if row.late_ns is None else round(row.late_ns / NS_PER_MS, 1),
        "limited": row.limited,
        "most_given_mj": round(MJ_PER_J * row.most_given_j, 2),
        "place_mm": rounded_mm(row.position_m),
        "meant_mm": rounded_mm(row.intended_m),
    }


def rounded_mm(place_m: Place | None) -> list[float] | None:
    """Return a place in mm, as a page gets it."""
    return None if place_m is None else [round(MM_PER_M * value, 3) for value in place_m]


def felt_rows(book: LiveBook) -> list[FeltRow]:
    """Return what the first hand that feels anything felt over the last seconds."""
    return next((trail.all() for trail in book.forces.rows.values() if trail.n), [])


class Swing(NamedTuple):
    """How a hand swings off what it intends while that rests: amplitude, and what it grows by in a period.

    ``growth_pct`` is None where the swing does not grow steadily, ``seen_in_s`` where it does not or is seen already.
    """

    size_mm: float
    growth_pct: float | None
    seen_in_s: float | None


class LoopVerdict(NamedTuple):
    """How a loop stands by the measure of the summary, over how long, and how the hand swings.

    ``not_yet``: a loop that would count as stable, of which too little was seen. ``stands`` is why nothing is told:
    the hand touches nothing, or was off what it intends by the same to a micrometre.
    """

    stability: Stability | Literal["not_yet"]
    over_s: float
    swing: Swing | None
    stands: Literal["free", "still"] | None = None


def loop_verdict(rows: Sequence[FeltRow], changed_ns: int) -> LoopVerdict | None:
    """Return how the loop of the last rows stands in the present network; None without touch.

    ``changed_ns`` is when the network was changed last: what was before is of another loop, as in the report.
    Nothing is told by what was before the hand came back to what it touches, or before a hand at rest moved.
    """
    rows = [row for row in rows if row.t_ns >= max(changed_ns, rows[-1].t_ns - _JUDGED_NS)]
    if len(rows) < 2:
        return None
    t_ns = np.array([row.t_ns for row in rows])
    shown = Frame.of_arrays(
        sample_ns=t_ns,
        force_n=np.array([row.hand_n for row in rows]),
        position_m=np.array([row.position_m for row in rows]),
        intended_m=np.array([row.intended_m for row in rows]),
        limited=np.array([row.limited for row in rows]),
    )
    stands = _stands(shown)
    if stands is not None:
        return LoopVerdict("not_decidable", _over_s(shown), None, stands)
    shown = shown.at(slice(_told_from(shown), None))
    over_s = _over_s(shown)
    found = stability(shown, max(round(NS_PER_S / float(np.median(np.diff(t_ns)))), 1))
    swing = swing_of(shown)
    if found == "stable" and swing is not None and swing.growth_pct is not None:
        found = "unstable"  # the intention has moved by more than a swing that is still small
    is_young = found == "stable" and over_s < _YOUNG_S
    return LoopVerdict("not_yet" if is_young else found, over_s, swing)


def _stands(shown: Frame) -> Literal["free", "still"] | None:
    """Return how a hand stands of which rounding alone would tell that it swings or does not."""
    felt_ns = _felt_ns(shown)
    if not len(felt_ns) or shown.sample_ns[-1] - felt_ns[-1] > _FREE_NS:
        return "free"
    off_mm = _off_mm(shown)
    return "still" if off_mm.any() and np.ptp(off_mm, axis=0).max() < _LEAST_MM else None


def _told_from(shown: Frame) -> int:
    """Return the row from which a loop tells something: since its last long time free, and since it first moved."""
    felt_ns = _felt_ns(shown)
    after_free = np.flatnonzero(np.diff(felt_ns) > _FREE_NS)
    begin = int(np.searchsorted(shown.sample_ns, felt_ns[after_free[-1] + 1])) if len(after_free) else 0
    off_mm = _off_mm(shown)[begin:]
    moved = np.abs(off_mm - off_mm[0]).max(axis=1) >= _LEAST_MM
    return begin + int(np.argmax(moved)) if moved.any() else begin


def _over_s(shown: Frame) -> float:
    return round(float(shown.sample_ns[-1] - shown.sample_ns[0]) / NS_PER_S, 1)


def _felt_ns(shown: Frame) -> NDArray[np.int64]:
    """Return the instants (K,) at which a hand felt a force."""
    return np.asarray(shown.sample_ns[shown.force_n.any(axis=1)])


def _off_mm(shown: Frame) -> NDArray[np.float64]:
    """Return how far a hand is off what it intends (N, 3)."""
    return np.asarray(MM_PER_M * (shown.position_m - shown.intended_m))


def told(found: LoopVerdict) -> dict[str, Any]:
    """Return a verdict, as a page gets it."""
    swing = found.swing and {name: value and float(f"{value:.3g}") for name, value in found.swing._asdict().items()}
    about = {"over_s": found.over_s, "young_s": _YOUNG_S, "stands": found.stands}
    return {"state": found.stability, "swing": swing, **about}


def swing_of(shown: Frame) -> Swing | None:
    """Return the swing of a hand since what it intends last moved; None where that is not long, or it does not swing.

    Along the direction in which it swings most; its size is that of the last period, its growth that of the line
    through the logarithms of all periods. Oracle: swings of known size and growth, tests/deploy/view/test_felt.
    """
    t_s = shown.sample_ns / NS_PER_S
    meant_m_s = np.linalg.norm(np.diff(shown.intended_m, axis=0), axis=1) / np.diff(t_s)
    moved = np.flatnonzero(meant_m_s > _RESTS_M_S)
    still = t_s >= (t_s[0] if not len(moved) else t_s[moved[-1] + 1] + _SETTLES_S)
    if np.count_nonzero(still) < _FEWEST_ROWS:
        return None
    t_s, off_mm = t_s[still], _off_mm(shown)[still]
    off_mm = off_mm - off_mm.mean(axis=0)
    along_mm = off_mm @ np.linalg.svd(off_mm, full_matrices=False)[2][0]
    level_mm = along_mm - np.polyval(np.polyfit(t_s, along_mm, 1), t_s)
    crossed = np.flatnonzero(np.diff(np.signbit(level_mm)))
    if len(crossed) < 2 * _FEWEST_PERIODS:
        return None
    period_s = 2.0 * float(np.diff(t_s[crossed]).mean())
    n = int((t_s[-1] - t_s[0]) / period_s)
    which = ((t_s[-1] - t_s) / period_s).astype(int)
    sizes_mm = np.array([_size_mm(along_mm[which == k]) for k in reversed(range(n))])
    if n < _FEWEST_PERIODS or sizes_mm[-1] < _LEAST_MM or (sizes_mm <= 0.0).any():
        return None
    line = np.polyfit(np.arange(n), np.log(sizes_mm), 1)
    if line[0] < _GROWS or np.corrcoef(np.arange(n), np.log(sizes_mm))[0, 1] < _STEADILY:
        return Swing(float(sizes_mm[-1]), None, None)
    unseen = float(np.log(_SEEN_MM / sizes_mm[-1]))
    in_s = unseen / float(line[0]) * period_s if unseen > 0.0 else None
    return Swing(float(sizes_mm[-1]), 100.0 * float(np.expm1(line[0])), in_s)


def _size_mm(along_mm: NDArray[np.float64]) -> float:
    return float(np.sqrt(2.0) * along_mm.std()) if len(along_mm) else 0.0


class NetworkEdges:
    """When the network of a run was last changed while it ran, as the states of netem tell, one after the other."""

    def __init__(self) -> None:
        self.changed_ns = 0
        self._known: Sequence[TimelineEntry] | None = None

    def note(self, state: EmulatorState | None, now_ns: int) -> None:
        """Note a state, as it is at ``now_ns`` of run time.

        A change is the begin or the end of what was requested, as `network_edges_ns` of the report has it. Oracle:
        states by hand, tests/deploy/view/test_felt.
        """
        if state is None or state.at_s is None:
            return
        added = [one for way in (state.forward, state.feedback) if way is not None for one in way.added]
        held = [one for one in added if one.at_s * NS_PER_S <= now_ns]
        if self._known is None:  # what was changed before the page looked
            self.changed_ns = max((round(one.at_s * NS_PER_S) for one in held), default=0)
        elif held != self._known:
            self.changed_ns = now_ns
        self._known = held
