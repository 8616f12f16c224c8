"""Records of a side's host: its clock against netem's, the clock's discipline, and the use of the processors."""

from typing import Annotated

from pydantic import AfterValidator, Field

from tis.common.messages import Message
from tis.common.metrics.processor_shares import numbers_of
from tis.common.topic import Topic


class ClockNote(Message):
    """Relation of a side's clock to netem's, the reference, at the beginning of the run."""

    boot_id: str = Field(description="Boot identifier of this side's host; equal identifiers mean one clock.")
    reference_boot_id: str = Field(description="Boot identifier of netem's host.")
    shared: bool = Field(description="true: both sides read the same clock.")
    epoch_ns: int = Field(description="Reading of this side's monotonic clock at its run time 0, in ns.")
    reference_epoch_ns: int = Field(description="Reading of netem's monotonic clock at run time 0, in ns.")


CLOCK = Topic("/tis/clock", ClockNote)


class ExchangeNote(Message):
    """An exchange of four timestamps with netem's clock. Exchanges before the epoch have negative stamps."""

    asked_ns: int = Field(description="Query sent (T1), in ns of this side's run time.")
    received_ns: int = Field(description="Query received by netem (T2), in ns of netem's run time.")
    replied_ns: int = Field(description="Reply sent by netem (T3), in ns of netem's run time.")
    answered_ns: int = Field(description="Reply received (T4), in ns of this side's run time.")


EXCHANGES = Topic("/tis/clock_exchanges", ExchangeNote)


class DisciplineNote(Message):
    """State of the host's clock discipline, as the kernel reports it (adjtimex)."""

    at_ns: int = Field(description="Run time of the reading, in ns.")
    synchronised: bool = Field(description="true: a time service synchronises the clock.")
    estimated_error_us: int = Field(description="Error of the clock that the time service estimates, in us.")
    maximum_error_us: int = Field(description="Maximum error of the clock, in us.")
    frequency_ppm: float = Field(description="Frequency correction that the kernel applies, in ppm.")


DISCIPLINE = Topic("/tis/clock_discipline", DisciplineNote)


def _as_ranges(processors: str) -> str:
    numbers_of(processors)
    return processors


class ProcessorNote(Message):
    """Use of the processors on which a side may run; times are sums over these processors.

    null: unknown, as without /proc/stat, a count of steal, or a quota.
    """

    from_ns: int = Field(description="Run time at which the period begins, in ns.")
    to_ns: int = Field(description="Run time at which the period ends, in ns.")
    processors: Annotated[str, AfterValidator(_as_ranges)] = Field(
        description="Numbers of the processors on which the process may run, like 0-3,6."
    )
    own_ns: int = Field(description="Processor time of this process, all threads, in ns.")
    busy_ns: int | None = Field(None, description="Time in which any program ran, this process included, in ns.")
    idle_ns: int | None = Field(None, description="Time in which nothing was to be run, in ns.")
    iowait_ns: int | None = Field(None, description="Idle time while a disk access was pending, in ns.")
    steal_ns: int | None = Field(None, description="Time that the virtual machine's host took from programs, in ns.")
    quota_processors: float | None = Field(
        None, description="CPU quota of the tightest control group, in processors."
    )
    n_periods: int | None = Field(None, description="Number of quota periods in which the group ran.")
    n_throttled: int | None = Field(None, description="Number of these periods in which it was throttled.")
    throttled_ns: int | None = Field(None, description="Throttled time, in ns.")


PROCESSORS = Topic("/tis/processors", ProcessorNote, stamps=("from_ns", "to_ns"))
