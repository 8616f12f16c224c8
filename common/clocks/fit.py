"""A clock's offset and drift over a run, fitted to its exchanges with the reference, with a bound on the error.

The line is the least-squares fit to the offsets of the shortest exchanges, each weighted by the inverse square of
its bound. Its uncertainty does not come from the fit's deviations, which know nothing of an asymmetric path, but from
what each exchange proves: at its instant the true offset lies within half the round trip of the measured one, so
within half the round trip plus the residual of the line. Between exchanges the offset may leave the line by the
greatest rate at which it can do so, `WANDER_PPM` plus what the exchanges leave open about the drift itself. At each
instant the tightest of all these limits holds. Exchanges that contradict each other at that rate (a clock that is
being slewed) raise it until they do not.
"""

from typing import Final

import numpy as np

from common.clocks.exchange import Exchanges, Ints, shortest
from common.clocks.model import PPM, ClockModel, Envelope, Floats
from common.clocks.reading import UNKNOWN_DRIFT_PPM
from common.units import NS_PER_S

WANDER_PPM: Final = 15.0
"""How much a clock's rate may change: PHI, the frequency tolerance of RFC 5905, section 4."""

_WINDOW_NS: Final = NS_PER_S
_MOST_WINDOWS: Final = 2000
_STEEPEST: Final = 1e-3  # twice what the kernel can slew by (adjtime): no rate, but a clock that stepped
_FASTEST: Final = 1e6


def fit_clock(exchanges: Exchanges) -> ClockModel:
    """Return the model of the clock that asked; raises `ValueError` without an exchange.

    The shortest exchange of each window counts. A drift that is not known to `UNKNOWN_DRIFT_PPM`, or that no clock
    has, is not used: it counts as 0, give or take that much. Oracle: clocks with a known offset, drift and wander
    behind random paths (tests/common/clocks/test_fit).
    """
    if not len(exchanges):
        raise ValueError("a clock that was never compared with the reference has no model")
    span_ns = int(exchanges.asked_ns[-1] - exchanges.asked_ns[0])
    best = shortest(exchanges, max(_WINDOW_NS, span_ns // _MOST_WINDOWS))
    at_ns, offset_ns, drift = _line(best)
    model = ClockModel(at_ns, offset_ns, drift)
    drift_bound = _drift_bound(best, model)
    if drift_bound > UNKNOWN_DRIFT_PPM * PPM or abs(drift) > _STEEPEST:
        drift_bound = UNKNOWN_DRIFT_PPM * PPM
        model = ClockModel(at_ns, offset_ns)
    rate = WANDER_PPM * PPM + drift_bound
    above, below = _envelopes(best, model, rate)
    while _contradictory(above, below) and rate < _FASTEST:
        rate *= 2
        above, below = _envelopes(best, model, rate)
    return ClockModel(model.at_ns, model.offset_ns, model.drift, drift_bound, above, below)


def _line(exchanges: Exchanges) -> tuple[int, float, float]:
    """Return an instant, the offset there, and the drift: least squares, weighted."""
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
    """Return how far the offset can be above the line when asked and below it when answered, residual included."""
    above_ns = exchanges.received_ns - exchanges.asked_ns - model.offset_at(exchanges.asked_ns)
    below_ns = exchanges.answered_ns - exchanges.replied_ns + model.offset_at(exchanges.answered_ns)
    return above_ns, below_ns


def _drift_bound(exchanges: Exchanges, model: ClockModel) -> float:
    """Return how far the drift can be off the line's: what an early and a late exchange together leave open."""
    middle = len(exchanges) // 2
    if middle == 0:
        return float("inf")
    above_ns, below_ns = _limits(exchanges, model)
    asked_ns, answered_ns = exchanges.asked_ns, exchanges.answered_ns
    open_ns = above_ns[middle:, None] + below_ns[None, :middle]
    apart_ns = asked_ns[middle:, None] - answered_ns[None, :middle]
    steeper = _least(open_ns, apart_ns)
    open_ns = below_ns[middle:, None] + above_ns[None, :middle]
    apart_ns = answered_ns[middle:, None] - asked_ns[None, :middle]
    flatter = _least(open_ns, apart_ns)
    return max(steeper, flatter, 0.0)


def _least(open_ns: Floats, apart_ns: Ints) -> float:
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
    """Tell whether the offset would have to be above its upper limit somewhere."""
    knots_ns = np.concatenate([above.at_ns, below.at_ns])
    return bool((above.limit_at(knots_ns) + below.limit_at(knots_ns) < 0).any())
