"""A clock's offset and drift over a run, fitted to its exchanges with the reference, with a bound on the error.

The line is the least-squares fit to the offsets of the shortest exchanges, each weighted by the inverse square of
its bound. Its uncertainty does not come from the residuals, which do not show an asymmetric path, but from the bound
of each exchange: at its instant the true offset lies within half the round trip of the measured one. Between
exchanges the offset may leave the line at `WANDER_PPM` plus the uncertainty of the drift. At each instant the
tightest of all these limits holds. Exchanges that contradict each other at this rate (a clock that is being slewed)
raise the rate until they do not.
"""

from typing import Final

import numpy as np

from tis.common.clocks.exchange import Exchanges, Ints, shortest
from tis.common.clocks.model import PPM, ClockModel, Envelope, Floats
from tis.common.clocks.offset import UNKNOWN_DRIFT_PPM
from tis.common.units import NS_PER_S

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
