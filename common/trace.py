"""A recorded network: send time of each message, and its delay or loss."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.common.units import NS_PER_S

LOST: Final = -1
MAX_DELAY_NS: Final = 3600 * NS_PER_S
MAX_SENT_NS: Final = 1_000_000 * NS_PER_S  # up to here a float of seconds resolves 1 ns

MAX_FAULTS: Final = 10


@dataclass(frozen=True, eq=False)
class Trace:
    """N >= 1 messages in the order of sending. Raises `DataError` for inconsistent columns.

    ``label`` names the trace in errors and reports; ``about`` describes its origin.
    """

    label: str
    sent_ns: NDArray[np.int64]
    """(N,), 0 to `MAX_SENT_NS`, not descending; only differences count."""
    delay_ns: NDArray[np.int64]
    """(N,), `LOST` where the message was lost, else 0 to `MAX_DELAY_NS`."""
    about: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        faults = _faults(self)
        if faults:
            raise DataError(faults)


class OpportunityTrace(Trace):
    """Recorded opportunities to send: their instants are the send times, and there are no delays."""


def truncated(label: str, faults: Sequence[Fault], n_faults: int) -> list[Fault]:
    """Return the first ten faults, and one that counts the remaining ones of ``n_faults``."""
    shown = list(faults[:MAX_FAULTS])
    left_out = n_faults - len(shown)
    return [*shown, Fault(label, "", f"... and {left_out} more")] if left_out > 0 else shown


def _faults(trace: Trace) -> list[Fault]:
    label, sent_ns, delay_ns = trace.label, trace.sent_ns, trace.delay_ns
    if sent_ns.shape != delay_ns.shape or sent_ns.ndim != 1:
        return [Fault(label, "", "must have as many delays as send times")]
    if not len(sent_ns):
        return [Fault(label, "", "must have at least one row")]
    falls = np.concatenate([[False], sent_ns[1:] < sent_ns[:-1]])
    checks = (
        ("sent_ns", f"must be between 0 and {MAX_SENT_NS}", (sent_ns < 0) | (sent_ns > MAX_SENT_NS), sent_ns),
        ("sent_ns", "must be at least that of the row before", falls, sent_ns),
        (
            "delay_ns",
            f"must be between 0 and {MAX_DELAY_NS}, or {LOST} where lost",
            (delay_ns < LOST) | (delay_ns > MAX_DELAY_NS),
            delay_ns,
        ),
    )
    found = [
        (int(row), Fault(label, f"row {row}: {column}", rule, int(values[row])))
        for column, rule, broken, values in checks
        for row in np.flatnonzero(broken)[:MAX_FAULTS]
    ]
    n_faults = sum(int(broken.sum()) for _, _, broken, _ in checks)
    return truncated(label, [fault for _, fault in sorted(found, key=lambda pair: pair[0])], n_faults)
