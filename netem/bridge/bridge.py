"""The live emulator between two Zenoh networks: messages are taken, held and put as they were.

Packets are offered in the Zenoh callback that delivers them; `tis.netem.bridge.driver` releases them.
"""

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from tis.common.channels import DESTINATION, ORIGIN, Direction, Network
from tis.common.peer_life import NO_ALARMS, Alarm
from tis.common.zenoh_syntax import KeySet
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.gate import Gate
from tis.netem.bridge.keys import is_private
from tis.netem.link.link import Link
from tis.netem.link.packet import MAX_COPIED_BYTES, Packet

_MAX_ENCODINGS: Final = 256
_encodings: dict[str, zenoh.Encoding] = {}
_MAX_PUBLISHERS: Final = 4096
_DECLARED_FROM: Final = 8  # messages: to declare a publisher takes as long as some twenty messages
_REMOTE: Final = zenoh.Locality.REMOTE
_PRIORITIES: Final = {
    str(one): one
    for one in (
        zenoh.Priority.REAL_TIME, zenoh.Priority.INTERACTIVE_HIGH, zenoh.Priority.INTERACTIVE_LOW,
        zenoh.Priority.DATA_HIGH, zenoh.Priority.DATA, zenoh.Priority.DATA_LOW, zenoh.Priority.BACKGROUND,
    )
}  # fmt: skip
_NUMBERS: Final = {name: number for number, name in enumerate(_PRIORITIES, 1)}
_CONGESTION_CONTROLS: Final = {
    str(one): one
    for one in (
        zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.BLOCK_FIRST,
    )
}  # fmt: skip

_Quality = tuple[str, str, str, bool]
"""Key, priority, congestion control and whether it is express: Zenoh's own objects cannot be hashed."""


def _encoding(name: str) -> zenoh.Encoding:
    """Return an encoding that shares no buffer with a sample."""
    found = _encodings.get(name)
    if found is None:
        if len(_encodings) >= _MAX_ENCODINGS:
            _encodings.clear()
        found = _encodings[name] = zenoh.Encoding(name)
    return found


def _arguments(quality: _Quality) -> dict[str, Any]:
    """Return a quality of service as arguments of Zenoh's."""
    _, priority, congestion_control, express = quality
    return {
        "priority": _PRIORITIES[priority],
        "express": express,
        "congestion_control": _CONGESTION_CONTROLS[congestion_control],
        "allowed_destination": _REMOTE,
    }


class Put:
    """A message as it is put on the other network, with all properties of its sample that a receiver can read.

    Each property is read once, since each access makes another object of Zenoh's.
    """

    __slots__ = ("attachment", "deletes", "encoding", "is_prepared", "payload", "publisher", "quality", "stamps")

    def __init__(
        self, sample: zenoh.Sample, key: str, payload: zenoh.ZBytes, n_bytes: int, attachment: bytes | None
    ) -> None:
        self.payload: zenoh.ZBytes | bytes = payload
        self.attachment = attachment
        self.encoding = _encoding(str(sample.encoding))
        self.deletes = n_bytes == 0 and sample.kind == zenoh.SampleKind.DELETE
        self.quality = key, str(sample.priority), str(sample.congestion_control), sample.express
        self.publisher: zenoh.Publisher | None = None
        self.is_prepared = False
        timestamp, source_info, stack = sample.timestamp, sample.source_info, sample.timestamp_stack
        self.stamps: dict[str, Any] = {}
        if timestamp is not None or source_info is not None or stack is not None:
            # the points at which a message is to be stamped; the stamps so far cannot be put
            points = None if stack is None else stack.instrumentation
            self.stamps = {"timestamp": timestamp, "source_info": source_info, "timestamp_instrumentation": points}


@dataclass(slots=True, eq=False)
class _Declared:
    """A publisher, and whether a message has been put with it since the last look for one to give up."""

    publisher: Final[zenoh.Publisher]
    is_used: bool = True


class Egress:
    """The ways into one network: a publisher for each key and quality of service that has had some messages.

    The first messages are put by the session, as most keys of a fleet that comes and goes have no more. Of too many
    publishers one that has not been used lately is given up. Zenoh undeclares it when the last message that holds it
    has gone, so never one in use, and never under our lock.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self.n_unsent = 0
        self._session = session
        self._lock = threading.Lock()  # guards the dictionaries; never held while Zenoh is called
        self._declared: dict[_Quality, _Declared] = {}
        self._n_messages: dict[_Quality, int] = {}

    def prepare(self, put: Put) -> None:
        """Find the publisher ahead of `send`."""
        try:
            put.publisher = self._publisher(put.quality)
            put.is_prepared = True
        except zenoh.ZError:  # it is counted when the message is sent
            return

    def send(self, put: Put, payload: zenoh.ZBytes | bytes) -> None:
        """Put or delete with all properties of ``put``, but with ``payload``; what Zenoh refuses is counted."""
        try:
            publisher = put.publisher if put.is_prepared else self._publisher(put.quality)
            if publisher is None:
                self._put(put, payload)
            elif put.deletes:
                publisher.delete(attachment=put.attachment, **put.stamps)
            elif put.stamps:
                publisher.put(payload, encoding=put.encoding, attachment=put.attachment, **put.stamps)
            else:  # each argument costs a conversion
                publisher.put(payload, encoding=put.encoding, attachment=put.attachment)
        except zenoh.ZError:
            self.n_unsent += 1

    def _put(self, put: Put, payload: zenoh.ZBytes | bytes) -> None:
        key, quality = put.quality[0], _arguments(put.quality)
        if put.deletes:
            self._session.delete(key, attachment=put.attachment, **put.stamps, **quality)
        else:
            self._session.put(key, payload, encoding=put.encoding, attachment=put.attachment, **put.stamps, **quality)

    def _publisher(self, quality: _Quality) -> zenoh.Publisher | None:
        """Return the publisher; None: there are too few messages yet."""
        found = self._declared.get(quality)
        if found is None:
            return self._declare(quality) if self._is_frequent(quality) else None
        found.is_used = True
        return found.publisher

    def _is_frequent(self, quality: _Quality) -> bool:
        with self._lock:
            n = self._n_messages.pop(quality, 0) + 1
            if n < _DECLARED_FROM:
                if len(self._n_messages) >= _MAX_PUBLISHERS:
                    del self._n_messages[next(iter(self._n_messages))]
                self._n_messages[quality] = n
        return n >= _DECLARED_FROM

    def _declare(self, quality: _Quality) -> zenoh.Publisher:
        ours = _Declared(self._session.declare_publisher(quality[0], **_arguments(quality)))
        with self._lock:
            kept = self._declared.setdefault(quality, ours)  # another thread may have been faster
            given_up = self._unused() if len(self._declared) > _MAX_PUBLISHERS else None
        del given_up  # without the lock, as it may undeclare itself
        return kept.publisher

    def _unused(self) -> _Declared:
        """Take out the publisher that has been unused for longest, as far as one is."""
        while True:
            quality = next(iter(self._declared))
            one = self._declared.pop(quality)
            if not one.is_used:
                return one
            one.is_used = False
            self._declared[quality] = one


class Bridge(Driver):
    """Two links between two sessions.

    Zenoh would swallow an exception of a callback, so each is kept. Items are parcels of messages, and of queries,
    replies and tokens objects that forward themselves.
    """

    def __init__(
        self, sessions: Mapping[Network, zenoh.Session], links: Mapping[Direction, Link],
        gates: Mapping[Direction, Gate] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(links)
        self.gates = gates or {}
        self.local = KeySet()  # keys that stay on their network
        self.base_overhead_ns = 0
        self._egress: Final = {direction: Egress(sessions[DESTINATION[direction]]) for direction in links}
        self._sessions = sessions
        self._held = ExitStack()

    def subscribe(self, direction: Direction, key: str) -> None:
        """Let the messages that match ``key`` cross in ``direction``."""
        # a callback that may wait runs in the thread that reads the connection, which stops reading it
        receiver = zenoh.handlers.Callback(self.receiver(direction), indirect=direction not in self.gates)
        session = self._sessions[ORIGIN[direction]]
        self._held.callback(session.declare_subscriber(key, receiver, allowed_origin=_REMOTE).undeclare)

    def receiver(self, direction: Direction) -> Callable[[zenoh.Sample], None]:
        """Return the callback for the messages of one direction."""
        link, is_gated = self.links[direction], direction in self.gates

        def receive(sample: zenoh.Sample) -> None:
            try:
                key = str(sample.key_expr)
                # a put may name many keys at once; in a run nobody needs that, and it could name a local one
                if key in self.local or ("*" in key and self.local) or is_private(key):
                    return
                attached, payload = sample.attachment, sample.payload
                attachment, n_bytes = None if attached is None else attached.to_bytes(), len(payload)
                put, header = Put(sample, key, payload, n_bytes, attachment), attachment or b""
                # what is held now, without the lock, only decides which way is tried first
                if not link.held and self._cross(direction, key, header, n_bytes, put):
                    return
                priority = _NUMBERS[put.quality[1]]
                if is_gated:
                    self.offer_in_turn(direction, key, header, n_bytes, put, priority)
                else:
                    self.offer(direction, key, header, n_bytes, put, priority)
            except BaseException as error:
                self.failed(error)

        return receive

    def _cross(self, direction: Direction, key: str, attachment: bytes, n_bytes: int, put: Put) -> bool:
        """Send a message that nothing holds back, and only then record it; False: it has to be offered."""
        link = self.links[direction]
        with self._lock:
            clock = self._clock
            now_ns = -1 if clock is None else clock.now_ns()
            if clock is None or now_ns < 0 or self._busy:
                return False
            if not link.lets_through(key, n_bytes + len(attachment), now_ns):
                return False
            self._n_leaving += 1
        released_ns = clock.now_ns()
        self._egress[direction].send(put, put.payload)
        with self._lock:
            link.crossed(key, attachment, n_bytes, now_ns, released_ns)
            self._n_leaving -= 1
        return True

    def close(self) -> None:
        """Stop listening."""
        self._held.close()

    def turn(self, now_ns: int) -> tuple[int, str]:
        """Return now: callbacks do the work, and no user's code runs here."""
        return now_ns, ""

    def alarms(self) -> Mapping[Alarm, int]:
        """Return none: netem reads no payload."""
        return NO_ALARMS

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        n_unsent = sum(egress.n_unsent for egress in self._egress.values())
        return super().counters() | {"unsent": n_unsent, "base_overhead_ns": self.base_overhead_ns}

    def payload(self, direction: Direction, packet: Packet, payload: zenoh.ZBytes | bytes) -> zenoh.ZBytes | bytes:
        """Return a packet's payload as it leaves; it is copied only when bits flip."""
        return self.links[direction].payload(packet, bytes(payload)) if packet.n_flips else payload

    def _send(self, direction: Direction, packet: Packet) -> None:
        item = packet.item
        if not isinstance(item, Put):
            super()._send(direction, packet)
        elif packet.departure == "released":
            payload = self.payload(direction, packet, item.payload) if packet.n_flips else item.payload
            self._egress[direction].send(item, payload)

    def _kept(self, direction: Direction, item: Any) -> None:
        """Copy a message that has to wait, unless it is larger than what that saves; it may be put meanwhile.

        A sample keeps the buffer in which Zenoh received it alive, some 9 kB even for 16 bytes.
        """
        if isinstance(item, Put):
            payload = item.payload
            if len(payload) <= MAX_COPIED_BYTES:
                item.payload = bytes(payload)
            self._egress[direction].prepare(item)
