"""Emergency stops: the request to the patient of a running session, repeated until it is confirmed."""

import secrets
import threading
import time
from typing import Final

import zenoh
from pydantic import ValidationError

from common.channels import stop_key, stopped_key
from common.errors import Fault, PeerError
from common.messages import EmergencyStop
from common.runtime.emulator_client import EmulatorAddress, connected
from common.runtime.zenoh_session import urgent_publisher

_EVERY_S: Final = 0.1
_TIME_OUT_S: Final = 3.0
_NUMBERS: Final = 1 << 53
_MAX_CHARS: Final = 200


def send_stop(session: zenoh.Session, prefix: str, stop: bool, reason: str) -> float | None:
    """Send a request until the patient confirms it; return after how many ms it did, None if it did not.

    ``prefix`` is the scenario's session. A lost request or confirmation is sent again every 100 ms.
    """
    # a stop must not fail because of its text
    request = EmergencyStop(stop=stop, reason=reason[:_MAX_CHARS], number=1 + secrets.randbelow(_NUMBERS - 1))
    confirmed = threading.Event()

    def on_answer(sample: zenoh.Sample) -> None:
        try:
            answer = EmergencyStop.model_validate_json(sample.payload.to_bytes())
        except ValidationError:
            return
        if str(sample.key_expr) == stopped_key(prefix) and answer.number == request.number and answer.stop == stop:
            confirmed.set()

    answers = session.declare_subscriber(stopped_key(prefix), on_answer)
    publisher = urgent_publisher(session, stop_key(prefix))
    try:
        begun_s = time.monotonic()
        while time.monotonic() - begun_s < _TIME_OUT_S:
            publisher.put(request.model_dump_json())
            if confirmed.wait(_EVERY_S):
                return 1e3 * (time.monotonic() - begun_s)
        return None
    finally:
        publisher.undeclare()  # type: ignore[no-untyped-call]
        answers.undeclare()  # type: ignore[no-untyped-call]


def emergency_stop(address: EmulatorAddress, stop: bool, reason: str) -> str:
    """Stop or release the arms of a running session; return what happened. Raises `InputError`, `PeerError`."""
    with connected(address) as remote:
        confirmed_ms = send_stop(remote.session, address.prefix, stop, reason)
    if confirmed_ms is None:
        rule = (
            f"no patient of session {address.prefix} confirmed within {_TIME_OUT_S:g} s: none is running there, "
            "its patient.safety is off, or this client may not ask that (control in the scenario's security)"
        )
        raise PeerError(Fault("tis stop", address.endpoint, rule))
    return f"{'stopped' if stop else 'released'}, confirmed by the patient after {confirmed_ms:.0f} ms"
