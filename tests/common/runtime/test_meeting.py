"""The exchange of scenarios over Zenoh, with honest and with hostile sides."""

import json
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_network, settle
from tis.common.runtime import meeting
from tis.common.runtime.control import ControlKeys, Presence
from tis.common.runtime.meeting import MAX_BYTES, Meeting, ScenarioExchange, new_meeting
from tis.common.runtime.process import Interrupt
from tis.common.scenario import Scenario, reading
from tis.deploy.run.resolve import resolve

pytestmark = pytest.mark.live
_KEYS = ControlKeys("tis")


def _scenario(*settings: str) -> Scenario:
    return resolve("default", settings)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meeting, "_LINGER_S", 0.01)


def test_both_sides_learn_in_which_field_they_differ() -> None:
    with (
        a_network() as network,
        ScenarioExchange({"west": network.router}, _KEYS, "netem", _scenario()) as netem,
        ScenarioExchange({"west": network.client}, _KEYS, "surgeon", _scenario("duration_s=4")) as surgeon,
    ):
        settle(network.client)
        assert surgeon.difference("west", "netem") == "duration_s is 20.0 there, 4.0 here"
        assert netem.difference("west", "surgeon") == "duration_s is 4.0 there, 20.0 here"


def test_a_side_that_is_gone_leaves_the_digests() -> None:
    with (
        a_network() as network,
        ScenarioExchange({"west": network.client}, _KEYS, "surgeon", _scenario()) as surgeon,
    ):
        assert surgeon.difference("west", "netem") == ""


@contextmanager
def _liar(session: zenoh.Session, key: str, payload: bytes) -> Iterator[None]:
    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(key, payload)

    queryable = session.declare_queryable(_KEYS.scenario("netem"), reply, complete=True)
    yield
    queryable.undeclare()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    "payload", [b"", b"{", b'{"a": 1}', b"[" * 10_000, bytes(MAX_BYTES + 1), json.dumps({"a\n": "1"}).encode()]
)
def test_a_hostile_answer_is_none(payload: bytes) -> None:
    with (
        a_network() as network,
        _liar(network.router, _KEYS.scenario("netem"), payload),
        ScenarioExchange({"west": network.client}, _KEYS, "surgeon", _scenario()) as surgeon,
    ):
        settle(network.client)
        assert surgeon.difference("west", "netem") == ""


def _a_meeting() -> Meeting:
    return new_meeting(resolve("default", (), None, 5.0), "surgeon", ("west",), Interrupt(), lambda: None)


def test_netem_is_named_first_and_ones_own_side_and_strangers_are_not() -> None:
    meeting = _a_meeting()
    own = meeting.digest
    meeting.rosters["west"].left += [
        Presence("patient", own, mirrored=True),
        Presence("netem", own, mirrored=False),
        Presence("surgeon", own, mirrored=True),
    ]
    assert meeting.lost() == ["netem", "patient"]
    meeting = _a_meeting()
    meeting.rosters["west"].left.append(Presence("patient", "0" * 16, mirrored=True))
    assert meeting.lost() == []


def test_the_loop_does_not_compute_the_scenarios_digest_again(monkeypatch: pytest.MonkeyPatch) -> None:
    meeting = _a_meeting()

    def again(_: object) -> str:
        raise AssertionError("computed again")

    monkeypatch.setattr(reading, "digest", again)
    assert meeting.lost() == []
    meeting.check_scenarios()
