"""Reception of messages: headers and payloads decoded, duplicates marked, anything else rejected and counted."""

from array import array
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar, get_args

from msgspec import DecodeError

from tis.common.channels import Channel
from tis.common.messages import Header, Sampled, decode
from tis.common.node import Arrival, Record
from tis.common.records import REJECTED, Rejected
from tis.common.signing import CodeFault, RunKeys
from tis.common.units import NS_PER_S

_MAX_LEAD_NS: Final = NS_PER_S  # of sampling and sending over the arrival, between clocks that are not synchronised
_MAX_BYTES: Final = 256 * 1024
"""Size of a payload; the longest histories take 90 kB. Each fault of a longer one would take time and memory."""
_N_LOGGED: Final = 1000  # messages without a valid code
_N_REMEMBERED: Final = 32_768  # half a minute at 1 kHz; what comes later is too old to be used


class SeenNumbers:
    """The contents that came under the newest 32 768 sequence numbers, as hashes.

    Each number has a place of its own, modulo 32 768, in memory that is taken at once: what is kept for every message
    of a long run must not be objects, between which the process's memory falls into pieces. Oracle: a dict,
    tests/common/test_intake.
    """

    def __init__(self) -> None:
        self._number = array("q", (-1,)) * _N_REMEMBERED
        self._content = array("q", (0,)) * _N_REMEMBERED

    def note(self, number: int, content: int) -> int | None:
        """Return the content that came before under a number, None if it is new; then the number is remembered.

        A number that is older than what its place remembers is new each time.
        """
        at = number % _N_REMEMBERED
        if self._number[at] == number:
            return self._content[at]
        if self._number[at] < number:
            self._number[at], self._content[at] = number, content
        return None

    def forget(self, number: int) -> None:
        """Take a number for new again."""
        at = number % _N_REMEMBERED
        if self._number[at] == number:
            self._number[at] = -1


Payload = TypeVar("Payload", bound=Sampled)


class Accepted(NamedTuple, Generic[Payload]):
    """A decoded message of the testbed."""

    channel: Channel[Any]
    header: Header
    message: Payload
    duplicate: bool
    conflicting: bool = False
    """Whether another content came before under the same sequence number."""


@dataclass
class Intake(Generic[Payload]):
    """Decodes the arrivals of one side. Damaged and foreign messages are counted and never raise."""

    session: str
    channels: Iterable[Channel[Payload]]
    run_id: int = 0
    """Number of the run, which the headers of its messages carry; 0 in virtual time."""
    n_accepted: int = 0
    n_duplicates: int = 0
    n_rejected: int = 0
    n_foreign: int = 0
    """Messages of another run."""
    n_conflicting: int = 0
    keys: RunKeys | None = None
    """What tells that a message is signed by the other side; None: messages are not signed."""
    code_faults: Counter[CodeFault] = field(default_factory=Counter)
    forged_since_ns: int | None = None
    _table: dict[str, Channel[Payload]] = field(init=False)
    _seen: dict[str, SeenNumbers] = field(init=False)

    def __post_init__(self) -> None:
        self._table = {channel.key(self.session): channel for channel in self.channels}
        self._seen = {key: SeenNumbers() for key in self._table}

    def wanted(self) -> tuple[str, ...]:
        """Return the keys to listen to."""
        return tuple(self._table)

    def take(self, arrival: Arrival) -> tuple[Accepted[Payload] | None, list[Record]]:
        """Return the decoded message, or None when it is rejected, and the records to log."""
        channel = self._table.get(arrival.key)
        if channel is None:
            return self._reject(arrival, "no channel has this key")
        header = Header.unpack(arrival.attachment)
        if header is None:
            return self._reject(arrival, "the attachment is not ours")
        if header.run_id != self.run_id:
            self.n_foreign += 1
            return self._reject(arrival, "it belongs to another run")
        if self.keys is not None:
            fault = self.keys.fault(arrival.key, arrival.attachment, arrival.payload)
            if fault is not None:
                return self._not_believed(fault, arrival)
        if not -_MAX_LEAD_NS <= header.sent_ns <= arrival.recv_ns + _MAX_LEAD_NS:  # no log could hold it
            return self._reject(arrival, "the send time lies outside the run")
        if len(arrival.payload) > _MAX_BYTES:
            return self._reject(arrival, f"the payload has more than {_MAX_BYTES} bytes")
        try:
            message: Payload = decode(arrival.payload, channel.payload)
        except DecodeError:
            return self._reject(arrival, f"the payload is no {channel.payload.__name__}")
        if not 0 <= message.sample_ns <= arrival.recv_ns + _MAX_LEAD_NS:
            return self._reject(arrival, "the sample instant lies outside the run")
        content = hash((header.sent_ns, arrival.payload))
        known = self._seen[arrival.key].note(header.seq, content)
        duplicate, conflicting = known is not None, known not in (None, content)
        self.n_accepted += 1
        self.n_duplicates += duplicate and not conflicting
        self.n_conflicting += conflicting
        record = Record(arrival.key, arrival.recv_ns, arrival.payload, channel.payload, header.sent_ns, header.seq)
        return Accepted(channel, header, message, duplicate, conflicting), [record]

    def forget(self, key: str, seq: int) -> None:
        """Take a sequence number for new again: the message that came under it is not used."""
        self._seen[key].forget(seq)

    def counters(self) -> dict[str, int]:
        """Return the numbers of messages of another run, and without the other side's code."""
        faults = {} if self.keys is None else {kind: self.code_faults[kind] for kind in get_args(CodeFault)}
        return {"other_run": self.n_foreign, **faults}

    def _not_believed(self, fault: CodeFault, arrival: Arrival) -> tuple[None, list[Record]]:
        """Count a message that the other side did not sign; of a flood a few are logged."""
        self.code_faults[fault] += 1
        if self.forged_since_ns is None:
            self.forged_since_ns = arrival.recv_ns
        if sum(self.code_faults.values()) > _N_LOGGED:
            self.n_rejected += 1
            return None, []
        return self._reject(arrival, "it is not signed" if fault == "unsigned" else "its code is wrong")

    def _reject(self, arrival: Arrival, reason: str) -> tuple[None, list[Record]]:
        self.n_rejected += 1
        note = Rejected(key=arrival.key, recv_ns=arrival.recv_ns, reason=reason, head_hex=arrival.payload[:32].hex())
        return None, [Record(REJECTED, arrival.recv_ns, note)]
