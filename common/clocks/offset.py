"""The clock offset before a run begins: the one of the exchange with the smallest bound."""

from typing import Final, NamedTuple

from tis.common.clocks.exchange import Exchanges

UNKNOWN_DRIFT_PPM: Final = 100.0
"""Assumed bound on the drift between two hosts: crystals are within some 50 ppm, one fast and one slow."""


class ClockReading(NamedTuple):
    """Offset of the reference over this host, and the bound on its error."""

    offset_ns: int
    bound_ns: int


def read_clock(exchanges: Exchanges, now_ns: int) -> ClockReading:
    """Return the offset at ``now_ns`` of the exchange with the smallest bound; bounds grow with age.

    Raises `ValueError` without an exchange. Oracle: a short old one against a long new one, tests/common/clocks.
    """
    if not len(exchanges):
        raise ValueError("a clock that was never compared with the reference has no offset")
    # Integer arithmetic, rounded up: ppm * 1000 is ppb.
    age_ns = now_ns - exchanges.answered_ns
    bound_ns = exchanges.bound_ns + -(-age_ns * round(UNKNOWN_DRIFT_PPM * 1000) // 10**9)
    best = int(bound_ns.argmin())
    return ClockReading(int(exchanges.offset_ns[best]), int(bound_ns[best]))
