"""One direction of a network from its record: the stages of a pipeline, and how sure they are."""

from math import log
from typing import Any, Final, NamedTuple

import numpy as np

from common.metrics.gilbert_fit import GilbertFit, fit_gilbert
from common.trace import Trace
from common.units import NS_PER_S
from netem.fit.half_life import HalfLife, fit_half_life
from netem.fit.marginal import Marginal, MarginalName, fit_marginal

_OVERTAKEN: Final = 1e-3
_LEAST_RECEIVED: Final = 2


class DirectionFit(NamedTuple):
    """``stages`` are a pipeline as a scenario has it; ``overtaken`` is the share of messages that were."""

    stages: dict[str, Any]
    n: int
    n_lost: int
    duration_s: float
    marginal: Marginal
    half_life: HalfLife
    losses: GilbertFit
    overtaken: float


def fit_direction(trace: Trace, wanted: MarginalName | None = None) -> DirectionFit:
    """Fit delay, correlation, loss and ordering; raises ValueError where the record is too short for it.

    Losses are independent unless the confidence interval of the mean run excludes that; then they are Gilbert's.
    Messages overtake each other in the fit when more than one in a thousand did. Oracle: what known models did,
    fitted, simulated and measured again, tests/deploy/net/test_round_trip.
    """
    lost = trace.delay_ns < 0
    received = ~lost
    n_received = int(received.sum())
    if n_received < _LEAST_RECEIVED:
        raise ValueError(f"must have at least {_LEAST_RECEIVED} messages that arrived, has {n_received}")
    sent_ns, delay_ns = trace.sent_ns[received], trace.delay_ns[received]
    duration_s = float(trace.sent_ns[-1] - trace.sent_ns[0]) / NS_PER_S
    half_life = fit_half_life(sent_ns, delay_ns)
    marginal = fit_marginal(delay_ns, _n_independent(n_received, duration_s, half_life), wanted)
    losses = fit_gilbert(lost)
    arrived_ns = sent_ns + delay_ns
    overtaken = float(np.mean(arrived_ns < np.maximum.accumulate(arrived_ns)))
    stages: dict[str, Any] = {}
    if (loss := _loss_stage(losses)) is not None:
        stages["loss"] = loss
    stages["delay"] = marginal.stage
    if half_life.seconds is not None and marginal.chosen != "constant":
        stages["correlation"] = {"half_life_s": float(f"{half_life.seconds:.4g}")}
    if overtaken > _OVERTAKEN:
        stages["ordering"] = "reorder"
    return DirectionFit(stages, len(lost), int(lost.sum()), duration_s, marginal, half_life, losses, overtaken)


def _n_independent(n: int, duration_s: float, half_life: HalfLife) -> float:
    """Return as how many independent delays the record counts for its mean: its length over twice the mean memory."""
    if half_life.seconds is None:
        return n
    return min(float(n), duration_s * log(2) / (2 * half_life.seconds))


def _loss_stage(losses: GilbertFit) -> dict[str, Any] | None:
    p = losses.p_loss
    if p == 0:
        return None
    rounded = float(f"{p:.4g}")
    burst, interval = losses.mean_burst, losses.mean_burst_interval
    if burst is None or interval is None or interval[0] <= 1 / (1 - p) <= interval[1]:
        return {"kind": "bernoulli", "p_loss": rounded}
    return {"kind": "burst", "p_loss": rounded, "mean_burst": float(f"{max(burst, 1.0):.4g}")}
