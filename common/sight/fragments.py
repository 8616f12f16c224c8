"""Frames as messages of bounded size, and frames put together from messages that arrive in any order, or not at all.

A fragment says of which frame it is, which part, and has a checksum of its own: nothing of it is believed before.
"""

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal, NamedTuple
from zlib import crc32

from tis.common.messages import Fragment

MAX_FRAME_BYTES: Final = 8 << 20
MAX_WAITING_BYTES: Final = 64 << 20
"""Memory of frames that wait for their last fragments: their bytes, and what Python needs for each fragment."""
_OBJECT_BYTES: Final = 100

_LAYOUT: Final = struct.Struct("<4sIIIIIq")
_CHECKSUM: Final = struct.Struct("<I")
FRAGMENT_HEAD_BYTES: Final = _LAYOUT.size + _CHECKSUM.size
_MAGIC: Final = b"tiv\x01"  # the last byte is the version of the layout
_MAX_SIZE: Final = 65_000
_MAX_STAMP: Final = 1 << 62


class Part(NamedTuple):
    """A fragment: of ``frame``, whose ``frame_bytes`` are cut into parts of ``size``, the part ``number``, from 0."""

    frame: int
    number: int
    size: int
    frame_bytes: int
    frame_checksum: int
    captured_ns: int
    checksum: int
    content: bytes

    @property
    def n_fragments(self) -> int:
        """Return the number of the frame's fragments."""
        return -(-self.frame_bytes // self.size)

    def note(self) -> Fragment:
        """Return what a log holds of it."""
        return Fragment(
            sample_ns=self.captured_ns,
            frame=self.frame,
            index=self.number,
            n_fragments=self.n_fragments,
            frame_bytes=self.frame_bytes,
            checksum=self.checksum,
        )


def cut(frame: int, captured_ns: int, data: bytes, size: int) -> Iterator[tuple[bytes, Fragment]]:
    """Yield the payloads of a frame's messages, each with what a log holds of it; raises `ValueError` for no frame.

    ``size`` is the number of the frame's bytes in a message, at most 65 000.
    """
    if not 0 < len(data) <= MAX_FRAME_BYTES or not 0 < size <= _MAX_SIZE:
        raise ValueError(f"a frame has 1 to {MAX_FRAME_BYTES} bytes, a fragment 1 to {_MAX_SIZE}")
    whole = crc32(data)
    for index, begin in enumerate(range(0, len(data), size)):
        content = data[begin : begin + size]
        head = _LAYOUT.pack(_MAGIC, frame, index, size, len(data), whole, captured_ns)
        checksum = crc32(content, crc32(head))
        part = Part(frame, index, size, len(data), whole, captured_ns, checksum, content)
        yield head + _CHECKSUM.pack(checksum) + content, part.note()


def parse(payload: bytes) -> Part | None:
    """Return the fragment in a payload; None for anything else, and for one that is damaged."""
    if len(payload) <= FRAGMENT_HEAD_BYTES or not payload.startswith(_MAGIC):
        return None
    head, content = payload[: _LAYOUT.size], payload[FRAGMENT_HEAD_BYTES:]
    (checksum,) = _CHECKSUM.unpack_from(payload, _LAYOUT.size)
    if crc32(content, crc32(head)) != checksum:
        return None
    _, frame, number, size, frame_bytes, whole, captured_ns = _LAYOUT.unpack(head)
    part = Part(frame, number, size, frame_bytes, whole, captured_ns, checksum, content)
    is_sound = 0 < part.size <= _MAX_SIZE and 0 < part.frame_bytes <= MAX_FRAME_BYTES
    is_sound = is_sound and part.number < part.n_fragments and 0 <= part.captured_ns <= _MAX_STAMP
    return part if is_sound and len(content) == min(part.size, part.frame_bytes - part.number * part.size) else None


@dataclass
class Assembly:
    """A frame of which fragments have arrived."""

    first: Part
    first_ns: int
    last_ns: int
    parts: dict[int, bytes] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        """Tell whether all fragments are there."""
        return len(self.parts) == self.first.n_fragments

    def stretches(self) -> list[tuple[int, bytes]]:
        """Return what is there of the frame: each stretch without a gap, with its first byte's number."""
        found: list[tuple[int, list[bytes]]] = []
        before = -2
        for index in sorted(self.parts):
            if index != before + 1:
                found.append((index * self.first.size, []))
            found[-1][1].append(self.parts[index])
            before = index
        return [(begin, b"".join(each)) for begin, each in found]

    @property
    def is_as_sent(self) -> bool:
        """Tell whether the frame is complete and has the checksum that all its fragments state."""
        return self.is_complete and crc32(self.stretches()[0][1]) == self.first.frame_checksum

    def missing(self) -> str:
        """Return the numbers of the fragments that are not there, like 0-2,5 (inverse: `numbers_in`)."""
        # from gap to gap: a forged frame may claim millions of fragments
        bounds = [-1, *sorted(self.parts), self.first.n_fragments]
        gaps = [(low + 1, high - 1) for low, high in pairwise(bounds) if high > low + 1]
        return ",".join(str(low) if low == high else f"{low}-{high}" for low, high in gaps)


Fate = Literal["new", "duplicated", "forged", "late"]


@dataclass
class Reassembly:
    """Frames in the making: each fragment once, none of a frame that was taken, memory within bounds.

    ``counts`` has the fragments by their fate; ``reordered`` those that came behind one with a later number.
    """

    waiting: dict[int, Assembly] = field(default_factory=dict)
    counts: Counter[Fate] = field(default_factory=Counter)
    n_reordered: int = 0
    next_frame: int | None = 0
    """The frame to be taken next; None: the one that comes first."""
    _newest: tuple[int, int] = (-1, -1)
    _n_bytes: int = 0

    def take(self, part: Part, recv_ns: int) -> Fate:
        """Put a fragment in its place; return what became of it.

        Of two fragments that contradict each other the first is believed, the other is forged.
        """
        fate = self._place(part, recv_ns)
        self.counts[fate] += 1
        at = part.frame, part.number
        if fate == "new":
            self.n_reordered += at < self._newest
            self._newest = max(self._newest, at)
        return fate

    def _place(self, part: Part, recv_ns: int) -> Fate:
        if self.next_frame is None:
            self.next_frame = part.frame
        if part.frame < self.next_frame:
            return "late"
        known, cost = self.waiting.get(part.frame), len(part.content) + _OBJECT_BYTES
        if known is None:
            if self._n_bytes + cost > MAX_WAITING_BYTES:
                return "forged"
            known = self.waiting[part.frame] = Assembly(part, recv_ns, recv_ns)
        first = known.first
        if part[2:6] != first[2:6]:
            return "forged"
        before = known.parts.get(part.number)
        if before is not None:
            return "duplicated" if before == part.content else "forged"
        if self._n_bytes + cost > MAX_WAITING_BYTES:
            return "forged"
        known.parts[part.number] = part.content
        known.last_ns = max(known.last_ns, recv_ns)
        self._n_bytes += cost
        return "new"

    def ready(self) -> bool:
        """Tell whether the next frame is to be taken.

        It is complete, or given up: a later one is complete, or one after the following has begun.
        """
        if self.next_frame is None:
            return False
        own = self.waiting.get(self.next_frame)
        if own is not None and own.is_complete:
            return True
        return any(
            frame > self.next_frame and (frame > self.next_frame + 1 or one.is_complete)
            for frame, one in self.waiting.items()
        )

    def pop(self) -> tuple[int, Assembly | None]:
        """Return the next frame's number, and what is there of it; None for nothing."""
        frame = self.next_frame or 0
        self.next_frame = frame + 1
        found = self.waiting.pop(frame, None)
        if found is not None:
            self._n_bytes -= sum(len(part) + _OBJECT_BYTES for part in found.parts.values())
        return frame, found


def numbers_in(text: str, n: int) -> list[int]:
    """Return the numbers below ``n`` that a text like 0-2,5 names; raises `ValueError` where it names none."""
    ends = [one.split("-") for one in text.split(",") if one]
    return [number for one in ends for number in range(int(one[0]), min(int(one[-1]) + 1, n))]


def received(data: bytes, missing: str, n_fragments: int, size: int) -> list[tuple[int, bytes]]:
    """Return the stretches of a frame that arrived, from the frame as sent and a log's list of what did not."""
    absent = set(numbers_in(missing, n_fragments))
    part = Part(0, 0, size, len(data), 0, 0, 0, b"")
    parts = {i: data[i * size : (i + 1) * size] for i in range(n_fragments) if i not in absent}
    return Assembly(part, 0, 0, parts).stretches()
