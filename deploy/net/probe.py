"""The probe: messages at a steady rate through a path, both ends in this process and so on one clock."""

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

import numpy as np
import zenoh
from numpy.typing import NDArray

from common.errors import Fault, PeerError
from common.header import Header
from common.runtime.inbox import sharpen_timers
from common.units import NS_PER_S

_WARM_UP: Final = b"tis probe, warming up"
_WARM_UP_EVERY_S: Final = 0.05
_SETTLE_S: Final = 0.2
_GLANCE_S: Final = 0.02
_SWITCH_S: Final = 0.0005


class Plan(NamedTuple):
    """What is to be sent, and how long it is waited for: for the path to be there, and for the last message."""

    key: str
    rate_hz: float
    n_messages: int
    n_bytes: int
    timeout_s: float
    wait_s: float


class Probed(NamedTuple):
    """N messages sent, in order: when, from the first on, and how late they came, -1 for those that did not in time.

    ``n_skipped`` were not sent since their moment had passed; ``n_foreign`` came on the key but are not ours.
    """

    sent_ns: NDArray[np.int64]
    delay_ns: NDArray[np.int64]
    n_duplicates: int
    n_late: int
    n_skipped: int
    n_foreign: int


class _Ears:
    """The receiving end: a callback that stamps and appends, nothing else."""

    def __init__(self) -> None:
        self.heard: list[tuple[int, Any]] = []
        self.error: BaseException | None = None

    def hear(self, sample: zenoh.Sample) -> None:
        try:
            self.heard.append((time.monotonic_ns(), sample.attachment))
        except BaseException as error:
            self.error = error


def probe(
    sender: zenoh.Session,
    receiver: zenoh.Session,
    plan: Plan,
    on_progress: Callable[[int], None] = lambda _: None,
) -> Probed:
    """Send from one session, receive at the other; raises `PeerError` when nothing comes through at all.

    Each message is due at ``i / rate_hz`` after the first; a moment that has passed is skipped, so that a stall of
    this process makes no burst. The delay is from just before the call that sends to the callback (RFC 7679). A
    message that comes later than ``timeout_s`` counts as lost (RFC 7680). Ctrl-C ends the sending early.
    """
    ears = _Ears()
    subscriber = receiver.declare_subscriber(plan.key, ears.hear)
    publisher = sender.declare_publisher(
        plan.key,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
        priority=zenoh.Priority.REAL_TIME,
        express=True,
    )
    try:
        with _undisturbed():
            _warm_up(publisher, ears, plan)
            n_before = len(ears.heard)
            sent_ns, n_skipped = _send(publisher, plan, on_progress)
            _drain(ears, n_before + len(sent_ns), plan.timeout_s)
    finally:
        publisher.undeclare()  # type: ignore[no-untyped-call]
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    if ears.error is not None:
        raise ears.error
    return _match(np.array(sent_ns, dtype=np.int64), ears.heard, plan.timeout_s)._replace(n_skipped=n_skipped)


def _warm_up(publisher: zenoh.Publisher, ears: _Ears, plan: Plan) -> None:
    """Send messages that do not count until one arrives, then let the others go by."""
    payload = bytes(plan.n_bytes)
    give_up = time.monotonic() + plan.wait_s
    while not ears.heard:
        if time.monotonic() >= give_up:
            raise PeerError(Fault("probe", plan.key, f"nothing came through within {plan.wait_s:g} s"))
        publisher.put(payload, attachment=_WARM_UP)
        time.sleep(_WARM_UP_EVERY_S)
    time.sleep(_SETTLE_S)


def _send(publisher: zenoh.Publisher, plan: Plan, on_progress: Callable[[int], None]) -> tuple[list[int], int]:
    payload = bytes(plan.n_bytes)
    sent_ns: list[int] = []
    n_skipped = 0
    period_ns = NS_PER_S / plan.rate_hz
    report_every = max(1, int(plan.rate_hz / 2))
    begin_ns = time.monotonic_ns()
    try:
        for i in range(plan.n_messages):
            due_ns = begin_ns + int(i * period_ns)
            now_ns = time.monotonic_ns()
            if now_ns > due_ns + period_ns:
                n_skipped += 1
                continue
            while now_ns < due_ns:
                time.sleep((due_ns - now_ns) * 1e-9)
                now_ns = time.monotonic_ns()
            attachment = Header(len(sent_ns), now_ns - begin_ns).pack()
            sent_ns.append(time.monotonic_ns())
            publisher.put(payload, attachment=attachment)
            if i % report_every == 0:
                on_progress(i)
    except KeyboardInterrupt:
        pass
    return sent_ns, n_skipped


def _drain(ears: _Ears, n_expected: int, timeout_s: float) -> None:
    give_up = time.monotonic() + timeout_s
    while len(ears.heard) < n_expected and time.monotonic() < give_up:
        time.sleep(_GLANCE_S)
    time.sleep(_GLANCE_S)


def _match(sent_ns: NDArray[np.int64], heard: list[tuple[int, Any]], timeout_s: float) -> Probed:
    delay_ns = np.full(len(sent_ns), -1, dtype=np.int64)
    n_duplicates = n_late = n_foreign = 0
    for recv_ns, attachment in list(heard):
        octets = b"" if attachment is None else attachment.to_bytes()
        header = Header.unpack(octets)
        if header is None or header.seq >= len(sent_ns):
            n_foreign += octets != _WARM_UP
            continue
        taken_ns = recv_ns - int(sent_ns[header.seq])
        if delay_ns[header.seq] >= 0:
            n_duplicates += 1
        elif taken_ns > timeout_s * NS_PER_S:
            n_late += 1
        else:
            delay_ns[header.seq] = max(taken_ns, 0)
    origin_ns = sent_ns[0] if len(sent_ns) else 0
    return Probed(sent_ns - origin_ns, delay_ns, n_duplicates, n_late, 0, n_foreign)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Keep the interpreter from stalling the ends: exact timers, short turns, no collection of garbage."""
    switch_s, collects = sys.getswitchinterval(), gc.isenabled()
    sharpen_timers()
    sys.setswitchinterval(_SWITCH_S)
    gc.disable()
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        if collects:
            gc.enable()
