"""Emergency stops at the patient: requests on keys of their own, which no emulated queue delays."""

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from msgspec import DecodeError

from tis.common.channels import release_key, stop_key, stopped_key
from tis.common.messages import Message, decode, encode
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.peer_life import Alarm
from tis.common.records import REJECTED, Rejected
from tis.common.safety_records import STOPS, STOPS_IN_FORCE, StopNote, StopsInForceNote
from tis.common.signing import CHALLENGE_NS, NOBODY, Identity, attached_proof, challenge_at, signer_of
from tis.common.stop_messages import (
    LATCH,
    MAX_REASON_CHARS,
    MAX_REASONS,
    EmergencyStop,
    ReleaseRule,
    StopRefusal,
    StopState,
)
from tis.common.units import NS_PER_S
from tis.patient_side.safety.stops_in_force import BEFORE, Stop, StopsInForce

_MAX_BYTES: Final = 2048
_N_KNOWN: Final = 1000
MAX_RELEASES_PER_S: Final = 5
MAX_ANSWERS_PER_S: Final = 20
MAX_PROOFS_PER_S: Final = 20
"""Proofs of releases that are checked, each at the cost of up to a millisecond."""


class Taken(NamedTuple):
    """Outcome of a request; ``is_done``: it is carried out, and not only answered."""

    outputs: list[Output]
    is_done: bool


class _Verdict(NamedTuple):
    """Decision on a request; ``under``: number of the requested stop, ``by_stopper`` as in `StopNote`."""

    is_done: bool
    refused: StopRefusal = ""
    under: int = 0
    by_stopper: bool | None = None
    signer: str = ""


@dataclass
class _PerSecond:
    """Admits at most so many in any second of run time."""

    n_most: int
    _admitted_ns: deque[int] = field(default_factory=deque)

    def admits(self, at_ns: int) -> bool:
        """Admit one more, if the second before ``at_ns`` has room for it."""
        while self._admitted_ns and at_ns - self._admitted_ns[0] >= NS_PER_S:
            self._admitted_ns.popleft()
        if len(self._admitted_ns) >= self.n_most:
            return False
        self._admitted_ns.append(at_ns)
        return True


@dataclass
class EmergencyStops:
    """Reads requests to stop or to release, carries them out, and answers each with the arms' state.

    A request is sent again until it is answered; a number that is known is not carried out again. A stop is always
    carried out; at most `MAX_RELEASES_PER_S` releases are. What is carried out is always answered and recorded, so
    that is bounded; of all else `MAX_ANSWERS_PER_S` are, and the rest is only counted. Oracle:
    test_emergency_stop, properties over arbitrary requests.

    ``own``: messages are signed, so a release needs the proof of a name in ``releasers``, and answers have this
    side's. A stop needs none: it must not fail, but one that nobody signed is told (``unsigned_stop``).
    """

    session: str
    rule: ReleaseRule = "anyone"
    releasers: Collection[str] = ()
    own: Identity | None = None
    in_force: StopsInForce = field(default_factory=StopsInForce)
    n_rejected: int = 0
    n_stops: int = 0
    n_releases: int = 0
    n_by_others: int = 0
    n_refused: int = 0
    n_flooded: int = 0
    n_unsigned: int = 0
    alarms: Mapping[Alarm, int] = field(default_factory=dict)
    """Alarms, by the run time at which they began; replaced, never changed, as another thread reads them."""
    _led_by: int = 0
    _released: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_N_KNOWN))
    _releases: _PerSecond = field(default_factory=lambda: _PerSecond(MAX_RELEASES_PER_S))
    _rejects: _PerSecond = field(default_factory=lambda: _PerSecond(MAX_ANSWERS_PER_S))
    _proofs: _PerSecond = field(default_factory=lambda: _PerSecond(MAX_PROOFS_PER_S))
    _answers: _PerSecond = field(default_factory=lambda: _PerSecond(MAX_ANSWERS_PER_S))

    def __post_init__(self) -> None:
        self.keys = (stop_key(self.session), release_key(self.session))
        self.answer_key = stopped_key(self.session)

    @property
    def is_stopped(self) -> bool:
        """Whether the arms are stopped: any stop is in force."""
        return bool(self.in_force.by_number)

    def take(self, arrival: Arrival, is_latched: bool = False) -> Taken:
        """Return the answer to a request and its records; what is none is counted, and rejected.

        ``is_latched``: an arm is safe until a release.
        """
        if len(arrival.payload) > _MAX_BYTES:
            return Taken(self._reject(arrival), is_done=False)
        try:
            request = decode(arrival.payload, EmergencyStop)
        except DecodeError:
            return Taken(self._reject(arrival), is_done=False)
        at_ns, was_stopped = arrival.recv_ns, self.is_stopped
        verdict = self._stop(request, arrival) if request.stop else self._release(request, arrival, is_latched)
        if verdict.is_done:
            if self.is_stopped != was_stopped:
                self._led_by = verdict.under or request.number
        elif not self._answers.admits(at_ns):
            self.n_flooded += 1
            self._raise("stop_flood", at_ns)
            return Taken([], is_done=False)
        self.n_refused += verdict.refused != ""
        note = StopNote(
            at_ns=at_ns,
            stop=request.stop,
            reason=request.reason,
            number=verdict.under or request.number,
            ends=0 if request.stop else request.ends,
            by_stopper=verdict.by_stopper,
            stopped=self.is_stopped,
            changed=self.is_stopped != was_stopped,
            signer=verdict.signer,
            refused=verdict.refused,
        )
        # First what a patient that is killed now must know when it is started anew.
        kept = [self._record(STOPS_IN_FORCE, at_ns, self.in_force.note(at_ns))] if verdict.is_done else []
        noted = [self._record(STOPS, at_ns, note)] if verdict.is_done or verdict.refused else []
        still_latched = is_latched and not (verdict.is_done and not self.is_stopped)
        return Taken([*kept, self._answer(request, verdict, still_latched, at_ns), *noted], verdict.is_done)

    def resume(self, in_force: bytes | None, last: bytes | None) -> bool:
        """Go on after the stops in force of an earlier process; return whether the arms are stopped.

        What cannot be read stops them. ``last`` is the last stop or release, for replays of logs of before, which
        hold no stops in force.
        """
        try:
            if in_force is not None:
                self.in_force.resume(decode(in_force, StopsInForceNote))
            elif last is not None and decode(last, StopNote).leaves_stopped:
                self.in_force.add(Stop(0, "", BEFORE))
        except ValueError:
            self.in_force.add(Stop(0, "", BEFORE))
        return self.is_stopped

    def counters(self) -> dict[str, int]:
        """Return the numbers of requests carried out, by others than the stopper, refused, only counted, unsigned."""
        return {
            "stops": self.n_stops,
            "releases": self.n_releases,
            "releases_by_others": self.n_by_others,
            "stop_requests_refused": self.n_refused,
            "stop_requests_flooded": self.n_flooded,
            **({} if self.own is None else {"stops_unsigned": self.n_unsigned}),
        }

    def _stop(self, request: EmergencyStop, arrival: Arrival) -> _Verdict:
        """Put a stop in force, on either key and at any rate, whoever asks."""
        under, is_new = self.in_force.add(Stop(request.number, request.lock, request.reason))
        self.n_stops += is_new
        signer = self._signer(arrival, "") if is_new else ""
        if signer == NOBODY:
            self.n_unsigned += 1
            self._raise("unsigned_stop", arrival.recv_ns)
        return _Verdict(is_new, "" if under else "ended before", under, signer=signer)

    def _signer(self, arrival: Arrival, challenge: str) -> str:
        """Return who signed a request, `NOBODY` where none is proved; "" where messages are not signed."""
        if self.own is None:
            return ""
        return signer_of(self.own, arrival.key, challenge, arrival.payload, arrival.attachment).name or NOBODY

    def _release(self, request: EmergencyStop, arrival: Arrival, is_latched: bool) -> _Verdict:
        """End the stop that a release names, or the latch, if its key, its secret and the rate allow it."""
        number = request.ends
        if not number or (request.number and (request.number, number) in self._released):
            return _Verdict(is_done=False)
        if arrival.key != self.keys[1]:
            return _Verdict(is_done=False, refused="not on this key")
        ends_latch = number == LATCH and is_latched and not self.is_stopped
        refused = "" if ends_latch else self.in_force.refusal(number, request.secret, self.rule)
        if refused:
            return _Verdict(is_done=False, refused=refused)
        signer = ""
        if self.own is not None:
            if not self._proofs.admits(arrival.recv_ns):
                return _Verdict(is_done=False, refused="too many releases")
            signer = self._releaser(request, arrival)
            if signer not in self.releasers:
                return _Verdict(is_done=False, refused="not signed", signer=signer)
        if not self._releases.admits(arrival.recv_ns):
            return _Verdict(is_done=False, refused="too many releases")
        by_stopper = None if ends_latch else self.in_force.is_by_stopper(number, request.secret)
        if not ends_latch:
            self.in_force.end(number)
        self._released.append((request.number, number))
        self.n_releases += 1
        if by_stopper is False:
            self.n_by_others += 1
            self._raise("foreign_release", arrival.recv_ns)
        return _Verdict(is_done=True, by_stopper=by_stopper, signer=signer)

    def _releaser(self, request: EmergencyStop, arrival: Arrival) -> str:
        """Return who signed a release lately; `NOBODY`, too, for one without a number, which could come again."""
        challenges = (self._challenge(arrival.recv_ns - age_ns) for age_ns in (0, CHALLENGE_NS))
        signers = (self._signer(arrival, one) for one in challenges if request.number)
        return next((one for one in signers if one != NOBODY), NOBODY)

    def _challenge(self, at_ns: int) -> str:
        """Return what a release has to state; empty where messages are not signed."""
        return "" if self.own is None else challenge_at(self.own.public, at_ns)

    def _raise(self, alarm: Alarm, at_ns: int) -> None:
        if alarm not in self.alarms:
            self.alarms = {**self.alarms, alarm: at_ns}

    def _answer(self, request: EmergencyStop, verdict: _Verdict, is_latched: bool, at_ns: int) -> Emission:
        stops = self.in_force.by_number
        reasons = [stop.reason[:MAX_REASON_CHARS] for stop in stops.values()][:MAX_REASONS]
        state = StopState(
            number=request.number,
            stop=self.is_stopped,
            led_by=self._led_by,
            under=verdict.under,
            in_force=tuple(stops),
            reasons=tuple(reasons),
            latched=is_latched,
            shared=self.in_force.is_joint(verdict.under),
            release=self.rule,
            challenge=self._challenge(at_ns),
            refused=verdict.refused,
        )
        payload, proof = encode(state), b""
        if self.own is not None:
            proof = attached_proof(self.own, self.answer_key, state.challenge, payload)
        return Emission("east", self.answer_key, payload, proof, lambda _: ())

    def _reject(self, arrival: Arrival) -> list[Output]:
        self.n_rejected += 1
        if not self._rejects.admits(arrival.recv_ns):  # of their own: garbage must not silence requests
            self._raise("stop_flood", arrival.recv_ns)
            return []
        head = arrival.payload[:32].hex()
        note = Rejected(
            key=arrival.key, recv_ns=arrival.recv_ns, reason="the payload is no EmergencyStop", head_hex=head
        )
        return [self._record(REJECTED, arrival.recv_ns, note)]

    def _record(self, topic: str, at_ns: int, note: Message) -> Record:
        return Record(topic, at_ns, note)
