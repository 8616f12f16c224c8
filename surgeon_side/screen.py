"""The screen: it puts the frames together, decodes them in their order, reads their stamps, and shows the newest.

A frame is decoded when it is complete, or given up (`tis.common.sight.fragments`). The picture that is newest at a
refresh of the display is shown from then on.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from msgspec.structs import replace as replaced

from tis.common.channels import VIDEO, HandChannels, Network
from tis.common.messages import Fragment, Header, encode
from tis.common.node import Arrival, Output, Record
from tis.common.records import COUNTERS, REJECTED, CounterNote, Rejected
from tis.common.scenario import Scenario
from tis.common.scenario.sight import SightPart
from tis.common.sight.codec import Decoder, decoder_of
from tis.common.sight.fragments import Assembly, Part, Reassembly, parse
from tis.common.sight.stamp import Picture, Stamp, read_stamps
from tis.common.sight_records import SCREEN, FrameState, ScreenNote
from tis.common.signing import RunKeys
from tis.common.units import NS_PER_S, ms_to_ns

_MAX_LEAD_NS: Final = NS_PER_S
_N_LOGGED: Final = 1000
"""Refused messages that are logged, of a flood."""


def frame_state(
    frame: int, assembly: Assembly | None, picture: Picture | None, stamps: tuple[Stamp | None, Stamp | None],
    is_damaged: bool, is_external: bool = False,
) -> FrameState:  # fmt: skip
    """Return what became of a frame; ``is_damaged``: something that it refers to did not arrive.

    A picture without any stamp is taken for one of a camera that makes none. An external camera counts by itself:
    its stamps need not name the frame.
    """
    if assembly is None:
        return "lost"
    if picture is None:
        return "undecodable"
    top, bottom = stamps
    is_of_another = not is_external and any(one is not None and one.frame != frame for one in stamps)
    if is_of_another or (top and bottom and top != bottom):
        return "torn"
    if is_damaged or not assembly.is_as_sent or (top is None) != (bottom is None):
        return "concealed"
    return "complete"


@dataclass
class ScreenNode:
    """Takes the picture's fragments as they come; wakes at those refreshes only that have something new to show."""

    session: str
    sight: SightPart
    decoder: Decoder
    name: str = "screen"
    run_id: int = 0
    frames: Reassembly = field(default_factory=Reassembly)
    keys: RunKeys | None = None
    """What tells that a fragment is signed by the patient; None: fragments are not signed."""
    picture: Picture | None = None
    """What is shown now; None before the first frame."""

    def __post_init__(self) -> None:
        self._key = VIDEO.key(self.session)
        self._counts: Counter[str] = Counter()
        self._waiting: list[tuple[ScreenNote, Picture | None]] = []
        self._refresh: int | None = None

    def join(self, run_id: int, from_ns: int = 0, epoch_unix_ns: int = 0) -> None:  # noqa: ARG002
        """Take fragments of this run only, and miss no frame from before ``from_ns``.

        A screen that comes late begins with the frame that comes first, as a camera that missed some numbers fewer.
        """
        self.run_id = run_id
        self.frames.next_frame = None if from_ns else 0

    def believe(self, own: bytes, other: bytes) -> None:
        """Use only fragments that are signed under the patient's key, ``other``."""
        self.keys = self.keys or RunKeys()
        self.keys.agree(own, other)

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the key of the picture."""
        return [("west", self._key)]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return no key."""
        return ()

    def next_wake_ns(self) -> int | None:
        """Return the instant of the refresh that shows what is decoded; None for nothing new."""
        return None if self._refresh is None else self.sight.refresh_ns(self._refresh)

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Put a fragment in its place, and decode the frames that are complete or given up."""
        header = Header.unpack(arrival.attachment)
        is_ours = header is not None and header.run_id == self.run_id
        if header is None or not is_ours or not abs(header.sent_ns) <= arrival.recv_ns + _MAX_LEAD_NS:
            return self._refuse(arrival, "forged", "the attachment is not of this run")
        part = parse(arrival.payload)
        if part is None:
            return self._refuse(arrival, "corrupted", "the payload is no whole fragment")
        if self.keys is not None and self.keys.fault(arrival.key, arrival.attachment, arrival.payload) is not None:
            return self._refuse(arrival, "forged", "the patient has not signed it")
        if not self._can_be(part, arrival.recv_ns):
            return self._refuse(arrival, "forged", "its frame cannot have been captured yet")
        fate = self.frames.take(part, arrival.recv_ns)
        if fate == "forged":
            return self._refuse(arrival, "forged", "it contradicts its frame's other fragments")
        if fate == "new":
            while self.frames.ready():
                self._decode(arrival.recv_ns, *self.frames.pop())
        content = encode(part.note())
        return [Record(arrival.key, arrival.recv_ns, content, Fragment, header.sent_ns, header.seq)]

    def _can_be(self, part: Part, recv_ns: int) -> bool:
        """Tell whether a frame of this number can have been captured by now, at its rate."""
        by_now_ns = recv_ns + _MAX_LEAD_NS
        # what an external camera says of a capture may be late, and its frames are numbered as they come
        of_number_ns = by_now_ns if self.sight.is_external else part.captured_ns
        return part.captured_ns <= by_now_ns and part.frame <= self.sight.last_frame(of_number_ns)

    def _refuse(self, arrival: Arrival, kind: str, reason: str) -> Sequence[Record]:
        self._counts[kind] += 1
        if self._counts.total() > _N_LOGGED:
            return ()
        note = Rejected(key=arrival.key, recv_ns=arrival.recv_ns, reason=reason, head_hex=arrival.payload[:32].hex())
        return [Record(REJECTED, arrival.recv_ns, note)]

    def _decode(self, now_ns: int, frame: int, assembly: Assembly | None) -> None:
        """Decode what is there of a frame; its record waits for the next refresh."""
        stretches, n_bytes = ([], 0) if assembly is None else (assembly.stretches(), assembly.first.frame_bytes)
        picture = self.decoder.decode(stretches, n_bytes)
        stamps = (None, None) if picture is None else read_stamps(picture)
        top, bottom = (one or (None, None) for one in stamps)
        note = ScreenNote(
            frame=frame,
            state=frame_state(frame, assembly, picture, stamps, not self.decoder.is_sound, self.sight.is_external),
            top_frame=top[0],
            top_command=top[1],
            bottom_frame=bottom[0],
            bottom_command=bottom[1],
            first_ns=None if assembly is None else assembly.first_ns,
            last_ns=None if assembly is None else assembly.last_ns,
            shown_ns=None,
            fragments=0 if assembly is None else len(assembly.parts),
            expected=None if assembly is None else assembly.first.n_fragments,
            missing="" if assembly is None else assembly.missing(),
        )
        self._waiting.append((note, picture))
        if self._refresh is None:
            after_ns = max(now_ns - ms_to_ns(self.sight.display_phase_ms), 0)
            self._refresh = -(-after_ns * self.sight.display_hz // NS_PER_S)

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Show the newest picture."""
        newest = max((i for i, (_, picture) in enumerate(self._waiting) if picture is not None), default=None)
        if newest is not None:
            note, self.picture = self._waiting[newest]
            self._waiting[newest] = replaced(note, shown_ns=now_ns), self.picture
        self._refresh = None
        return self._told(now_ns)

    def _told(self, now_ns: int) -> list[Record]:
        told, self._waiting = self._waiting, []
        return [Record(SCREEN, now_ns, note) for note, _ in told]

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Decode what is left, and return the last records and the counters."""
        while self.frames.waiting:
            self._decode(now_ns, *self.frames.pop())
        counters = [CounterNote(name=name, value=n) for name, n in self.counters().items()]
        return [*self._told(now_ns), *(Record(COUNTERS, now_ns, one) for one in counters)]

    def counters(self) -> dict[str, int]:
        """Return the numbers of fragments by what became of them."""
        counts, frames = self._counts, self.frames
        return {
            "video_received": frames.counts["new"],
            "video_duplicated": frames.counts["duplicated"],
            "video_reordered": frames.n_reordered,
            "video_corrupted": counts["corrupted"],
            "video_forged": counts["forged"],
            "video_late": frames.counts["late"],
        }


def build_screen(scenario: Scenario, hands: Sequence[HandChannels] = ()) -> ScreenNode:  # noqa: ARG001
    """Return the screen of a scenario with sight, which is the same whatever hands there are."""
    assert scenario.sight is not None
    return ScreenNode(scenario.session, scenario.sight, decoder_of(scenario.sight))
