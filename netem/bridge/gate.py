"""The gate in front of queues that push back: a callback of Zenoh waits here, so that its connection is not read.

The sender's queues fill up, and its own congestion control acts. Whoever waits holds no lock. Zenoh runs such
callbacks in its receiving threads, one for each connection; there must be more of them than may wait.
"""

import os
import threading
from dataclasses import replace
from typing import Final, get_args

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.runtime.zenoh_session import ZenohOptions, merge_acceptor
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change
from tis.common.units import s_to_ns
from tis.netem.link.link import Door

MAX_WAITING: Final = 24
"""Connections that are held back at once; what others send meanwhile finds the queue full and is dropped."""

_RECEIVE_BYTES: Final = 65_536
"""The part of a connection that the system keeps in front of netem, which is a queue without priorities."""

_N_SPARE: Final = 8
_LOOK_S: Final = 0.005
_LEASE_SHARE: Final = 0.5


class Visit:
    """One message at the gate; `Gate.leave` ends it."""

    __slots__ = ("bell", "group", "turn", "until_ns")

    def __init__(self, turn: tuple[int, int]) -> None:
        self.turn: Final = turn
        self.until_ns = 0
        self.bell: Final = threading.Event()
        self.group: str | None = None

    def wait(self) -> None:
        """Wait for the turn; it is looked for again soon also without a ring: outages and the end do not ring."""
        self.bell.wait(_LOOK_S)
        self.bell.clear()


class Gate:
    """The messages of one direction that wait for room, the highest priority first. The driver's lock guards it.

    No message waits for more than half the lease of its connection.
    """

    def __init__(self, lease_s: float, most: int = MAX_WAITING) -> None:
        self.n_held_back = 0
        """Messages that had to wait."""
        self.n_overdue = 0
        """Those that waited as long as the lease allows, or found too many waiting."""
        self._most: Final = most
        self._patience_ns: Final = s_to_ns(_LEASE_SHARE * lease_s)
        self._n_visits = 0
        self._waiting: list[Visit] = []

    def visit(self, priority: int) -> Visit:
        """Return a new visit."""
        self._n_visits += 1
        return Visit((priority, self._n_visits))

    def must_wait(self, visit: Visit, door: Door | None, now_ns: int) -> bool:
        """Tell whether a message must wait before this door, None where nothing pushes back."""
        is_new = visit.group is None
        if door is None or (door.has_room and not self._is_behind(visit, door.group)):
            return False
        if is_new and len(self._waiting) < self._most:
            self.n_held_back += 1
            self._waiting.append(visit)
            visit.until_ns = now_ns + self._patience_ns
        if now_ns >= visit.until_ns:
            self.n_overdue += 1
            return False
        visit.group = door.group
        return True

    def leave(self, visit: Visit) -> None:
        """End a visit; the next one may find room, too."""
        if visit.group is not None:
            self._waiting.remove(visit)
            self.ring()

    def ring(self) -> None:
        """Wake the first one of each group."""
        first: dict[str | None, Visit] = {}
        for one in self._waiting:
            if one.group not in first or one.turn < first[one.group].turn:
                first[one.group] = one
        for one in first.values():
            one.bell.set()

    def _is_behind(self, visit: Visit, group: str) -> bool:
        return any(one.group == group and one.turn < visit.turn for one in self._waiting)


def gates_for(
    network: NetworkPart, lease_s: float, options: ZenohOptions
) -> tuple[dict[Direction, Gate], ZenohOptions]:
    """Return the gates of a network, none unless it pushes back, and the options of the sessions that have them.

    It sets up Zenoh's receiving threads, so it comes before the first session. Callbacks that wait need many of them,
    unless the user has set their number: then one connection of each direction waits, as Zenoh's default is two.
    """
    if not network.pushes_back:
        merge_acceptor()
        return {}, options
    threads = f"(acc: (handover: rx), rx: (worker_threads: {2 * MAX_WAITING + _N_SPARE}))"
    most = MAX_WAITING if os.environ.setdefault("ZENOH_RUNTIME", threads) == threads else 1
    gates = {direction: Gate(lease_s, most) for direction in get_args(Direction)}
    return gates, replace(options, receive_bytes=_RECEIVE_BYTES)


def without_gates(change: Change) -> Change:
    """Return a change of a network that began without gates; raises `InputError` for one that needs them."""
    if getattr(change.rate, "backpressure", False):
        raise InputError(Fault("control", "change.rate.backpressure", "must hold from the start of netem on", True))
    return change
