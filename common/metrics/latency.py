"""How late the patient's estimates are, and where the time went. All instants in ns of run time."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.metrics.percentiles import Summary, summarise
from common.units import NS_PER_MS

Instants = NDArray[np.int64]


class LatencyParts(NamedTuple):
    """Durations in integer ns, shape (N,): one entry for each tick that uses a new freshest sample.

    The first four add up to ``end_to_end`` exactly, entry by entry (percentiles of them do not add).
    """

    surgeon: Instants
    network: Instants
    tick_wait: Instants
    compute: Instants
    end_to_end: Instants


def latency_parts(
    sample_ns: Instants, sent_ns: Instants, recv_ns: Instants, begin_ns: Instants, published_ns: Instants
) -> LatencyParts:
    """Split the way of each used sample: taken, sent, received, tick begun, estimate published; shapes (N,).

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
    """Return for each command sample the time until the first feedback that carries it arrived; shape (C,).

    The arguments (F,) are what the surgeon's side received on one feedback key: the sample instant of the
    command that each message answers, and its arrival. Both are read from the surgeon's clock, so no
    synchronisation enters. Sorted by sample instant; commands that no feedback carries do not appear. As
    RFC 2681, with the tick's wait included. Oracle: a dictionary in the tests.
    """
    order = np.lexsort((recv_ns, command_sample_ns))
    command, first = np.unique(command_sample_ns[order], return_index=True)
    return recv_ns[order][first] - command


def latency_ms(parts: LatencyParts, beside: Mapping[str, Instants]) -> dict[str, Summary]:
    """Return the summary's ``latency_ms``: percentiles of each part and of what stands ``beside`` (ns in, ms out)."""
    named = {**parts._asdict(), **beside}
    return {name: summarise(values / NS_PER_MS) for name, values in named.items()}
