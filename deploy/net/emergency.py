"""Emergency stops of a running session: to stop the arms, and to end stops by name, with what proves the stopper."""

import queue
import re
import secrets
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Final, NamedTuple, Self

import zenoh
from msgspec import DecodeError

from tis.common.channels import release_key, stop_key, stopped_key
from tis.common.errors import Fault, InputError, PeerError, printable
from tis.common.messages import decode, encode
from tis.common.runtime.emulator_client import EmulatorAddress, connected
from tis.common.runtime.signing import client_identity
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.signing import SECRETS, Identity, attached_proof, signer_of
from tis.common.stop_messages import LATCH, EmergencyStop, StopState, lock_of

# Connection to a running session's patient for emergency stops: each request is repeated until it is answered.

TIME_OUT_S: Final = 3.0
WHERE: Final = "tis stop"
_EVERY_S: Final = 0.1


class Answer(NamedTuple):
    """The arms' state after a request, how long the patient took to tell it, and whether it signed that."""

    state: StopState
    after_ms: float
    is_signed: bool = False

    @property
    def confirmed(self) -> str:
        """Return who confirmed it, and when."""
        return f"confirmed {'and signed ' * self.is_signed}by the patient after {self.after_ms:.0f} ms"


class StopLine:
    """Sends requests and hears the patient's answers; close it before the session, as its context does.

    ``own`` signs the requests. An answer that states to be signed, and is not by the patient, is none.
    """

    def __init__(self, session: zenoh.Session, address: EmulatorAddress, own: Identity | None = None) -> None:
        self._address: Final = address
        self._own: Final = own
        self._knows: Final = threading.Event()
        self._key: Final = stopped_key(address.prefix)
        self._newest: StopState | None = None
        self._awaited = 0
        self._heard: Final[queue.SimpleQueue[tuple[StopState, bool]]] = queue.SimpleQueue()
        self._answers = session.declare_subscriber(self._key, self._hear)
        self._stops = publisher_of(session, stop_key(address.prefix))
        self._releases = publisher_of(session, release_key(address.prefix))

    def ask(self, request: EmergencyStop) -> Answer:
        """Send a request until the patient answers it; raises `PeerError` when it does not.

        A release travels on a key of its own, as not everybody may use it; a question travels with the stops.
        """
        publisher = self._releases if request.ends else self._stops
        self._awaited, payload, begun_s = request.number, encode(request), time.monotonic()
        proof, key = None, str(publisher.key_expr)
        if self._own is not None and (request.stop or request.ends):
            proof = attached_proof(self._own, key, self._challenge() if request.ends else "", payload)
        while time.monotonic() - begun_s < TIME_OUT_S:
            publisher.put(payload, attachment=proof)
            with suppress(queue.Empty):
                while (heard := self._heard.get(timeout=_EVERY_S))[0].number != request.number:
                    pass  # of the request before, which was answered more than once
                return Answer(heard[0], 1e3 * (time.monotonic() - begun_s), heard[1])
        if request.ends and self._newest is None:  # is it the patient that is silent, or netem that refuses releases?
            with suppress(PeerError):
                self.ask(EmergencyStop(stop=False, number=fresh_number()))
        raise PeerError(Fault(WHERE, self._address.endpoint, self._silence(request)))

    def _challenge(self) -> str:
        """Return what a release must state: that of any answer, as in a flood not every question is answered."""
        question, until_s = encode(EmergencyStop(stop=False, number=fresh_number())), time.monotonic() + TIME_OUT_S
        while self._newest is None and time.monotonic() < until_s:
            self._stops.put(question)
            self._knows.wait(_EVERY_S)
        return "" if self._newest is None else self._newest.challenge

    def _hear(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        try:
            state = decode(payload, StopState)
        except DecodeError:
            return
        if str(sample.key_expr) != self._key:
            return
        is_signed = False
        if self._own is not None and state.challenge:
            proof = b"" if sample.attachment is None else sample.attachment.to_bytes()
            is_signed = signer_of(self._own, self._key, state.challenge, payload, proof).name in ("patient", SECRETS)
            if not is_signed:
                return
        self._newest = state
        self._knows.set()
        if state.number == self._awaited:
            self._heard.put((state, is_signed))

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


@contextmanager
def _line(address: EmulatorAddress) -> Iterator[StopLine]:
    """Connect, with what proves this client's name; raises `InputError`, `PeerError`."""
    own = client_identity(address.client(), address.secret)
    with connected(address) as remote, StopLine(remote.session, address, own) as line:
        yield line


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
    reasons = dict(zip(state.in_force, map(printable, state.reasons), strict=False))
    named = [f"number {n}" + (f": {reasons[n]}" if reasons[n] else "") for n in numbers if n in reasons]
    more = ", ..." if len(named) < len(numbers) else ""
    return f"{len(numbers)} {other}stop{'' if len(numbers) == 1 else 's'} ({', '.join(named)}{more})"


_TOKEN: Final = re.compile(r"([0-9]{1,16})(?:-([0-9A-Za-z]{1,64}))?")
_MAX_CHARS: Final = 200
_N_TRIES: Final = 3
_AGAIN_S: Final = 0.25
_PATIENCE_S: Final = 20.0


class Token(NamedTuple):
    """What ends a stop: its number, and the secret that only its stopper knows; "" for a stop without one."""

    number: int
    secret: str

    def __str__(self) -> str:
        """Return the token as one word (inverse: `parse`)."""
        return f"{self.number}-{self.secret}" if self.secret else str(self.number)

    @classmethod
    def parse(cls, word: str) -> "Token":
        """Return the token of a word; raises `InputError`."""
        found = _TOKEN.fullmatch(word)
        if found is None or not 0 < int(found[1]) < LATCH:
            rule = "must be a token as tis stop prints it, NUMBER-SECRET, or the number of a stop without a secret"
            raise InputError(Fault(WHERE, "--release", rule, word))
        return cls(int(found[1]), found[2] or "")


class Stopped(NamedTuple):
    """What happened, in words, and what ends the stop; None: no token does."""

    text: str
    token: Token | None


def stop_arms(address: EmulatorAddress, reason: str) -> Stopped:
    """Stop the arms of a running session; raises `InputError`, `PeerError`."""
    with _line(address) as line:
        for _ in range(_N_TRIES):
            secret, number = secrets.token_hex(16), fresh_number()
            # a stop must not fail because of its text
            request = EmergencyStop(stop=True, reason=reason[:_MAX_CHARS], number=number, lock=lock_of(secret))
            answer = line.ask(request)
            state = answer.state
            if state.under:  # else somebody has ended it before its answer came: again, as another one
                break
        else:
            raise PeerError(Fault(WHERE, address.endpoint, f"somebody ended this stop at once, {_N_TRIES} times"))
    others = tuple(n for n in state.in_force if n != state.under)
    beside = f", beside {listed(state, others, 'other ')}" if others else ""
    text = f"stopped, {answer.confirmed}{beside}"
    if state.shared:
        return Stopped(f"{text}; it is one of too many stops, which no token ends", None)
    return Stopped(text, Token(state.under, secret))


def release_one(address: EmulatorAddress, token: Token) -> str:
    """End one stop; return what happened, with the state of the arms. Raises `InputError`, `PeerError`."""
    with _line(address) as line:
        answer = _end(line, address, token)  # without a question: in a flood only what is carried out is answered
    if answer.state.refused == "no such stop in force":
        fault = f"no stop of number {token.number} is in force: the arms are {told(answer.state)}"
        raise InputError(Fault(WHERE, "--release", fault))
    _check_signed(answer.state)
    if answer.state.refused:
        fault = f"the secret is not that of stop {token.number}: the arms are {told(answer.state)}"
        raise InputError(Fault(WHERE, "--release", fault))
    return _released(answer)


def release_all(address: EmulatorAddress, known: Mapping[int, str]) -> str:
    """End every stop in force that the scenario lets this client end, and the latch of a safe arm.

    ``known`` holds the secrets of own stops by their numbers. Returns what happened, with the state of the arms.
    Raises `InputError` where there is something to end, but nothing that this client may; `PeerError`.
    """
    with _line(address) as line:
        answer = line.ask(EmergencyStop(stop=False, number=fresh_number()))
        state = answer.state
        if not state.in_force and not state.latched:
            return f"no stop is in force, as the patient told after {answer.after_ms:.0f} ms"
        may = [n for n in state.in_force if state.release != "stopper" or n in known]
        if state.in_force and not may:
            raise InputError(Fault(WHERE, "--release", _need(state)))
        ended = False
        for number in may or [LATCH]:
            answer = _end(line, address, Token(number, known.get(number, "")))
            _check_signed(answer.state)
            ended |= answer.state.refused == ""
    # Where others ended them meanwhile there was nothing to do.
    if not ended and answer.state.stop:
        raise InputError(Fault(WHERE, "--release", _need(answer.state)))
    return _released(answer)


def _end(line: StopLine, address: EmulatorAddress, token: Token) -> Answer:
    """End a stop; where others end so many that the patient refuses more for now, again. Raises `PeerError`."""
    begun_s = time.monotonic()
    while time.monotonic() - begun_s < _PATIENCE_S:
        request = EmergencyStop(stop=False, number=fresh_number(), ends=token.number, secret=token.secret)
        answer = line.ask(request)
        if answer.state.refused != "too many releases":
            return answer
        time.sleep(_AGAIN_S)
    raise PeerError(Fault(WHERE, address.endpoint, f"refused for {_PATIENCE_S:g} s: too many releases from others"))


def _check_signed(state: StopState) -> None:
    """Raise `InputError` where a release lacks the signature of one who may release."""
    if state.refused == "not signed":
        rule = (
            "must be signed by one who may release: -c certs/NAME/zenoh.json5 of surgeon, security.control or "
            "patient.safety.releasers, or --secret-file"
        )
        raise InputError(Fault(WHERE, "--release", f"{rule}; the arms are {told(state)}"))


def _need(state: StopState) -> str:
    return (
        f"the arms stay stopped by {listed(state, state.in_force)}: patient.safety.release is {state.release}, so "
        "each needs the token that its tis stop printed (tis stop --release TOKEN), or its number if it has no secret"
    )


def _released(answer: Answer) -> str:
    state, text = answer.state, f"released, {answer.confirmed}"
    if not state.stop:
        return text
    return f"{text}; the arms stay stopped by {listed(state, state.in_force, 'other ')}"
