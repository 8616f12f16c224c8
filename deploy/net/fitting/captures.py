"""A pair of packet captures, at the sender and at the receiver, as a record of one way: needs the extra ``pcap``."""

import hashlib
from collections import defaultdict, deque
from collections.abc import Iterator
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np

from tis.common.errors import GET_PCAP, DataError, Fault
from tis.common.runtime.scenario_files import read_limited
from tis.common.trace import LOST, MAX_DELAY_NS, Trace
from tis.common.units import NS_PER_MS, NS_PER_S

SUFFIXES: Final = (".pcap", ".pcapng", ".cap")
_MAX_BYTES: Final = 2_000_000_000
_MAX_PACKETS: Final = 5_000_000

Seen = tuple[int, bytes]
"""When a packet was captured, in ns, and a digest of what does not change on its way."""


def captured(sent: Path, received: Path) -> Trace:
    """Return the record of the packets in ``sent`` as they appear in ``received``; raises `DataError`.

    Packets are paired by protocol and transport payload (of TCP also the sequence number), the first unpaired one
    first; addresses and ports may change on the way. Packets sent outside the time that the second capture covers do
    not count. Where the second clock is behind, its stamps are shifted until the shortest delay is 0.
    """
    there, here = _packets(sent), _packets(received)
    waiting: dict[bytes, deque[int]] = defaultdict(deque)
    for place, (_, digest) in enumerate(there):
        waiting[digest].append(place)
    sent_ns = np.array([at for at, _ in there], dtype=np.int64)
    delay_ns = np.full(len(there), LOST, dtype=np.int64)
    found = np.zeros(len(there), dtype=np.bool_)
    for at, digest in here:
        if waiting[digest]:
            place = waiting[digest].popleft()
            delay_ns[place], found[place] = at - sent_ns[place], True
    if not found.any():
        raise DataError(Fault(str(received), "", f"must have packets of {sent}: no payload is in both"))
    first, last = np.flatnonzero(found)[[0, -1]]
    sent_ns, delay_ns, found = sent_ns[first : last + 1], delay_ns[first : last + 1], found[first : last + 1]
    about = {"delay": f"captured in {received.name} after {sent.name}, by the clocks of the two captures"}
    behind_ns = int(delay_ns[found].min())
    if behind_ns < 0:
        delay_ns[found] -= behind_ns
        about["clock"] = f"the second clock is behind: shifted by {-behind_ns / NS_PER_MS:.6g} ms"
    if (worst := int(delay_ns[found].max())) > MAX_DELAY_NS:
        raise DataError(Fault(str(received), "", "must be by the clock of the first capture: an hour apart", worst))
    order = np.argsort(sent_ns, kind="stable")
    sent_ns = sent_ns[order] - sent_ns[order][0]
    return Trace(str(sent), sent_ns, delay_ns[order], about)


def _packets(path: Path) -> list[Seen]:
    if find_spec("dpkt") is None:
        raise DataError(Fault(str(path), "", f"needs the extra pcap: {GET_PCAP}")) from None
    try:
        content = read_limited(path, _MAX_BYTES)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be read: {error.strerror}")) from None
    return parse_capture(content, str(path))


def parse_capture(content: bytes, where: str) -> list[Seen]:
    """Return the packets of a capture that carry a transport payload; raises `DataError` for another file."""
    import dpkt  # an extra

    try:
        found = list(_read(content, where, dpkt))
    except DataError:
        raise
    except Exception as error:  # dpkt documents no closed set of errors for a damaged file
        raise DataError(Fault(where, "", f"must be a capture (pcap or pcapng): {type(error).__name__}")) from None
    if not found:
        raise DataError(Fault(where, "", "must have UDP or TCP packets with a payload"))
    return found


def _read(content: bytes, where: str, dpkt: Any) -> Iterator[Seen]:
    reader = dpkt.pcap.UniversalReader(BytesIO(content))
    layers = {
        dpkt.pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        dpkt.pcap.DLT_LINUX_SLL: dpkt.sll.SLL,
        dpkt.pcap.DLT_LINUX_SLL2: dpkt.sll2.SLL2,
        dpkt.pcap.DLT_NULL: dpkt.loopback.Loopback,
    }
    layer = layers.get(reader.datalink())
    if layer is None and reader.datalink() != dpkt.pcap.DLT_RAW:
        raise DataError(Fault(where, "", "must be of Ethernet, Linux cooked, loopback or raw IP", reader.datalink()))
    for number, (at_s, frame) in enumerate(reader):
        if number >= _MAX_PACKETS:
            raise DataError(Fault(where, "", f"must have at most {_MAX_PACKETS} packets"))
        digest = _digest(frame, layer, dpkt)
        if digest is not None:
            yield round(at_s * NS_PER_S), digest


def _digest(frame: bytes, layer: Any, dpkt: Any) -> bytes | None:
    """Return a digest of a packet's transport payload; None for one without, or cut short by the capture."""
    try:
        packet = (
            layer(frame).data if layer is not None else (dpkt.ip6.IP6 if frame[0] >> 4 == 6 else dpkt.ip.IP)(frame)
        )
        segment = getattr(packet, "data", None)
        if not isinstance(packet, dpkt.ip.IP | dpkt.ip6.IP6) or not isinstance(segment, dpkt.udp.UDP | dpkt.tcp.TCP):
            return None
        payload = bytes(segment.data)
    except (dpkt.UnpackError, IndexError, ValueError):
        return None
    if not payload:
        return None
    number = segment.seq.to_bytes(4, "big") if isinstance(segment, dpkt.tcp.TCP) else b""
    return hashlib.blake2b(number + payload, digest_size=16).digest()
