"""What a hand feels, and whether its loop is stable, with the stiffness from which theory expects it to swing now."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from math import isfinite
from typing import Any, Final

import numpy as np

from tis.common.coupling.stability import Arm, Limb, loop_limit
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.frame import Frame
from tis.deploy.report.subjects.touch import Stability, stability
from tis.deploy.view.hold_reason import RunAbout
from tis.deploy.watch.arms import Place
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.forces import MJ_PER_J, FeltRow

_NEW_NS: Final = NS_PER_S
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


def stability_of(rows: Sequence[FeltRow]) -> Stability | None:
    """Return how the loop of the last rows stands, by the measure of the summary; None without touch."""
    if len(rows) < 2:
        return None
    step_ns = float(np.median(np.diff([row.t_ns for row in rows])))
    shown = Frame.of_arrays(
        force_n=np.array([row.hand_n for row in rows]),
        position_m=np.array([row.position_m for row in rows]),
        intended_m=np.array([row.intended_m for row in rows]),
        limited=np.array([row.limited for row in rows]),
    )
    return stability(shown, max(round(NS_PER_S / step_ns), 1))
