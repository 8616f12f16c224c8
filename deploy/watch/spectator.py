"""The surgeon's screen, for a program that only listens: the newest picture, and the share that is whole.

The spectator puts the frames together as the screen does, by a screen of its own. It has no part in the run's clock:
it shows a picture as soon as it is decoded, and not at a refresh.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from tis.common.channels import VIDEO
from tis.common.messages import Header
from tis.common.node import Arrival, Record
from tis.common.scenario.sight import SightPart
from tis.common.sight.codec import Decoder, decoder_of
from tis.common.sight.fragments import parse
from tis.common.sight.stamp import Picture
from tis.common.sight_records import FrameState, ScreenNote
from tis.surgeon_side.screen import ScreenNode

JUDGED_FRAMES_S: Final = 2
"""Seconds of frames of which the share that came whole is told."""


class Shown(NamedTuple):
    """A picture as it was decoded; of the last ``n`` frames ``n_whole`` came whole. ``number`` counts pictures.

    Where no picture so far had a stamp (``is_stamped``), as of a camera of others, none tells which command it shows,
    nor whether it is torn.
    """

    number: int
    frame: int
    state: FrameState
    captured_ns: int
    picture: Picture
    n_whole: int
    n: int
    is_stamped: bool


@dataclass
class Spectator:
    """Takes the messages of the picture as they come, of one run after the other; ``shown`` is the newest picture."""

    session: str
    sight: SightPart
    decoder: Callable[[SightPart], Decoder] = decoder_of
    shown: Shown | None = None
    _screen: ScreenNode | None = None
    _ahead_ns: int = 0
    """Run time less the spectator's clock, by the newest instant of capture that was believed."""
    _captured_ns: dict[int, int] = field(default_factory=dict)
    _whole: deque[bool] = field(init=False)
    _is_stamped: bool = False

    def __post_init__(self) -> None:
        self._whole = deque(maxlen=JUDGED_FRAMES_S * self.sight.fps)

    def take(self, payload: bytes, attachment: bytes, at_ns: int) -> None:
        """Take a message that came at ``at_ns`` of the spectator's clock. Oracle: frames cut by hand."""
        header, part = Header.unpack(attachment), parse(payload)
        if header is None or part is None:
            return
        if self._screen is None or header.run_id != self._screen.run_id:
            self._begin(header.run_id, part.captured_ns, at_ns)
        screen = self._screen
        assert screen is not None
        if part.frame >= (screen.frames.next_frame or 0):
            self._captured_ns.setdefault(part.frame, part.captured_ns)
        key, recv_ns = VIDEO.key(self.session), at_ns + self._ahead_ns
        screen.receive(Arrival("west", key, payload, attachment, recv_ns))
        if screen.next_wake_ns() is not None:
            self._ahead_ns = max(self._ahead_ns, part.captured_ns - at_ns)
            for record in screen.wake(recv_ns):
                if isinstance(record, Record) and isinstance(record.data, ScreenNote):
                    self._note(record.data, screen)

    def restart(self) -> None:
        """Begin anew with the next message, as where some were not taken."""
        self._screen = None

    def _begin(self, run_id: int, captured_ns: int, at_ns: int) -> None:
        self._screen = ScreenNode(self.session, self.sight, self.decoder(self.sight))
        self._screen.join(run_id, max(captured_ns, 1))
        self._ahead_ns = captured_ns - at_ns
        self._captured_ns.clear()
        self._whole.clear()
        self._is_stamped = not self.sight.is_external

    def _note(self, note: ScreenNote, screen: ScreenNode) -> None:
        self._whole.append(note.state == "complete")
        captured_ns = self._captured_ns.pop(note.frame, None)
        if note.shown_ns is None or captured_ns is None or screen.picture is None:
            return
        number = 1 if self.shown is None else self.shown.number + 1
        n_whole, n = sum(self._whole), len(self._whole)
        self._is_stamped |= note.top_frame is not None or note.bottom_frame is not None
        told = note.frame, note.state, captured_ns, screen.picture, n_whole, n, self._is_stamped
        self.shown = Shown(number, *told)
        # of frames that were refused nothing is kept
        self._captured_ns = {frame: ns for frame, ns in self._captured_ns.items() if frame > note.frame}
