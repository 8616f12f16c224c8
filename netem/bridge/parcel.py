"""A message that the bridge holds, apart from the buffer in which Zenoh received it.

A sample keeps that buffer alive, some 9 kB even for 16 bytes. So a message that has to wait is copied, unless it is
itself larger than what the copy would save.
"""

from typing import Final

import zenoh

from tis.netem.link.packet import MAX_COPIED_BYTES

_MAX_ENCODINGS: Final = 256
_encodings: dict[str, zenoh.Encoding] = {}


class Kept:
    """The properties of a sample that a receiver can read, under their names, without the sample."""

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
