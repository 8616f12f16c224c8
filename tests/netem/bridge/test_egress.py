"""Publishers: declared for keys with some messages, given up by use, never while a message waits with one."""

import gc
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from tis.netem.bridge import bridge as bridge_module
from tis.netem.bridge.bridge import Egress, Put

FROM = bridge_module._DECLARED_FROM


class Publisher:
    def __init__(self, session: "Session", key: str) -> None:
        self.session, self.key = session, key

    def put(self, payload: bytes, **_: Any) -> None:
        self.session.put_with.append((self.key, payload))

    def __del__(self) -> None:
        assert not self.session.is_locked()
        self.session.undeclared.append(self.key)


class Session:
    def __init__(self) -> None:
        self.put_plain: list[tuple[str, bytes]] = []
        self.put_with: list[tuple[str, bytes]] = []
        self.declared: list[str] = []
        self.undeclared: list[str] = []
        self.is_locked: Callable[[], bool] = lambda: False

    def declare_publisher(self, key: str, **_: Any) -> Publisher:
        assert not self.is_locked()
        self.declared.append(key)
        return Publisher(self, key)

    def put(self, key: str, payload: bytes, **_: Any) -> None:
        assert not self.is_locked()
        self.put_plain.append((key, payload))


def an_egress() -> tuple[Egress, Session]:
    session = Session()
    egress = Egress(session)  # type: ignore[arg-type]
    session.is_locked = egress._lock.locked
    return egress, session


def put(key: str) -> Put:
    sample: Any = SimpleNamespace(
        encoding="zenoh/bytes", kind=zenoh.SampleKind.PUT, priority=zenoh.Priority.DATA, express=False,
        congestion_control=zenoh.CongestionControl.DROP, timestamp=None, source_info=None, timestamp_stack=None,
    )  # fmt: skip
    return Put(sample, key, b"", 1, None)  # type: ignore[arg-type]


def test_the_first_messages_of_a_key_need_no_publisher() -> None:
    egress, session = an_egress()
    for i in range(FROM + 3):
        egress.send(put("a"), bytes([i]))
    assert session.put_plain == [("a", bytes([i])) for i in range(FROM - 1)]
    assert session.put_with == [("a", bytes([i])) for i in range(FROM - 1, FROM + 3)]
    assert session.declared == ["a"]


def test_a_message_that_waited_is_counted_once() -> None:
    egress, session = an_egress()
    for _ in range(FROM - 1):
        waiting = put("a")
        egress.prepare(waiting)
        egress.send(waiting, b"")
    assert session.declared == []
    egress.prepare(put("a"))
    assert session.declared == ["a"]  # before its release, not during it


def test_what_is_used_stays_and_what_waits_keeps_its_publisher(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridge_module, "_MAX_PUBLISHERS", 4)
    monkeypatch.setattr(bridge_module, "_DECLARED_FROM", 1)
    egress, session = an_egress()
    waiting = put("waits")
    egress.prepare(waiting)
    for i in range(40):
        egress.send(put(f"new/{i}"), b"")
        egress.send(put("used"), b"")
    gc.collect()
    assert session.declared.count("used") == 1
    assert len(egress._declared) == 4
    assert "waits" not in [quality[0] for quality in egress._declared]
    assert "waits" not in session.undeclared
    assert len(session.undeclared) >= 36
    egress.send(waiting, b"at last")
    assert ("waits", b"at last") in session.put_with
    del waiting
    gc.collect()
    assert "waits" in session.undeclared


def test_keys_with_one_message_each_take_no_memory_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridge_module, "_MAX_PUBLISHERS", 10)
    egress, session = an_egress()
    for i in range(100):
        egress.send(put(f"{i}"), b"")
    assert len(egress._n_messages) == 10
    assert len(session.put_plain) == 100
    assert session.declared == []
