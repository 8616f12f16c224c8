"""Lateness of the arm that a page shows, and the network's part of it."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from tis.common.metrics.percentiles import median
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.watch.arms import DisplayRow
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.streams import StreamName

JUDGED_S: Final = 3.0
_FROZEN_NS: Final = 300 * NS_PER_MS
_BOTH_WAYS: Final[tuple[StreamName, StreamName]] = ("master", "answers")


def is_frozen(book: LiveBook) -> bool:
    """Tell whether no new picture has come lately."""
    return book.now_ns - book.displays.fresh_ns > _FROZEN_NS


def late_ms(book: LiveBook, arm: str | None) -> float | None:
    """Return how late an arm's picture is; None before the first.

    The median of the new pictures of the last seconds; of a frozen one its age.
    """
    rows = [] if arm is None else book.displays.rows[arm].all()
    if not rows:
        return None
    if is_frozen(book):
        return rows[-1].late_ns / NS_PER_MS
    return median([row.late_ns for row in _new(rows) or rows[-1:]]) / NS_PER_MS


def network_ms(book: LiveBook, arm: str | None) -> float | None:
    """Return the network's part of `late_ms`, both ways; None where it cannot be told, as of a frozen picture.

    Each new picture has the delays of its own command and answer; the part is the median of their sums, since a busy
    observer stamps single messages late, and no more than the lateness. Oracle: delays by hand,
    tests/deploy/view/test_lateness.
    """
    new = [] if arm is None or is_frozen(book) else _new(book.displays.rows[arm].all())
    there, back = (
        sorted((row.sent_ns, row.delay_ns) for row in book.crossed[name].all() if row.delay_ns is not None)
        for name in _BOTH_WAYS
    )
    if not (new and there and back):
        return None
    sent_ns, there_ns = np.array(there).T
    answered_ns, back_ns = np.array(back).T
    arrived_ns = np.maximum.accumulate(answered_ns + back_ns)
    # the command that was sent with the sample, and the last answer that had arrived
    command = np.searchsorted(sent_ns, [row.command_ns for row in new]).clip(max=len(sent_ns) - 1)
    answer = np.searchsorted(arrived_ns, [row.t_ns for row in new], side="right") - 1
    late_ns = median([row.late_ns for row in new])
    both_ns = median(there_ns[command] + back_ns[answer.clip(min=0)])
    return round(float(min(late_ns, both_ns)) / NS_PER_MS, 1)


def _new(rows: Sequence[DisplayRow]) -> list[DisplayRow]:
    """Return those of the last seconds that answered a newer command than the one before."""
    begin_ns = rows[-1].t_ns - int(JUDGED_S * NS_PER_S) if rows else 0
    return [row for before, row in pairwise(rows) if before.command_ns < row.command_ns and row.t_ns >= begin_ns]
