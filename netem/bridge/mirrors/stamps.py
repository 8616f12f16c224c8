"""Timestamps for the replies of advanced publishers' caches, so that a subscriber recognises duplicates.

An advanced subscriber identifies samples by the sequence number in their source information, which the Python binding
cannot put into a reply. Without it the subscriber uses the timestamp, so a reply without one gets a timestamp here,
derived from source and sequence number: equal for equal samples, later for later ones.
"""

import hashlib
import threading
from typing import Final, NamedTuple

import zenoh

from tis.common.units import NS_PER_S

_ADVANCED: Final = "/@adv/"
_MAX_SOURCES: Final = 10_000


class _Source(NamedTuple):
    """The publisher of a sample; its timestamps count from the instant of its first sample here."""

    stamp_id: bytes
    first_ns: int
    first_sn: int


class Stamps:
    """The timestamps of replies, by publisher."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._sources: dict[str, _Source] = {}
        self._lock = threading.Lock()

    def stamp(self, query_key: str, sample: zenoh.Sample) -> zenoh.Timestamp | None:
        """Return the timestamp of a reply to a query for ``query_key``: the sample's own, if it has one."""
        info = sample.source_info
        if sample.timestamp is not None or info is None or _ADVANCED not in query_key:
            return sample.timestamp
        name = f"{info.source_id.zid} {info.source_id.eid}"
        source = self._sources.get(name)
        if source is None:
            source = self._open(name, info.source_sn)
        seconds, nanos = divmod(source.first_ns + info.source_sn - source.first_sn, NS_PER_S)
        return zenoh.Timestamp(zenoh.NTP64(seconds, nanos), source.stamp_id)

    def _open(self, name: str, sn: int) -> _Source:
        stamp_id = hashlib.blake2b(name.encode(), digest_size=16).digest()
        now = self._session.new_timestamp().get_time_as_ntp64()  # before the lock, since it calls Zenoh
        opened = _Source(stamp_id, now.as_secs() * NS_PER_S + now.subsec_nanos(), sn)
        with self._lock:
            if name not in self._sources and len(self._sources) >= _MAX_SOURCES:
                del self._sources[next(iter(self._sources))]
            return self._sources.setdefault(name, opened)
