import contextlib
import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import DecodeError
from msgspec.structs import asdict, replace

from tests.every_message import every_message
from tis.common.messages import (
    MAX_SIZE,
    FeedbackPose,
    Message,
    Pose,
    Quaternion,
    SampledPose,
    Vector3,
    as_row,
    decode,
    encode,
    position_m,
)
from tis.common.peer_life import Beat
from tis.common.safety_records import StopsInForceNote
from tis.common.stop_messages import EmergencyStop, lock_of

finite = st.floats(-MAX_SIZE, MAX_SIZE)
vectors = st.builds(Vector3, x=finite, y=finite, z=finite)
quaternions = st.builds(Quaternion, x=finite, y=finite, z=finite, w=finite)
feedback = st.builds(
    FeedbackPose,
    sample_ns=st.integers(0, 2**62),
    position_m=vectors,
    orientation=quaternions,
    gripper_rad=finite,
    tick=st.integers(0, 2**40),
    command_sample_ns=st.none() | st.integers(-(2**62), 2**62),
)
POSE = Pose(
    sample_ns=7,
    position_m=Vector3(x=0.1, y=-0.2, z=0.3),
    orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
    gripper_rad=0.5,
)


@settings(deadline=None, max_examples=50)
@given(feedback)
def test_every_bit_survives_the_wire(message: FeedbackPose) -> None:
    assert decode(encode(message), FeedbackPose) == message


def test_what_flies_is_plain_json_in_si_units() -> None:
    assert json.loads(encode(POSE)) == {
        "sample_ns": 7,
        "position_m": {"x": 0.1, "y": -0.2, "z": 0.3},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        "gripper_rad": 0.5,
    }


@pytest.mark.parametrize("bad", ["NaN", "Infinity", "null", '"a"', "1e999"])
def test_numbers_that_are_none_are_refused(bad: str) -> None:
    with pytest.raises(DecodeError):
        decode(f'{{"x": {bad}, "y": 0, "z": 0}}'.encode(), Vector3)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"x": 1, "y": 2}', '{"x": 1, "y": 2, "z": 3, "w": 4}'])
def test_damaged_or_foreign_payloads_are_refused(text: str) -> None:
    with pytest.raises(DecodeError):
        decode(text.encode(), Vector3)


def test_a_pose_is_not_a_feedback_pose() -> None:
    with pytest.raises(DecodeError):
        decode(encode(POSE), FeedbackPose)


def test_messages_do_not_change() -> None:
    with pytest.raises(AttributeError, match="immutable"):
        POSE.gripper_rad = 1.0  # type: ignore[misc]


def test_position_as_a_tuple() -> None:
    assert position_m(POSE) == (0.1, -0.2, 0.3)


def _before(sample_ns: int) -> Pose:
    return replace(POSE, sample_ns=sample_ns)


def test_a_sampled_pose_without_history_flies_as_a_pose_and_an_old_payload_is_one() -> None:
    plain = decode(encode(POSE), SampledPose)
    assert plain.history == ()
    assert encode(plain) == encode(POSE)


def test_history_survives_the_wire() -> None:
    message = SampledPose(**asdict(POSE), history=(_before(0), _before(6)))
    assert decode(encode(message), SampledPose) == message


@pytest.mark.parametrize("instants", [(-1,), (7,), (8,), (3, 3), (4, 2)])
def test_a_history_that_is_not_of_the_past_in_order_is_refused(instants: tuple[int, ...]) -> None:
    text = encode(POSE)[:-1] + b',"history":[' + b",".join(encode(_before(one)) for one in instants) + b"]}"
    with pytest.raises(DecodeError, match="history must be ordered"):
        decode(text, SampledPose)


@pytest.mark.parametrize("model", every_message())
def test_what_is_no_object_is_refused_by_the_decoder_of_every_message(model: type[Message]) -> None:
    """A wrong annotation shows at the first decoding only, as a `TypeError`."""
    for payload in (b"[]", b'{"no field of ours": 1}'):
        with pytest.raises(DecodeError):
            decode(payload, model)
    assert model.__struct_config__.frozen
    assert model.__struct_config__.forbid_unknown_fields


def _vector(x: bytes) -> bytes:
    return b'{"x": %s, "y": 0, "z": 0}' % x


HOSTILE = {
    "nothing": b"",
    "a byte order mark": b"\xef\xbb\xbf" + _vector(b"0"),
    "UTF-16": _vector(b"0").decode().encode("utf-16"),
    "bytes after the end": _vector(b"0") + b" {}",
    "no UTF-8 in a name": _vector(b"0").replace(b'"z"', b'"\xff"'),
    "no UTF-8 in a text": _vector(b'"\xff\xfe"'),
    "half a surrogate pair": _vector(rb'"\ud800"'),
    "half a surrogate pair in a name": _vector(b"0").replace(b'"z"', rb'"\udfff"'),
    "an unknown field": _vector(b"0")[:-1] + b', "w": 0}',
    "deep brackets": b"[" * 100_000,
    "deep objects": b'{"x":' * 100_000,
    "deep brackets in a field": _vector(b"[" * 100_000),
    "deep brackets in an unknown field": _vector(b"0")[:-1] + b', "w": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "a number beyond floats": _vector(b"1e999"),
    "an integer beyond floats": _vector(b"1" + b"0" * 400),
    "an integer of thousands of digits": _vector(b"9" * 5000),
    "a fraction of thousands of digits, too large": _vector(b"9" * 5000 + b"." + b"9" * 5000),
    "NaN": _vector(b"NaN"),
    "Infinity": _vector(b"-Infinity"),
    "no number at the end": _vector(b"0")[:-1] + b', "z":}',
}


@pytest.mark.parametrize("payload", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_payload_is_refused_by_one_error(payload: bytes) -> None:
    with pytest.raises(DecodeError):
        decode(payload, Vector3)
    with pytest.raises(DecodeError):
        decode(b'{"sample_ns": 0, "position_m": ' + payload, Pose)


def test_of_a_field_that_is_there_twice_the_last_counts_and_each_is_checked() -> None:
    assert decode(_vector(b'1, "x": 2'), Vector3) == Vector3(2.0, 0.0, 0.0)
    for twice in (b'NaN, "x": 2', b'2, "x": 1e999', b'"1", "x": 2'):
        with pytest.raises(DecodeError):
            decode(_vector(twice), Vector3)


@pytest.mark.parametrize("text", [b'"\xff"', b'"\xed\xa0\x80"', rb'"\ud800"', rb'"\ud800\u0041"', rb'"\udc00"'])
def test_a_text_that_is_no_text_is_refused(text: bytes) -> None:
    with pytest.raises(DecodeError):
        decode(b'{"stop": true, "reason": %s}' % text, EmergencyStop)


@pytest.mark.parametrize("number", ["5.0", "5e0", '"5"', "true", "1e400", "4611686018427387905", "9" * 5000])
def test_an_instant_is_an_integer_within_64_bits(number: str) -> None:
    payload = encode(POSE).replace(b":7,", f":{number},".encode())
    with pytest.raises(DecodeError):
        decode(payload, Pose)


@given(
    st.binary(max_size=300)
    | st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists).map(
        lambda value: json.dumps(value).encode()
    )
)
def test_any_bytes_are_decoded_or_refused(payload: bytes) -> None:
    for model in (SampledPose, FeedbackPose, EmergencyStop, Beat):
        with contextlib.suppress(DecodeError):
            decode(payload, model)


class _Name(str):
    __slots__ = ()


def test_numbers_of_numpy_and_texts_of_derived_types_fly_as_themselves() -> None:
    """They pass for floats and texts, with mypy too; a run must not end at one."""
    assert encode(Vector3(np.float64(0.1), 0.2, 0.3)) == b'{"x":0.1,"y":0.2,"z":0.3}'
    assert as_row(Vector3(np.float64(0.1), 0.2, 0.3)) == {"x": 0.1, "y": 0.2, "z": 0.3}
    assert encode(EmergencyStop(stop=True, reason=_Name("a"))) == encode(EmergencyStop(stop=True, reason="a"))


def test_what_is_neither_number_nor_text_is_an_error_of_the_program() -> None:
    with pytest.raises(TypeError):
        encode(Vector3(object(), 0.2, 0.3))  # type: ignore[arg-type]


@pytest.mark.parametrize("lock", ["", lock_of("a")])
def test_a_lock_ends_where_its_text_ends(lock: str) -> None:
    """In Python ``$`` matches before a last newline, too."""
    assert decode(encode(EmergencyStop(stop=True, lock=lock)), EmergencyStop).lock == lock
    assert decode(encode(StopsInForceNote(at_ns=0, stops=f"7:{lock}")), StopsInForceNote).stops == f"7:{lock}"
    for message in (EmergencyStop(stop=True, lock=f"{lock}\n"), StopsInForceNote(at_ns=0, stops=f"7:{lock}\n")):
        with pytest.raises(DecodeError):
            decode(encode(message), type(message))


_RACE = """
import sys, threading
from msgspec import defstruct
from tis.common.messages import Message, decode
sys.setswitchinterval(1e-6)
for n in range(300):
    inner = [defstruct(f"I{n}_{i}", [(f"g{j}", int | None, None) for j in range(3)]) for i in range(4)]
    fields = [(f"f{i}", one | None, None) for i, one in enumerate(inner)]
    model = defstruct(f"M{n}", fields, bases=(Message,), frozen=True)
    gate = threading.Barrier(3)
    def first():
        gate.wait()
        decode(b'{"f3":{"g1":1}}', model)
    threads = [threading.Thread(target=first) for _ in range(3)]
    for one in threads: one.start()
    for one in threads: one.join()
"""


def test_the_first_messages_of_a_kind_may_come_in_several_threads_at_once() -> None:
    """Msgspec shows a type to other threads before it is whole: the process died by SIGSEGV."""
    found = subprocess.run([sys.executable, "-c", _RACE], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stderr) == (0, "")
