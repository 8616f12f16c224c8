"""Conditions and queues of a link over the run."""

from typing import Any

import numpy as np

from tis.common.channels import Direction
from tis.common.metrics.percentiles import queue_depth
from tis.common.records import CONTROL, QUEUES
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.measures.network.requested import Requested


def queue_summary(logs: RunLogs, direction: Direction) -> dict[str, Any]:
    """Return the depth of the rate queues over time; None where nothing queued."""
    notes = sorted(
        (row["at_ns"], row["n_packets"], row["n_bytes"])
        for row in logs.of("netem", QUEUES)
        if row["direction"] == direction
    )
    at_ns, n_packets, n_bytes = np.array(notes, dtype=np.int64).reshape(-1, 3).T
    until_ns = max(int(at_ns[-1]), logs.sides["netem"].last_ns) if len(at_ns) else 0
    return {name: queue_depth(at_ns, depth, until_ns) for name, depth in (("packets", n_packets), ("bytes", n_bytes))}


def condition_summary(logs: RunLogs, request: Requested) -> dict[str, Any]:
    """Return the changes, outages, stalls and control requests during the run, and the time in each state."""
    log = logs.sides.get("netem")
    spans = request.spans(log.last_ns) if log is not None else []
    control = logs.of("netem", CONTROL)
    states: dict[str, float] = {}
    for span in spans:
        if span.state is not None:
            states[span.state] = states.get(span.state, 0.0) + (span.end_ns - span.begin_ns) / NS_PER_S
    return {
        "changes": max(0, len(spans) - 1),
        "outages": sum(span.outage and (i == 0 or not spans[i - 1].outage) for i, span in enumerate(spans)),
        "outage_s": sum(span.end_ns - span.begin_ns for span in spans if span.outage) / NS_PER_S,
        "stall_s": sum(span.end_ns - span.begin_ns for span in spans if span.stall) / NS_PER_S,
        "states_s": states,
        "control_accepted": sum(note["accepted"] for note in control),
        "control_refused": sum(not note["accepted"] for note in control),
    }
