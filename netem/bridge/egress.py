"""Egress of the emulator: messages are put on the destination network as they were put on the origin."""

from typing import Final

import zenoh

from tis.netem.bridge.parcel import Kept

_MAX_PUBLISHERS: Final = 4096
_REMOTE: Final = zenoh.Locality.REMOTE

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
