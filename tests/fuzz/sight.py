"""The screen under hostile fragments with right checksums, and both decoders under damaged frames.

``python -m tests.fuzz.sight --executions 200000`` prints how often what came out. A half of the executions gives a
message to a screen, with fields changed at random; the other half gives a decoder a damaged frame. A screen is whole
while it raises nothing, keeps its memory within bounds, and calls no frame complete that is not.
"""

import struct
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Sequence
from random import Random
from typing import Any, Final
from zlib import crc32

import numpy as np

from tis.common.messages import Header
from tis.common.node import Arrival, Record
from tis.common.scenario.sight import SightPart
from tis.common.sight.codec import Decoder, decoder_of, encoder_of
from tis.common.sight.fragments import MAX_WAITING_BYTES, cut
from tis.common.sight.picture import Scene, draw
from tis.common.sight.stamp import Stamp
from tis.common.sight_records import ScreenNote
from tis.surgeon_side.screen import ScreenNode

SIZE: Final[dict[str, Any]] = {"width": 320, "height": 240, "fragment_bytes": 400}
SCENE: Final = Scene(320, 240, 150, yields=True)
_FIELDS: Final = ("frame", "number", "size", "frame_bytes", "frame_checksum", "captured_ns")
_HEAD: Final = struct.Struct("<4sIIIIIq")
_RENEW: Final = 2000


def encoded(sight: SightPart, n: int = 12) -> list[bytes]:
    """Return the first frames of a scene."""
    encoder = encoder_of(sight)
    path = [((60 + 5 * k, 100 + 4 * k), None) for k in range(n)]
    return [encoder.encode(draw(SCENE, Stamp(k, k), path[: k + 1])).data for k in range(n)]


def hostile(payload: bytes, rng: Random) -> bytes:
    """Return a fragment with some fields changed, and the checksum of what it then is."""
    magic, *fields = _HEAD.unpack_from(payload)
    content = payload[_HEAD.size + 4 :]
    for _ in range(rng.choice((0,) * 90 + (1, 1, 2))):
        at = rng.randrange(len(fields))
        limit = 1 << (62 if at == len(fields) - 1 else 32)
        fields[at] = rng.choice((0, 1, fields[at] ^ 1 << rng.randrange(8), rng.randrange(200), limit - 1)) % limit
    if rng.random() < 0.01:
        content = content[: rng.randrange(len(content) + 1)] + rng.randbytes(rng.randrange(3))
    head = _HEAD.pack(magic, *fields)
    damaged = bytearray(head + struct.pack("<I", crc32(content, crc32(head))) + content)
    if rng.random() < 0.01:
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


class HostileScreen:
    """A screen that gets one hostile fragment after the other."""

    def __init__(self, sight: SightPart, frames: Sequence[bytes], rng: Random) -> None:
        self._sight, self._rng = sight, rng
        self._payloads = [p for k, data in enumerate(frames) for p, _ in cut(k, sight.captured_ns(k), data, 400)]
        self.found: Counter[str] = Counter()
        self._begin()

    def _begin(self) -> None:
        self._screen = ScreenNode("tis", self._sight, decoder_of(self._sight))
        self._now_ns, self._at = 0, 0

    def step(self) -> None:
        """Give it a fragment, in order or not, and look at what it says."""
        rng, screen = self._rng, self._screen
        self._now_ns += rng.choice((0, 100_000, 5_000_000))
        which = self._at if rng.random() < 0.97 else rng.randrange(len(self._payloads))
        self._at = (self._at + 1) % len(self._payloads)
        payload = hostile(self._payloads[which], rng)
        run_id = 0 if rng.random() < 0.98 else 5
        header = Header(which, self._now_ns, run_id).pack()
        records = list(screen.receive(Arrival("west", "tis/ECM/video", payload, header, self._now_ns)))
        due_ns = screen.next_wake_ns()
        if due_ns is not None and due_ns <= self._now_ns:
            records += [one for one in screen.wake(self._now_ns) if isinstance(one, Record)]
        self._check([one.data for one in records if isinstance(one, Record) and isinstance(one.data, ScreenNote)])
        if self._at == 0 or self.found.total() % _RENEW == 0:
            screen.finish(self._now_ns)
            self.found += Counter(screen.counters())
            self._begin()

    def _check(self, notes: Sequence[ScreenNote]) -> None:
        assert sum(len(part) for one in self._screen.frames.waiting.values() for part in one.parts.values()) < (
            MAX_WAITING_BYTES
        )
        for note in notes:
            self.found[note.state] += 1
            if note.state == "complete":
                assert not note.missing
                assert note.fragments == note.expected
                assert self._sight.is_external or {note.top_frame, note.bottom_frame} <= {note.frame, None}


def damaged(sight: SightPart, decoder: Decoder, frames: Sequence[bytes], rng: Random) -> str:
    """Give a decoder a frame with bytes changed and parts missing; return what came out."""
    data = bytearray(rng.choice(frames))
    for _ in range(rng.choice((0, 1, 5, 50))):
        data[rng.randrange(len(data))] = rng.randrange(256)
    begin = rng.choice((0, 0, rng.randrange(len(data))))
    end = rng.choice((len(data), rng.randrange(begin, len(data)) + 1))
    stretches = [(begin, bytes(data[begin:end]))]
    if end + 9 < len(data):
        stretches.append((end + 9, bytes(data[end + 9 :])))
    found = decoder.decode(stretches, len(data))
    assert found is None or (sight.is_of_size(*found.shape[1::-1]) and found.dtype == np.uint8)
    return "no picture" if found is None else "picture"


def fuzz(n: int, seed: int) -> Counter[str]:
    """Do ``n`` executions; return how often what came out."""
    found: Counter[str] = Counter()
    rng = Random(seed)
    drawn = [SightPart(codec=codec, **SIZE) for codec in ("jpeg", "h264")]
    foreign = [
        SightPart(camera="external", codec=sight.codec, fragment_bytes=sight.fragment_bytes) for sight in drawn
    ]
    kinds = [*drawn, *foreign]
    each = [(sight, encoded(source)) for sight, source in zip(kinds, [*drawn, *drawn], strict=True)]
    screens = [HostileScreen(sight, frames, rng) for sight, frames in each]
    decoders = [decoder_of(sight) for sight in kinds]
    names = [f"external {sight.codec}" if sight.is_external else sight.codec for sight in kinds]
    for k in range(n):
        which = k // 2 % len(kinds)
        if k % 2:
            screens[which].step()
        else:
            found[f"{names[which]}: {damaged(kinds[which], decoders[which], each[which][1], rng)}"] += 1
    for name, screen in zip(names, screens, strict=True):
        found += Counter({f"{name} screen: {what}": value for what, value in screen.found.items()})
    return found


def main() -> None:
    """Fuzz, and print what came out."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--executions", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for name, value in sorted(fuzz(asked.executions, asked.seed).items()):
        print(f"{value:9d}  {name}")  # noqa: T201


if __name__ == "__main__":
    main()
