"""netem's audit log: whether it is whole, and who was refused, by address and name."""

from collections.abc import Collection, Iterable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final

from tis.common.audit import AUDIT_FILE, AuditEntry, Verified, verify
from tis.common.errors import DataError, Fault
from tis.common.host_records import AUDIT, AuditNote
from tis.common.refusal import MEANING
from tis.deploy.logs.log_paths import log_file
from tis.deploy.logs.read.load import RunLogs, load_side
from tis.deploy.present.page import folded, note
from tis.deploy.present.table import Column, Table
from tis.netem.control.replay import request_in_words

_MAX_BYTES: Final = 200_000_000
_MAX_ROWS: Final = 40
_STEP_S: Final = 5.0


def audit_of(logs: RunLogs) -> Verified | None:
    """Return the audit log beside a run's logs, as far as it is whole; None without one. Raises `DataError`."""
    file = logs.run_dir / AUDIT_FILE
    try:
        if not file.is_file():
            return None
        if file.stat().st_size > _MAX_BYTES:
            raise DataError(Fault(str(file), "", f"must have at most {_MAX_BYTES} bytes"))
        lines = file.read_bytes().splitlines(keepends=True)
    except OSError as error:
        raise DataError(Fault(str(file), "", f"cannot be read: {error.strerror}")) from None
    noted = [AuditNote(**row) for row in logs.of("netem", AUDIT)]
    return verify(lines, noted)


def releasers(logs: RunLogs, stops: Collection[int]) -> list[str]:
    """Return the connections of which one released each of these stops, by their numbers; none without a log."""
    try:
        found = audit_of(logs) if stops else None
    except DataError:  # the report tells of it
        return []
    named = {f"of {number}" for number in stops}
    entries = () if found is None else found.entries
    return list(dict.fromkeys(who for one in entries if one.event == "release" and one.what in named
                              for who in one.among))  # fmt: skip


def verify_run(run_dir: Path) -> str:
    """Return in words that a run's audit log is whole; raises `DataError` where it is not, or is not there."""
    path = log_file(run_dir, "netem")
    logs = RunLogs(run_dir, {"netem": load_side(path, "netem")} if path.is_file() else {})
    found = audit_of(logs)
    where = str(run_dir / AUDIT_FILE)
    if found is None:
        raise DataError(Fault(where, "", "is not there"))
    if found.fault:
        raise DataError(Fault(where, "", found.fault))
    beside = "" if logs.sides else "; netem's log, which would show a cut tail, is not there"
    return f"{found.words}{clock_steps(found.entries)}{beside}"


def clock_steps(entries: Iterable[AuditEntry]) -> str:
    """Return where netem's calendar clock, by which certificates are valid, stepped beside the run's time first."""
    before_s = None
    for number, entry in enumerate(entries, 1):
        with suppress(ValueError):
            if entry.run_s is not None:
                now_s = datetime.fromisoformat(entry.utc).timestamp() - entry.run_s
                if before_s is not None and abs(now_s - before_s) > _STEP_S:
                    return f"; the calendar clock stepped by {now_s - before_s:+.0f} s before line {number}"
                before_s = now_s
    return ""


def refusal_table(found: Verified) -> Table:
    """Return who was refused: alike refusals of an address, summed over the run."""
    sums: dict[tuple[str, str, str, str], tuple[AuditEntry, int]] = {}
    for entry in found.entries:
        if entry.event == "refused":
            alike = (entry.what, entry.address.rpartition(":")[0], entry.name, entry.key)
            first, n = sums.get(alike, (entry, 0))
            sums[alike] = first, n + entry.n
    rows = [
        (
            "" if first.run_s is None else f"{first.run_s:.1f}",
            MEANING.get(first.what, first.what),  # type: ignore[call-overload]
            first.address or ("one of: " + "; ".join(first.among) if first.among else ""),
            first.name,
            first.key,
            n,
        )
        for first, n in sorted(sums.values(), key=lambda row: row[0].utc)[:_MAX_ROWS]
    ]
    columns = ("from, s", Column("refused", words=True), Column("address", words=True), "name", "key", "times")
    return Table("Who was refused", columns, rows)


def action_table(found: Verified) -> Table:
    """Return the stops, the releases and the changes of the network."""
    rows = [
        (
            "" if one.run_s is None else f"{one.run_s:.1f}",
            one.event,
            _request(one),
            one.name,
            one.network,
            "; ".join(one.among),
        )
        for one in found.entries
        if one.event in ("stop", "release", "network")
    ][:_MAX_ROWS]
    return Table("Stops, releases, changes", ("at, s", "what", Column("request", words=True), "signed by", "network",
                                             Column("by one of", words=True)), rows)  # fmt: skip


def _request(entry: AuditEntry) -> str:
    if entry.event != "network" or entry.what == "refused":
        return entry.what
    return request_in_words(entry.key.rpartition("/")[2], entry.what, entry.run_s or 0.0)


def audit_markup(logs: RunLogs) -> str:
    """Return the audit log for a run's page; "" without one."""
    try:
        found = audit_of(logs)
    except DataError as error:
        return note(str(error.faults[0]))
    if found is None:
        return ""
    refused, done = refusal_table(found), action_table(found)
    text = note(f"The audit log, {AUDIT_FILE}: {found.words}{clock_steps(found.entries)}.")
    if refused.rows:
        text += refused.html()
    return text + (folded(f"Stops, releases, changes: {len(done.rows)}", done.html()) if done.rows else "")
