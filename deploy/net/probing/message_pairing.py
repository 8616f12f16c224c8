"""Pairing of sent messages with the stamps of arrivals: delay and its uncertainty. Pure."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.clocks import SHARED, ClockModel
from tis.common.trace import LOST

Ints = NDArray[np.int64]
Stamp = tuple[int, int, int]
"""Sequence number, mark and instant (ns) of an arrival; other messages have `WARMING_UP` or `FOREIGN` as number."""

WARMING_UP: Final = -2
FOREIGN: Final = -1


class Paired(NamedTuple):
    """N messages in the order of sending: delay, `LOST` if not in time, and its uncertainty.

    ``n_impossible`` arrived before they were sent, by more than the uncertainty: a clock was set meanwhile.
    """

    delay_ns: Ints
    uncertainty_ns: Ints
    n_duplicates: int = 0
    n_late: int = 0
    n_foreign: int = 0
    n_impossible: int = 0


def pair(sent_ns: Ints, marks: Ints, stamps: Sequence[Stamp], timeout_ns: int, clock: ClockModel = SHARED) -> Paired:
    """Pair messages (N,), sent at ``sent_ns`` by the sender's clock with these ``marks``, with their stamps.

    ``stamps`` are in order of arrival, by the receiver's clock, the reference of ``clock``. The first arrival counts;
    one after ``timeout_ns`` counts as lost (RFC 7680); one with a different mark is foreign. A negative delay is
    raised to 0, which is closer to the truth and within the uncertainty. Oracle: literal stamps behind
    an asymmetric path (tests/deploy/net/probing/test_message_pairing).
    """
    n = len(sent_ns)
    left_ns = clock.to_reference_ns(sent_ns)
    uncertainty_ns = clock.uncertainty_ns(sent_ns)
    # own messages by number and mark, everything else is foreign
    rows = np.array(stamps, dtype=np.int64).reshape(-1, 3)
    rows = rows[rows[:, 0] != WARMING_UP]
    ours = (rows[:, 0] >= 0) & (rows[:, 0] < n)
    ours[ours] = marks[rows[ours, 0]] == rows[ours, 1]
    seq, _, came_ns = rows[ours].T
    delay_ns = np.full(n, LOST, dtype=np.int64)
    # the first arrival of each number; `stamps` are in order of arrival
    arrived, first = np.unique(seq, return_index=True)
    delay_in_ns = came_ns[first] - left_ns[arrived]
    in_time = delay_in_ns <= timeout_ns
    delay_ns[arrived[in_time]] = np.maximum(delay_in_ns[in_time], 0)
    return Paired(
        delay_ns,
        uncertainty_ns,
        n_duplicates=len(seq) - len(arrived),
        n_late=int((~in_time).sum()),
        n_foreign=int((~ours).sum()),
        n_impossible=int((delay_in_ns < -uncertainty_ns[arrived]).sum()),
    )


def last_received(marks: Ints, stamps: Sequence[Stamp]) -> int:
    """Return the number of messages sent up to the last one known to have arrived."""
    found = [seq for seq, mark, _ in stamps if 0 <= seq < len(marks) and marks[seq] == mark]
    return max(found, default=-1) + 1
