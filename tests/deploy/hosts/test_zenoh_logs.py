"""Collections over Zenoh on loopback, from honest and from hostile ends."""

import asyncio
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_network, settle, soon
from tis.common.errors import DataError, PeerError, TisError
from tis.deploy.hosts import zenoh_logs
from tis.deploy.hosts.transfer import Collection
from tis.deploy.hosts.zenoh_logs import (
    CHUNK_BYTES,
    MAX_QUERY_BYTES,
    ZenohLogs,
    ZenohOffer,
    answer,
    key_of,
    offers,
)

pytestmark = pytest.mark.live
_SHA = "0" * 64
_LIST = json.dumps({"logs": [{"name": "netem.mcap", "n_bytes": 5, "sha256": _SHA}]})


def _collect(folder: Path, source: ZenohLogs, told: Callable[[str], None]) -> None:
    asyncio.run(Collection(folder, told, pause_s=0).fetch_all(source))


@pytest.mark.parametrize("offering", ["router", "client"])
def test_logs_are_fetched_in_chunks_whichever_end_listens(tmp_path: Path, offering: str) -> None:
    logs = {"patient.mcap": os.urandom(2 * CHUNK_BYTES + 7), "patient_2.mcap": b"", "netem.mcap": b"x"}
    source, target, told = tmp_path / "source", tmp_path / "target", list[str]()
    for folder in (source, target):
        folder.mkdir()
    for name, content in logs.items():
        (source / name).write_bytes(content)
    (source / "scenario.yaml").write_text("secret")
    (target / "patient.mcap.part").write_bytes(logs["patient.mcap"][: CHUNK_BYTES + 1])
    with a_network() as network:
        ends = (network.router, network.client)
        offerer, collector = ends if offering == "router" else ends[::-1]
        with ZenohOffer(offerer, source, told.append):
            settle(network.client)
            assert soon(lambda: bool(offers(collector, "here")))
            [found] = offers(collector, "here")
            _collect(target, found, told.append)
            _collect(target, found, told.append)
    assert {path.name: path.read_bytes() for path in target.iterdir()} == logs
    assert f"continued after {CHUNK_BYTES + 1} bytes" in " ".join(told)
    assert sum("is here already" in line for line in told) == 3


@pytest.mark.parametrize(
    ("operation", "payload"),
    [
        ("read", b'{"name": "../../etc/passwd", "begin": 0, "end": 9}'),
        ("read", b'{"name": "scenario.yaml", "begin": 0, "end": 9}'),
        ("read", b'{"name": "patient.mcap", "begin": -1, "end": 9}'),
        ("read", b""),
        ("list", b'{"parts": {"../x": 1}}'),
        ("list", b"\xff"),
        ("list", b"[" * 10_000),
        ("erase", b"{}"),
    ],
)
def test_a_query_of_another_form_is_refused(tmp_path: Path, operation: str, payload: bytes) -> None:
    (tmp_path / "scenario.yaml").write_text("secret")
    with pytest.raises((ValueError, TisError)):
        answer(tmp_path, operation, payload)


def test_a_chunk_is_never_longer_than_its_limit(tmp_path: Path) -> None:
    (tmp_path / "netem.mcap").write_bytes(bytes(3 * CHUNK_BYTES))
    query = json.dumps({"name": "netem.mcap", "begin": 1, "end": 1 << 60}).encode()
    assert len(answer(tmp_path, "read", query)) == CHUNK_BYTES


def test_hostile_queries_are_answered_with_errors_and_the_offer_lives_on(tmp_path: Path) -> None:
    (tmp_path / "netem.mcap").write_bytes(b"x")
    with a_network() as network, ZenohOffer(network.router, tmp_path, list[str]().append) as offer:
        settle(network.client)
        for operation, payload in (("read", b"{}"), ("x", b""), ("list", bytes(MAX_QUERY_BYTES + 1))):
            replies = list(network.client.get(key_of(offer.number, operation), payload=payload, timeout=20.0))
            assert [reply.ok for reply in replies] == [None]
        assert soon(lambda: bool(offers(network.client, "here")))


@contextmanager
def _liar(session: zenoh.Session, number: str, replies: dict[str, Any]) -> Iterator[ZenohLogs]:
    def reply(query: zenoh.Query) -> None:
        with query:
            operation = str(query.key_expr).rpartition("/")[2]
            query.reply(key_of(number, operation), replies.get(operation, b""))

    queryable = session.declare_queryable(key_of(number, "*"), reply, complete=True)
    yield ZenohLogs(session, number, "liar")
    queryable.undeclare()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    ("replies", "words"),
    [
        ({"list": b"{}"}, "not of this version"),
        ({"list": bytes(200_000)}, "not asked"),
        ({"list": json.dumps({"logs": [{"name": "../x", "n_bytes": 1, "sha256": _SHA}]})}, "not of this version"),
        (
            {"list": _LIST},
            "after 0 of 5 bytes",
        ),
        (
            {"list": _LIST, "read": bytes(6)},
            "not asked",
        ),
        (
            {"list": _LIST, "read": bytes(5)},
            "change while they are fetched",
        ),
    ],
)
def test_hostile_replies_leave_no_log(tmp_path: Path, replies: dict[str, Any], words: str) -> None:
    with a_network() as network, _liar(network.router, "0" * 16, replies):
        settle(network.client)
        with pytest.raises((PeerError, DataError), match=words):
            _collect(tmp_path, ZenohLogs(network.client, "0" * 16, "liar"), list[str]().append)
    assert not list(tmp_path.glob("*.mcap"))


def test_an_offer_whose_number_is_none_is_not_asked(tmp_path: Path) -> None:
    with a_network() as network, _liar(network.router, "0" * 15, {}):
        settle(network.client)
        assert offers(network.client, "here") == []


def test_an_offer_that_is_gone_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_logs, "_LIST_S", 1.0)
    with a_network() as network, pytest.raises(PeerError, match="does not answer"):
        _collect(tmp_path, ZenohLogs(network.client, "0" * 16, "gone"), list[str]().append)
