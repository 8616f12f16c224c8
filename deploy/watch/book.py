"""Bounded tables of an observer of both networks, extended with each message."""

from collections import defaultdict, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple, TypeVar

import numpy as np
from msgspec import DecodeError

from tis.common.channels import DESTINATION, ORIGIN, SIDE_ON, Network, Side, is_set_point, local_keys, stopped_key
from tis.common.messages import FeedbackPose, Header, Pose, components, decode, position_m
from tis.common.peer_life import Alarm, Beat
from tis.common.runtime.control import ControlKeys
from tis.common.stop_messages import StopState
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.watch.arms import ArmMotion, Displays, Place, TrackRow, Trail
from tis.deploy.watch.forces import Forces
from tis.deploy.watch.live_figures import LiveFigures, live_figures
from tis.deploy.watch.safety import SafetyStates
from tis.deploy.watch.streams import STREAM_OF, Crossing, Crossings, Stream, StreamName, watched_streams
from tis.patient_side.rotations import unit

WINDOW_S: Final = 5
MISSING: Final[tuple[Side, ...]] = ("surgeon", "patient")
"""The sides that tick, in the order in which they are told."""

_SILENT_NS: Final = 2 * NS_PER_S
"""Time without an arrival after which figures of what arrived are of the past, and are not told."""

_ALL_HEARD_NS: Final = 2 * NS_PER_S
"""Time after the first message on a network after which all keys there are heard, however busy the machine."""

_MAX_ROWS: Final = 4000
_N_CLOCK: Final = 100

Row = TypeVar("Row")


class Sighting(NamedTuple):
    """Message seen by the observer: network, and instant on the observer's clock."""

    network: Network
    key: str
    at_ns: int
    attachment: bytes
    payload: bytes


class PlaceRow(NamedTuple):
    """Position of a master at a sample instant."""

    t_ns: int
    place_m: Place


class UnseenRow(NamedTuple):
    """Number of packets that the observer did not see on their network of origin, before one sent at ``sent_ns``."""

    sent_ns: int
    n: int


class AgeRow(NamedTuple):
    """Age of the freshest sample at a tick, and the end-to-end latency if that sample was new."""

    t_ns: int
    age_ms: float
    end_to_end_ms: float | None


class LiveBook:
    """Tables behind the live figures. Call `take` per message and `settle` periodically; not thread-safe.

    With ``thinning`` n only every n-th message is decoded, by sequence number, so the same ones on both networks.
    """

    def __init__(self, session: str) -> None:
        self.thinning = 1
        self.now_ns = 0
        self.ticks_missed: dict[Side, int] = {}
        """By side the ticks that had not begun when the next one was due, as its beats count them."""
        self.tracks: defaultdict[str, Trail[TrackRow]] = defaultdict(lambda: Trail(_MAX_ROWS))
        self.masters: defaultdict[str, Trail[PlaceRow]] = defaultdict(lambda: Trail(_MAX_ROWS))
        self.ages: defaultdict[str, Trail[AgeRow]] = defaultdict(lambda: Trail(_MAX_ROWS))
        self.crossed: dict[StreamName, Trail[Crossing]] = {name: Trail(_MAX_ROWS) for name in STREAM_OF.values()}
        self.safety = SafetyStates()
        self.displays = Displays(session)
        self.forces = Forces(session)
        self.newest: defaultdict[str, dict[str, Place]] = defaultdict(dict)
        """By arm the newest place in m of the commanded pose (``hand``) and of the patient's ``estimate``."""
        self.alarms: dict[Alarm, int] = {}
        """What the patient has evidence of, and the run time at which it began, in ns."""
        self.is_stopped: bool | None = None
        """Whether an emergency stop is in force, as the patient last told anyone; None: it told nobody."""
        self._patient_ahead_ns: deque[int] = deque(maxlen=_N_CLOCK)
        self._beat_keys = {ControlKeys(session).beat(side): side for side in MISSING}
        self._stopped_key = stopped_key(session)
        self._local = local_keys(session, "east")
        self._table = watched_streams(session)
        self._crossings: defaultdict[str, Crossings] = defaultdict(Crossings)
        self._motion: defaultdict[str, ArmMotion] = defaultdict(ArmMotion)
        self._newest_command_ns: dict[str, int] = {}
        self._fresh_ns = -1
        self._skipped: Trail[UnseenRow] = Trail(_MAX_ROWS)
        self._first_ns: dict[str, int] = {}
        """When a network, and the arrivals of a key, were first heard, on the observer's clock."""
        self._offered_seq: dict[str, int] = {}
        self._unseen: Trail[UnseenRow] = Trail(_MAX_ROWS)

    def take(self, seen: Sighting) -> None:
        """Add a message; messages that are not of the session's streams are ignored."""
        self._first_ns.setdefault(seen.network, seen.at_ns)
        if self._told(seen):
            return
        stream, is_displayed = self._table.get(seen.key), self.displays.knows(seen.network, seen.key)
        header = Header.unpack(seen.attachment) if stream is not None or is_displayed else None
        if is_displayed and header is not None and header.seq % self.thinning == 0:
            self.displays.take(seen.network, seen.key, seen.payload, self.now_ns)
        if stream is None or header is None:
            return
        at_origin = seen.network == ORIGIN[stream.direction]
        if at_origin:
            self._note_unseen(seen.key, header)
            if seen.network == "east":
                self._patient_ahead_ns.append(header.sent_ns - seen.at_ns)
        # hold needs the freshest of all samples, so arriving arm samples are decoded without thinning
        if header.seq % self.thinning == 0:
            self._cross(stream, header, seen, at_origin)
        elif stream.role != "arm" or at_origin:
            return
        if not at_origin:
            self._first_ns.setdefault(seen.key, seen.at_ns)
        if at_origin or stream.role == "arm":
            self._decode(stream, header, seen, at_origin)

    def _told(self, seen: Sighting) -> bool:
        """Take what is neither a stream that is followed nor a display; return whether it was."""
        if seen.key in self._beat_keys or seen.key == self._stopped_key:
            self._hear(seen)
            return True
        if seen.network == "west":
            return self.forces.take(seen.key, seen.payload, self.now_ns)
        if seen.key in self._local and is_set_point(seen.key):
            self.safety.take(seen.key.split("/")[-2], seen.payload, self.now_ns)
        return seen.key in self._local

    def _hear(self, seen: Sighting) -> None:
        with suppress(DecodeError):
            if seen.key == self._stopped_key:
                self.is_stopped = decode(seen.payload, StopState).stop
                return
            beat = decode(seen.payload, Beat)
            if beat.side != self._beat_keys[seen.key]:
                return
            if beat.side == "patient":
                self.alarms = {**beat.alarms, **self.alarms}
            if beat.ticks_missed is not None:
                before = self.ticks_missed.get(beat.side, 0)
                self.ticks_missed[beat.side] = max(before, beat.ticks_missed)
                self._skip(beat.side, beat.ticks_missed - before)

    def set_thinning(self, thinning: int) -> None:
        """Decode only every ``thinning``-th message from now on; a multiple of the value before."""
        self.thinning = thinning
        for crossings in self._crossings.values():
            crossings.keep_multiples(thinning)

    def settle(self, now_ns: int) -> None:
        """Record the packets lost by now, on the observer's clock, and the ticks whose truth is known."""
        for key, crossings in self._crossings.items():
            trail = self.crossed[STREAM_OF[self._table[key].role]]
            for lost in crossings.expire(now_ns, self._heard_ns(key, now_ns)):
                trail.append(lost)
        for arm, motion in self._motion.items():
            for row in motion.rows():
                self.tracks[arm].append(row)

    def _heard_ns(self, key: str, now_ns: int) -> int:
        """Return since when a key is surely listened to at its end: what was sent before may go unseen there.

        Surely: from its first arrival on, or 2 s after anything was heard there, where all of it is lost.
        """
        anything_ns = self._first_ns.get(DESTINATION[self._table[key].direction], now_ns)
        return min(anything_ns + _ALL_HEARD_NS, self._first_ns.get(key, now_ns))

    @property
    def patient_ahead_ns(self) -> int | None:
        """Return the patient's run time less the observer's clock, by the quickest message; None at first."""
        return max(self._patient_ahead_ns, default=None)

    @property
    def decided_ns(self) -> int:
        """Return up to which sending time it is decided which packets are lost."""
        timeout_ns = max((crossings.loss_timeout_ns for crossings in self._crossings.values()), default=0)
        undecided_ns = [one.undecided_ns for one in self._crossings.values() if one.undecided_ns is not None]
        return min([self.now_ns - timeout_ns, *undecided_ns])

    def figures(self, window_s: float = WINDOW_S) -> LiveFigures:
        """Return the figures of the newest ``window_s`` of run time, of all arms together."""
        begin_ns = self.now_ns - int(window_s * NS_PER_S)
        ages = [row for trail in self.ages.values() for row in _since(trail, begin_ns, lambda row: row.t_ns)]
        silent_s, display_silent_s = self._silence_s(self._fresh_ns), self._silence_s(self.displays.fresh_ns)
        found = live_figures(
            {name: _latest(_since(trail, begin_ns, lambda row: row.sent_ns)) for name, trail in self.crossed.items()},
            [row.end_to_end_ms for row in ages if row.end_to_end_ms is not None and silent_s is None],
            [_since(trail, begin_ns, lambda row: row.t_ns) for trail in self.tracks.values()],
            self._n_unseen(begin_ns) // self.thinning,
            self.displays.errors(begin_ns) if display_silent_s is None else None,
            [row.age_ms for row in ages],
        )
        gap_max_ms = max((_gap_ms(trail, begin_ns) for trail in self.ages.values()), default=None)
        return replace(
            found,
            gap_max_ms=gap_max_ms,
            silent_s=silent_s,
            display_silent_s=display_silent_s,
            now_s=self.now_ns / NS_PER_S,
        )

    def _silence_s(self, fresh_ns: int) -> float | None:
        """Return the time since ``fresh_ns``, in s; None where that is not long, or nothing ever arrived."""
        silent_ns = self.now_ns - fresh_ns
        return silent_ns / NS_PER_S if fresh_ns >= 0 and silent_ns > _SILENT_NS else None

    def _skip(self, side: Side, n: int) -> None:
        """Note new missed ticks: the numbers of their messages on each key that was seen are free."""
        n_keys = sum(SIDE_ON[ORIGIN[self._table[key].direction]] == side for key in self._offered_seq)
        if n > 0 and n_keys:
            self._skipped.append(UnseenRow(self.now_ns, n * n_keys))

    def _n_unseen(self, begin_ns: int) -> int:
        """Return how many packets since ``begin_ns`` did not come here: free numbers but those of missed ticks."""
        free, skipped = (
            sum(row.n for row in _since(trail, begin_ns, lambda row: row.sent_ns))
            for trail in (self._unseen, self._skipped)
        )
        return max(free - skipped, 0)

    def _note_unseen(self, key: str, header: Header) -> None:
        """Note the packets that were sent between this one and the last one seen, and that did not come here."""
        before = self._offered_seq.get(key, header.seq - 1)
        self._offered_seq[key] = max(before, header.seq)
        if header.seq > before + 1:
            self._unseen.append(UnseenRow(header.sent_ns, header.seq - before - 1))

    def _cross(self, stream: Stream, header: Header, seen: Sighting, at_origin: bool) -> None:
        crossings = self._crossings[seen.key]
        if at_origin:
            self.now_ns = max(self.now_ns, header.sent_ns)
            crossing = crossings.offered(header.seq, header.sent_ns, seen.at_ns)
        else:
            crossing = crossings.arrived(header.seq, seen.at_ns)
        if crossing is not None:
            self.crossed[STREAM_OF[stream.role]].append(crossing)

    def _decode(self, stream: Stream, header: Header, seen: Sighting, at_origin: bool) -> None:
        try:
            pose = decode(seen.payload, stream.channel.payload)
        except DecodeError:
            return
        where_m, parts = position_m(pose), unit(components(pose.orientation))
        turn = None if parts is None else np.array(parts)
        motion = self._motion[stream.device]
        match stream.role:
            case "command":
                self.masters[stream.device].append(PlaceRow(pose.sample_ns, where_m))
            case "arm" if at_origin:
                self.newest[stream.device]["hand"] = where_m
                motion.sent(pose.sample_ns, where_m, turn)
            case "arm":
                motion.arrived(pose.sample_ns, where_m, turn)
            case "estimated":
                self.newest[stream.device]["estimate"] = where_m
                fresh_ns = pose.command_sample_ns if isinstance(pose, FeedbackPose) else None
                if fresh_ns is not None:
                    motion.estimated(pose.sample_ns, fresh_ns, where_m, turn)
                    self._record_age(stream.device, header, pose, fresh_ns)

    def _record_age(self, arm: str, header: Header, pose: Pose, fresh_ns: int) -> None:
        is_new = fresh_ns > self._newest_command_ns.get(arm, -1)
        self._newest_command_ns[arm] = max(fresh_ns, self._newest_command_ns.get(arm, -1))
        if is_new:
            self._fresh_ns = max(self._fresh_ns, pose.sample_ns)
        end_to_end_ms = (header.sent_ns - fresh_ns) / NS_PER_MS if is_new else None
        self.ages[arm].append(AgeRow(pose.sample_ns, (pose.sample_ns - fresh_ns) / NS_PER_MS, end_to_end_ms))


def _gap_ms(ages: Trail[AgeRow], begin_ns: int) -> float:
    """Return the longest time in which no tick since ``begin_ns`` had a newer sample than the one before, in ms."""
    rows = _since(ages, begin_ns, lambda row: row.t_ns)
    edges_ns = [row.t_ns for k, row in enumerate(rows) if row.end_to_end_ms is not None or k in (0, len(rows) - 1)]
    return max((later - before for before, later in pairwise(edges_ns)), default=0) / NS_PER_MS


def _since(trail: Trail[Row], begin_ns: int, at_ns: Callable[[Row], int]) -> list[Row]:
    return [row for row in trail.all() if at_ns(row) >= begin_ns]


def _latest(crossings: list[Crossing]) -> list[Crossing]:
    """Return one row per packet: a packet that arrived after it counted as lost has two."""
    arrived = {row.sent_ns for row in crossings if row.delay_ns is not None}
    return [row for row in crossings if row.delay_ns is not None or row.sent_ns not in arrived]
