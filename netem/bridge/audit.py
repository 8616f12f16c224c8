"""Writes the audit log of a netem: `tis.common.audit` with what Zenoh and the kernel tell of who did it.

Zenoh tells address and certificate's name of each connection that it accepted. Of one that it refused it logs the
kind only: the kernel names the address, by a notice of each TCP connection that ends (sock_diag(7)).
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, Self

import zenoh
from msgspec import DecodeError

from tis.common.audit import (
    AUDIT_FILE,
    AUDIT_VARIABLE,
    FIRST,
    MAX_AMONG,
    MAX_LINES,
    NO_AUDIT,
    Chain,
    Happening,
    Sums,
    digest,
)
from tis.common.channels import Network
from tis.common.host_records import AUDIT, AuditNote
from tis.common.messages import decode
from tis.common.node import Record
from tis.common.refusal import MEANING, Refusal, sender_in
from tis.common.runtime.clock import Clock
from tis.common.runtime.zenoh_log import ROUTER_LEVELS, RefusalCounter, ZenohLog
from tis.common.stop_messages import EmergencyStop
from tis.common.units import NS_PER_S
from tis.common.zenoh_syntax import port_of
from tis.netem.bridge.gossip import GOSSIP_LEVEL, Gossip
from tis.netem.bridge.tcp_ends import hear_tcp_ends, tcp_ends_socket

_FLUSH_S: Final = 1.0
_MAX_WAITING: Final = 2000
_MAX_TOLD: Final = 20
_MAX_CONNECTIONS: Final = 4096
_NEAR_NS: Final = 500_000_000
"""Time between a refusal in Zenoh's log and the end of its connection."""
_OF_CONNECTIONS: Final = frozenset(
    ("no_certificate", "foreign_authority", "expired", "bad_certificate", "no_tls", "false_netem", "no_password",
     "wrong_password")
)  # fmt: skip


class _Refused(NamedTuple):
    at_ns: int
    kind: Refusal
    zid: str
    name: str
    key: str
    among: tuple[str, ...]


class _Connection(NamedTuple):
    network: str
    address: str
    name: str

    @property
    def words(self) -> str:
        return " ".join(filter(None, (self.name, self.network, self.address)))


class AuditTrail:
    """Collects happenings from any thread, and writes them each second; `begin` names the folder.

    What comes before waits, bounded. ``listen`` are netem's endpoints. ``tell`` is called once for each
    kind and address that was refused. `look` and `finish` are called by the thread that writes netem's log.
    """

    @classmethod
    def opened(
        cls,
        stack: ExitStack,
        listen: Iterable[tuple[Network, str]],
        tell: Callable[[str], None],
        refusals: bool = True,
    ) -> Self:
        """Return one that ends with ``stack``, and read Zenoh's own log, which takes standard output.

        ``refusals``: also what Zenoh refuses, which has many lines where somebody tries again and again.
        """
        audit = cls(listen, tell)

        def take(line: bytes) -> None:
            audit.gossip.take(line)
            if refusals:
                audit.refusals.take(line)

        levels = f"{ROUTER_LEVELS if refusals else 'warn'},{GOSSIP_LEVEL}"
        stack.enter_context(ZenohLog(levels, take))
        return audit

    def __init__(self, listen: Iterable[tuple[Network, str]], tell: Callable[[str], None]) -> None:
        self.refusals: Final = RefusalCounter(self.refused)
        self.gossip: Final = Gossip()
        ports = {port_of(endpoint): network for network, endpoint in listen}
        self._ports, self._warn = {port: network for port, network in ports.items() if port}, tell
        self._told: set[tuple[str, str]] = set()
        self._lock = threading.Lock()  # guards what follows; Zenoh is never called with it
        self._sums = Sums()
        self._refused: deque[_Refused] = deque(maxlen=_MAX_WAITING)
        self._n_beyond: dict[Refusal, int] = {}
        self._ends: deque[tuple[int, Network, str]] = deque(maxlen=_MAX_WAITING)
        self._open: dict[str, _Connection] = {}
        self._left: dict[str, int] = {}  # those of them that have just left
        self._newest: tuple[str, ...] | None = None
        self._known: dict[str, _Connection] = {}
        self._writing = threading.Lock()
        self._chain = Chain()
        self._noted = 0
        self._file: BinaryIO | None = None
        self._clock: Clock | None = None
        self._held: list[Any] = []
        self._over = threading.Event()
        self._threads = [threading.Thread(target=self._serve, name="audit", daemon=True)]
        with suppress(OSError):  # a kernel without it: refused connections have no address then
            kernel = tcp_ends_socket(_FLUSH_S)
            hears = (kernel, self._ended, self._over)
            self._threads.append(threading.Thread(target=hear_tcp_ends, args=hears, name="ends", daemon=True))
        for thread in self._threads:
            thread.start()

    def watch(self, stack: ExitStack, sessions: Mapping[Network, zenoh.Session]) -> None:
        """Note the connections of netem's networks, until ``stack`` closes, before the sessions."""
        stack.callback(self._close)
        for network, session in sessions.items():
            take = self._link_taker(network)
            self._held.append(session.info.declare_link_events_listener(take, history=True))

    def refused(self, kind: Refusal, line: bytes) -> None:
        """Take a refusal from Zenoh's log."""
        at_ns, sender = time.time_ns(), sender_in(line)
        with self._lock:
            if len(self._refused) < _MAX_WAITING:
                self._refused.append(_Refused(at_ns, kind, *sender, self._among()))
            else:
                self._n_beyond[kind] = self._n_beyond.get(kind, 0) + 1

    def note(self, one: Happening, is_by_somebody: bool = False) -> None:
        """Take a happening; ``is_by_somebody``: a client did it, and Zenoh does not say which."""
        at_ns = time.time_ns()
        with self._lock:
            self._sums.add(at_ns, one._replace(among=self._among(one.network)) if is_by_somebody else one)

    def asked(self, network: Network, key: str, payload: bytes, signer: str = "") -> None:
        """Take a request to stop or to release; a question is none. ``signer``: who signed it."""
        try:
            request = decode(payload, EmergencyStop)
        except DecodeError:
            return
        if request.stop:
            what = f"{request.number} {request.reason}".strip()
            self.note(Happening("stop", what, network, name=signer, key=key), is_by_somebody=True)
        elif request.ends:
            what = f"of {request.ends}"
            self.note(Happening("release", what, network, name=signer, key=key), is_by_somebody=True)

    def begin(self, folder: Path | None, clock: Clock) -> None:
        """Write to the folder from now on, if there is one; a log that an earlier process left there goes on."""
        if folder is None:
            return
        if os.environ.get(AUDIT_VARIABLE) == NO_AUDIT:
            self._warn(f"nothing is audited: {AUDIT_VARIABLE} is {NO_AUDIT}")
            return
        path, again = folder / AUDIT_FILE, ""
        with self._writing:
            try:
                left = path.read_bytes() if path.exists() else b""
                lines = left.splitlines(keepends=True)
                again = "again" if lines else ""
                if lines and not left.endswith(b"\n"):
                    again = "again, behind a line that a kill had cut"
                    os.truncate(path, len(left) - len(lines.pop()))
                self._file, self._clock = path.open("ab"), clock
                self._chain = Chain(digest(lines[-1].removesuffix(b"\n")) if lines else FIRST, len(lines))
            except OSError as error:
                self._give_up(error)
        self.note(Happening("begun", again))

    def look(self) -> Iterator[Record]:
        """Yield the record of the log's length for netem's log, where it has grown."""
        with self._writing:
            clock, head, n_lines = self._clock, self._chain.head, self._chain.n_lines
        if clock is not None and n_lines != self._noted:
            self._noted, at_ns = n_lines, max(0, clock.now_ns())
            yield Record(AUDIT, at_ns, AuditNote(at_ns=at_ns, lines=n_lines, sha256=head))

    def finish(self) -> Iterator[Record]:
        """Write all that waits and the end; yield the last record for netem's log."""
        self._flush(is_end=True)
        yield from self.look()

    def _close(self) -> None:
        for one in self._held:
            one.undeclare()
        self._held.clear()
        self._over.set()
        with self._writing:
            self._close_file()

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError), file:
                os.fsync(file.fileno())

    def _link_taker(self, network: Network) -> Callable[[zenoh.LinkEvent], None]:
        def take(event: zenoh.LinkEvent) -> None:
            link, zid = event.link, str(event.link.zid)
            address = str(link.dst).partition("/")[2].partition("?")[0]
            one = _Connection(network, address, link.auth_identifier or "")
            is_new = event.kind == zenoh.SampleKind.PUT
            with self._lock:
                if is_new:
                    self._open[zid] = self._known[zid] = one
                else:
                    self._left[zid] = time.time_ns()
                self._newest = None
                while len(self._known) > _MAX_CONNECTIONS:
                    del self._known[next(iter(self._known))]
                self._sums.add(time.time_ns(), Happening("connected" if is_new else "left", zid, *one))

        return take

    def _among(self, network: str = "") -> tuple[str, ...]:
        """Return who is connected, or has just left, the newest first."""
        if network or self._newest is None:
            found = [one.words for one in self._open.values() if network in ("", one.network)][-MAX_AMONG:]
            if network:
                return tuple(found[::-1])
            self._newest = tuple(found[::-1])
        return self._newest

    def _ended(self, port: int, address: str) -> None:
        """Take the end of a TCP connection, if it was at a port of netem's."""
        network = self._ports.get(port)
        if network is not None:
            with self._lock:
                self._ends.append((time.time_ns(), network, address))

    def _serve(self) -> None:
        while not self._over.wait(_FLUSH_S):
            self._flush()

    def _flush(self, is_end: bool = False) -> None:
        """Name who was refused, as far as that can be told, and write what has happened; nothing follows the end."""
        with self._writing:  # first: what one thread takes no other one overtakes
            with self._lock:
                told = self._name_refused()
                found = [] if self._file is None else self._sums.take()
            for at_ns, one, n in found:
                self._write(at_ns, one, n)
            if is_end:
                self._write(time.time_ns(), Happening("ended"), 1)
                self._close_file()
            with suppress(OSError):
                if self._file is not None:
                    self._file.flush()
        for text in told:
            self._warn(text)

    def _write(self, at_ns: int, one: Happening, n: int) -> None:
        if self._file is None or (self._chain.n_lines > MAX_LINES and one.event != "ended"):
            return
        if self._chain.n_lines == MAX_LINES and one.event != "ended":
            one = Happening("full", f"the log has {MAX_LINES} lines")
        clock = self._clock
        run_ns = -1 if clock is None else clock.now_ns() - (time.time_ns() - at_ns)
        utc = datetime.fromtimestamp(at_ns / NS_PER_S, UTC).isoformat(timespec="milliseconds")
        try:
            self._file.write(self._chain.line(utc, run_ns if run_ns >= 0 else None, one, n))
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._file = None
        self._warn(f"the audit log cannot be written: {error.strerror}")

    def _name_refused(self) -> list[str]:
        """Sum the refusals with the addresses that are known of them; return what is new of it in words."""
        now_ns, later, told = time.time_ns(), deque[_Refused](maxlen=_MAX_WAITING), list[str]()
        accepted = {one.address for one in self._known.values()}
        ends = [one for one in self._ends if one[2] not in accepted]
        for one in self._refused:
            found = self._named(one, ends)
            if found is None and now_ns - one.at_ns < _NEAR_NS:  # what names it comes a moment later
                later.append(one)
                continue
            found = found or Happening("refused", one.kind, among=() if one.kind in _OF_CONNECTIONS else one.among)
            self._sums.add(one.at_ns, found)
            told += self._new_words(found, one.kind)
        self._refused = later
        for kind, n in self._n_beyond.items():
            self._sums.add(now_ns, Happening("refused", kind, among=self._among()), n)
        self._n_beyond.clear()
        for zid in [zid for zid, left_ns in self._left.items() if now_ns - left_ns > NS_PER_S]:
            del self._left[zid]
            self._open.pop(zid, None)
            self._newest = None
        while self._ends and now_ns - self._ends[0][0] > 4 * _NEAR_NS:
            self._ends.popleft()
        return told

    def _named(self, one: _Refused, ends: list[tuple[int, Network, str]]) -> Happening | None:
        """Return a refusal with its sender, None where nothing names it."""
        if one.kind in _OF_CONNECTIONS:
            near = [end for end in ends if abs(end[0] - one.at_ns) < _NEAR_NS]
            if not near:
                return None
            end = min(near, key=lambda end: abs(end[0] - one.at_ns))
            if len(near) > 1:  # the last of them serves the refusals that follow
                ends.remove(end)
            return Happening("refused", one.kind, *end[1:])
        who = self._known.get(one.zid)
        if who is None:
            return None
        if one.name and one.name != who.name:
            who = self._known[one.zid] = who._replace(name=one.name)
        return Happening("refused", one.kind, *who, one.key)

    def _new_words(self, one: Happening, kind: Refusal) -> list[str]:
        """Return a refusal in words, if it is the first of its kind and address."""
        host = one.address.rpartition(":")[0]
        if (kind, host) in self._told or len(self._told) >= _MAX_TOLD:
            return []
        self._told.add((kind, host))
        whom = f" from {one.address}" if one.address else ""
        named = f", named {one.name}" if one.name else ""
        return [f"netem refused {MEANING[kind]}{whom}{named}"]
