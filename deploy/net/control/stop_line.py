"""Connection to a running session's patient for emergency stops: each request is repeated until it is answered."""

import queue
import secrets
import time
from contextlib import suppress
from types import TracebackType
from typing import Final, NamedTuple, Self

import zenoh
from pydantic import ValidationError

from tis.common.channels import release_key, stop_key, stopped_key
from tis.common.errors import Fault, PeerError
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.stop_messages import LATCH, EmergencyStop, StopState

TIME_OUT_S: Final = 3.0
WHERE: Final = "tis stop"
_EVERY_S: Final = 0.1


class Answer(NamedTuple):
    """The arms' state after a request, and how long the patient took to tell it."""

    state: StopState
    after_ms: float


class StopLine:
    """Sends requests and hears the patient's answers; close it before the session, as its context does."""

    def __init__(self, session: zenoh.Session, address: EmulatorAddress) -> None:
        self._address: Final = address
        self._key: Final = stopped_key(address.prefix)
        self._newest: StopState | None = None
        self._awaited = 0
        self._heard: Final[queue.SimpleQueue[StopState]] = queue.SimpleQueue()
        self._answers = session.declare_subscriber(self._key, self._hear)
        self._stops = publisher_of(session, stop_key(address.prefix))
        self._releases = publisher_of(session, release_key(address.prefix))

    def ask(self, request: EmergencyStop) -> Answer:
        """Send a request until the patient answers it; raises `PeerError` when it does not.

        A release travels on a key of its own, as not everybody may use it; a question travels with the stops.
        """
        publisher = self._releases if request.ends else self._stops
        self._awaited, payload, begun_s = request.number, request.model_dump_json(), time.monotonic()
        while time.monotonic() - begun_s < TIME_OUT_S:
            publisher.put(payload)
            with suppress(queue.Empty):
                while (state := self._heard.get(timeout=_EVERY_S)).number != request.number:
                    pass  # of the request before, which was answered more than once
                return Answer(state, 1e3 * (time.monotonic() - begun_s))
        if request.ends and self._newest is None:  # is it the patient that is silent, or netem that refuses releases?
            with suppress(PeerError):
                self.ask(EmergencyStop(stop=False, number=fresh_number()))
        raise PeerError(Fault(WHERE, self._address.endpoint, self._silence(request)))

    def _hear(self, sample: zenoh.Sample) -> None:
        try:
            state = StopState.model_validate_json(sample.payload.to_bytes())
        except ValidationError:
            return
        if str(sample.key_expr) != self._key:
            return
        self._newest = state
        if state.number == self._awaited:
            self._heard.put(state)

    def _silence(self, request: EmergencyStop) -> str:
        """Return why no answer may have come, by what the patient answered before, to whomever."""
        silent = f"the patient did not answer within {TIME_OUT_S:g} s"
        if self._newest is not None and request.ends and self._newest.release == "named":
            named = "so it hears only the clients in patient.safety.releasers"
            return f"{silent}: patient.safety.release is named, {named}"
        if self._newest is not None:
            return f"{silent}, but others: there are too many requests. It told last: {told(self._newest)}"
        return (
            f"no patient of session {self._address.prefix} confirmed within {TIME_OUT_S:g} s: none is running there, "
            "its patient.safety is off, or this client may not ask that (control in the scenario's security)"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for one in (self._stops, self._releases, self._answers):
            one.undeclare()  # type: ignore[no-untyped-call]


def fresh_number() -> int:
    """Return a number for a request, which no other request has."""
    return 1 + secrets.randbelow(LATCH - 1)


def told(state: StopState) -> str:
    """Return the arms' state in words."""
    if state.stop:
        return f"stopped by {listed(state, state.in_force)}"
    return "not stopped, but latched (patient.safety.latch)" if state.latched else "not stopped"


def listed(state: StopState, numbers: tuple[int, ...], other: str = "") -> str:
    """Return how many stops these are, and those that the state gives reasons of by number and reason."""
    reasons = dict(zip(state.in_force, map(_printable, state.reasons), strict=False))
    named = [f"number {n}" + (f": {reasons[n]}" if reasons[n] else "") for n in numbers if n in reasons]
    more = ", ..." if len(named) < len(numbers) else ""
    return f"{len(numbers)} {other}stop{'' if len(numbers) == 1 else 's'} ({', '.join(named)}{more})"


def _printable(text: str) -> str:
    """Return a text of others without what would steer a terminal."""
    return "".join(each if each.isprintable() else "?" for each in text)
