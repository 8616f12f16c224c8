"""The first copy of each message to leave: with duplicates, a message's delay is that copy's (RFC 7679)."""

import numpy as np

from tis.deploy.logs.read.batches import Releases


def first_copies(left: Releases) -> Releases:
    """Return, of packets in order of leaving, the first one of each message, in the same order.

    A restarted sender uses a number again, so a message is named by number and instant of offering (oracle: a few
    messages by hand, tests/deploy/report/test_link_summary).
    """
    if not left.copy_index.any():
        return left
    order = np.lexsort((np.arange(len(left.seq)), left.offered_ns, left.seq))
    seq, offered_ns = left.seq[order], left.offered_ns[order]
    is_first = np.ones(len(order), dtype=np.bool_)
    is_first[1:] = (seq[1:] != seq[:-1]) | (offered_ns[1:] != offered_ns[:-1])
    return left.at(np.sort(order[is_first]))
