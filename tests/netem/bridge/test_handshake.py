"""The offer of shared memory in the first message of a connection, as Zenoh itself sends it."""

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Thread

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from tis.netem.bridge.handshake import Opening


@contextmanager
def first_message(uses_shared_memory: bool) -> Iterator[bytes]:
    """Yield the first message that a client of this version of Zenoh sends."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        config = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [f"tcp/127.0.0.1:{server.getsockname()[1]}"],
            "connect/timeout_ms": 500,
            "scouting/multicast/enabled": False,
            "transport/shared_memory/enabled": uses_shared_memory,
        }.items():
            config.insert_json5(key, json.dumps(value))

        def call() -> None:
            with suppress(zenoh.ZError):
                zenoh.open(config)

        caller = Thread(target=call)
        caller.start()
        with server.accept()[0] as connection:
            yield connection.recv(65_536)
        caller.join()


@pytest.mark.live
def test_the_offer_of_a_client_becomes_unknown_and_nothing_else_changes() -> None:
    with first_message(True) as offers:
        pass
    with first_message(False) as plain:
        pass
    opening = Opening()
    passed = opening.take(offers)
    assert opening.withdrawn
    assert [(old ^ new) for old, new in zip(offers, passed, strict=True) if old != new] == [0x02 ^ 0x0F]
    opening = Opening()
    assert (opening.take(plain), opening.withdrawn) == (plain, False)


_QOS, _OFFER, _AUTH = b"\x81", b"\xc2\x81\x01" + bytes(129), b"\x43\x01a"
MESSAGE = b"\xc1\x09\x22abc\x0a\xff\xff" + _QOS + _OFFER + _AUTH
OFFER = len(MESSAGE).to_bytes(2, "little") + MESSAGE
WITHDRAWN = OFFER.replace(b"\xc2\x81\x01", b"\xcf\x81\x01")


@given(st.integers(4, len(OFFER)), st.binary(max_size=30))
def test_the_first_message_goes_on_whole_and_all_after_it_as_it_is(cut: int, more: bytes) -> None:
    opening = Opening()
    passed = opening.take(OFFER[:cut]) + opening.take(OFFER[cut:] + more if OFFER[cut:] + more else more)
    assert passed + opening.take(more) == WITHDRAWN + more + more
    assert opening.withdrawn


@given(st.one_of(st.binary(min_size=1), st.binary().map(lambda rest: b"\x05\x00\x81\x09" + rest)))
def test_no_other_bytes_are_changed_and_none_are_kept_beyond_the_end(data: bytes) -> None:
    opening = Opening()
    passed = opening.take(data) + opening.take(b"")
    changed = [place for place, (old, new) in enumerate(zip(data, passed, strict=True)) if old != new]
    assert len(changed) == opening.withdrawn
    assert all(passed[place] & 0x0F == 0x0F for place in changed)


@pytest.mark.parametrize("short", [b"a", b"hi\n", b"\x05\x00\x01"])
def test_a_short_greeting_of_another_protocol_does_not_wait(short: bytes) -> None:
    assert Opening().take(short) == short


def test_an_encrypted_stream_is_told() -> None:
    opening = Opening()
    assert opening.take(b"\x16\x03\x01\x02\x00\x01rest") == b"\x16\x03\x01\x02\x00\x01rest"
    assert (opening.encrypted, opening.withdrawn) == (True, False)
