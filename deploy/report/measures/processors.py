"""Processor shares of each side during the run, from the notes at the end of its log."""

from collections.abc import Sequence
from typing import Any, get_args

from tis.common.channels import Side
from tis.common.errors import DataError, Fault
from tis.common.host_records import PROCESSORS
from tis.common.metrics.processor_shares import ProcessorShares, processor_shares
from tis.deploy.logs.json_rows import Row
from tis.deploy.logs.read.load import RunLogs


def shares_of(logs: RunLogs, side: Side) -> ProcessorShares | None:
    """Return a side's shares; None in virtual time, in old logs, and for a side that was cut short.

    Sides on one host count as the testbed's own processes. Raises `DataError` for notes of another version.
    Oracle: logs written by hand, test_processors.
    """
    note = _note(logs, side)
    if note is None:
        return None
    try:
        return processor_shares(note, _mates(logs, side))
    except (LookupError, TypeError, ValueError):
        raise DataError(Fault(PROCESSORS, "", "holds records that this version does not know")) from None


def processors_summary(logs: RunLogs, sides: Sequence[Side] = get_args(Side)) -> dict[str, Any]:
    """Return the summary's ``processors``: an entry for each side, None without notes."""
    shares = {side: shares_of(logs, side) for side in sides}
    return {side: None if found is None else found.summary() for side, found in shares.items()}


def _note(logs: RunLogs, side: Side) -> Row | None:
    return next(iter(logs.of(side, PROCESSORS)), None)


def _mates(logs: RunLogs, side: Side) -> list[Row | None]:
    """Return the notes of the other sides on this host; None for one that may run there but left none."""
    hosts = {name: clock.host for name, clock in logs.clocks.sides.items()}
    if not hosts:
        return []  # a standalone netem runs alone
    own = hosts.get(side, "")
    near = (mate for mate in get_args(Side) if mate != side and _may_be_same(own, hosts.get(mate, "")))
    return [_note(logs, mate) for mate in near]


def _may_be_same(host: str, other: str) -> bool:
    return not host or not other or host == other
