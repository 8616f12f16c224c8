"""The exchange of scenarios over Zenoh, with honest and with hostile sides."""

import json
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_network, settle
from tis.common.runtime import meeting
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.meeting import MAX_BYTES, ScenarioExchange
from tis.common.scenario import Scenario
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
