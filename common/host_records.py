"""Records of a side's host: its clock against netem's, the clock's discipline, and the use of the processors."""

from typing import Annotated

from msgspec import Meta

from tis.common.messages import Message
from tis.common.metrics.processor_shares import numbers_of
from tis.common.topic import Topic


class ClockNote(Message, frozen=True):
    """Relation of a side's clock to netem's, the reference, at the beginning of the run."""

    boot_id: Annotated[
        str, Meta(description="Boot identifier of this side's host; equal identifiers mean one clock.")
    ]
    reference_boot_id: Annotated[str, Meta(description="Boot identifier of netem's host.")]
    shared: Annotated[bool, Meta(description="true: both sides read the same clock.")]
    epoch_ns: Annotated[int, Meta(description="Reading of this side's monotonic clock at its run time 0, in ns.")]
    reference_epoch_ns: Annotated[int, Meta(description="Reading of netem's monotonic clock at run time 0, in ns.")]


CLOCK = Topic("/tis/clock", ClockNote)


class ExchangeNote(Message, frozen=True):
    """An exchange of four timestamps with netem's clock. Exchanges before the epoch have negative stamps."""

    asked_ns: Annotated[int, Meta(description="Query sent (T1), in ns of this side's run time.")]
    received_ns: Annotated[int, Meta(description="Query received by netem (T2), in ns of netem's run time.")]
    replied_ns: Annotated[int, Meta(description="Reply sent by netem (T3), in ns of netem's run time.")]
    answered_ns: Annotated[int, Meta(description="Reply received (T4), in ns of this side's run time.")]


EXCHANGES = Topic("/tis/clock_exchanges", ExchangeNote)


class DisciplineNote(Message, frozen=True):
    """State of the host's clock discipline, as the kernel reports it (adjtimex)."""

    at_ns: Annotated[int, Meta(description="Run time of the reading, in ns.")]
    synchronised: Annotated[bool, Meta(description="true: a time service synchronises the clock.")]
    estimated_error_us: Annotated[int, Meta(description="Error of the clock that the time service estimates, in us.")]
    maximum_error_us: Annotated[int, Meta(description="Maximum error of the clock, in us.")]
    frequency_ppm: Annotated[float, Meta(description="Frequency correction that the kernel applies, in ppm.")]


DISCIPLINE = Topic("/tis/clock_discipline", DisciplineNote)


class ProcessorNote(Message, frozen=True):
    """Use of the processors on which a side may run; times are sums over these processors.

    null: unknown, as without /proc/stat, a count of steal, or a quota.
    """

    from_ns: Annotated[int, Meta(description="Run time at which the period begins, in ns.")]
    to_ns: Annotated[int, Meta(description="Run time at which the period ends, in ns.")]
    processors: Annotated[
        str, Meta(description="Numbers of the processors on which the process may run, like 0-3,6.")
    ]
    own_ns: Annotated[int, Meta(description="Processor time of this process, all threads, in ns.")]
    busy_ns: Annotated[
        int | None, Meta(description="Time in which any program ran, this process included, in ns.")
    ] = None
    idle_ns: Annotated[int | None, Meta(description="Time in which nothing was to be run, in ns.")] = None
    iowait_ns: Annotated[int | None, Meta(description="Idle time while a disk access was pending, in ns.")] = None
    steal_ns: Annotated[
        int | None, Meta(description="Time that the virtual machine's host took from programs, in ns.")
    ] = None
    quota_processors: Annotated[
        float | None, Meta(description="CPU quota of the tightest control group, in processors.")
    ] = None
    n_periods: Annotated[int | None, Meta(description="Number of quota periods in which the group ran.")] = None
    n_throttled: Annotated[int | None, Meta(description="Number of these periods in which it was throttled.")] = None
    throttled_ns: Annotated[int | None, Meta(description="Throttled time, in ns.")] = None

    def __post_init__(self) -> None:
        numbers_of(self.processors)  # raises `ValueError` where it names none


PROCESSORS = Topic("/tis/processors", ProcessorNote, stamps=("from_ns", "to_ns"))


class AuditNote(Message, frozen=True):
    """The audit log's length and the hash of its last line, at an instant."""

    at_ns: Annotated[int, Meta(description="Run time, in ns.")]
    lines: Annotated[int, Meta(ge=0, description="Number of lines.")]
    sha256: Annotated[str, Meta(description="SHA-256 of the last line, in hex; zeros without any.")]


AUDIT = Topic("/tis/audit", AuditNote, stamps=("at_ns",))
