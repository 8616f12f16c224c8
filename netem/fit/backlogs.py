"""Backlogs in a record: delays that ramp up while a queue fills and ramp down while it drains.

Others' traffic fills the queue in front of a rate R. While it comes with the load L, beside the record's own load l,
the wait grows by (L + l) / R - 1 seconds a second, at most up to the queue's length; then it shrinks by 1 - l / R. So
the slopes tell R and L in units of l, and the record's message length tells l.
"""

from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.record import rounded

MESSAGE_BYTES: Final = 256
"""Length that a record's messages are assumed to have, as simulations of a network have it."""

_MAX_MESSAGES: Final = 100_000
_MIN_BACKLOGS: Final = 4
_NOISES: Final = 5.0
_MIN_WAIT_MS: Final = 10.0
_BASE: Final = 0.1
_RAMP: Final = (0.2, 0.8)
_MIN_POINTS: Final = 5
_STRAIGHT: Final = 0.9
_TOP: Final = 0.1
_SAME_HEIGHT: Final = 0.05
_MIN_FULL: Final = 3
_FULL_SHARE: Final = 0.2
_MIN_LOAD: Final = 0.02
_MANY: Final = 1_000_000
_CROSS_MS: Final = 2.0
_BY_BYTES: Final = 2.0
_SMOOTHED: Final = 9
_MS_PER_S: Final = 1000.0
_rounded: Final = partial(rounded, digits=6)


class Backlogs(NamedTuple):
    """The ``stage`` of a rate with its queue and the others' traffic, as in a scenario; the waits of the record.

    ``within`` (N,) are the messages that waited, ``n`` the number of backlogs, ``rising`` and ``falling`` the slopes
    in s per s, ``highest_ms`` the median of their highest waits.
    """

    stage: dict[str, Any]
    within: NDArray[np.bool_]
    n: int
    rising: float
    falling: float
    highest_ms: float

    def removed_from(self, trace: Trace) -> Trace:
        """Return the record without the time that the rate takes to send a message."""
        sending_ns = round(MESSAGE_BYTES * 8 / self.stage["kbit_s"] * NS_PER_MS)
        without = np.maximum(trace.delay_ns - sending_ns, 0)
        return Trace(trace.label, trace.sent_ns, np.where(trace.delay_ns >= 0, without, LOST))


class _Ramps(NamedTuple):
    """One backlog: slopes in s per s, highest wait in ms, for how long it was filled, and when it began, in s."""

    rising: float
    falling: float
    highest_ms: float
    filled_s: float
    begin_s: float


def find_backlogs(trace: Trace) -> Backlogs | None:
    """Return the backlogs of a record; None with fewer than four whose delays ramp both up and down.

    A record of more than 100 000 messages has none: its replays, message by message, would take many minutes.
    Oracle: queues by Lindley's recursion, tests/netem/fit/test_backlogs.
    """
    received = np.flatnonzero(trace.delay_ns >= 0)
    if not _SMOOTHED <= len(received) <= _MAX_MESSAGES:
        return None
    sent_s = (trace.sent_ns[received] - trace.sent_ns[0]) / NS_PER_S
    delay_ms = trace.delay_ns[received] / NS_PER_MS
    wait_ms = scipy.ndimage.median_filter(delay_ms, size=_SMOOTHED) - float(np.quantile(delay_ms, _BASE))
    noise_ms = float(np.median(np.abs(np.diff(delay_ms)))) / 0.95  # of the difference of two normal deviates
    high = wait_ms > max(_MIN_WAIT_MS, _NOISES * noise_ms)
    edges = np.flatnonzero(np.diff(high.astype(np.int8), prepend=0, append=0))
    spans = [_widened(wait_ms, noise_ms, first, stop) for first, stop in edges.reshape(-1, 2).tolist()]
    found = [ramps for first, stop in spans if (ramps := _ramps(sent_s[first:stop], wait_ms[first:stop]))]
    if len(found) < _MIN_BACKLOGS or len(found) < len(spans) / 2:
        return None
    within = np.zeros(len(trace.sent_ns), dtype=np.bool_)
    for first, stop in spans:
        within[received[first] : received[stop - 1] + 1] = True
    rising, falling = (float(np.median([getattr(each, name) for each in found])) for name in ("rising", "falling"))
    lost_s = (trace.sent_ns[trace.delay_ns < 0] - trace.sent_ns[0]) / NS_PER_S
    highest_ms = float(np.median([each.highest_ms for each in found]))
    full_ms = (1 - _TOP) * highest_ms
    n_lost = int(np.count_nonzero(np.interp(lost_s, sent_s, wait_ms) >= full_ms))
    p_lost = n_lost / max(n_lost + int(np.count_nonzero(wait_ms >= full_ms)), 1)
    stage = _stage(trace, found, rising, falling, p_lost)
    return Backlogs(stage, within, len(found), rising, falling, highest_ms)


def _widened(wait_ms: Floats, noise_ms: float, first: int, stop: int) -> tuple[int, int]:
    """Return a span of high waits with the feet of its ramps."""
    foot_ms = 2 * noise_ms
    while first > 0 and wait_ms[first - 1] > foot_ms and wait_ms[first - 1] <= wait_ms[first] + foot_ms:
        first -= 1
    while stop < len(wait_ms) and wait_ms[stop] > foot_ms and wait_ms[stop] <= wait_ms[stop - 1] + foot_ms:
        stop += 1
    return first, stop


def _ramps(at_s: Floats, wait_ms: Floats) -> _Ramps | None:
    """Return the ramps of one backlog, None unless it is a straight ramp up, perhaps a plateau, and one down."""
    highest_ms = float(wait_ms.max())
    low, high = (share * highest_ms for share in _RAMP)
    top = np.flatnonzero(wait_ms >= (1 - _TOP) * highest_ms)
    before, after = slice(0, int(top[0]) + 1), slice(int(top[-1]), len(wait_ms))
    slopes = []
    for part in (before, after):
        inner = (wait_ms[part] >= low) & (wait_ms[part] <= high)
        x, y = at_s[part][inner], wait_ms[part][inner]
        if len(x) < _MIN_POINTS or np.ptp(y) == 0:
            return None
        if abs(float(np.corrcoef(x, y)[0, 1])) < _STRAIGHT:
            return None
        slopes.append(float(np.polyfit(x, y, 1)[0]) / _MS_PER_S)
    rising, falling = slopes[0], -slopes[1]
    if rising <= 0 or falling <= 0:
        return None
    return _Ramps(rising, min(falling, 1.0), highest_ms, float(at_s[top[-1]] - at_s[0]), float(at_s[0]))


def _stage(trace: Trace, found: list[_Ramps], rising: float, falling: float, p_lost: float) -> dict[str, Any]:
    """Return the stage; ``p_lost`` is the share of messages that were lost while the queue was about full."""
    interval_s = float(np.median(np.diff(trace.sent_ns))) / NS_PER_S
    own_kbit_s = MESSAGE_BYTES / 125 / interval_s
    kbit_s = own_kbit_s / max(1.0 - falling, _MIN_LOAD)
    cross_kbit_s = (1.0 + rising) * kbit_s - own_kbit_s
    on_s = float(np.mean([each.filled_s for each in found]))
    begins_s = [each.begin_s for each in found]
    cycle_s = float(np.mean(np.diff(begins_s)))
    # as long as 2 ms: shorter ones would only make replays slower
    cross_bytes = int(np.clip(round(_CROSS_MS / _MS_PER_S * kbit_s * 125), 64, 65_535))
    heights_ms = np.array([each.highest_ms for each in found])
    at_top = heights_ms >= (1 - _SAME_HEIGHT) * heights_ms.max()
    stage: dict[str, Any] = {"kbit_s": _rounded(kbit_s)}
    if at_top.sum() >= max(_MIN_FULL, _FULL_SHARE * len(found)):  # chance does not end so many at one height
        # A full queue that counts packets drops what is beyond the rate, the record's messages as well; one that
        # counts bytes still takes a message as short as these where a long one finds no room.
        n_per_s = 125 * (own_kbit_s / MESSAGE_BYTES + cross_kbit_s / cross_bytes)
        waiting_bytes = float(np.median(heights_ms[at_top])) / _MS_PER_S * kbit_s * 125
        n_waiting = waiting_bytes * n_per_s / (125 * (own_kbit_s + cross_kbit_s))
        if p_lost < rising / (1 + rising) / 2:
            cross_bytes = min(round(_BY_BYTES * cross_bytes), 65_535)  # the longer, the fewer short ones are dropped
            stage["queue"] = {"kind": "tail_drop", "max_packets": _MANY, "max_bytes": round(waiting_bytes)}
        else:
            stage["queue"] = {"kind": "tail_drop", "max_packets": max(1, round(n_waiting))}
    stage["cross"] = {
        "kind": "on_off",
        "kbit_s": _rounded(cross_kbit_s),
        "message_bytes": cross_bytes,
        "mean_on_s": _rounded(on_s),
        "mean_off_s": _rounded(max(cycle_s - on_s, interval_s)),
    }
    return stage
