"""Latency of the patient's estimates and its parts, and the machine's punctuality. Instants in ns of run time."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.percentiles import Summary, summarise
from tis.common.units import NS_PER_MS, NS_PER_US

Instants = NDArray[np.int64]


class LatencyParts(NamedTuple):
    """Durations in integer ns, shape (N,): one entry for each tick that uses a new freshest sample.

    ``end_to_end`` is the exact sum of the others, entry by entry (percentiles do not add).
    """

    surgeon: Instants
    network: Instants
    tick_wait: Instants
    compute: Instants
    end_to_end: Instants


def latency_parts(
    sample_ns: Instants, sent_ns: Instants, recv_ns: Instants, begin_ns: Instants, published_ns: Instants
) -> LatencyParts:
    """Split the latency of each used sample at: sampled, sent, received, tick begun, estimate published; (N,).

    The network's part is a one-way delay as in RFC 7679, from the call that sends to the stamp on arrival.
    """
    return LatencyParts(
        surgeon=sent_ns - sample_ns,
        network=recv_ns - sent_ns,
        tick_wait=begin_ns - recv_ns,
        compute=published_ns - begin_ns,
        end_to_end=published_ns - sample_ns,
    )


def round_trip_ns(command_sample_ns: Instants, recv_ns: Instants) -> Instants:
    """Return the time from each command sample to the arrival of the first feedback that answers it; shape (C,).

    The arguments (F,) are the messages that the surgeon's side received on one feedback key: the sample instant of
    the answered command, and the arrival, both on the surgeon's clock. Sorted by sample instant, without unanswered
    commands. As RFC 2681, with the wait for the tick included. Oracle: a dictionary in the tests.
    """
    order = np.lexsort((recv_ns, command_sample_ns))
    command, first = np.unique(command_sample_ns[order], return_index=True)
    return recv_ns[order][first] - command


def latency_ms(parts: LatencyParts, beside: Mapping[str, Instants]) -> dict[str, Summary]:
    """Return the summary's ``latency_ms``: percentiles of each part and of the durations ``beside``, both in ns."""
    named = {**parts._asdict(), **beside}
    return {name: summarise(values / NS_PER_MS) for name, values in named.items()}


def lateness_us(due_ns: Instants, done_ns: Instants) -> Summary:
    """Return p50, p95, p99 and max of ``done - due`` in us; both (N,), in ns of run time.

    For ticks this is the lateness (begin - t_k), for an emulator's packets the release error (left - decided).
    """
    return summarise((done_ns - due_ns) / NS_PER_US)


def tick_summary(
    rate_hz: int, due_ns: Instants, begin_ns: Instants, missed: NDArray[np.bool_]
) -> dict[str, int | Summary]:
    """Return the summary's ``ticks``; the arrays (T,) hold every tick, including the missed ones.

    A tick is missed when it did not begin before the next one was due. It is counted but has no lateness.
    """
    begun = ~missed
    return {
        "rate_hz": rate_hz,
        "count": len(due_ns),
        "missed": int(np.count_nonzero(missed)),
        "lateness_us": lateness_us(due_ns[begun], begin_ns[begun]),
    }
