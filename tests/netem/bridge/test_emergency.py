"""What netem passes on of requests to stop: all of the request, and no attachment that is larger than a proof."""

import queue
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from tis.common.channels import stop_key
from tis.common.messages import encode
from tis.common.scenario.security import NoSecurity
from tis.common.signing import MAX_PROOF_BYTES
from tis.common.stop_messages import EmergencyStop
from tis.netem.bridge import emergency


@pytest.mark.parametrize("n_bytes", [None, 100, MAX_PROOF_BYTES + 1])
def test_a_stop_passes_without_an_attachment_that_is_no_proof(
    monkeypatch: pytest.MonkeyPatch, n_bytes: int | None
) -> None:
    passed: queue.SimpleQueue[tuple[Any, Any]] = queue.SimpleQueue()
    publisher = SimpleNamespace(put=lambda payload, attachment: passed.put((payload, attachment)))
    monkeypatch.setattr(emergency, "publisher_of", lambda *_: publisher)
    takers: dict[str, list[Any]] = {}

    def declare(key: str, take: Any, **_: object) -> object:
        takers.setdefault(key, []).append(take)
        return SimpleNamespace(undeclare=lambda: None)

    sessions: Any = {name: SimpleNamespace(declare_subscriber=declare) for name in ("west", "east")}
    asked: list[tuple[Any, ...]] = []
    audit: Any = SimpleNamespace(asked=lambda *found: asked.append(found))
    emergency.EmergencyLine(sessions, "tis", audit, NoSecurity(kind="none", sign=True))

    class Content(bytes):
        def to_bytes(self) -> bytes:
            assert len(self) <= MAX_PROOF_BYTES, "copied"
            return bytes(self)

    payload = Content(encode(EmergencyStop(stop=True, number=7)))
    attachment = None if n_bytes is None else Content(n_bytes)
    sample = SimpleNamespace(
        key_expr=stop_key("tis"), payload=payload, attachment=attachment, kind=zenoh.SampleKind.PUT
    )
    for take in takers[stop_key("tis")]:
        take(sample)
    assert passed.get_nowait() == (payload, attachment if n_bytes == 100 else None)
    assert passed.empty()
    assert len(asked) == 2
