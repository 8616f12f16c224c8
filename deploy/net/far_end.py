"""Receiving end of a probe on another host: a client that fetches its stamps and compares the clocks."""

import contextlib
import threading
import time
from typing import Final

import zenoh

from tis.common.clocks import SHARED, ClockModel, Exchanges, Stamps, fit_clock
from tis.common.errors import Fault, PeerError
from tis.common.host_records import ExchangeNote
from tis.common.node import Record
from tis.common.runtime.clock import WallClock
from tis.common.runtime.clock_watch import ClockWatch
from tis.deploy.net.probe import Arrivals, Plan
from tis.deploy.net.reflector import Batch, clock_key, stamps_key

_WHERE: Final = "tis net probe"
_LATER: Final = "later"
_EVERY_S: Final = 1.0
_QUICK_S: Final = 0.05


class _Notes:
    """Recorder of the exchanges of a clock watch."""

    def __init__(self) -> None:
        self.stamps: list[Stamps] = []

    def record(self, record: Record) -> None:
        note = record.data
        if isinstance(note, ExchangeNote):
            self.stamps.append((note.asked_ns, note.received_ns, note.replied_ns, note.answered_ns))


class FarEnd:
    """Client of a `tis net reflect`: a thread fetches its stamps each second, so that they survive its end.

    The far end is unavailable when it has not answered for ``plan.wait_s``, when another instance answers (it was
    restarted), or when it has dropped stamps that were not fetched yet.
    """

    def __init__(self, session: zenoh.Session, plan: Plan) -> None:
        self.failure = ""
        self._session, self._plan = session, plan
        self._key = stamps_key(plan.key)
        self._arrivals = Arrivals()
        self._notes = _Notes()
        self._next, self._far_name = 0, ""
        self._answered_s = time.monotonic()
        self._known_until_s = 0.0
        self._condition = threading.Condition()
        self._pause_s = _EVERY_S
        self._closed = False
        self._thread = threading.Thread(target=self._keep_fetching, name="stamps", daemon=True)
        self._watch = ClockWatch(session, clock_key(plan.key), plan.timeout_s)

    def meet(self) -> None:
        """Find the far end and compare the clocks for the first time; raises `PeerError` without an answer."""
        give_up = time.monotonic() + self._plan.wait_s
        missing = Fault(
            _WHERE, "--reflector", f"no `tis net reflect` answers on {self._plan.key} within {self._plan.wait_s:g} s"
        )
        while not (batches := self._query(_LATER)):
            if time.monotonic() >= give_up:
                raise PeerError(missing)
            time.sleep(_QUICK_S)
        if len({batch.name for batch in batches}) > 1:
            raise PeerError(
                Fault(_WHERE, "--key", "several far ends answer here: give each its own key", self._plan.key)
            )
        # from here on only this instance counts, and only stamps after its present total
        self._far_name, self._next = batches[0].name, batches[0].total
        while True:
            try:
                self._watch.meet()
                break
            except PeerError:
                if time.monotonic() >= give_up:
                    raise PeerError(missing) from None
                time.sleep(_QUICK_S)
        self._watch.follow(self._notes, WallClock(0), 0)
        self._answered_s = time.monotonic()
        self._thread.start()

    @property
    def host(self) -> str:
        """Return the far end's host name."""
        return self._far_name.partition(" ")[0]

    def arrivals(self) -> Arrivals:
        """Return the fetched stamps."""
        return self._arrivals

    def unavailable(self) -> bool:
        """Tell whether no further stamps will come."""
        return bool(self.failure)

    def settle(self, hurry: bool) -> None:
        """Fetch often from now on (``hurry``); or wait for all stamps so far, then fetch each second again."""
        requested_s = time.monotonic()
        with self._condition:
            self._pause_s = _QUICK_S
            self._condition.notify_all()
            if not hurry:
                longest_s = 2 * (self._plan.wait_s + self._plan.timeout_s)
                self._condition.wait_for(lambda: self._known_until_s >= requested_s or bool(self.failure), longest_s)
                self._pause_s = _EVERY_S

    def clock(self) -> tuple[ClockModel, Exchanges]:
        """Return this host's clock against the far end's; raises `PeerError` when the clocks cannot be compared."""
        if self._watch.shared:
            return SHARED, Exchanges.of([])
        exchanges = Exchanges.of(self._notes.stamps)
        if not len(exchanges):
            raise PeerError(Fault(_WHERE, "--reflector", "the answers of its clock contradict each other"))
        return fit_clock(exchanges), exchanges

    def close(self) -> None:
        """Stop fetching; a second call does nothing."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
        if self._thread.ident is not None:
            self._thread.join()
        self._watch.close()

    def _keep_fetching(self) -> None:
        while not self._closed and not self.failure:
            requested_s = time.monotonic()
            complete = self._fetch()
            with self._condition:
                if complete:
                    self._known_until_s = requested_s
                elif time.monotonic() - self._answered_s > self._plan.wait_s:
                    self.failure = self.failure or f"did not answer for {self._plan.wait_s:g} s"
                self._condition.notify_all()
                if complete is not False and not self._closed:
                    self._condition.wait(self._pause_s)

    def _fetch(self) -> bool | None:
        """Fetch one batch; return whether it ends with the newest stamp, None without an answer."""
        batch = next(iter(self._query(str(self._next))), None)
        if batch is None:
            return None
        self._answered_s = time.monotonic()
        if batch.name != self._far_name:
            self.failure = "was restarted"
            return None
        if batch.first != self._next:
            self.failure = "has dropped stamps that were not fetched in time"
            return None
        for row in batch.rows:
            self._arrivals.add(row)
        self._next += len(batch.rows)
        return self._next == batch.total

    def _query(self, first: str) -> list[Batch]:
        found: list[Batch] = []
        with contextlib.suppress(zenoh.ZError):  # the session is closed
            for reply in self._session.get(
                f"{self._key}?from={first}",
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=self._plan.timeout_s,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
                allowed_destination=zenoh.Locality.REMOTE,
            ):
                sample = reply.ok
                if sample is not None and sample.attachment is not None:
                    batch = Batch.unpack(sample.payload.to_bytes(), sample.attachment.to_bytes())
                    found += [] if batch is None else [batch]
        return found
