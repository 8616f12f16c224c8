"""The control plane over real Zenoh sessions on loopback."""

import json
import threading
import time
from collections.abc import Iterator

import pytest
import zenoh

from common.runtime.control import Bell, ControlKeys, Epoch, Presence, Roster
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
    assert soon(lambda: [one.side for one in roster.left] == ["surgeon"])
    assert roster.present == {mirror}

    network.client.close()  # type: ignore[no-untyped-call]
    assert soon(lambda: [one.side for one in roster.left] == ["surgeon", "patient"])
    assert {(one.side, one.digest) for one in roster.met} == {("surgeon", DIGEST), ("patient", "fedcba")}
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
    b'{"epoch_ns": 1}', b'{"epoch_ns": 1, "run_id": -1}', b'{"epoch_ns": 1, "run_id": 4294967296}',
    b'{"epoch_ns": 1, "run_id": null}', b'{"epoch_ns": 4611686018427387904, "run_id": 1}',
]  # fmt: skip


def test_junk_on_the_keys_of_begin_and_end_is_ignored(network: Network) -> None:
    roster, changes = _watching(network.client)
    ears = [network.router.declare_publisher(key) for key in (KEYS.epoch, KEYS.end)]
    assert soon(lambda: all(ear.matching_status.matching for ear in ears))  # type: ignore[attr-defined]
    for payload in JUNK:
        network.router.put(KEYS.epoch, payload)
        network.router.put(KEYS.end, payload)
    network.router.delete(KEYS.epoch)
    network.router.delete(KEYS.end)
    network.router.put(KEYS.end, json.dumps({"side": "netem", "reason": "x" * 600}))
    network.router.put(KEYS.end, json.dumps({"side": "netem", "reason": "a later one"}))
    network.router.put(KEYS.epoch, Epoch(10**18 + 1, 2**32 - 1).dumped())
    network.router.put(KEYS.epoch, Epoch(10**18 + 2, 7).dumped())
    assert soon(lambda: roster.epoch is not None)
    time.sleep(0.1)
    assert roster.epoch == Epoch(10**18 + 1, 2**32 - 1), "a run begins once"
    assert roster.end_reason == "x" * 500
    assert len(changes) == 3


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


def test_no_more_than_a_hundred_presences_are_remembered(network: Network) -> None:
    roster, _ = _watching(network.router)
    _held = [
        network.client.liveliness().declare_token(KEYS.token("surgeon", f"{k:x}", mirrored=False)) for k in range(150)
    ]
    assert soon(lambda: len(roster.met) == 100)
    _one_more = network.client.liveliness().declare_token(KEYS.token("netem", DIGEST, mirrored=False))
    time.sleep(0.1)
    assert len(roster.met) == len(roster.present) == 100
