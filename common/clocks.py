"""Comparison of two clocks: exchanges of timestamps, and the offset and drift of one clock over the other.

Before a run the exchange with the smallest bound gives the offset (`read_clock`). Over a run a line is fitted to the
offsets of the shortest exchanges, each weighted by the inverse square of its bound (`fit_clock`). Its uncertainty
does not come from the residuals, which do not show an asymmetric path, but from the bound of each exchange: at its
instant the true offset lies within half the round trip of the measured one. Between exchanges the offset may leave
the line at `WANDER_PPM` plus the uncertainty of the drift. At each instant the tightest of all these limits holds.
Exchanges that contradict each other at this rate (a clock that is being slewed) raise the rate until they do not.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.units import NS_PER_S

Ints = NDArray[np.int64]
Stamps = tuple[int, int, int, int]


@dataclass(frozen=True)
class Exchanges:
    """N exchanges, columns (N,) in ns; T1 to T4 of RFC 5905, section 8.

    ``asked_ns`` (query sent) and ``answered_ns`` (reply received) are this host's stamps, ``received_ns`` and
    ``replied_ns`` the reference's. The offset of the reference is at most ``received - asked`` at T1 and at least
    ``replied - answered`` at T4, however the round trip divides into its two ways.
    """

    asked_ns: Ints
    received_ns: Ints
    replied_ns: Ints
    answered_ns: Ints

    @classmethod
    def of(cls, stamps: Iterable[Stamps]) -> Self:
        """Return the exchanges of stamps given one by one, by ascending T1, without impossible ones.

        Impossible: T3 before T2, or T3 - T2 longer than T4 - T1.
        """
        asked_ns, received_ns, replied_ns, answered_ns = np.array(list(stamps), dtype=np.int64).reshape(-1, 4).T
        made_ns = replied_ns - received_ns  # processing time of the reference, part of T4 - T1
        kept = np.flatnonzero((made_ns >= 0) & (answered_ns - asked_ns >= made_ns))
        kept = kept[np.argsort(asked_ns[kept], kind="stable")]
        return cls(asked_ns[kept], received_ns[kept], replied_ns[kept], answered_ns[kept])

    def __len__(self) -> int:
        """Return N."""
        return len(self.asked_ns)

    @property
    def offset_ns(self) -> Ints:
        """Return the offset of the reference over this host, (N,): RFC 5905's theta, rounded down."""
        found: Ints = (self.received_ns - self.asked_ns + self.replied_ns - self.answered_ns) // 2
        return found

    @property
    def round_trip_ns(self) -> Ints:
        """Return the round-trip time without the reference's processing, (N,): RFC 5905's delta."""
        return (self.answered_ns - self.asked_ns) - (self.replied_ns - self.received_ns)

    @property
    def bound_ns(self) -> Ints:
        """Return the bound on the error of `offset_ns`, (N,): half the round trip, rounded up.

        It is reached when one way took all the time. Oracle: random asymmetric paths, test_exchange.
        """
        found: Ints = -(-self.round_trip_ns // 2)
        return found

    def at(self, which: Ints) -> "Exchanges":
        """Return the exchanges with the indices ``which``."""
        return Exchanges(
            self.asked_ns[which], self.received_ns[which], self.replied_ns[which], self.answered_ns[which]
        )


def shortest(exchanges: Exchanges, window_ns: int) -> Exchanges:
    """Return the exchange with the smallest round trip of each window of ``window_ns``, the earlier of equals.

    Queueing only adds to a round trip, so the shortest has the smallest bound (the clock filter of RFC 5905, section
    10, over eight exchanges). Oracle: a dictionary of windows in the tests.
    """
    if not len(exchanges):
        return exchanges
    window = (exchanges.asked_ns - exchanges.asked_ns[0]) // window_ns
    # Sorted by window, then by round trip (stable), so the first of each window is its shortest.
    order = np.lexsort((exchanges.round_trip_ns, window))
    _, first = np.unique(window[order], return_index=True)
    return exchanges.at(order[first])


UNKNOWN_DRIFT_PPM: Final = 100.0
"""Assumed bound on the drift between two hosts: crystals are within some 50 ppm, one fast and one slow."""


class ClockReading(NamedTuple):
    """Offset of the reference over this host, and the bound on its error."""

    offset_ns: int
    bound_ns: int


def read_clock(exchanges: Exchanges, now_ns: int) -> ClockReading:
    """Return the offset at ``now_ns`` of the exchange with the smallest bound; bounds grow with age.

    Raises `ValueError` without an exchange. Oracle: a short old one against a long new one, tests/common/clocks.
    """
    if not len(exchanges):
        raise ValueError("a clock that was never compared with the reference has no offset")
    # Integer arithmetic, rounded up: ppm * 1000 is ppb.
    age_ns = now_ns - exchanges.answered_ns
    bound_ns = exchanges.bound_ns + -(-age_ns * round(UNKNOWN_DRIFT_PPM * 1000) // 10**9)
    best = int(bound_ns.argmin())
    return ClockReading(int(exchanges.offset_ns[best]), int(bound_ns[best]))


Floats = NDArray[np.float64]

PPM: Final = 1e-6


@dataclass(frozen=True)
class Envelope:
    """Upper limit of a function whose rate of change is at most ``rate``, given at knots.

    ``at_ns`` (M,) ascending, ``limit_ns`` (M,).
    """

    at_ns: Ints
    limit_ns: Floats
    rate: float

    @classmethod
    def tightest(cls, at_ns: Ints, limit_ns: Floats, rate: float) -> Self:
        """Return the tightest envelope: each knot is also bounded by any other's limit plus rate * distance.

        Two passes, as in a distance transform (oracle: the minimum over all pairs, tests/common/clocks/test_model).
        """
        away = rate * (at_ns - at_ns[0])
        from_before = np.minimum.accumulate(limit_ns - away) + away
        from_after = np.minimum.accumulate((limit_ns + away)[::-1])[::-1] - away
        return cls(at_ns, np.minimum(from_before, from_after), rate)

    def limit_at(self, ns: Ints) -> Floats:
        """Return the limit at instants (N,), extrapolated beyond the first and the last knot."""
        after = np.searchsorted(self.at_ns, ns)
        left, right = np.maximum(after - 1, 0), np.minimum(after, len(self.at_ns) - 1)
        by_knot = [self.limit_ns[knot] + self.rate * np.abs(ns - self.at_ns[knot]) for knot in (left, right)]
        limit: Floats = np.minimum(*by_knot)
        return limit


@dataclass(frozen=True)
class ClockModel:
    """Offset of the reference over a host's clock: ``offset_ns`` at ``at_ns``, with a constant ``drift``.

    ``drift`` is the reference's gain per ns of this host. ``above`` and ``below`` limit the distance of the true
    offset from that line. Without limits the clock is shared: it is the reference itself.
    """

    at_ns: int = 0
    offset_ns: float = 0.0
    drift: float = 0.0
    drift_bound: float = 0.0
    above: Envelope | None = None
    below: Envelope | None = None

    @property
    def shared(self) -> bool:
        """Tell whether this is the reference clock itself."""
        return self.above is None

    def offset_at(self, own_ns: Ints) -> Floats:
        """Return the offset of the reference at instants (N,) of this host, in ns."""
        since_ns = (np.asarray(own_ns, dtype=np.int64) - self.at_ns).astype(np.float64)
        return self.offset_ns + self.drift * since_ns

    def to_reference_ns(self, own_ns: Ints) -> Ints:
        """Return instants (N,) of this host on the reference's clock, to the nearest ns; unchanged if shared.

        Oracle: a clock with a known offset and drift (tests/common/clocks/test_fit).
        """
        own_ns = np.asarray(own_ns, dtype=np.int64)
        return own_ns if self.shared else own_ns + np.rint(self.offset_at(own_ns)).astype(np.int64)

    def uncertainty_ns(self, own_ns: Ints) -> Ints:
        """Return the bound on the error of `to_reference_ns` at instants (N,), in ns; 0 for a shared clock.

        A strict bound, not a standard deviation: see `tis.common.clocks`.
        """
        own_ns = np.asarray(own_ns, dtype=np.int64)
        if self.above is None or self.below is None:
            return np.zeros_like(own_ns)
        either = np.maximum(self.above.limit_at(own_ns), self.below.limit_at(own_ns))
        return np.ceil(np.maximum(either, 0)).astype(np.int64) + 1  # one for the rounding to whole ns

    def from_reference_ns(self, reference_ns: Ints) -> Ints:
        """Return the readings of this host's clock at instants (N,) of the reference's, to the nearest ns."""
        reference_ns = np.asarray(reference_ns, dtype=np.int64)
        if self.shared:
            return reference_ns
        since_ns = (reference_ns - self.at_ns).astype(np.float64) - self.offset_ns
        return self.at_ns + np.rint(since_ns / (1 + self.drift)).astype(np.int64)

    def uncertainty_at_ns(self, reference_ns: Ints) -> Ints:
        """Return `uncertainty_ns` at instants (N,) of the reference's clock."""
        return self.uncertainty_ns(self.from_reference_ns(reference_ns))


SHARED: Final = ClockModel()
"""The model of the reference clock itself."""


WANDER_PPM: Final = 15.0
"""Maximum change of a clock's rate: PHI, the frequency tolerance of RFC 5905, section 4."""

_WINDOW_NS: Final = NS_PER_S
_MAX_WINDOWS: Final = 2000
_MAX_DRIFT: Final = 1e-3  # twice the kernel's slew rate (adjtime): a steeper line is a step of the clock
_MAX_RATE: Final = 1e6


def fit_clock(exchanges: Exchanges) -> ClockModel:
    """Return the model of this host's clock; raises `ValueError` without an exchange.

    The shortest exchange of each window counts. A drift that is uncertain by more than `UNKNOWN_DRIFT_PPM`, or
    impossible for a clock, is replaced by 0 with that bound. Oracle: clocks with a known offset, drift and wander
    behind random paths (tests/common/clocks/test_fit).
    """
    if not len(exchanges):
        raise ValueError("a clock that was never compared with the reference has no model")
    span_ns = int(exchanges.asked_ns[-1] - exchanges.asked_ns[0])
    best = shortest(exchanges, max(_WINDOW_NS, span_ns // _MAX_WINDOWS))
    # The line, and how far its drift can be wrong.
    at_ns, offset_ns, drift = _line(best)
    model = ClockModel(at_ns, offset_ns, drift)
    drift_bound = _drift_bound(best, model)
    if drift_bound > UNKNOWN_DRIFT_PPM * PPM or abs(drift) > _MAX_DRIFT:
        drift_bound = UNKNOWN_DRIFT_PPM * PPM
        model = ClockModel(at_ns, offset_ns)
    # The limits about the line, widened until an offset exists that satisfies all of them.
    rate = WANDER_PPM * PPM + drift_bound
    above, below = _envelopes(best, model, rate)
    while _contradictory(above, below) and rate < _MAX_RATE:
        rate *= 2
        above, below = _envelopes(best, model, rate)
    return ClockModel(model.at_ns, model.offset_ns, model.drift, drift_bound, above, below)


def _line(exchanges: Exchanges) -> tuple[int, float, float]:
    """Return an instant, the offset there, and the drift: weighted least squares."""
    # Relative to the first exchange, since floats do not hold ns of a monotonic clock exactly.
    first_ns, origin_ns = int(exchanges.asked_ns[0]), int(exchanges.offset_ns[0])
    weight = 1.0 / np.maximum(exchanges.bound_ns, 1).astype(np.float64) ** 2
    weight /= weight.sum()
    t_ns = (exchanges.asked_ns - first_ns) + (exchanges.answered_ns - exchanges.asked_ns) / 2
    above_ns = (exchanges.offset_ns - origin_ns).astype(np.float64)
    mean_ns = round(float(weight @ t_ns))
    centred_ns = t_ns - mean_ns
    spread = float(weight @ centred_ns**2)
    drift = float(weight @ (centred_ns * above_ns)) / spread if spread > 0 else 0.0
    level_ns = float(weight @ above_ns) - drift * float(weight @ centred_ns)
    return first_ns + mean_ns, origin_ns + level_ns, drift


def _limits(exchanges: Exchanges, model: ClockModel) -> tuple[Floats, Floats]:
    """Return the limits of the offset above the line at T1 and below it at T4, residual included."""
    above_ns = exchanges.received_ns - exchanges.asked_ns - model.offset_at(exchanges.asked_ns)
    below_ns = exchanges.answered_ns - exchanges.replied_ns + model.offset_at(exchanges.answered_ns)
    return above_ns, below_ns


def _drift_bound(exchanges: Exchanges, model: ClockModel) -> float:
    """Return the bound on the error of the line's drift: the tightest that an early and a late exchange imply."""
    middle = len(exchanges) // 2
    if middle == 0:
        return float("inf")
    # A later upper limit and an earlier lower limit bound the slope from above, and conversely.
    above_ns, below_ns = _limits(exchanges, model)
    asked_ns, answered_ns = exchanges.asked_ns, exchanges.answered_ns
    open_ns = above_ns[middle:, None] + below_ns[None, :middle]
    apart_ns = asked_ns[middle:, None] - answered_ns[None, :middle]
    steeper = _min_slope(open_ns, apart_ns)
    open_ns = below_ns[middle:, None] + above_ns[None, :middle]
    apart_ns = answered_ns[middle:, None] - asked_ns[None, :middle]
    flatter = _min_slope(open_ns, apart_ns)
    return max(steeper, flatter, 0.0)


def _min_slope(open_ns: Floats, apart_ns: Ints) -> float:
    usable = apart_ns > 0
    return float((open_ns[usable] / apart_ns[usable]).min(initial=np.inf))


def _envelopes(exchanges: Exchanges, model: ClockModel, rate: float) -> tuple[Envelope, Envelope]:
    above_ns, below_ns = _limits(exchanges, model)
    order = np.argsort(exchanges.answered_ns, kind="stable")
    return (
        Envelope.tightest(exchanges.asked_ns, above_ns, rate),
        Envelope.tightest(exchanges.answered_ns[order], below_ns[order], rate),
    )


def _contradictory(above: Envelope, below: Envelope) -> bool:
    """Tell whether the upper limit lies below the lower one somewhere."""
    knots_ns = np.concatenate([above.at_ns, below.at_ns])
    return bool((above.limit_at(knots_ns) + below.limit_at(knots_ns) < 0).any())
