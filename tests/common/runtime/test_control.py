"""The control plane over real Zenoh sessions on loopback."""

import json
import threading
import time
from collections.abc import Iterator

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from tests.common.runtime.live_zenoh import Network, a_network, soon
from tis.common.runtime.control import Bell, ControlKeys, Epoch, Presence, Roster

pytestmark = pytest.mark.live
KEYS = ControlKeys("t")
DIGEST = "0123456789abcdef"
BOOT = "fedcba9876543210"


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
    b"", b"\xff\xfe", b"{", b"[]", b"7", b"null", b"{}", b'{"reason": null}', b'{"reason": {"a": 1}}',
    b'{"reason": 7}', b"[" * 20_000,
]  # fmt: skip


def test_junk_on_the_key_of_the_end_is_ignored(network: Network) -> None:
    roster, changes = _watching(network.client)
    ear = network.router.declare_publisher(KEYS.end)
    assert soon(lambda: ear.matching_status.matching)  # type: ignore[attr-defined]
    for payload in JUNK:
        network.router.put(KEYS.end, payload)
    network.router.delete(KEYS.end)
    network.router.put(KEYS.end, json.dumps({"side": "netem", "reason": "x" * 600}))
    network.router.put(KEYS.end, json.dumps({"side": "netem", "reason": "a later one"}))
    assert soon(lambda: len(changes) == 2)
    assert roster.end_reason == "x" * 500


def test_the_run_of_netem_begins_once_and_each_side_tells_its_own(network: Network) -> None:
    """A roster that begins to watch later learns the run as well."""
    first, second = Epoch(10**18 + 1, 2**32 - 1, BOOT), Epoch(10**18 + 2, 7, BOOT)
    early, _ = _watching(network.client)
    liveliness = network.router.liveliness()
    held = liveliness.declare_token(KEYS.run("netem", first.text))
    _own = liveliness.declare_token(KEYS.run("patient", first.text))
    assert soon(lambda: early.epochs == {"netem": first, "patient": first})
    late, _ = _watching(network.client)
    assert soon(lambda: late.epoch == first)
    held.undeclare()  # type: ignore[no-untyped-call]
    assert soon(lambda: early.epochs == {"patient": first})
    _again = liveliness.declare_token(KEYS.run("netem", second.text))
    assert soon(lambda: early.epochs["netem"] == second if "netem" in early.epochs else False)
    assert early.epoch == first, "a run begins once"
    assert early.present == set()


@given(
    epoch_ns=st.integers(0, 2**62 - 1),
    run_id=st.integers(0, 2**32 - 1),
    boot=st.text("0123456789abcdef", min_size=16, max_size=16),
)
def test_an_epoch_is_read_back_from_its_text(epoch_ns: int, run_id: int, boot: str) -> None:
    assert Epoch.parse(Epoch(epoch_ns, run_id, boot).text) == Epoch(epoch_ns, run_id, boot)


@pytest.mark.parametrize(
    "text",
    ["", "1", "1-2", "1-2-3", f"-1-2-{BOOT}", f"4294967296-2-{BOOT}", f"1-4611686018427387904-{BOOT}", f"1-2-{BOOT}0",
     f"1-2-{BOOT.upper()}", f"1.0-2-{BOOT}", f"\u0661-2-{BOOT}", f"*-2-{BOOT}"],
)  # fmt: skip
def test_what_names_no_epoch_is_none(text: str) -> None:
    assert Epoch.parse(text) is None


def test_control_keys_are_not_matched_by_a_rule_for_everything() -> None:
    everything = zenoh.KeyExpr("**")
    for key in (KEYS.run("netem", "1"), KEYS.end, KEYS.clock, KEYS.token("netem", DIGEST, mirrored=True)):
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
