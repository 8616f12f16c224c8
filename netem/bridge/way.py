"""One way of a carried connection: bytes from one socket, through a link, into the other."""

import socket
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from tis.common.channels import Direction
from tis.netem.link.packet import Packet


class Budget:
    """The bytes of one way under way; beyond ``most`` no more are taken from the sender."""

    def __init__(self, most: int) -> None:
        self._most: Final = most
        self._lock = threading.Lock()
        self._n_bytes = 0

    def take(self, n_bytes: int) -> None:
        """Count bytes that were read."""
        with self._lock:
            self._n_bytes += n_bytes

    def give_back(self, n_bytes: int) -> bool:
        """Count bytes that have left; tell whether there is room again."""
        with self._lock:
            was_full = self._n_bytes >= self._most
            self._n_bytes -= n_bytes
            return was_full and self._n_bytes < self._most

    @property
    def is_open(self) -> bool:
        """Tell whether more bytes may be read."""
        return self._n_bytes < self._most


@dataclass(slots=True)
class Segment:
    """Bytes on their way; none: the sender has sent its last byte, or has gone (``aborts``)."""

    way: "Way"
    data: bytes
    aborts: bool = False

    def forward(self, packet: Packet) -> None:  # noqa: ARG002
        """Write the bytes into the other socket."""
        self.way.write(self)

    def drop(self) -> None:
        """End the connection: a stream without these bytes is another one."""
        self.way.fail()


@dataclass(eq=False)
class Way:
    """One way of the connection at a ``place``.

    `write` is called from the threads that release packets; it never blocks. ``ring`` tells the thread that watches
    the sockets that this way wants something of it.
    """

    place: Final[int]
    direction: Final[Direction]
    source: Final[socket.socket]
    sink: Final[socket.socket]
    budget: Final[Budget]
    ring: Final[Callable[[], None]]
    has_read_all: bool = False
    is_over: bool = False
    """Whether the sink has got everything, so that nothing is left to do."""
    is_broken: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _waiting: deque[bytes] = field(default_factory=deque)
    _is_last: bool = False

    @property
    def name(self) -> str:
        """Return the name of its flow on the link."""
        return f"connection/{self.place}"

    @property
    def wants_to_write(self) -> bool:
        """Tell whether bytes wait for the sink."""
        return bool(self._waiting)

    def write(self, segment: Segment) -> None:
        """Write a segment, or keep it until the sink takes it."""
        if segment.aborts:
            self.fail()
            return
        with self._lock:
            if segment.data:
                self._waiting.append(segment.data)
            else:
                self._is_last = True
        self.flush()

    def flush(self) -> None:
        """Write what waits, as far as the sink takes it."""
        n_written, had_waiting = 0, False
        with self._lock:
            try:
                while self._waiting:
                    n = self.sink.send(self._waiting[0])
                    n_written += n
                    data = self._waiting.popleft()
                    if n < len(data):
                        self._waiting.appendleft(data[n:])
            except BlockingIOError:
                had_waiting = True
            except OSError:  # the sink has gone, and with it all that waits for it
                self.is_broken = True
                n_written += sum(map(len, self._waiting))
                self._waiting.clear()
            if self._is_last and not self._waiting and not self.is_over:
                self.is_over = True
                with suppress(OSError):
                    self.sink.shutdown(socket.SHUT_WR)
        if self.budget.give_back(n_written) or had_waiting or self.is_broken or self.is_over:
            self.ring()

    def fail(self) -> None:
        """End the connection."""
        self.is_broken = True
        self.ring()
