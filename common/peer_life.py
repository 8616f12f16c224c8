"""Judgement of the other sides by their beats: ended, standing still, out of reach, or back again. Pure.

Each side sends a beat a few times a second, apart from its data and outside the emulated network. A beat holds the
sender's clock and the last turn of its loop. The judge asks at each look; a look after a pause of its own counts the
pause as nobody's silence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Final, Literal, NamedTuple

from msgspec import Meta
from msgspec import field as struct_field

from tis.common.channels import Side
from tis.common.messages import Message
from tis.common.units import NS_PER_MS, NS_PER_S

Alarm = Literal["conflict", "foreign_set_point", "foreign_release", "stop_flood", "forged", "unsigned_stop"]
"""Evidence that somebody attacks: of forged samples, of set points, releases, stops and floods that are not ours."""

NO_ALARMS: Final[Mapping[Alarm, int]] = MappingProxyType({})

Event = Literal[
    "left", "frozen", "link_down", "silent", "back", "stalled", "resumed", "clock_step", "suspended", "conflict",
    "foreign_set_point", "foreign_release", "stop_flood", "foreign_beat", "forged",
    "unsigned_stop",
]  # fmt: skip

View = Literal["left", "frozen", "link_down", "silent"]
"""netem's view of a side that is not well."""

BEAT_EVERY_NS: Final = 200 * NS_PER_MS
_MAX_SILENCE_NS: Final = NS_PER_S
"""Five beats: without any of them a side counts as silent, so it is told within two seconds."""
_MAX_SILENCE_BEYOND_NS: Final = 1_400 * NS_PER_MS
"""The same for a side behind netem, so that netem's own judgement comes first."""
_BLIND_NS: Final = 2 * NS_PER_S
"""After a silence beats that were held up come late, which is no step of a clock."""
_MAX_STALL_NS: Final = NS_PER_S
_MIN_STEP_NS: Final = NS_PER_S // 2
"""Smallest step of a clock that is told; beats of a busy host come later by less."""
_RANK: Final[dict[View, int]] = {"silent": 0, "frozen": 1, "link_down": 2, "left": 3}
_N_BEATS: Final = 5
_MIN_STEPPED_NS: Final = 4 * BEAT_EVERY_NS
"""A step of a clock shows in so many beats in a row, over so long: a flood of forged ones is no step."""
_N_CONTRADICTED: Final = 2
"""Beats that are ahead, each followed by one that is not: a clock does not step forth and back."""
MAX_RUN_ID: Final = (1 << 32) - 1
_MAX_DRIFT_NS: Final = NS_PER_MS
"""By which a clock may fall behind from beat to beat, far more than any does."""
_MAX_STAMP_NS: Final = 1 << 60
"""Size of the largest instant: 36 years. Differences of differences still fit a log."""

Stamp = Annotated[int, Meta(ge=-_MAX_STAMP_NS, le=_MAX_STAMP_NS)]


class Beat(Message, frozen=True):
    """A sign of life of one side."""

    side: Annotated[Side, Meta(description="Side that sends it.")]
    at_ns: Annotated[Stamp, Meta(description="Its run time, in ns.")]
    loop_ns: Annotated[Stamp, Meta(description="Run time of its loop's last turn, in ns.")]
    run_id: Annotated[int, Meta(ge=0, le=MAX_RUN_ID, description="The run; 0: none yet.")] = 0
    doing: Annotated[
        str, Meta(max_length=200, description="What the loop does in this turn, where that may take long.")
    ] = ""
    views: Annotated[
        dict[Side, View], Meta(max_length=3, description="What netem knows of other sides that are not well.")
    ] = struct_field(default_factory=dict)
    alarms: Annotated[
        dict[Alarm, Stamp],
        Meta(
            max_length=8,
            description="What the side has evidence of, and the run time at which it began, in ns. conflict: samples "
            "of the surgeon came in two versions; foreign_set_point: somebody else sends set points; "
            "foreign_release: a release came from another than the stopper; stop_flood: requests to stop or to "
            "release flood it; forged: messages that nobody of the run has signed; unsigned_stop: a stop that nobody "
            "has signed, which was carried out.",
        ),
    ] = struct_field(default_factory=dict)
    ticks_missed: Annotated[
        Annotated[int, Meta(ge=0, le=_MAX_STAMP_NS)] | None,
        Meta(description="Its ticks that had not begun when the next one was due, so far."),
    ] = None


class Change(NamedTuple):
    """A change in the life of a peer; ``for_ns`` is how long it has been so, or how far its clock stepped."""

    peer: Side
    event: Event
    at_ns: int
    for_ns: int
    doing: str = ""


@dataclass
class _Away:
    """Beats in a row whose offset is not the usual one."""

    is_ahead: bool
    since_ns: int
    n: int = 0


@dataclass
class PeerLife:
    """Life of one other side, as this side sees it. Oracle: test_peer_life, by literal times.

    ``silence`` is the reason of a silence that has been told, ``silent_ns`` when it began; ``stalled_ns`` is when a
    stall that has been told began.
    """

    peer: Side
    is_neighbour: bool = True
    heard_ns: int | None = None
    silence: View | None = None
    silent_ns: int = 0
    stalled_ns: int | None = None
    has_left: bool = False
    _offset_ns: int | None = None
    _n_known: int = 0
    _away: "_Away | None" = None
    _n_contradicted: int = 0
    _is_forged: bool = False
    _blind_until_ns: int = -(1 << 62)
    _beat: Beat | None = None
    _alarms: set[Alarm] = field(default_factory=set)
    _raised: list[Change] = field(default_factory=list)
    _steps: list[Change] = field(default_factory=list)

    def hear(self, beat: Beat, now_ns: int) -> None:
        """Take a beat that arrived at ``now_ns``."""
        if self.silence is None and now_ns >= self._blind_until_ns:
            self._judge_clock(beat.at_ns - now_ns, now_ns)
        else:
            self._offset_ns = self._away = None
        for alarm, begun_ns in beat.alarms.items():
            if alarm not in self._alarms:
                self._alarms.add(alarm)
                self._raised.append(Change(self.peer, alarm, begun_ns, 0))
        self.heard_ns, self._beat = now_ns, beat

    def forged(self, now_ns: int) -> None:
        """Take note that somebody else sends beats of this side."""
        if not self._is_forged:
            self._is_forged = True
            self._raised.append(Change(self.peer, "foreign_beat", now_ns, 0))

    def _judge_clock(self, offset_ns: int, now_ns: int) -> None:
        """Judge the peer's clock by the offset of a beat: a late one is below, and only a step can be far above."""
        usual_ns = self._offset_ns
        if usual_ns is None or self._n_known < _N_BEATS:
            self._offset_ns = offset_ns if usual_ns is None else max(offset_ns, usual_ns)
            self._n_known = 1 if usual_ns is None else self._n_known + 1
            return
        is_ahead = offset_ns > usual_ns + _MIN_STEP_NS
        if not is_ahead and offset_ns > usual_ns - _MIN_STEP_NS:  # as always
            if self._away is not None and self._away.is_ahead:
                self._n_contradicted += 1
                if self._n_contradicted >= _N_CONTRADICTED:
                    self.forged(now_ns)
            self._away = None
            self._offset_ns = max(offset_ns, usual_ns - _MAX_DRIFT_NS)
            return
        if self._away is None or self._away.is_ahead != is_ahead:
            self._away = _Away(is_ahead, now_ns)
        self._away.n += 1
        if self._away.n >= _N_BEATS and now_ns - self._away.since_ns >= _MIN_STEPPED_NS:
            self._steps.append(Change(self.peer, "clock_step", now_ns, offset_ns - usual_ns))
            self._offset_ns, self._away = offset_ns, None

    def pause(self, paused_ns: int, now_ns: int) -> None:
        """Take note that this side stood still until now, for so long: nobody was silent meanwhile."""
        self._blind_until_ns = now_ns + _BLIND_NS
        self._steps.clear()
        if self.heard_ns is not None:
            self.heard_ns = min(now_ns, self.heard_ns + paused_ns)

    def look(self, now_ns: int, is_present: bool, link_is_down: bool | None, view: View | None) -> list[Change]:
        """Return what has changed.

        Parameters
        ----------
        now_ns
            Run time of the look.
        is_present
            Whether the side's token is present.
        link_is_down
            Whether sent bytes stay without acknowledgement; None: not known.
        view
            What netem says of this side; None: it is well, or this side's own neighbour.
        """
        found, self._steps, self._raised = self._steps + self._raised, [], []
        if self.heard_ns is None:  # its beats count from the first look
            self.heard_ns = now_ns
        if not is_present and not self.has_left:
            self.has_left, self.silent_ns = True, self.heard_ns
            return [*found, Change(self.peer, "left", now_ns, now_ns - self.heard_ns)]
        if self.has_left:
            if not is_present or self.heard_ns <= self.silent_ns:  # one that only waits for a run does not beat
                return found
            self.has_left, self.silence = False, None
            return [*found, Change(self.peer, "back", now_ns, now_ns - self.silent_ns)]
        return [*found, *self._silence(now_ns, link_is_down, view), *self._stall(now_ns)]

    def _silence(self, now_ns: int, link_is_down: bool | None, view: View | None) -> Sequence[Change]:
        if self.heard_ns is None:
            return ()
        quiet_ns = now_ns - self.heard_ns
        if quiet_ns <= (_MAX_SILENCE_NS if self.is_neighbour else _MAX_SILENCE_BEYOND_NS):
            if self.silence is None:
                return ()
            self._blind_until_ns = now_ns + _BLIND_NS
            lasted_ns = self.heard_ns - self.silent_ns
            self.silence = None
            return (Change(self.peer, "back", now_ns, lasted_ns),)
        known: dict[bool | None, View] = {True: "link_down", False: "frozen", None: "silent"}
        event = view or known[link_is_down]
        if self.silence is None:
            self.silent_ns = self.heard_ns
        elif _RANK[event] <= _RANK[self.silence]:  # the reason may show later than the silence
            return ()
        self.silence = event
        return (Change(self.peer, event, now_ns, quiet_ns),)

    def _stall(self, now_ns: int) -> Sequence[Change]:
        beat = self._beat
        if beat is None or self.silence is not None:
            return ()
        stall_ns = beat.at_ns - beat.loop_ns
        if stall_ns > _MAX_STALL_NS and self.stalled_ns is None:
            self.stalled_ns = beat.loop_ns
            return (Change(self.peer, "stalled", now_ns, stall_ns, beat.doing),)
        if stall_ns <= _MAX_STALL_NS and self.stalled_ns is not None:
            lasted_ns = beat.loop_ns - self.stalled_ns
            self.stalled_ns = None
            return (Change(self.peer, "resumed", now_ns, lasted_ns),)
        return ()

    def quiet_ns(self, now_ns: int) -> int:
        """Return how long nothing has been heard; 0 before the first beat."""
        return 0 if self.heard_ns is None else now_ns - self.heard_ns


TEXTS: Final[dict[Event, str]] = {
    "left": "left, and this side goes on without it",
    "frozen": "stands still: its host answers, its process does not",
    "link_down": "cannot be reached: the network between the hosts does not carry anything",
    "silent": "is silent",
    "back": "is back after {s} s",
    "stalled": "does not tick: its loop has been in one step for {s} s{doing}",
    "resumed": "ticks again after {s} s",
    "clock_step": "has a clock that stepped by {s} s",
    "suspended": "was suspended with its host for {s} s",
    "conflict": "receives samples of the surgeon in two versions: somebody forges them (patient.gate.on_conflict)",
    "foreign_set_point": "hears set points for its arm that somebody else sends",
    "foreign_release": "was released from an emergency stop by somebody without its token (patient.safety.release)",
    "stop_flood": "is flooded with requests to stop or to release",
    "forged": "receives messages that the other side has not signed: somebody forges or alters them",
    "unsigned_stop": "was stopped by a request that nobody has signed, which stops all the same",
    "foreign_beat": "has signs of life that it did not send: somebody forges them",
}


def described(change: Change, by: Side) -> str:
    """Return a change as a sentence for the user, as the side ``by`` tells it."""
    if change.peer == by and change.event == "frozen":
        return f"this process stood still for {change.for_ns / NS_PER_S:.1f} s, until {change.at_ns / NS_PER_S:.1f} s"
    sign = "+" if change.event == "clock_step" else ""
    seconds = f"{change.for_ns / NS_PER_S:{sign}.1f}"
    text = TEXTS[change.event].format(s=seconds, doing=f", {change.doing}" if change.doing else "")
    return f"{change.peer} {text}, at {change.at_ns / NS_PER_S:.1f} s"
