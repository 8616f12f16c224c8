"""The way out of the emulator: messages are put on the other network as they were put on this one."""

from typing import Final

import zenoh

_MOST_PUBLISHERS: Final = 4096
_REMOTE: Final = zenoh.Locality.REMOTE

_Quality = tuple[str, str, bool, bool]


class Egress:
    """One network's publishers, declared when a key and its quality of service first occur.

    A declared publisher forwards a message in half of the time that `Session.put` takes.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[_Quality, zenoh.Publisher] = {}

    def send(self, sample: zenoh.Sample, key: str, payload: zenoh.ZBytes) -> bool:
        """Put or delete; everything of the message that a receiver can read stays as it was, but for ``payload``.

        ``key`` is the sample's. False: Zenoh refused it.
        """
        blocks = sample.congestion_control != zenoh.CongestionControl.DROP
        quality = (key, str(sample.priority), sample.express, blocks)
        publisher = self._publishers.get(quality)
        try:
            if publisher is None:
                publisher = self._declare(quality, sample)
            if sample.kind == zenoh.SampleKind.DELETE:
                publisher.delete(
                    attachment=sample.attachment, timestamp=sample.timestamp, source_info=sample.source_info
                )
                return True
            timestamp, source_info = sample.timestamp, sample.source_info
            if timestamp is None and source_info is None:  # what is not handed over need not be converted
                publisher.put(payload, encoding=sample.encoding, attachment=sample.attachment)
                return True
            publisher.put(
                payload,
                encoding=sample.encoding,
                attachment=sample.attachment,
                timestamp=timestamp,
                source_info=source_info,
            )
        except zenoh.ZError:
            return False
        return True

    def _declare(self, quality: _Quality, sample: zenoh.Sample) -> zenoh.Publisher:
        if len(self._publishers) >= _MOST_PUBLISHERS:
            self._publishers.pop(next(iter(self._publishers))).undeclare()  # type: ignore[no-untyped-call]
        publisher = self._session.declare_publisher(
            sample.key_expr,
            priority=sample.priority,
            express=sample.express,
            congestion_control=sample.congestion_control,
            allowed_destination=_REMOTE,
        )
        self._publishers[quality] = publisher
        return publisher
