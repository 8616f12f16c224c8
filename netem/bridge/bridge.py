"""The live emulator between two Zenoh networks: messages are taken, held and put as they were.

Packets are offered in the Zenoh callback that delivers them; `tis.netem.bridge.driver` releases them.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, Final

import zenoh

from tis.common.channels import DESTINATION, ORIGIN, Direction, Network
from tis.common.peer_life import NO_ALARMS, Alarm
from tis.common.zenoh_syntax import KeySet
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.keys import is_private
from tis.netem.link.link import Link
from tis.netem.link.packet import MAX_COPIED_BYTES, Due

_MAX_ENCODINGS: Final = 256
_encodings: dict[str, zenoh.Encoding] = {}
_MAX_PUBLISHERS: Final = 4096
_REMOTE: Final = zenoh.Locality.REMOTE


class Kept:
    """The properties of a sample that a receiver can read, under their names, without the sample.

    A sample keeps the buffer in which Zenoh received it alive, some 9 kB even for 16 bytes. So a message that has to
    wait is copied, unless it is itself larger than what the copy would save.
    """

    __slots__ = (
        "attachment", "congestion_control", "encoding", "express", "kind", "payload", "priority", "source_info",
        "timestamp", "timestamp_stack",
    )  # fmt: skip

    def __init__(self, sample: zenoh.Sample, payload: zenoh.ZBytes, attachment: bytes | None) -> None:
        self.payload = payload.to_bytes()
        self.attachment = attachment
        self.encoding = _encoding(str(sample.encoding))
        self.kind = sample.kind
        self.priority = sample.priority
        self.express = sample.express
        self.congestion_control = sample.congestion_control
        self.timestamp = sample.timestamp
        self.source_info = sample.source_info
        self.timestamp_stack = sample.timestamp_stack


class Parcel:
    """A message on a link: the sample itself until `keep`, which may run while another thread sends it.

    Payload and attachment are the sample's: each access to one of Zenoh's properties makes another object.
    """

    __slots__ = ("attachment", "message", "payload")

    def __init__(self, sample: zenoh.Sample, payload: zenoh.ZBytes, attachment: bytes | None) -> None:
        self.message: zenoh.Sample | Kept = sample
        self.payload: zenoh.ZBytes | None = payload
        self.attachment = attachment

    def keep(self) -> None:
        """Copy the sample, since it has to wait."""
        sample, payload = self.message, self.payload
        if payload is not None and isinstance(sample, zenoh.Sample) and len(payload) <= MAX_COPIED_BYTES:
            self.message = Kept(sample, payload, self.attachment)
            self.payload = None  # it keeps Zenoh's buffer alive


def _encoding(name: str) -> zenoh.Encoding:
    """Return an encoding that shares no buffer with a sample."""
    found = _encodings.get(name)
    if found is None:
        if len(_encodings) >= _MAX_ENCODINGS:
            _encodings.clear()
        found = _encodings[name] = zenoh.Encoding(name)
    return found


_Quality = tuple[str, str, bool, bool]


class Egress:
    """The publishers of one network, declared at the first message with a key and a quality of service.

    A declared publisher forwards a message in half the time of `Session.put`.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[_Quality, zenoh.Publisher] = {}

    def send(self, sample: zenoh.Sample | Kept, key: str, payload: zenoh.ZBytes | bytes) -> bool:
        """Put or delete with all properties of ``sample`` that a receiver can read, but with ``payload``.

        ``key`` is the sample's. Returns False if Zenoh refused it.
        """
        blocks = sample.congestion_control != zenoh.CongestionControl.DROP
        quality = (key, str(sample.priority), sample.express, blocks)
        publisher = self._publishers.get(quality)
        try:
            if publisher is None:
                publisher = self._declare(quality, key, sample)
            if sample.kind == zenoh.SampleKind.DELETE:
                publisher.delete(
                    attachment=sample.attachment,
                    timestamp=sample.timestamp,
                    timestamp_instrumentation=_instrumentation(sample),
                    source_info=sample.source_info,
                )
                return True
            timestamp, source_info, instrumentation = sample.timestamp, sample.source_info, _instrumentation(sample)
            # each argument costs a conversion
            if timestamp is None and source_info is None and instrumentation is None:
                publisher.put(payload, encoding=sample.encoding, attachment=sample.attachment)
                return True
            publisher.put(
                payload,
                encoding=sample.encoding,
                attachment=sample.attachment,
                timestamp=timestamp,
                timestamp_instrumentation=instrumentation,
                source_info=source_info,
            )
        except zenoh.ZError:
            return False
        return True

    def _declare(self, quality: _Quality, key: str, sample: zenoh.Sample | Kept) -> zenoh.Publisher:
        if len(self._publishers) >= _MAX_PUBLISHERS:
            self._publishers.pop(next(iter(self._publishers))).undeclare()  # type: ignore[no-untyped-call]
        publisher = self._session.declare_publisher(
            key,
            priority=sample.priority,
            express=sample.express,
            congestion_control=sample.congestion_control,
            allowed_destination=_REMOTE,
        )
        self._publishers[quality] = publisher
        return publisher


def _instrumentation(sample: zenoh.Sample | Kept) -> zenoh.TimestampInstrumentation | None:
    """Return the points at which a message is to be stamped; the stamps so far cannot be put."""
    stack = sample.timestamp_stack
    return None if stack is None else stack.instrumentation


class Bridge(Driver):
    """Two links between two sessions.

    Zenoh would swallow an exception of a callback, so each is kept. Items are parcels of messages, and of queries,
    replies and tokens objects that forward themselves.
    """

    def __init__(self, sessions: Mapping[Network, zenoh.Session], links: Mapping[Direction, Link]) -> None:
        super().__init__(links)
        self.local = KeySet()  # keys that stay on their network
        self.base_overhead_ns = 0
        self.n_unsent = 0
        self._egress: Final = {direction: Egress(sessions[DESTINATION[direction]]) for direction in links}
        self._sessions = sessions
        self._held = ExitStack()

    def subscribe(self, direction: Direction, key: str) -> None:
        """Let the messages that match ``key`` cross in ``direction``."""
        session, receiver = self._sessions[ORIGIN[direction]], self.receiver(direction)
        self._held.callback(session.declare_subscriber(key, receiver, allowed_origin=_REMOTE).undeclare)

    def receiver(self, direction: Direction) -> Callable[[zenoh.Sample], None]:
        """Return the callback for the messages of one direction."""
        link = self.links[direction]

        def receive(sample: zenoh.Sample) -> None:
            try:
                key = str(sample.key_expr)
                # a put may name many keys at once; in a run nobody needs that, and it could name a local one
                if key in self.local or ("*" in key and self.local) or is_private(key):
                    return
                attached, payload = sample.attachment, sample.payload
                attachment, n_bytes = None if attached is None else attached.to_bytes(), len(payload)
                header = attachment or b""
                # what is held now, without the lock, only decides which way is tried first
                if link.held or not self._cross(direction, key, header, n_bytes, sample, payload):
                    self.offer(direction, key, header, n_bytes, Parcel(sample, payload, attachment))
            except BaseException as error:
                self.failed(error)

        return receive

    def _cross(
        self,
        direction: Direction,
        key: str,
        attachment: bytes,
        n_bytes: int,
        sample: zenoh.Sample,
        payload: zenoh.ZBytes,
    ) -> bool:
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
        if not self._egress[direction].send(sample, key, payload):
            self.n_unsent += 1
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
        own = {"unsent": self.n_unsent, "base_overhead_ns": self.base_overhead_ns}
        return super().counters() | own

    def payload(self, direction: Direction, due: Due, payload: zenoh.ZBytes | bytes) -> zenoh.ZBytes | bytes:
        """Return a packet's payload as it leaves; it is copied only when bits flip."""
        if not due.n_flips:
            return payload
        return self.links[direction].payload(due, payload if isinstance(payload, bytes) else payload.to_bytes())

    def _send(self, direction: Direction, due: Due) -> None:
        item = due.item
        if not isinstance(item, Parcel):
            super()._send(direction, due)
        elif due.departure == "released":
            message = item.message
            if not self._egress[direction].send(message, due.name, self.payload(direction, due, message.payload)):
                self.n_unsent += 1

    def _kept(self, item: Any) -> None:
        if isinstance(item, Parcel):
            item.keep()
