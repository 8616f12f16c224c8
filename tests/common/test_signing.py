"""Signed messages: what a code covers, and what two sides agree on."""

import hashlib

import pytest
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.hmac import HMAC
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from hypothesis import given
from hypothesis import strategies as st

from tests.nodes import a_pose
from tis.common.channels import hand_channels
from tis.common.intake import Intake
from tis.common.messages import Header, encode
from tis.common.node import Arrival
from tis.common.signing import RunKeys, code, run_keys

_OURS, _THEIRS = b"a" * 32, b"b" * 32
_KEY = "tis/MTML/measured_cp"


def _pair() -> tuple[RunKeys, RunKeys]:
    return RunKeys(_OURS, (_THEIRS,)), RunKeys(_THEIRS, (_OURS,))


@given(st.binary(min_size=1, max_size=64), st.binary(min_size=1, max_size=32), st.text(max_size=20), st.binary())
def test_keys_and_codes_are_those_of_another_implementation(
    shared: bytes, key: bytes, name: str, payload: bytes
) -> None:
    header = Header(3, 4, 5).pack()
    mac = HMAC(key, SHA256())
    mac.update(header + len(name).to_bytes(4, "little") + name.encode() + payload)
    assert code(key, name, header, payload) == mac.finalize()[:16]
    salt = hashlib.sha256(b"tis run 1\ns\np\nd").digest()
    for side, found in run_keys(shared, "s", "p", "d").items():
        assert found == HKDF(SHA256(), 32, salt, side.encode()).derive(shared)


@given(st.data())
def test_a_single_changed_bit_of_key_header_payload_or_code_is_found(data: st.DataObject) -> None:
    surgeon, patient = _pair()
    payload = b'{"x":1}'
    attachment = surgeon.sign(_KEY, Header(7, 8, 9).pack(), payload)
    assert patient.fault(_KEY, attachment, payload) is None
    whole = bytearray(attachment + payload)
    bit = data.draw(st.integers(0, 8 * len(whole) - 1))
    whole[bit // 8] ^= 1 << bit % 8
    assert patient.fault(_KEY, bytes(whole[:36]), bytes(whole[36:])) == "wrong_code"
    assert patient.fault(_KEY + "2", attachment, payload) == "wrong_code"
    assert patient.fault(_KEY, attachment[:20], payload) == "unsigned"
    assert surgeon.fault(_KEY, attachment, payload) == "wrong_code"  # reflected
    assert RunKeys().fault(_KEY, attachment, payload) == "wrong_code"


def test_after_a_new_agreement_the_key_before_counts_until_the_first_message_under_the_new_one() -> None:
    patient = RunKeys(_THEIRS, (_OURS,))
    old, new = RunKeys(_OURS), RunKeys(b"c" * 32)
    header, payload = Header(0).pack(), b"{}"
    patient.agree(_THEIRS, new.own)
    assert patient.fault(_KEY, old.sign(_KEY, header, payload), payload) is None
    assert patient.fault(_KEY, new.sign(_KEY, header, payload), payload) is None
    assert patient.fault(_KEY, old.sign(_KEY, header, payload), payload) == "wrong_code"


@pytest.mark.parametrize("fault", ["unsigned", "wrong_code"])
def test_an_intake_uses_what_is_signed_and_counts_the_rest_by_kind(fault: str) -> None:
    surgeon, patient = _pair()
    channels = hand_channels("left", "PSM2")
    intake = Intake("tis", [channels.command])
    assert intake.counters() == {"other_run": 0}
    intake.keys = patient
    payload, header = encode(a_pose(0.0, 0.0, 0.0, sample_ns=0)), Header(0).pack()
    forged = header if fault == "unsigned" else header + bytes(16)
    found, records = intake.take(Arrival("east", _KEY, payload, forged, 5))
    assert found is None
    assert len(records) == 1
    for k in range(2000):
        assert len(intake.take(Arrival("east", _KEY, payload, forged, 6 + k))[1]) <= 1
    accepted, _ = intake.take(Arrival("east", _KEY, payload, surgeon.sign(_KEY, header, payload), 9))
    assert accepted is not None
    assert not accepted.duplicate  # the forged ones took no number
    assert intake.counters() == {"other_run": 0, "unsigned": 0, "wrong_code": 0} | {fault: 2001}
    assert intake.forged_since_ns == 5
    replayed, _ = intake.take(Arrival("east", _KEY, payload, surgeon.sign(_KEY, header, payload), 10))
    assert replayed is not None
    assert replayed.duplicate
