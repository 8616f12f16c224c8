"""Emergency stops at the patient, without a network."""

import json
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.patient_side.safety.stop_requests import (
    ANSWER_KEY,
    LOCK,
    RELEASE_KEY,
    SECRET,
    STOP_KEY,
    a_release,
    a_stop,
    request,
)
from tis.common.messages import decode, encode
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.records import REJECTED
from tis.common.runtime.signing import SharedSecret
from tis.common.safety_records import STOPS, STOPS_IN_FORCE, StopNote, StopsInForceNote
from tis.common.signing import CHALLENGE_NS, SECRETS, attached_proof, challenge_at, signer_of
from tis.common.stop_messages import LATCH, MAX_IN_FORCE, EmergencyStop, ReleaseRule, StopState, lock_of
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.patient_side.safety.emergency_stop import EmergencyStops


def _state(outputs: list[Output]) -> StopState:
    (answer,) = [one for one in outputs if isinstance(one, Emission)]
    assert (answer.network, answer.key) == ("east", ANSWER_KEY)
    return decode(answer.payload, StopState)


def _notes(outputs: list[Output]) -> list[StopNote]:
    return [one.data for one in outputs if isinstance(one, Record) and isinstance(one.data, StopNote)]


def test_a_stop_is_answered_with_the_arms_state_and_logged_once() -> None:
    stops = EmergencyStops("tis")
    outputs, is_done = stops.take(a_stop(3, 5, LOCK, "smoke"))
    assert is_done
    assert _state(outputs) == StopState(
        number=3, stop=True, led_by=3, under=3, in_force=(3,), reasons=("smoke",), latched=False, release="anyone",
        refused="",
    )  # fmt: skip
    kept, _, logged = outputs  # what a new process needs stands there before anybody believes the stop
    assert kept == Record(STOPS_IN_FORCE, 5, StopsInForceNote(at_ns=5, stops=f"3:{LOCK}"))
    note = StopNote(at_ns=5, stop=True, reason="smoke", number=3, stopped=True, changed=True)
    assert logged == Record(STOPS, 5, note)
    (again,), is_done = stops.take(a_stop(3, 6, LOCK, "smoke"))
    assert _state([again]).in_force == (3,)
    assert not is_done
    assert stops.is_stopped


def test_a_repeat_after_the_release_is_answered_with_the_state_not_with_an_echo() -> None:
    """A stops, B releases, and A's request comes once more: the arm tracks, and A must not be told otherwise."""
    stops = EmergencyStops("tis")
    stops.take(a_stop(1, 0, LOCK))
    assert not _state(stops.take(a_release(2, ends=1, at_ns=50)).outputs).stop
    outputs, is_done = stops.take(a_stop(1, 100, LOCK))
    state = _state(outputs)
    assert (is_done, stops.is_stopped) == (False, False)
    assert (state.number, state.stop, state.under, state.led_by, state.refused) == (1, False, 0, 2, "ended before")


def test_each_stop_stays_in_force_until_a_release_that_names_it() -> None:
    stops = EmergencyStops("tis")
    stops.take(a_stop(1, reason="a hand"))
    stops.take(a_stop(2, reason="smoke"))
    outputs, is_done = stops.take(a_release(3, ends=1))
    assert is_done
    assert _notes(outputs)[0].changed is False
    assert (_state(outputs).stop, _state(outputs).in_force, _state(outputs).reasons) == (True, (2,), ("smoke",))
    # late repeats of both change nothing
    for late in (a_stop(1), a_release(3, ends=1)):
        assert not stops.take(late).is_done
    assert _state(stops.take(a_release(4, ends=1)).outputs).refused == "no such stop in force"
    assert not _state(stops.take(a_release(5, ends=2)).outputs).stop


@pytest.mark.parametrize("key", [STOP_KEY, RELEASE_KEY])
def test_a_release_that_names_no_stop_asks_for_the_state(key: str) -> None:
    stops = EmergencyStops("tis")
    stops.take(a_stop(1, reason="x" * 200))
    outputs, is_done = stops.take(request(key, 5, stop=False, number=2))
    state = _state(outputs)
    assert (is_done, state.stop, state.in_force, state.reasons, state.refused) == (False, True, (1,), ("x" * 40,), "")
    assert len(outputs) == 1


def test_releases_travel_on_a_key_of_their_own_and_stops_on_either() -> None:
    stops = EmergencyStops("tis")
    assert stops.take(request(RELEASE_KEY, 5, stop=True, number=1)).is_done
    outputs, is_done = stops.take(request(STOP_KEY, 5, stop=False, number=2, ends=1))
    assert (is_done, _state(outputs).refused) == (False, "not on this key")
    assert [note.refused for note in _notes(outputs)] == ["not on this key"]
    assert stops.is_stopped


def test_a_stop_without_a_number_is_told_the_one_that_it_is_given() -> None:
    stops = EmergencyStops("tis")
    state = _state(stops.take(a_stop(0)).outputs)
    assert (state.number, state.stop, state.in_force) == (0, True, (state.under,))
    assert state.under >= 1 << 52
    assert not _state(stops.take(a_release(9, ends=state.under)).outputs).stop
    assert stops.take(a_stop(0)).is_done


@pytest.mark.parametrize(
    ("rule", "secret", "released", "by_others"),
    [
        ("anyone", SECRET, True, 0),
        ("anyone", "", True, 1),
        ("stopper", SECRET, True, 0),
        ("stopper", "", False, 0),
        ("stopper", "another", False, 0),
        ("named", "", True, 1),  # netem lets only the named ones use the key
    ],
)
def test_who_may_release(rule: ReleaseRule, secret: str, released: bool, by_others: int) -> None:
    stops = EmergencyStops("tis", rule)
    stops.take(a_stop(1, lock=LOCK))
    outputs, is_done = stops.take(a_release(2, ends=1, secret=secret))
    (note,) = _notes(outputs)
    assert is_done == released == (not _state(outputs).stop)
    assert (note.refused, note.ends) == ("" if released else "wrong secret", 1)
    counts = stops.counters()
    assert (counts["releases"], counts["releases_by_others"], counts["stop_requests_refused"]) == (
        int(released), by_others, int(not released),
    )  # fmt: skip
    assert note.by_stopper is (None if not released else secret == SECRET)
    assert SECRET not in str(outputs[1:])  # a secret stands in no log


def test_a_stop_without_a_lock_is_ended_by_whoever_names_it() -> None:
    stops = EmergencyStops("tis", "stopper")
    stops.take(a_stop(1))
    (note,) = _notes(stops.take(a_release(2, ends=1)).outputs)
    assert (note.by_stopper, note.stopped, note.changed) == (None, False, True)
    assert stops.counters()["releases_by_others"] == 0


def test_a_latch_is_ended_by_a_release_that_names_it_while_no_stop_is_in_force() -> None:
    stops = EmergencyStops("tis")
    assert _state(stops.take(request(STOP_KEY, 5, stop=False, number=1), is_latched=True).outputs).latched
    outputs, is_done = stops.take(a_release(2, ends=LATCH), is_latched=True)
    assert (is_done, _state(outputs).latched) == (True, False)
    assert _state(stops.take(a_release(3, ends=LATCH)).outputs).refused == "no such stop in force"
    stops.take(a_stop(4))
    assert _state(stops.take(a_release(5, ends=LATCH), is_latched=True).outputs).refused == "no such stop in force"
    assert not _state(stops.take(a_release(6, ends=4), is_latched=True).outputs).latched


def test_a_flood_of_stops_and_releases_is_bounded_and_counted() -> None:
    """30 000 requests in 4 s, each release of a stop in force: five releases a second, and a few answers."""
    stops, n_answers, n_notes = EmergencyStops("tis"), 0, 0
    for k in range(15_000):
        at_ns = k * 4 * NS_PER_S // 15_000
        outputs = stops.take(a_stop(2 * k + 1, at_ns)).outputs
        outputs += stops.take(a_release(2 * k + 2, next(iter(stops.in_force.by_number)), at_ns)).outputs
        n_answers += sum(isinstance(one, Emission) for one in outputs)
        n_notes += len(_notes(outputs))
    counts = stops.counters()
    assert len(stops.in_force.by_number) == MAX_IN_FORCE + 1
    assert (counts["releases"], counts["stops"]) == (4 * 5, 4 * 5 + MAX_IN_FORCE + 1)
    assert n_answers == counts["stops"] + counts["releases"] + 4 * 20
    assert n_answers + counts["stop_requests_flooded"] == 30_000
    assert 0 < counts["stop_requests_refused"] <= 4 * 20
    assert n_notes == counts["stops"] + counts["releases"] + counts["stop_requests_refused"]


def test_in_a_flood_a_stop_is_carried_out_and_confirmed() -> None:
    stops = EmergencyStops("tis")
    for k in range(3000):
        stops.take(request(STOP_KEY, k, stop=False, number=k))
    outputs, is_done = stops.take(a_stop(5000, 3000))
    assert (is_done, _state(outputs).stop) == (True, True)
    assert stops.take(request(STOP_KEY, 3001, stop=False, number=1)).outputs == []
    # a second later others are answered again
    assert _state(stops.take(request(STOP_KEY, NS_PER_S, stop=False, number=1)).outputs).stop


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"{}", b'{"stop": 1}', b"\xff", json.dumps({"stop": True, "reason": "x" * 201}).encode(),
        b'{"stop": true, "lock": "short"}', b'{"stop": false, "ends": -1}',
        b'{"stop": false, "number": 9007199254740992}',
    ],
)  # fmt: skip
def test_what_is_no_request_stops_nothing_and_is_rejected(payload: bytes) -> None:
    stops = EmergencyStops("tis")
    (record,), is_done = stops.take(Arrival("east", STOP_KEY, payload, b"", 5))
    assert not is_done
    assert isinstance(record, Record)
    assert record.topic == REJECTED
    assert not stops.is_stopped
    records = [stops.take(Arrival("east", STOP_KEY, payload, b"", 6)).outputs for _ in range(1000)]
    assert (stops.n_rejected, sum(map(len, records))) == (1001, 19)


def test_the_longest_answer_passes_netem() -> None:
    stops = EmergencyStops("tis")
    for number in range(MAX_IN_FORCE + 1):
        outputs, _ = stops.take(a_stop(LATCH - 1 - number, reason="\0" * 200))
    (answer,) = [one for one in outputs if isinstance(one, Emission)]
    assert 2048 < len(answer.payload) < 4096
    assert len(a_stop(LATCH - 1, lock=LOCK, reason="\0" * 200).payload) < 2048


@dataclass
class _Twin:
    """Oracle of the properties: the stops in force as sets, from what the patient says that it carried out."""

    stops: EmergencyStops
    in_force: set[int] = field(default_factory=set)
    released_ns: list[int] = field(default_factory=list)

    def take(self, arrival: Arrival) -> None:
        asked = decode(arrival.payload, EmergencyStop)
        before = set(self.in_force)
        outputs, is_done = self.stops.take(arrival)
        if is_done and asked.stop:
            self.in_force |= set(self.stops.in_force.by_number) - before
        elif is_done:
            self.in_force -= {asked.ends}
            self.released_ns.append(arrival.recv_ns)
        # a release ends only what it names, and a stop adds one at most
        assert set(self.stops.in_force.by_number) == self.in_force
        assert len(self.in_force ^ before) == int(is_done)
        assert self.stops.is_stopped == bool(self.in_force)
        # a stop is carried out at any rate, unless it ended before, of which few are answered
        if asked.stop and not self.stops.is_stopped and outputs:
            assert _state(outputs).refused == "ended before"
        for one in outputs:
            if isinstance(one, Emission):
                state = decode(one.payload, StopState)
                assert (state.number, state.stop) == (asked.number, bool(self.in_force))
                assert set(state.in_force) == self.in_force
        assert sum(arrival.recv_ns - t_ns < NS_PER_S for t_ns in self.released_ns) <= 5


_steps = st.lists(
    st.tuples(
        st.integers(0, 400), st.sampled_from([STOP_KEY, RELEASE_KEY]), st.booleans(), st.integers(0, 60),
        st.integers(-9, 9), st.sampled_from(["", SECRET, "another"]),
    ),
    max_size=80,
)  # fmt: skip


@given(_steps, st.sampled_from(["anyone", "stopper", "named"]))
def test_over_any_requests_the_arms_are_stopped_while_a_stop_is_in_force(steps: Any, rule: ReleaseRule) -> None:
    twin, at_ms = _Twin(EmergencyStops("tis", rule)), 0
    for wait_ms, key, stop, number, ends, secret in steps:
        at_ms += wait_ms
        if ends < 0:  # one of the stops in force, or none
            ends = ([*twin.in_force] * 9 or [0] * 9)[ends]
        lock = lock_of(secret) if stop and secret else ""
        fields = {"stop": stop, "number": number, "lock": lock, "ends": ends, "secret": secret}
        twin.take(request(key, at_ms * NS_PER_MS, **fields))


@given(st.lists(st.integers(0, 400), min_size=6, max_size=40))
def test_a_release_is_carried_out_while_less_than_five_were_within_a_second(waits_ms: list[int]) -> None:
    """Oracle: the instants of all carried-out releases, counted anew at each."""
    stops, done_ms, at_ms = EmergencyStops("tis"), list[int](), 0
    for k, wait_ms in enumerate(waits_ms, start=1):
        at_ms += wait_ms
        stops.take(a_stop(k, at_ms * NS_PER_MS))
        _, is_done = stops.take(a_release(100 + k, ends=k, at_ns=at_ms * NS_PER_MS))
        assert is_done == (sum(at_ms - one < 1000 for one in done_ms) < 5)
        done_ms += [at_ms] * is_done


def test_a_new_process_goes_on_with_the_stops_in_force() -> None:
    stops = EmergencyStops("tis", "stopper")
    stops.take(a_stop(4, lock=LOCK))
    kept = stops.take(a_stop(5, lock=lock_of("another"))).outputs[0]
    again = EmergencyStops("tis", "stopper")
    assert isinstance(kept, Record)
    assert isinstance(kept.data, StopsInForceNote)
    assert again.resume(encode(kept.data), None)
    assert _state(again.take(a_release(6, ends=5, secret=SECRET)).outputs).refused == "wrong secret"
    assert _state(again.take(a_release(7, ends=4, secret=SECRET)).outputs).in_force == (5,)
    outputs, _ = again.take(a_release(8, ends=5, secret="another"))
    assert not _state(outputs).stop
    kept = outputs[0]
    assert isinstance(kept, Record)
    assert isinstance(kept.data, StopsInForceNote)
    assert not EmergencyStops("tis").resume(encode(kept.data), None)
    assert not EmergencyStops("tis").resume(None, None)


@pytest.mark.parametrize("kept", [b"", b"{}", b'{"at_ns": 5, "stops": "1:2"}'])
def test_what_a_new_process_cannot_read_stops_the_arms(kept: bytes) -> None:
    assert EmergencyStops("tis").resume(kept, None)
    assert EmergencyStops("tis").resume(None, kept)


def _signed(arrival: Arrival, own: SharedSecret, challenge: str = "") -> Arrival:
    return arrival._replace(attachment=attached_proof(own, arrival.key, challenge, arrival.payload))


def test_where_messages_are_signed_anybody_stops_and_only_who_signs_releases() -> None:
    stops, own = EmergencyStops("tis", releasers={SECRETS}, own=SharedSecret(b"s" * 32)), SharedSecret(b"s" * 32)
    assert stops.own is not None
    challenge, stranger = challenge_at(stops.own.public, 5), SharedSecret(b"t" * 32)
    taken = [stops.take(one) for one in (a_stop(1), _signed(a_stop(2), own), _signed(a_stop(3), stranger))]
    assert [one.is_done for one in taken] == [True] * 3
    assert [note.signer for one in taken for note in _notes(one.outputs)] == ["-", SECRETS, "-"]
    assert (stops.alarms, stops.counters()["stops_unsigned"]) == ({"unsigned_stop": 5}, 2)
    release = a_release(9, ends=1)
    forged = (
        release,
        _signed(release, stranger, challenge),
        _signed(release, own),
        _signed(release, own, challenge_at("1" * 64, 5)),  # of another process of the patient
        _signed(a_release(0, ends=1), own, challenge),  # one without a number could come again
        release._replace(attachment=_signed(a_release(8, ends=2), own, challenge).attachment),
        release._replace(attachment=b"\xff" * 50_000),
    )
    for one in forged:
        outputs, is_done = stops.take(one)
        assert (_state(outputs).refused, is_done) == ("not signed", False)
    assert stops.is_stopped
    outputs, is_done = stops.take(_signed(release, own, challenge))
    assert is_done
    (answer,) = [one for one in outputs if isinstance(one, Emission)]
    assert isinstance(answer.attachment, bytes)
    assert signer_of(own, ANSWER_KEY, challenge, answer.payload, answer.attachment).name == SECRETS
    assert decode(answer.payload, StopState).challenge == challenge
    assert [note.signer for note in _notes(outputs)] == [SECRETS]
    for k in range(30):  # checks of proofs are bounded
        assert not stops.take(a_release(10 + k, ends=2, at_ns=6)).is_done
    for at_ns, is_done in ((7, False), (2 * NS_PER_S, True)):
        found = stops.take(_signed(a_release(50, ends=2, at_ns=at_ns), own, challenge)).is_done
        assert found == is_done


def test_a_signed_release_that_was_held_back_expires() -> None:
    own = SharedSecret(b"s" * 32)
    for late_ns, is_done in ((0, True), (CHALLENGE_NS, True), (2 * CHALLENGE_NS, False), (360 * CHALLENGE_NS, False)):
        stops = EmergencyStops("tis", releasers={SECRETS}, own=own)
        told = _state(stops.take(a_stop(1)).outputs).challenge
        outputs, found = stops.take(_signed(a_release(9, ends=1, at_ns=5 + late_ns), own, told))
        assert (found, stops.is_stopped) == (is_done, not is_done)
        fresh = _state(outputs).challenge
        assert is_done or stops.take(_signed(a_release(10, ends=1, at_ns=6 + late_ns), own, fresh)).is_done


def test_garbage_does_not_silence_a_question() -> None:
    stops = EmergencyStops("tis")
    for at_ns in range(500):
        stops.take(Arrival("east", STOP_KEY, b"{", b"", at_ns))
    assert _state(stops.take(a_release(9, ends=0, at_ns=501)).outputs).number == 9
    assert stops.alarms == {"stop_flood": 20}
    assert not stops.take(Arrival("east", STOP_KEY, b"{" * 3000, b"", 2 * NS_PER_S)).is_done
    assert stops.n_rejected == 501


@pytest.mark.parametrize(("stop", "is_stopped"), [("true", True), ("false", False)])
def test_a_log_of_before_tells_by_its_last_request_whether_the_arm_was_stopped(stop: str, is_stopped: bool) -> None:
    stops = EmergencyStops("tis")
    assert stops.resume(None, f'{{"at_ns": 5, "stop": {stop}, "reason": ""}}'.encode()) == is_stopped
