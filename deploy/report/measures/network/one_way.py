"""One-way delay, delay variation and loss of a direction, from sender to receiver."""

from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.metrics.delay_variation import packet_delay_variation_ns
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.message_columns import MessageColumns
from tis.deploy.report.measures.log_gaps import LogGaps
from tis.deploy.report.measures.network.link_books import ENDS

_NONE: Final[Ints] = np.empty(0, dtype=np.int64)


class OneWay(NamedTuple):
    """The one-way columns of all keys of a direction.

    Of the A messages that arrived, key by key in order of sending: ``sent_ns`` (A,) is the instant of sending,
    ``one_way_ns`` (A,) the one-way delay from the call that sends to the stamp of the first arrival (RFC 7679), and
    ``pdv_ns`` (A,) its excess over the smallest delay of the key (RFC 5481). ``lost`` (N,) marks, of the N messages
    sent, in order of sending, those that had not arrived by the end of the drain (RFC 7680).
    """

    sent_ns: Ints
    one_way_ns: Ints
    pdv_ns: Ints
    lost: NDArray[np.bool_]

    @classmethod
    def of(cls, logs: RunLogs, direction: Direction, session: str) -> Self | None:
        """Return one direction's columns; None where a log is missing (oracle: a few messages, test_one_way).

        Messages in the gaps of damaged logs are left out (`LogGaps`).
        """
        sender, receiver = ENDS[direction]
        if logs.coverage(sender) is None or logs.coverage(receiver) is None:
            return None
        gaps = LogGaps.of(logs, direction, session, (sender, receiver))
        sent, received = (logs.messages(side, direction, session) for side in (sender, receiver))
        left, delays, variations = [_NONE], [_NONE], [_NONE]
        lost, sent_ns = [np.empty(0, dtype=np.bool_)], [_NONE]
        for key, columns in sent.items():
            arrived = received.get(key, MessageColumns())
            # duplicates: the first arrival counts (RFC 7679)
            seq, first = np.unique(arrived.seq, return_index=True)
            logged = ~gaps.affect(columns.sent_ns)
            ours = np.isin(seq, columns.seq[logged])
            left.append(arrived.sent_ns[first[ours]])
            delay_ns = arrived.log_ns[first[ours]] - left[-1]
            delays.append(delay_ns)
            variations.append(packet_delay_variation_ns(delay_ns))
            lost.append(~np.isin(columns.seq[logged], seq))
            sent_ns.append(columns.sent_ns[logged])
        # losses of all keys in order of sending, as bursts hit all keys at once
        order = np.argsort(np.concatenate(sent_ns), kind="stable")
        return cls(
            np.concatenate(left), np.concatenate(delays), np.concatenate(variations), np.concatenate(lost)[order]
        )
