"""Trace rows that a run played: a run shorter than its trace is compared with these, not with the whole trace."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network.delay import TraceDelay
from tis.common.scenario.network.loss import TraceLoss
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import Ints
from tis.deploy.report.measures.network.requested_pipeline import RequestedPipeline, requested_pipeline
from tis.netem.draws.grid import row_of_cell, row_of_packet
from tis.netem.stages.delay import latency_of
from tis.netem.stages.delay.trace import row_delays_ns

Floats = NDArray[np.float64]

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
