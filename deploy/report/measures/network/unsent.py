"""Messages that a side used although the other side never sent them: forged by somebody on the network."""

from typing import NamedTuple

import numpy as np

from tis.common.channels import Direction
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.batches import fates_by_key
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.message_columns import MessageColumns
from tis.deploy.report.measures.network.link_books import ENDS

_SPREAD = np.int64(0x2545_F491_4F6C_DD1D)  # an odd factor: sequence numbers beside fingerprints in 64 bits


class Unsent(NamedTuple):
    """Number of forged messages, and key and run time in ns of the first one to arrive."""

    n: int
    key: str
    first_ns: int


def unsent(logs: RunLogs, direction: Direction, session: str) -> Unsent | None:
    """Return the messages used by the receiver of a direction that its sender's log does not hold.

    What the receiver quarantined is not in its messages, and of several copies with one sequence number only the
    first is used. A message whose bits netem flipped is not forged. None when the sender's log is missing or damaged,
    as it may then lack what was sent; and without a testbed. Oracle: literals, test_unsent.
    """
    sender, receiver = ENDS[direction]
    covered = logs.coverage(sender)
    if not session or covered is None or not covered.whole:
        return None
    sent = logs.messages(sender, direction, session)
    unknown: dict[str, Ints] = {}  # by key, the indices of the messages used that were not sent like this
    used = logs.messages(receiver, direction, session)
    for key, back in used.items():
        _, first = np.unique(back.seq, return_index=True)
        known = np.isin(_identity(back)[first], _identity(sent.get(key, MessageColumns())))
        if not known.all():
            unknown[key] = first[~known]
    # The fates are only read when there is a message whose bits netem may have flipped.
    flipped = _flipped(logs, direction) if unknown else {}
    n, first_key, first_ns = 0, "", 0
    for key, index in unknown.items():
        back = used[key]
        forged = index[~np.isin(back.seq[index], flipped.get(key, ()))]
        if len(forged):
            arrived_ns = int(back.log_ns[forged].min())
            if not n or arrived_ns < first_ns:
                first_key, first_ns = key, arrived_ns
            n += len(forged)
    return Unsent(n, first_key, first_ns)


def unsent_problem(found: Unsent | None, direction: Direction) -> list[str]:
    """Return the problem that forged messages are for a run; empty without any."""
    if found is None or not found.n:
        return []
    sender, receiver = ENDS[direction]
    how_many = f"{found.n} message{'s' if found.n > 1 else ''}"
    return [
        f"links.{direction}: the {receiver} used {how_many} that the {sender} did not send; the first on "
        f"{found.key}, which arrived at {found.first_ns / NS_PER_S:.3f} s"
    ]


def _identity(messages: MessageColumns) -> Ints:
    """Return a number (N,) for each sequence number with its payload."""
    with np.errstate(over="ignore"):
        return np.asarray(messages.fingerprint ^ (messages.seq * _SPREAD))


def _flipped(logs: RunLogs, direction: Direction) -> dict[str, Ints]:
    """Return by key the sequence numbers of the messages whose bits netem flipped."""
    return {key: fates.seq[fates.flipped > 0] for key, fates in fates_by_key(logs, direction).items()}
