"""Figures of a recorded path: delay, delay variation, loss and bursts, as the standards define them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.delay_variation import (
    inter_packet_delay_variation_ns,
    packet_delay_variation_ns,
    rtp_jitter_ns,
)
from tis.common.metrics.loss import GilbertFit, fit_gilbert, loss_runs
from tis.common.metrics.percentiles import TAIL, Summary, summarise
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.fit.direction import steady_reason
from tis.netem.fit.half_life import HalfLife, fit_half_life
from tis.netem.fit.record import measuring_adds

Nanoseconds = NDArray[np.int64]


class Variation(NamedTuple):
    """Delay variation in ms of the messages that arrived; None for too few.

    ``pdv_p99``: p99 less the minimum (RFC 5481); ``ipdv_p50`` and ``ipdv_p99`` of the absolute difference of
    neighbours that both arrived (RFC 3393); ``rtp_jitter``: the smoothed jitter of RFC 3550 at the record's end.
    """

    pdv_p99: float | None
    ipdv_p50: float | None
    ipdv_p99: float | None
    rtp_jitter: float | None


class PathFigures(NamedTuple):
    """Figures of a record: ``delay_ms`` has mean, std, p50 .. p99.9, max."""

    n: int
    n_lost: int
    delay_ms: Summary
    variation: Variation
    losses: GilbertFit
    n_runs: int
    longest_run: int
    half_life: HalfLife
    n_overtaken: int


def path_figures(trace: Trace) -> PathFigures:
    """Compute the figures of a record (oracle: by hand, tests/deploy/net/probing/test_delay_figures)."""
    lost = trace.delay_ns < 0
    sent_ns, delay_ns = trace.sent_ns[~lost], trace.delay_ns[~lost]
    arrived_ns = sent_ns + delay_ns
    runs = loss_runs(lost)
    steady = steady_reason(delay_ns, measuring_adds(trace)) if len(delay_ns) else ""
    return PathFigures(
        n=len(lost),
        n_lost=int(lost.sum()),
        delay_ms=summarise(delay_ns / NS_PER_MS, TAIL, ("mean", "std", "max")),
        variation=_variation(trace.sent_ns, trace.delay_ns, ~lost),
        losses=fit_gilbert(lost),
        n_runs=runs.n_runs,
        longest_run=runs.longest,
        half_life=HalfLife(None, None, None, steady) if steady else fit_half_life(sent_ns, delay_ns),
        n_overtaken=int(np.count_nonzero(arrived_ns < np.maximum.accumulate(arrived_ns))),
    )


def as_json(figures: PathFigures) -> dict[str, Any]:
    """Return the figures as plain values."""
    return {
        **figures._asdict(),
        "variation": figures.variation._asdict(),
        "losses": figures.losses._asdict(),
        "half_life": figures.half_life._asdict(),
    }


def _variation(sent_ns: Nanoseconds, delay_ns: Nanoseconds, arrived: NDArray[np.bool_]) -> Variation:
    sent_in_ns, came_in_ns = sent_ns[arrived], (sent_ns + delay_ns)[arrived]
    order = np.argsort(came_in_ns, kind="stable")
    jitter_ns = rtp_jitter_ns(sent_in_ns[order], came_in_ns[order])
    spread = summarise(packet_delay_variation_ns(delay_ns[arrived]) / NS_PER_MS, (99,), ())
    steps = summarise(np.abs(inter_packet_delay_variation_ns(delay_ns, arrived)) / NS_PER_MS, (50, 99), ())
    jitter = float(jitter_ns[-1]) / NS_PER_MS if len(jitter_ns) else None
    return Variation(spread["p99"], steps["p50"], steps["p99"], jitter)
