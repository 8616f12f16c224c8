"""The control plane over real Zenoh sessions on loopback."""

import json
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from common.errors import PeerError
from common.runtime.clock import boot_id
from common.runtime.control import Bell, ClockReading, ControlKeys, Presence, Roster, answer_clock, read_clock
from tests.common.runtime.live_zenoh import Network, a_network, soon

pytestmark = pytest.mark.live
KEYS = ControlKeys("t")
DIGEST = "0123456789abcdef"


@pytest.fixture
def network() -> Iterator[Network]:
    with a_network() as network:
        yield network


def _watching(session: zenoh.Session) -> tuple[Roster, list[int]]:
    changes: list[int] = []
    roster = Roster(KEYS, lambda: changes.append(1))
    roster.watch(session)
    return roster, changes


def test_a_roster_follows_who_comes_and_goes_whenever_it_began_to_watch(network: Network) -> None:
    """Whoever came before the watching began is seen as well; a token goes with its session too."""
    early = network.client.liveliness().declare_token(KEYS.token("surgeon", DIGEST, mirrored=False))
    roster, changes = _watching(network.router)
    assert soon(lambda: roster.present == {Presence("surgeon", DIGEST, mirrored=False)})
    assert roster.sides() == {"surgeon"}
    assert roster.left == []

    _held = network.client.liveliness().declare_token(KEYS.token("patient", "fedcba", mirrored=True))
    mirror = Presence("patient", "fedcba", mirrored=True)
    assert soon(lambda: mirror in roster.present)
    assert roster.sides() == {"surgeon", "patient"}

    early.undeclare()  # type: ignore[no-untyped-call]
    assert soon(lambda: roster.left == ["surgeon"])
    assert roster.present == {mirror}

    network.client.close()  # type: ignore[no-untyped-call]
    assert soon(lambda: roster.left == ["surgeon", "patient"])
    assert roster.present == set()
    assert len(changes) == 4


def test_a_client_sees_tokens_of_its_router(network: Network) -> None:
    roster, _ = _watching(network.client)
    _held = network.router.liveliness().declare_token(KEYS.token("netem", DIGEST, mirrored=False))
    assert soon(lambda: roster.sides() == {"netem"})


def test_tokens_of_nobody_we_know_are_ignored(network: Network) -> None:
    roster, changes = _watching(network.router)
    strange = ("t/@tis/side/nurse/1", "other/@tis/side/netem/1", "t/side/netem/1", "t/@tis/side/netem")
    _held = [network.client.liveliness().declare_token(key) for key in strange]
    _known = network.client.liveliness().declare_token(KEYS.token("netem", DIGEST, mirrored=False))
    assert soon(lambda: bool(roster.present))
    assert roster.present == {Presence("netem", DIGEST, mirrored=False)}
    assert len(changes) == 1


JUNK: list[bytes] = [
    b"", b"\xff\xfe", b"{", b"[]", b"7", b"null", b'"epoch_ns"', b"{}", b'{"epoch_ns": "1"}', b'{"epoch_ns": 1.5}',
    b'{"epoch_ns": true}', b'{"epoch_ns": null}', b'{"epoch_ns": [1]}', b'{"reason": null}', b'{"reason": {"a": 1}}',
    b'{"reason": 7}', b"[" * 20_000,
]  # fmt: skip


def test_junk_on_the_keys_of_begin_and_end_is_ignored(network: Network) -> None:
    roster, changes = _watching(network.client)
    for payload in JUNK:
        network.router.put(KEYS.epoch, payload)
        network.router.put(KEYS.end, payload)
    network.router.delete(KEYS.epoch)
    network.router.delete(KEYS.end)
    network.router.put(KEYS.end, json.dumps({"side": "netem", "reason": "x" * 600}))
    network.router.put(KEYS.end, json.dumps({"side": "netem", "reason": "a later one"}))
    network.router.put(KEYS.epoch, json.dumps({"epoch_ns": 10**18 + 1}))
    assert soon(lambda: roster.epoch_ns is not None)
    assert roster.epoch_ns == 10**18 + 1
    assert roster.end_reason == "x" * 500
    assert len(changes) == 3


def test_on_one_host_the_clock_is_shared_exactly(network: Network) -> None:
    queryable = answer_clock(network.router, KEYS)
    assert boot_id()
    assert read_clock(network.client, KEYS) == ClockReading(0, 0)
    queryable.undeclare()


@pytest.fixture
def elsewhere(network: Network) -> Iterator[dict[str, Any]]:
    """netem on another host: its clock is 3 s ahead; the test may change what it says."""
    reading: dict[str, Any] = {"boot_id": "another-boot", "ahead_ns": 3_000_000_000}

    def answer(query: zenoh.Query) -> None:
        with query:
            ns = time.monotonic_ns() + reading["ahead_ns"]
            query.reply(KEYS.clock, json.dumps({"monotonic_ns": ns, "boot_id": reading["boot_id"]}))

    queryable = network.router.declare_queryable(KEYS.clock, answer)
    yield reading
    queryable.undeclare()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("ahead_ns", [3_000_000_000, -86_400_000_000_000])
def test_another_hosts_clock_is_known_within_the_stated_bound(
    network: Network, elsewhere: dict[str, Any], ahead_ns: int
) -> None:
    elsewhere["ahead_ns"] = ahead_ns
    offset_ns, bound_ns = read_clock(network.client, KEYS)
    assert 0 < bound_ns < 100_000_000
    assert abs(offset_ns - ahead_ns) <= bound_ns + 1  # one for halves of a ns


def test_hosts_without_a_boot_id_do_not_share_a_clock(
    network: Network, elsewhere: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.runtime.control.boot_id", lambda: "")
    elsewhere["boot_id"] = ""
    reading = read_clock(network.client, KEYS)
    assert abs(reading.offset_ns - 3_000_000_000) <= reading.bound_ns + 1


def test_a_clock_that_nobody_answers_for_is_an_error(network: Network) -> None:
    with pytest.raises(PeerError, match="netem: t/@tis/clock: does not answer clock queries"):
        read_clock(network.client, KEYS)


@pytest.mark.parametrize("answer", [b"", b"[]", b"{}", b'{"monotonic_ns": "soon", "boot_id": "b"}', b"\xff"])
def test_an_answer_that_is_no_clock_counts_as_none(network: Network, answer: bytes) -> None:
    def junk(query: zenoh.Query) -> None:
        with query:
            query.reply(KEYS.clock, answer)

    queryable = network.router.declare_queryable(KEYS.clock, junk)
    with pytest.raises(PeerError, match="does not answer clock queries"):
        read_clock(network.client, KEYS)
    queryable.undeclare()  # type: ignore[no-untyped-call]


def test_control_keys_are_not_matched_by_a_rule_for_everything() -> None:
    everything = zenoh.KeyExpr("**")
    for key in (KEYS.epoch, KEYS.end, KEYS.clock, KEYS.token("netem", DIGEST, mirrored=True)):
        assert not everything.intersects(zenoh.KeyExpr(key))
        assert not zenoh.KeyExpr("t/**").intersects(zenoh.KeyExpr(key))


def test_a_bell_rung_before_the_wait_is_heard_once() -> None:
    bell = Bell()
    bell.ring()
    bell.ring()
    heard: list[float] = []

    def wait_twice() -> None:
        for timeout_s in (60, 0.05):
            before_s = time.monotonic()
            bell.wait(timeout_s)
            heard.append(time.monotonic() - before_s)

    thread = threading.Thread(target=wait_twice, daemon=True)
    thread.start()
    thread.join(5)
    assert len(heard) == 2
    assert heard[0] < 5
    assert heard[1] >= 0.05
