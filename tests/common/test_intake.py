import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import to_builtins
from msgspec.structs import asdict

from tests.nodes import LEFT, Stamp, a_pose, an_arrival
from tis.common.intake import Intake, SeenNumbers
from tis.common.messages import MAX_HISTORY, Header, SampledPose, encode
from tis.common.node import Arrival
from tis.common.records import REJECTED, Rejected

KEY = "tis/MTML/measured_cp"


def _intake() -> Intake[SampledPose]:
    return Intake("tis", [LEFT.command, LEFT.arm])


def test_a_message_of_ours_is_decoded_and_logged_as_it_flew() -> None:
    arrival = an_arrival(KEY, 40_000_000, Stamp(3, 33_333_333, 33_400_000), a_pose(0.25))
    accepted, records = _intake().take(arrival)
    assert accepted is not None
    assert to_builtins(accepted.message) == to_builtins(a_pose(0.25, sample_ns=33_333_333))
    (flown,) = records
    assert (flown.topic, flown.data, flown.log_ns) == (KEY, arrival.payload, 40_000_000)
    assert (flown.publish_ns, flown.seq) == (33_400_000, 3)


def test_a_second_copy_is_a_duplicate_on_its_key_only() -> None:
    intake = _intake()
    for key in (KEY, KEY, "tis/PSM2/setpoint_cp"):
        accepted, _ = intake.take(an_arrival(key, 10, Stamp(0, 0, 1), a_pose()))
        assert accepted is not None
    assert (intake.n_accepted, intake.n_duplicates) == (3, 1)


def test_each_kind_of_foreign_message_is_counted_with_its_reason() -> None:
    whole = encode(a_pose())
    cases = {
        "the attachment is not ours": an_arrival(KEY, 5, b"", a_pose()),
        "the sample instant lies outside the run": an_arrival(KEY, 5, Stamp(0, 2_000_000_000, 0), a_pose()),
        "the send time lies outside the run": an_arrival(KEY, 5, Stamp(0, 0, 2**63 - 1), a_pose()),
        "the payload is no SampledPose": an_arrival(KEY, 5, Stamp(0, 0, 0), whole[:-20]),
        "no channel has this key": an_arrival("tis/MTMR/measured_cp", 5, Stamp(0, 0, 0), a_pose()),
    }
    intake = _intake()
    for reason, arrival in cases.items():
        accepted, (record,) = intake.take(arrival)
        assert accepted is None
        assert record.topic == REJECTED
        assert isinstance(record.data, Rejected)
        assert record.data.reason == reason
    assert intake.n_rejected == len(cases)


def test_a_send_time_before_the_run_is_rejected() -> None:
    """Clocks that were compared over a network may differ by some ms, and a foreign surgeon need not state any."""
    for sent_ns, is_accepted in ((-(2**63), False), (-2_000_000_000, False), (-1_000_000, True), (0, True)):
        accepted, _ = _intake().take(an_arrival(KEY, 5, Stamp(0, 0, sent_ns), a_pose()))
        assert (accepted is not None) == is_accepted


@pytest.mark.parametrize("field", ["tick", "command_sample_ns"])
def test_an_answer_with_a_number_that_no_log_can_hold_is_rejected(field: str) -> None:
    answer = {**json.loads(encode(a_pose())), "tick": 3, "command_sample_ns": 0}
    for number, is_accepted in ((2**62, True), (2**62 + 1, False), (10**400, False), (5.0, False), ("5", False)):
        payload = json.dumps({**answer, field: number}).encode()
        key = LEFT.estimated.key("tis")
        accepted, _ = Intake("tis", [LEFT.estimated]).take(an_arrival(key, 5, Stamp(0, 0, 0), payload))
        assert (accepted is not None) == is_accepted


@pytest.mark.parametrize("instant", ["5.0", "5e0", '"5"', "true"])
def test_a_sample_instant_that_is_no_integer_is_rejected(instant: str) -> None:
    text = encode(a_pose(sample_ns=7)).decode().replace(":7,", f":{instant},").encode()
    accepted, _ = _intake().take(an_arrival(KEY, 5, Stamp(0, 0, 0), text))
    assert accepted is None


@pytest.mark.parametrize("number", ["NaN", "1e400", '"0.5"', "true"])
def test_a_pose_with_what_is_no_finite_number_is_rejected(number: str) -> None:
    text = encode(a_pose()).decode().replace("0.5", number).encode()
    accepted, _ = _intake().take(an_arrival(KEY, 5, Stamp(0, 0, 0), text))
    assert accepted is None


CUT_HEADERS = st.integers(0, 20).map(lambda size: Header(0).pack()[:size])


@given(payload=st.binary(max_size=200), attachment=st.binary(max_size=60) | CUT_HEADERS)
def test_no_bytes_whatever_raise(payload: bytes, attachment: bytes) -> None:
    intake = _intake()
    accepted, records = intake.take(Arrival("east", KEY, payload, attachment, 5))
    assert records
    assert (accepted is None) == (intake.n_rejected == 1)


NUMBERS = st.integers(0, 5) | st.integers(32_766, 32_771) | st.integers(2**32 - 3, 2**32 - 1)


@given(st.lists(st.tuples(NUMBERS, st.integers(-(2**63), 2**63 - 1), st.booleans()), max_size=40))
def test_seen_numbers_are_those_of_a_dict_but_for_what_newer_ones_replaced(
    notes: list[tuple[int, int, bool]],
) -> None:
    seen, known = SeenNumbers(), dict[int, int]()
    for number, content, forgotten in notes:
        newer = [other for other in known if other > number and (other - number) % 32_768 == 0]
        if newer:
            assert seen.note(number, content) is None
            continue
        assert seen.note(number, content) == known.get(number)
        older = [other for other in known if other < number and (number - other) % 32_768 == 0]
        for other in older:
            del known[other]
        known.setdefault(number, content)
        if forgotten:
            seen.forget(number)
            del known[number]


def test_a_message_half_a_minute_later_is_known_no_more_and_takes_no_memory() -> None:
    seen = SeenNumbers()
    for number in range(100_000):
        assert seen.note(number, -number) is None
    assert [seen.note(number, 0) for number in (99_999, 67_232, 67_231)] == [-99_999, -67_232, None]


def _with_history(n: int, earlier: str) -> bytes:
    whole = encode(a_pose(sample_ns=1_000_000)).decode()
    return (whole[:-1] + ', "history": [' + ", ".join([earlier] * n) + "]}").encode()


@pytest.mark.parametrize("earlier", ["{}", "0"])
def test_a_long_message_of_faults_is_not_read_to_its_end(earlier: str) -> None:
    """Each fault would take a kB: a message of 30 MB all memory of a host."""
    reasons = []
    for n in (50_000, 1_000_000):
        _, (record,) = _intake().take(an_arrival(KEY, 5, Stamp(0, 0, 0), _with_history(n, earlier)))
        assert isinstance(record.data, Rejected)
        reasons.append(record.data.reason)
    assert reasons == ["the payload is no SampledPose", "the payload has more than 262144 bytes"]


def test_the_longest_history_of_a_scenario_is_accepted_and_a_longer_one_is_not() -> None:
    for n, is_accepted in ((MAX_HISTORY, True), (MAX_HISTORY + 1, False)):
        earlier = tuple(a_pose(-1e9 / 3, -1e9 / 7, -1e9 / 9, sample_ns=k) for k in range(n))
        pose = SampledPose(**asdict(a_pose(sample_ns=10**6)), history=earlier)
        accepted, _ = _intake().take(an_arrival(KEY, 5, Stamp(0, 0, 0), encode(pose)))
        assert (accepted is not None) == is_accepted
