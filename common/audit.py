"""The audit log: who connected, was refused, and changed what; JSON lines, each with the hash of the one before.

A line that is changed, taken out or put in breaks the chain. Who rewrites all lines after it is found by netem's log,
which notes the number of lines and the hash of the last one (`AuditNote`).
"""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Annotated, Final, Literal, NamedTuple

from msgspec import DecodeError, Meta

from tis.common.host_records import AuditNote
from tis.common.messages import Message, decode, encode
from tis.common.units import NS_PER_S

AUDIT_FILE: Final = "audit.jsonl"
AUDIT_VARIABLE: Final = "TIS_AUDIT"
"""Variable of netem's environment by which `tis bench security` measures what auditing costs."""
NO_AUDIT: Final = "off"
FIRST: Final = "0" * 64
"""Stands for the hash of the line before the first one."""
MAX_LINE_BYTES: Final = 8192
MAX_AMONG: Final = 8
MAX_PER_SECOND: Final = 64
"""Lines of a second; what else happens in it is summed without address and key."""
MAX_LINES: Final = 200_000

AuditEvent = Literal["begun", "connected", "left", "refused", "stop", "release", "network", "full", "ended"]
_MAX_CHARS: Final = 512
_Text = Annotated[str, Meta(max_length=_MAX_CHARS)]
_Hash = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$(?!\n)")]


class AuditEntry(Message, frozen=True, omit_defaults=True, kw_only=True):
    """A line: one happening, or all alike of one second."""

    before: Annotated[_Hash, Meta(description="SHA-256 of the line before, in hex; zeros in the first line.")]
    utc: Annotated[_Text, Meta(description="Time by netem's calendar clock, ISO 8601; of several, the first.")]
    run_s: Annotated[float | None, Meta(description="Run time, in s; null: the run had not begun.")]
    event: Annotated[AuditEvent, Meta(description="What happened.")]
    what: Annotated[_Text, Meta(description="Kind of refusal; request; reason.")] = ""
    n: Annotated[int, Meta(ge=1, description="How many alike within this second.")] = 1
    network: Annotated[_Text, Meta(description="west or east.")] = ""
    address: Annotated[_Text, Meta(description="Address and port of the other end.")] = ""
    name: Annotated[_Text, Meta(description="Name in its certificate; of a stop or a release: who signed it.")] = ""
    key: Annotated[_Text, Meta(description="Zenoh key.")] = ""
    among: Annotated[
        tuple[_Text, ...],
        Meta(max_length=MAX_AMONG, description="Names and addresses that were connected; one of them did it."),
    ] = ()


class Happening(NamedTuple):
    """What a line says beside its time; equal ones of a second are summed, whatever the port."""

    event: AuditEvent
    what: str = ""
    network: str = ""
    address: str = ""
    name: str = ""
    key: str = ""
    among: tuple[str, ...] = ()

    @property
    def without_port(self) -> "Happening":
        """Return the same of any port of the address."""
        return self._replace(address=self.address.rpartition(":")[0])


class Sums:
    """The happenings of about a second, alike ones counted. Oracle: a Counter, tests/common/test_audit."""

    def __init__(self) -> None:
        self._found: dict[Happening, tuple[int, int, Happening]] = {}

    def add(self, at_ns: int, one: Happening, n: int = 1) -> None:
        """Count a happening at a calendar time in ns since 1970."""
        alike = one.without_port
        if alike not in self._found and len(self._found) >= MAX_PER_SECOND:
            alike = one = Happening(one.event, one.what)  # of which there are few
        first_ns, before, shown = self._found.get(alike, (at_ns, 0, one))
        self._found[alike] = (first_ns, before + n, shown)

    def take(self) -> list[tuple[int, Happening, int]]:
        """Return time, happening and number of all so far, by time, and begin anew."""
        found, self._found = self._found, {}
        return sorted(((first_ns, shown, n) for first_ns, n, shown in found.values()), key=lambda row: row[0])


class Chain:
    """Writes the lines; ``head`` is the hash of the last one."""

    def __init__(self, head: str = FIRST, n_lines: int = 0) -> None:
        self.head, self.n_lines = head, n_lines

    def line(self, utc: str, run_ns: int | None, one: Happening, n: int = 1) -> bytes:
        """Return the next line, with its end."""
        content = encode(
            AuditEntry(
                before=self.head, utc=utc, run_s=None if run_ns is None else round(run_ns / NS_PER_S, 3), n=n,
                event=one.event, what=_cut(one.what), network=one.network, address=_cut(one.address),
                name=_cut(one.name), key=_cut(one.key), among=tuple(map(_cut, one.among[:MAX_AMONG])),
            )
        )  # fmt: skip
        self.head, self.n_lines = digest(content), self.n_lines + 1
        return content + b"\n"


def _cut(text: str) -> str:
    return text[:_MAX_CHARS]


def digest(line: bytes) -> str:
    """Return the SHA-256 of a line without its end, in hex."""
    return hashlib.sha256(line).hexdigest()


class Verified(NamedTuple):
    """What the chain of an audit log says; ``fault`` is empty where it is whole."""

    entries: Sequence[AuditEntry]
    head: str
    has_ended: bool
    fault: str = ""

    @property
    def words(self) -> str:
        """Return the verdict in words."""
        if self.fault:
            return self.fault
        n = len(self.entries)
        end = "" if self.has_ended else "; without an end: netem was killed, or goes on"
        return f"whole: {n} line{'s' if n != 1 else ''}{end}"


def verify(lines: Iterable[bytes], noted: Sequence[AuditNote] = ()) -> Verified:
    """Return the entries of an audit log up to its first fault.

    ``noted`` are what netem's log says of it: a cut tail and a chain that was made anew contradict them. Who can
    rewrite both files is not found. Oracle: every single change of a log, tests/common/test_audit.
    """
    entries: list[AuditEntry] = []
    heads, fault = [FIRST], ""
    for number, line in enumerate(lines, 1):
        content = line.removesuffix(b"\n")
        try:
            entry = decode(content[: MAX_LINE_BYTES + 1], AuditEntry)
        except DecodeError:
            fault = f"changed at line {number}: no entry" if line.endswith(b"\n") else f"cut within line {number}"
            break
        if entry.before != heads[-1]:
            fault = f"changed at line {max(1, number - 1)}: line {number} does not follow it"
            break
        entries.append(entry)
        heads.append(digest(content))
    for note in noted:
        if note.lines < len(heads) and heads[note.lines] != note.sha256:
            fault = fault or f"changed at line {note.lines}: netem's log noted another one"
        elif note.lines >= len(heads):
            fault = fault or f"cut: netem's log noted {note.lines} lines, {len(entries)} are here"
    return Verified(entries, heads[-1], bool(entries) and entries[-1].event == "ended", fault)
