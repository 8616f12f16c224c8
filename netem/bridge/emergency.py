"""Emergency stops across netem: passed on at once, beside the emulated links, which may delay or lose everything.

A patient that is started anew in mid-run is told again that it was stopped: a crash must not release an arm.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh
from pydantic import ValidationError

from common.channels import Network, stop_key, stopped_key
from common.messages import EmergencyStop
from common.runtime.control import ControlKeys
from common.runtime.zenoh_session import urgent_publisher

_MAX_BYTES: Final = 2048


class EmergencyLine:
    """Passes requests to the patient's network and their confirmations back, by Zenoh's highest priority.

    A request that a full queue drops is repeated by its sender until it is confirmed. ``stopped`` is the last one
    that the patient has confirmed, if it was to stop. Close it before the sessions.
    """

    def __init__(self, sessions: Mapping[Network, zenoh.Session], session: str) -> None:
        self.n_passed = 0
        self.stopped: bytes | None = None
        self._held: list[Any] = []
        self._again = urgent_publisher(sessions["east"], stop_key(session))
        self._open(sessions["west"], sessions["east"], stop_key(session))
        self._open(sessions["east"], sessions["west"], stopped_key(session))
        confirmed = sessions["east"].declare_subscriber(
            stopped_key(session), self._remember, allowed_origin=zenoh.Locality.REMOTE
        )
        back = (
            sessions["east"]
            .liveliness()
            .declare_subscriber(ControlKeys(session).run("patient", "*"), self._stop_again)
        )
        self._held += [confirmed, back]

    def close(self) -> None:
        """Stop passing; a second call does nothing."""
        for one in self._held:
            one.undeclare()
        self._held.clear()

    def counters(self) -> dict[str, int]:
        """Return the number of messages passed, by name."""
        return {"emergency_messages": self.n_passed}

    def _remember(self, sample: zenoh.Sample) -> None:
        if len(sample.payload) > _MAX_BYTES:
            return
        payload = sample.payload.to_bytes()
        with suppress(ValidationError):
            self.stopped = payload if EmergencyStop.model_validate_json(payload).stop else None

    def _stop_again(self, sample: zenoh.Sample) -> None:
        """Stop a patient that has come into the run, if it was stopped before it left."""
        if sample.kind == zenoh.SampleKind.PUT and self.stopped is not None:
            with suppress(zenoh.ZError):  # the session is closed
                self._again.put(self.stopped)

    def _open(self, origin: zenoh.Session, destination: zenoh.Session, key: str) -> None:
        publisher = urgent_publisher(destination, key)

        def pass_on(sample: zenoh.Sample) -> None:
            is_ours = sample.kind == zenoh.SampleKind.PUT and str(sample.key_expr) == key
            if is_ours and len(sample.payload) <= _MAX_BYTES:
                self.n_passed += 1
                with suppress(zenoh.ZError):  # the session is closed
                    publisher.put(sample.payload)

        self._held.append(origin.declare_subscriber(key, pass_on, allowed_origin=zenoh.Locality.REMOTE))
