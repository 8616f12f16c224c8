"""Use of the processors by each side, from the notes at the end of its log, and contention as a cause of lateness."""

from collections.abc import Mapping, Sequence
from typing import Final, get_args

from tis.common.channels import Side
from tis.common.errors import DataError, Fault
from tis.common.host_records import PROCESSORS
from tis.common.metrics.processor_shares import processor_shares
from tis.deploy.logs.payloads import Row
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.table import Table
from tis.deploy.report.section import Section, means


class ProcessorFigures(Section):
    """Use of the processors that a side may run on."""

    wall_s: float = means("Time over which it was counted.")
    processors: str = means("Numbers of the processors, as `0-3,6`.")
    n_processors: int = means("Number of processors.")
    own_pct: float | None = means("Processor time of this side, 100 for one processor.")
    testbed_pct: float | None = means("Share of the processors' time of all sides on the host.")
    others_pct: float | None = means("Share of other programs.")
    steal_pct: float | None = means("Share taken by the host of this virtual machine.")
    idle_pct: float | None = means("Share in which there was nothing to run.")
    iowait_pct: float | None = means("Share in which a disk was waited for.")
    throttled_pct: float | None = means("Share of the control group's periods in which it was throttled.")
    throttled_ms: float | None = means("Time for which it was throttled.")
    quota_processors: float | None = means("Quota of the control group, in processors.")

    @property
    def unused_pct(self) -> float | None:
        """Return the share of idle time, with or without a pending disk access."""
        return None if self.idle_pct is None or self.iowait_pct is None else self.idle_pct + self.iowait_pct


_SHARES: Final = {
    "testbed_pct": "tis",
    "others_pct": "other programs",
    "steal_pct": "taken by VM's host",
    "idle_pct": "idle",
    "iowait_pct": "disk wait",
    "own_pct": "this side, of one",
}
_NOTE: Final = (
    "Shares of the time of all processors that a side may use, over the whole run; short bursts hardly show. tis: "
    "its sides on this host. Other programs: all else, the live page too. Taken by a virtual machine's host: steal "
    "time, while a process wanted to run. This side: of one processor's time, above 100 with several threads. "
    "-: unknown, which is not 0."
)
_QUOTA_NOTE: Final = (
    " Quota: the processor time that the side's control group may use, in processors. Held back: the share of its "
    "periods in which the group was throttled."
)


def shares_of(logs: RunLogs, side: Side) -> ProcessorFigures | None:
    """Return a side's shares; None in virtual time, in old logs, and for a side that was cut short.

    Sides on one host count as the testbed's own processes. Raises `DataError` for notes of another version.
    Oracle: logs written by hand, test_processors.
    """
    note = _note(logs, side)
    if note is None:
        return None
    try:
        found = processor_shares(note, _mates(logs, side))
        return None if found is None else ProcessorFigures(**found)
    except (LookupError, TypeError, ValueError):
        raise DataError(Fault(PROCESSORS, "", "holds records that this version does not know")) from None


def processors_summary(logs: RunLogs, sides: Sequence[Side] = get_args(Side)) -> dict[Side, ProcessorFigures | None]:
    """Return the summary's ``processors``: an entry for each side, None without notes."""
    return {side: shares_of(logs, side) for side in sides}


def _note(logs: RunLogs, side: Side) -> Row | None:
    return next(iter(logs.of(side, PROCESSORS)), None)


def _mates(logs: RunLogs, side: Side) -> list[Row | None]:
    """Return the notes of the other sides on this host; None for one that may run there but left none."""
    hosts = {name: clock.host for name, clock in logs.clocks.sides.items()}
    if not hosts:
        return []  # a standalone netem runs alone
    own = hosts.get(side, "")
    # a side of an unknown host may run on this one
    return [
        _note(logs, mate) for mate in get_args(Side) if mate != side and (not own or hosts.get(mate, "") in ("", own))
    ]


_SCARCE_PCT: Final = 30
_MIN_USE_PCT: Final = 10
_MIN_STEAL_PCT: Final = 2
_MIN_THROTTLED_PCT: Final = 1
_ONE_BUSY_PCT: Final = 80


def contention_clause(shares: ProcessorFigures | None, side: Side) -> str:
    """Return a clause that follows `starved` or `too busy`, the largest cause first; "" when nothing is known.

    ``shares`` are of ``side``'s processors. Steal time counts from 2 % on: a virtual machine's host takes it only
    from runnable processes, and for many ms at a time. A quota counts when it throttled 1 % of its periods. Other
    programs and the testbed itself count from 10 % on, and only when less than 30 % of the time was idle; otherwise
    they can interfere only in bursts, which shares of a whole run do not show. Oracle: literal shares,
    test_contention.
    """
    if shares is None:
        return ""
    if causes := _causes(shares, side):
        return f"; meanwhile {_listed(causes)}"
    unused, own, others = shares.unused_pct, shares.own_pct, shares.others_pct
    if unused is None or unused < _SCARCE_PCT:
        return ""
    left = f"the processors were {unused:.0f} % idle over the run"
    if own is not None and own >= _ONE_BUSY_PCT:
        return f"; meanwhile {left}, but {side} itself used {own:.0f} % of one"
    if others is not None and others >= _MIN_USE_PCT:
        return f", though {left}: not for want of them, unless in bursts of other programs ({others:.0f} %)"
    return f", though {left}: not for want of them"


def _causes(shares: ProcessorFigures, side: Side) -> list[tuple[float, str, bool]]:
    """Return the causes, largest first: share in %, cause, and whether it is a share of processor time."""
    scarce = shares.unused_pct is not None and shares.unused_pct < _SCARCE_PCT
    found = [
        (shares.steal_pct, "the virtual machine's host took", True, _MIN_STEAL_PCT),
        (shares.others_pct if scarce else None, "other programs used", True, _MIN_USE_PCT),
        (shares.testbed_pct if scarce else None, "tis itself used", True, _MIN_USE_PCT),
        (shares.throttled_pct, f"a quota of {shares.quota_processors or 0:g} processors held {side} back in", False,
         _MIN_THROTTLED_PCT),
    ]  # fmt: skip
    causes = [
        (share, cause, of_time) for share, cause, of_time, lowest in found if share is not None and share >= lowest
    ]
    return sorted(causes, reverse=True)


def _listed(causes: list[tuple[float, str, bool]]) -> str:
    """Return the causes as a list that names their unit once."""
    texts, has_unit = [], False
    for share, cause, of_time in causes:
        of = " of its periods" if not of_time else "" if has_unit else " of the processors' time"
        has_unit = has_unit or of_time
        texts.append(f"{cause} {share:.0f} %{of}")
    *first, last = texts
    return f"{', '.join(first)} and {last}" if first else last


def processor_table(processors: Mapping[Side, ProcessorFigures | None]) -> Table:
    """Return a row for each side; none without any notes."""
    noted = [entry for entry in processors.values() if entry is not None]
    quota = ("quota_processors", "throttled_pct") if any(one.quota_processors is not None for one in noted) else ()
    names = ("n_processors", *_SHARES, *quota)
    columns = ("side", "processors", *_SHARES.values(), *(("quota", "held back") if quota else ()))
    rows = [
        (side, *(None if entry is None else entry[name] for name in names))
        for side, entry in processors.items()
        if noted
    ]
    return Table("Who had the processors, % of their time", columns, rows, _NOTE + (_QUOTA_NOTE if quota else ""))
