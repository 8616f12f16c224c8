"""Messages over Zenoh: one session for surgeon or patient, two for netem, which stands between two networks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import zenoh

from common.channels import Network
from common.header import Header
from common.node import Arrival, Emission, Node
from common.runtime.clock import Clock
from common.runtime.inbox import Inbox
from common.runtime.loop import Delivery


class Passport(NamedTuple):
    """What a Zenoh sample is besides key, payload and attachment; a forwarder hands it on."""

    deletes: bool
    encoding: zenoh.Encoding
    timestamp: zenoh.Timestamp | None
    priority: zenoh.Priority
    express: bool
    congestion_control: zenoh.CongestionControl
    source_info: zenoh.SourceInfo | None


def passport_of(sample: zenoh.Sample) -> Passport:
    """Return all of a sample that its receiver can read."""
    return Passport(
        sample.kind == zenoh.SampleKind.DELETE,
        sample.encoding,
        sample.timestamp,
        sample.priority,
        sample.express,
        sample.congestion_control,
        sample.source_info,
    )


@dataclass
class ZenohBus:
    """The bus of one live process. Payloads stay Zenoh's bytes when ``forwards`` (netem reads none)."""

    sessions: Mapping[Network, zenoh.Session]
    clock: Clock
    inbox: Inbox[zenoh.Sample]
    forwards: bool = False
    _publishers: dict[tuple[Network, str], zenoh.Publisher] = field(default_factory=dict, repr=False)
    _subscribers: list[zenoh.Subscriber[None]] = field(default_factory=list, repr=False)

    def listen(self, node: Node) -> None:
        """Subscribe to what the node listens to; only to what others publish."""
        for network, key in node.listens():
            self._subscribers.append(
                self.sessions[network].declare_subscriber(
                    key, self.inbox.receiver(network), allowed_origin=zenoh.Locality.REMOTE
                )
            )

    def send(self, seat: int, emission: Emission) -> int:  # noqa: ARG002  (one seat in a live process)
        """Put a message on its network: reliable, but dropped rather than waited for when a queue is full."""
        if emission.passport is not None:
            return self._forward(emission)
        publisher = self._publishers.get((emission.network, emission.key))
        if publisher is None:
            publisher = self._declare(emission)
        attachment = emission.attachment
        sent_ns = self.clock.now_ns()
        if isinstance(attachment, Header):
            attachment = attachment._replace(sent_ns=sent_ns).pack()
        publisher.put(emission.payload, attachment=attachment)
        return sent_ns

    def _declare(self, emission: Emission) -> zenoh.Publisher:
        publisher = self.sessions[emission.network].declare_publisher(
            emission.key,
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._publishers[emission.network, emission.key] = publisher
        return publisher

    def _forward(self, emission: Emission) -> int:
        passport: Passport = emission.passport
        session = self.sessions[emission.network]
        common: dict[str, Any] = {
            "attachment": emission.attachment or None,
            "timestamp": passport.timestamp,
            "priority": passport.priority,
            "express": passport.express,
            "congestion_control": passport.congestion_control,
            "source_info": passport.source_info,
            "allowed_destination": zenoh.Locality.REMOTE,
        }
        sent_ns = self.clock.now_ns()
        if passport.deletes:
            session.delete(emission.key, **common)
        else:
            session.put(emission.key, emission.payload, encoding=passport.encoding, **common)
        return sent_ns

    def wait(self, deadline_ns: int) -> Delivery | None:
        """Return the next arrival stamped at or before the deadline, None when there is none."""
        stamped = self.inbox.wait(deadline_ns)
        if stamped is None:
            return None
        sample = stamped.item
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        payload: Any = sample.payload if self.forwards else sample.payload.to_bytes()
        passport = passport_of(sample) if self.forwards else None
        return Delivery(
            0, Arrival(stamped.network, str(sample.key_expr), payload, attachment, stamped.recv_ns, passport)
        )
