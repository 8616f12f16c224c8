"""Clients of a run's networks that are not its sides: what they say, and whether they are let in."""

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import zenoh

from tests.nodes import a_pose
from tis.common.messages import Header, encode
from tis.common.runtime.control import ControlKeys, Epoch
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.control import control_prefix

KEYS = ControlKeys("tis")
_SETTLE_S = 0.3


@contextmanager
def a_client(endpoint: str, credentials: Mapping[str, Any] | None = None) -> Iterator[zenoh.Session | None]:
    """Yield a session with these credentials, None when it is not let in."""
    try:
        session = zenoh.open(configure("client", ZenohOptions(connect=[endpoint], credentials=credentials or {})))
    except zenoh.ZError:
        yield None
        return
    with session:
        yield session


def lie(session: zenoh.Session) -> None:
    """Say what only netem may: that the run begins, that it ends, and who is there."""
    session.put(KEYS.end, json.dumps({"side": "netem", "reason": "because I say so"}))
    held = [
        session.liveliness().declare_token(KEYS.run("netem", Epoch(1, 7, "0" * 16).text)),
        session.liveliness().declare_token(KEYS.token("netem", "0" * 16, mirrored=False)),
        session.liveliness().declare_token(KEYS.token("patient", "0" * 16, mirrored=True)),
    ]
    time.sleep(_SETTLE_S)
    for token in held:
        token.undeclare()  # type: ignore[no-untyped-call]


def speak_for_the_patient(session: zenoh.Session) -> None:
    """Send an estimate, as only the patient may."""
    session.put("tis/PSM2/estimated_cp", encode(a_pose(0)).decode(), attachment=Header(0).pack())
    time.sleep(_SETTLE_S)


def cause_an_outage(session: zenoh.Session) -> list[Any]:
    """Ask netem for an outage; return its answers."""
    request = json.dumps({"direction": "both", "for_ms": 60_000})
    replies = session.get(f"{control_prefix('tis')}outage", payload=request, timeout=0.5)
    return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]


def of_another_run(session: zenoh.Session) -> None:
    """Send a command with the number of another run."""
    session.put("tis/MTML/measured_cp", encode(a_pose(0)).decode(), attachment=Header(0, 0, 0xBAD).pack())
    time.sleep(_SETTLE_S)
