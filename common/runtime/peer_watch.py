"""Signs of life between the sides: beats are sent, heard and judged off the hot path.

A neighbour's silence is told by the health of its TCP connections, as Linux reports it.
"""

import socket
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, get_args

import zenoh
from msgspec import DecodeError

from tis.common.channels import SIDE_ON, Network, Side
from tis.common.messages import Header, decode, encode
from tis.common.node import Record
from tis.common.peer_life import BEAT_EVERY_NS, MAX_RUN_ID, NO_ALARMS, Alarm, Beat, Change, PeerLife, View, described
from tis.common.records import PEERS, PeerNote
from tis.common.runtime.clock import WallClock, monotonic_ns
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.loop import LateRecorder
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.signing import SIGNERS, RunKeys
from tis.common.units import NS_PER_MS, NS_PER_S

BEAT_EVERY_S: Final = BEAT_EVERY_NS / NS_PER_S
_MAX_BYTES: Final = 2048
_MAX_WAITING: Final = 100
_MIN_STEP_NS: Final = NS_PER_S // 2
_MIN_PAUSE_NS: Final = NS_PER_S


class Beats:
    """Sends a side's beats on its networks, and hears those of the others.

    netem, which is on both networks, passes each side's on to the other one, and believes a side on its own only. A
    beat of another run is not believed, and counts as ``forged``; one without a run waits for its own.
    ``is_witness``: another program is this side, and sends its own beats. ``signed``: the run's keys; what the side
    beyond netem has not signed, or has been heard before, is forged. netem's own beats have no code: its access
    control lets nobody else send them, and what they say of others only names a silence.
    """

    def __init__(
        self,
        side: Side,
        sessions: Mapping[Network, zenoh.Session],
        keys: ControlKeys,
        run_id: int,
        is_witness: bool = False,
        signed: RunKeys | None = None,
    ) -> None:
        self._signed, self._beyond = signed, SIGNERS.get(side)
        self._number = self._heard_number = 0
        self.run_id = run_id
        self.forged: set[Side] = set()
        self._heard: deque[Beat] = deque(maxlen=_MAX_WAITING)
        self._keys = keys
        heard_by = () if is_witness else sessions.values()
        self._own = [publisher_of(session, keys.beat(side)) for session in heard_by]
        self._relays: dict[Side, zenoh.Publisher] = {}
        self._held: list[Any] = []
        for network, session in sessions.items():
            home: Side | None = None
            for away in sessions.keys() - {network}:
                home = SIDE_ON[network]
                self._relays[home] = publisher_of(sessions[away], keys.beat(home))
            self._held.append(
                session.declare_subscriber(keys.beats, self._receiver(home), allowed_origin=zenoh.Locality.REMOTE)
            )

    def close(self) -> None:
        """Stop sending and hearing; a second call does nothing."""
        for one in (*self._held, *self._own, *self._relays.values()):
            one.undeclare()
        self._held.clear()
        self._own.clear()
        self._relays.clear()

    def send(self, beat: Beat) -> None:
        """Send this side's beat on each of its networks; a full queue drops it."""
        payload, attachment = encode(beat), None
        if self._signed is not None:  # numbers go on after a new start of this side, whatever its clock does
            self._number = max(self._number + 1, beat.at_ns // NS_PER_MS) & MAX_RUN_ID
            header = Header(self._number, beat.at_ns, self.run_id).pack()
            attachment = self._signed.sign(self._keys.beat(beat.side), header, payload)
        for publisher in self._own:
            publisher.put(payload, attachment=attachment)

    def heard(self) -> list[Beat]:
        """Return the beats since the last call."""
        found = []
        while self._heard:
            found.append(self._heard.popleft())
        return found

    def _receiver(self, home: Side | None) -> Callable[[zenoh.Sample], None]:
        """Return the callback of a network; ``home`` is the only side that is believed there, None: any is."""

        def receive(sample: zenoh.Sample) -> None:
            attached = sample.attachment
            if len(sample.payload) > _MAX_BYTES or (attached is not None and len(attached) > _MAX_BYTES):
                return
            payload = sample.payload.to_bytes()
            try:
                beat = decode(payload, Beat)
            except DecodeError:
                return
            if str(sample.key_expr) != self._keys.beat(beat.side) or home not in (None, beat.side):
                return
            if beat.run_id != self.run_id:
                self.forged |= {beat.side} if beat.run_id else set()
                return
            if self._signed is not None and beat.side == self._beyond and not self._is_signed(sample, payload):
                self.forged |= {beat.side}
                return
            self._heard.append(beat)
            relay = self._relays.get(beat.side)
            if relay is not None:
                with suppress(zenoh.ZError):  # the session is closed
                    relay.put(payload, attachment=attached)

        return receive

    def _is_signed(self, sample: zenoh.Sample, payload: bytes) -> bool:
        """Tell whether the side beyond netem has signed a beat, and none that is newer has come."""
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        header = Header.unpack(attachment)
        if header is None or self._signed is None or self._signed.fault(str(sample.key_expr), attachment, payload):
            return False
        is_new, self._heard_number = header.seq > self._heard_number, max(header.seq, self._heard_number)
        return is_new and header.run_id == self.run_id


class PeerWatch:
    """Judges the lives of the other sides at each `look`, and tells what changes: to the user, and in the log.

    ``ports`` are the endpoints' ports of the neighbours, ``present`` returns the sides whose tokens are present.
    ``lost`` are the sides that have left or been silent for longer than the scenario allows.
    """

    def __init__(
        self,
        side: Side,
        beats: Beats,
        clock: WallClock,
        ports: Mapping[Side, set[int]],
        present: Callable[[], set[Side]],
        timeout_s: float,
    ) -> None:
        self.lost: dict[Side, str] = {}
        self.last_loss: tuple[Side, str] | None = None
        self._side, self._beats, self._clock, self._ports, self._present = side, beats, clock, ports, present
        self._timeout_ns = int(timeout_s * NS_PER_S)
        others = sorted({*get_args(Side)} - {side}, key=lambda peer: peer not in ports)  # neighbours first
        self._lives: dict[Side, PeerLife] = {peer: PeerLife(peer, peer in ports) for peer in others}
        self._views: Mapping[Side, View] = {}
        self._own = _OwnClocks()
        self._alarms: set[Alarm] = set()
        self._looked_ns: int | None = None

    def look(
        self, loop_ns: int, doing: str, alarms: Mapping[Alarm, int] = NO_ALARMS, ticks_missed: int | None = None
    ) -> Sequence[Change]:
        """Send a beat with this side's alarms and missed ticks, take those that came, and return what has changed."""
        now_ns = self._clock.now_ns()
        pause_ns = 0 if self._looked_ns is None else max(0, now_ns - self._looked_ns - BEAT_EVERY_NS)
        self._looked_ns = now_ns
        found = self.own_changes()
        found += [Change(self._side, one, alarms[one], 0) for one in alarms if one not in self._alarms]
        self._alarms |= alarms.keys()
        stepped = sum(one.for_ns for one in found if one.event == "clock_step")
        if pause_ns - max(stepped, 0) > _MIN_PAUSE_NS:
            found.append(Change(self._side, "frozen", now_ns, pause_ns))
        if pause_ns > _MIN_STEP_NS:
            for life in self._lives.values():
                life.pause(pause_ns, now_ns)
        for peer in self._beats.forged & self._lives.keys():
            self._lives[peer].forged(now_ns)
        for beat in self._beats.heard():
            if beat.side == "netem":
                self._views = beat.views
            if beat.side in self._lives:
                self._lives[beat.side].hear(beat, now_ns)
        found += self._look_at_others(now_ns)
        views = self._unwell() if self._side == "netem" else {}
        own = (doing, views, dict(alarms), ticks_missed)
        self._beats.send(Beat(self._side, now_ns, loop_ns, self._beats.run_id, *own))
        return found

    def own_changes(self) -> list[Change]:
        """Return steps and suspensions of this host's clock since the last look."""
        return self._own.changes(self._side, self._clock.now_ns())

    def _look_at_others(self, now_ns: int) -> list[Change]:
        """Return what has changed in the lives of the others, the neighbours' first."""
        present, found = self._present(), list[Change]()
        for peer, life in self._lives.items():
            if peer not in self._ports and self._cannot_see_beyond():  # nothing is known of a side behind netem
                continue
            changes = life.look(now_ns, peer in present, self._link_is_down(peer, life), self._view(peer))
            self._note_loss(peer, life, now_ns)
            found += changes
            for back in (one for one in changes if peer == "netem" and one.event == "back"):
                for beyond in self._lives.keys() - {"netem"}:  # what lies behind it was not silent
                    self._lives[beyond].pause(back.for_ns, now_ns)
        return found

    def _cannot_see_beyond(self) -> bool:
        netem = self._lives.get("netem")
        return netem is not None and (netem.has_left or netem.silence is not None)

    def _note_loss(self, peer: Side, life: PeerLife, now_ns: int) -> None:
        if life.has_left:
            self.lost[peer] = "left during the run"
        elif life.quiet_ns(now_ns) > self._timeout_ns:
            self.lost[peer] = f"was silent for {life.quiet_ns(now_ns) / NS_PER_S:.0f} s (peer_timeout_s)"
            self.last_loss = (peer, self.lost[peer])
        else:
            self.lost.pop(peer, None)

    def _link_is_down(self, peer: Side, life: PeerLife) -> bool | None:
        """Look at the connection only once a neighbour is silent: the table of all connections takes a while."""
        ports = self._ports.get(peer)
        is_quiet = life.quiet_ns(self._clock.now_ns()) > NS_PER_S
        return is_retransmitting(ports) if ports and is_quiet else None

    def _view(self, peer: Side) -> View | None:
        """Return what netem says of a side behind it."""
        return None if peer in self._ports else self._views.get(peer)

    def _unwell(self) -> dict[Side, View]:
        found: dict[Side, View] = {peer: "left" for peer, life in self._lives.items() if life.has_left}
        return found | {peer: life.silence for peer, life in self._lives.items() if life.silence is not None}


class _OwnClocks:
    """Steps of this host's monotonic clock, and its suspensions, against clocks that neither follow nor stop."""

    def __init__(self) -> None:
        self._step_ns, self._sleep_ns = self._differences()

    def changes(self, side: Side, now_ns: int) -> list[Change]:
        step_ns, sleep_ns = self._differences()
        found = []
        if abs(step_ns - self._step_ns) > _MIN_STEP_NS:
            found.append(Change(side, "clock_step", now_ns, step_ns - self._step_ns))
        if sleep_ns - self._sleep_ns > _MIN_STEP_NS:
            found.append(Change(side, "suspended", now_ns, sleep_ns - self._sleep_ns))
        self._step_ns, self._sleep_ns = step_ns, sleep_ns
        return found

    @staticmethod
    def _differences() -> tuple[int, int]:
        raw_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)
        mono_ns = monotonic_ns()
        return mono_ns - raw_ns, time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()


def tell(changes: Sequence[Change], recorder: LateRecorder, status: Status, ends: bool) -> None:
    """Log changes in the lives of the sides, and tell the user."""
    for change in changes:
        note = PeerNote(
            at_ns=change.at_ns, peer=change.peer, event=change.event, for_ns=change.for_ns, doing=change.doing
        )
        recorder.record(Record(PEERS, change.at_ns, note))
        if not (ends and change.event == "left"):  # the end of the run says it
            status.warning(described(change, status.side))


# The health of this process's TCP connections, as Linux reports it: bytes that nobody acknowledges.

_TABLES: Final = ("/proc/self/net/tcp", "/proc/self/net/tcp6")
_ESTABLISHED: Final = "01"
_RETRANSMITTING: Final = "01"
_MIN_RETRANSMITS: Final = 1
_IPV4_BYTES: Final = 4
_DISCARD_PORT: Final = 9


def is_retransmitting(ports: set[int]) -> bool | None:
    """Tell whether a connection of this process with one of these ports, here or there, sends again and again.

    A host whose process stands still still acknowledges; a network that carries nothing does not. None: not known, as
    where no such connection is TCP. Oracle: a namespace whose link is taken down, tests/system/test_peers.
    """
    try:
        own = set(_own_sockets())
    except OSError:
        return None
    rows = [row for table in _TABLES for row in _rows(table)]
    ours = [
        row for row in rows if row[9] in own and row[3] == _ESTABLISHED and ports & {_port(row[1]), _port(row[2])}
    ]
    if not ours:
        return None
    return any(_is_stuck(row) for row in ours)


def _is_stuck(row: list[str]) -> bool:
    """Tell whether bytes are sent again, or cannot be sent as the way to the other host is gone."""
    timer = row[5].partition(":")[0]
    waiting_bytes = int(row[4].partition(":")[0], 16)
    if timer == _RETRANSMITTING:
        return int(row[6], 16) >= _MIN_RETRANSMITS
    return waiting_bytes > 0 and not _has_route(row[2])


def _has_route(address: str) -> bool:
    """Tell whether this host knows a way to an address of the table, such as 0201090A:1D17; nothing is sent."""
    words = bytes.fromhex(address.partition(":")[0])
    packed = b"".join(words[i : i + 4][::-1] for i in range(0, len(words), 4))  # words of the host's byte order
    family = socket.AF_INET if len(packed) == _IPV4_BYTES else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((socket.inet_ntop(family, packed), _DISCARD_PORT))
    except OSError:
        return False
    return True


def _rows(table: str) -> Iterator[list[str]]:
    try:
        lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
    except OSError:  # a host without IPv6 has one table
        return
    for line in lines:
        yield line.split()


def _port(address: str) -> int:
    return int(address.rpartition(":")[2], 16)


def _own_sockets() -> Iterator[str]:
    """Yield the inodes of this process's sockets."""
    for name in Path("/proc/self/fd").iterdir():
        try:
            target = str(name.readlink())
        except OSError:
            continue
        if target.startswith("socket:["):
            yield target[8:-1]
