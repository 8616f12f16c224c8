"""Requested delay and loss of a pipeline, in closed form where there is one; of a trace, its played rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.fidelity import batch_inflation, gilbert_inflation
from tis.common.metrics.percentiles import TAIL, Summary
from tis.common.scenario.network.delay import TraceDelay
from tis.common.scenario.network.loss import BernoulliLoss, BurstLoss, TraceLoss
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import Address, Stream
from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.columns import Ints
from tis.netem.draws.grid import row_of_cell, row_of_packet
from tis.netem.stages.delay import LatencyModel, latency_of
from tis.netem.stages.delay.trace import row_delays_ns
from tis.netem.stages.loss import ExpectedLoss, expected_loss, loss_blocks

Floats = NDArray[np.float64]

_N_DRAWS: Final = 40_000
_N_BLOCKS: Final = 64
_SHARES: Final = (0.1, 0.5, 0.9)


@dataclass(frozen=True)
class RequestedPipeline:
    """One pipeline under one condition: the moments of its delay before queue and ordering, its probabilities.

    ``skewness`` and the effect of ``reorder.early_ms`` are estimated from draws; all else is exact.
    """

    pipeline: Pipeline
    traces: Mapping[str, Trace]
    mean_ns: float
    std_ns: float
    skewness: float

    @property
    def half_life_s(self) -> float | None:
        """Return the half-life of the delay's correlation; None for independent delays."""
        return None if self.pipeline.correlation is None else self.pipeline.correlation.half_life_s

    @property
    def is_recorded(self) -> bool:
        """Tell whether delay or loss comes from a trace."""
        return isinstance(self.pipeline.delay, TraceDelay) or isinstance(self.pipeline.loss, TraceLoss)

    @property
    def p_duplicate(self) -> float:
        """Return the probability that a message is duplicated."""
        return self.pipeline.duplicate.p_duplicate if self.pipeline.duplicate else 0.0

    @property
    def p_corrupt(self) -> float:
        """Return the probability that bits of a message are flipped."""
        return self.pipeline.corrupt.p_corrupt if self.pipeline.corrupt else 0.0

    def loss(self, n_packets: int = 1) -> ExpectedLoss:
        """Return the loss of messages that span ``n_packets`` MTU-sized packets."""
        return expected_loss(self.pipeline.loss, self.traces, n_packets)

    def loss_inflation(self) -> float:
        """Return the factor by which bursts inflate the variance of the loss share.

        Closed form for independent losses and Gilbert's model, from draws for other models, 1 for a trace, which is
        deterministic.
        """
        part, (p_loss, mean_burst) = self.pipeline.loss, self.loss()
        if isinstance(part, TraceLoss):
            return 1.0
        if isinstance(part, BernoulliLoss | BurstLoss | None):
            return gilbert_inflation(p_loss, mean_burst)
        # a fixed address: the same draws, hence the same figures, for every run
        address = Address(0, "forward", "report")
        blocks, uniforms = loss_blocks(part, address, self.traces), address.stream("loss")
        p = np.concatenate([blocks.block(number) for number in range(_N_BLOCKS)])
        lost = (uniforms.uniforms(0, len(p)) < p).astype(np.float64)
        return batch_inflation(lost - p_loss, p_loss * (1.0 - p_loss))

    def steps_ns(self) -> list[tuple[float, float]]:
        """Return points (delay, share at or below it) of the distribution function at which shares can be tested.

        Empty for a delay without spread, for a trace (each row is requested exactly), and with ``reorder``.
        """
        recorded = isinstance(self.pipeline.delay, TraceDelay)
        if self.std_ns == 0.0 or recorded or self.pipeline.reorder is not None:
            return []
        latency = latency_of(self.pipeline, self.traces)
        delays_ns = latency.quantiles_ns(_SHARES)
        if latency.jitter is not None and latency.jitter.reach_ns > 0.0:
            return list(zip(delays_ns, _SHARES, strict=True))
        # a distribution with steps may hold more than the requested share at its quantile
        return list(zip(delays_ns, latency.delay.cdf(np.array(delays_ns)).tolist(), strict=True))

    def n_packets(self, n_bytes: Ints) -> Ints:
        """Return how many packets (N,) of the loss model's MTU messages of ``n_bytes`` (N,) are cut into."""
        mtu_bytes = None if isinstance(self.pipeline.loss, TraceLoss | None) else self.pipeline.loss.mtu_bytes
        return np.ones_like(n_bytes) if mtu_bytes is None else np.maximum(1, -(-n_bytes // mtu_bytes))

    def delay_ms(self) -> Summary:
        """Return the requested delay under the names of measured delays; None where there is no closed form.

        Oracle: long simulations, tests/deploy/report/subjects/network/test_requested_pipeline.
        """
        quantiles = {
            f"p{p:g}": value for p, value in zip(TAIL, self.quantiles_ms([p / 100 for p in TAIL]), strict=True)
        }
        return {"mean": self.mean_ns / NS_PER_MS, "std": self.std_ns / NS_PER_MS, **quantiles, "max": None}

    def quantiles_ms(self, shares: Sequence[float]) -> list[float | None]:
        """Return the quantiles of the delay at ``shares``, each in (0, 1)."""
        reorder = self.pipeline.reorder
        p_early = reorder.p_reorder if reorder else 0.0
        if reorder is not None and reorder.early_ms is not None and p_early > 0.0:
            return [None] * len(shares)
        # reordered messages skip the delay: they are the lowest p_early of the distribution
        rest = [(share - p_early) / (1.0 - p_early) if share > p_early else None for share in shares]
        found = iter(
            latency_of(self.pipeline, self.traces).quantiles_ns([share for share in rest if share is not None])
        )
        return [0.0 if share is None else next(found) / NS_PER_MS for share in rest]


def requested_pipeline(pipeline: Pipeline, traces: Mapping[str, Trace]) -> RequestedPipeline | None:
    """Return the request of a pipeline; None when it names a trace that is not in ``traces``."""
    named = [part.path for part in (pipeline.delay, pipeline.loss) if isinstance(part, TraceDelay | TraceLoss)]
    if any(path not in traces for path in named):
        return None
    latency = latency_of(pipeline, traces)
    mean_ns, std_ns = latency.mean_ns, latency.std_ns
    reorder = pipeline.reorder
    if std_ns == 0.0 and reorder is None:
        return RequestedPipeline(pipeline, traces, mean_ns, std_ns, 0.0)
    drawn_ns = _draws(latency)
    # mixture of the law and of the early messages: second moments add by their shares
    if reorder is not None:
        p_early, early_ns = reorder.p_reorder, reorder.early_ms
        early = np.zeros_like(drawn_ns) if early_ns is None else np.maximum(drawn_ns - early_ns * NS_PER_MS, 0.0)
        square = (1 - p_early) * (std_ns**2 + mean_ns**2) + p_early * float((early**2).mean())
        mean_ns = (1 - p_early) * mean_ns + p_early * float(early.mean())
        std_ns = float(np.sqrt(max(square - mean_ns**2, 0.0)))
        drawn_ns = np.concatenate([drawn_ns[int(p_early * len(drawn_ns)) :], early[: int(p_early * len(drawn_ns))]])
    spread_ns = float(drawn_ns.std())
    skewness = float(((drawn_ns - drawn_ns.mean()) ** 3).mean()) / spread_ns**3 if spread_ns > 0.0 else 0.0
    return RequestedPipeline(pipeline, traces, mean_ns, std_ns, skewness)


def _draws(latency: LatencyModel) -> np.ndarray:
    return latency.sample(*_uniforms()).astype(np.float64)


@cache
def _uniforms() -> tuple[Floats, Floats]:
    """Return the uniforms of the draws, the same for every run: drawn once."""
    u, v = (Stream.named(0, f"report/{what}").uniforms(0, _N_DRAWS) for what in ("delay", "jitter"))
    for one in (u, v):
        one.flags.writeable = False
    return u, v


_BY_ROW: Final = "packet"


def delay_moments_ns(request: RequestedPipeline, seq: Ints, offered_ns: Ints) -> tuple[Floats, Floats]:
    """Return mean and standard deviation of the requested delay of each of N packets, (N,) each, in ns.

    A trace requests the delay of its row exactly, plus jitter if any. Oracle: `tis.netem.expected.simulate`,
    test_trace_playback.
    """
    part, n = request.pipeline.delay, len(seq)
    if not isinstance(part, TraceDelay):
        return np.full(n, request.mean_ns), np.full(n, request.std_ns)
    trace = request.traces[part.path]
    mean_ns = row_delays_ns(trace)[_rows(part, trace, seq, offered_ns)]
    variance = np.zeros(n)
    jitter = latency_of(request.pipeline, request.traces).jitter
    if jitter is not None and n:
        # jitter cannot make a delay negative, so its mean and variance depend on the row's delay
        deviation_ns, variance = jitter.moments_ns(mean_ns)
        mean_ns = mean_ns + deviation_ns
    reorder = request.pipeline.reorder
    if reorder is not None:
        p, early_ns = reorder.p_reorder, reorder.early_ms
        early = np.zeros(n) if early_ns is None else np.maximum(mean_ns - early_ns * NS_PER_MS, 0.0)
        # mixture of ordinary and early packets: law of total variance
        late_ns, mean_ns = mean_ns, (1 - p) * mean_ns + p * early
        variance = variance + p * (1 - p) * (late_ns - early) ** 2
    return mean_ns, np.sqrt(variance)


def p_loss(request: RequestedPipeline, seq: Ints, offered_ns: Ints, n_packets: Ints) -> Floats:
    """Return the probability (N,) that the models lose each of N messages; 0 or 1 for the loss of a trace.

    ``n_packets`` (N,) is the number of MTU-sized packets that each message was cut into.
    """
    part = request.pipeline.loss
    if isinstance(part, TraceLoss):
        trace = request.traces[part.path]
        return np.asarray((trace.delay_ns == LOST)[_rows(part, trace, seq, offered_ns)], dtype=np.float64)
    # few sizes occur: one evaluation of the model for each
    sizes, place = np.unique(n_packets, return_inverse=True)
    return np.array([request.loss(int(size)).p_loss for size in sizes], dtype=np.float64)[place]


def with_played_rows(request: RequestedPipeline, seq: Ints, offered_ns: Ints) -> RequestedPipeline:
    """Return the request with its traces reduced to the rows that N packets took.

    Without a trace, or without packets, the request is returned as it is.
    """
    delay, loss = request.pipeline.delay, request.pipeline.loss
    if not request.is_recorded or not len(seq):
        return request
    changes: dict[str, object] = {}
    traces: dict[str, Trace] = {}
    for stage, part in (("delay", delay), ("loss", loss)):
        if not isinstance(part, TraceDelay | TraceLoss):
            continue
        trace = request.traces[part.path]
        # when loss comes from another model, a lost row still supplies a delay
        fills = stage == "delay" and not _is_same(request.pipeline)
        delay_ns = row_delays_ns(trace).astype(np.int64) if fills else trace.delay_ns
        name = f"{part.path} by {part.advance}" + (", filled" if fills else "")
        rows = _rows(part, trace, seq, offered_ns)
        traces[name] = Trace(trace.label, np.arange(len(rows)), delay_ns[rows], trace.about)
        changes[stage] = part.model_copy(update={"path": name, "advance": _BY_ROW})
    return requested_pipeline(request.pipeline.model_copy(update=changes), traces) or request


def _is_same(pipeline: Pipeline) -> bool:
    """Tell whether loss and delay come from one trace, so that its lost rows carry no packet."""
    delay, loss = pipeline.delay, pipeline.loss
    if not isinstance(delay, TraceDelay) or not isinstance(loss, TraceLoss):
        return False
    return (delay.path, delay.advance) == (loss.path, loss.advance)


def _rows(part: TraceDelay | TraceLoss, trace: Trace, seq: Ints, offered_ns: Ints) -> Ints:
    if part.advance == _BY_ROW:
        return row_of_packet(len(trace.sent_ns), seq)
    return row_of_cell(trace, offered_ns // NS_PER_MS)
