"""The live emulator between two Zenoh networks.

Packets are offered in the Zenoh callback that delivers them; `tis.netem.bridge.driver` releases them.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

import zenoh

from tis.common.channels import DESTINATION, ORIGIN, Direction, Network
from tis.common.peer_life import NO_ALARMS, Alarm
from tis.common.zenoh_syntax import KeySet
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.egress import Egress
from tis.netem.bridge.keys import is_private
from tis.netem.bridge.parcel import Parcel
from tis.netem.link.link import Link
from tis.netem.link.packet import Due


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
        self._held: list[Any] = []

    def subscribe(self, direction: Direction, key: str) -> None:
        """Let the messages that match ``key`` cross in ``direction``."""
        session = self._sessions[ORIGIN[direction]]
        self._held.append(
            session.declare_subscriber(key, self.receiver(direction), allowed_origin=zenoh.Locality.REMOTE)
        )

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
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()

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
