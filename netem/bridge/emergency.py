"""Emergency stops across netem: passed on at once, beside the emulated links, which may delay or lose everything."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from tis.common.channels import Network, release_key, stop_key, stopped_key
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.signing import hello_key
from tis.netem.bridge.audit import AuditTrail

_MAX_BYTES: Final = 20_000
_REMOTE: Final = zenoh.Locality.REMOTE


class EmergencyLine:
    """Passes requests to the patient's network and their answers back, by Zenoh's highest priority.

    A request that a full queue drops is repeated by its sender until it is answered. Close it before the sessions.
    """

    def __init__(self, sessions: Mapping[Network, zenoh.Session], session: str, audit: AuditTrail) -> None:
        self.n_passed = 0
        self._held: list[Any] = []
        self._audit = audit
        for key in (stop_key(session), release_key(session)):  # in the east they reach the patient without netem
            for network, one in sessions.items():
                self._held.append(one.declare_subscriber(key, self._listener(network), allowed_origin=_REMOTE))
        self._open(sessions["west"], sessions["east"], stop_key(session))
        self._open(sessions["west"], sessions["east"], release_key(session))
        self._open(sessions["east"], sessions["west"], stopped_key(session))
        self._open(sessions["west"], sessions["east"], hello_key(session, "surgeon"))
        self._open(sessions["east"], sessions["west"], hello_key(session, "patient"))

    def close(self) -> None:
        """Stop passing; a second call does nothing."""
        for one in self._held:
            one.undeclare()
        self._held.clear()

    def counters(self) -> dict[str, int]:
        """Return the number of messages passed, by name."""
        return {"emergency_messages": self.n_passed}

    def _listener(self, network: Network) -> Callable[[zenoh.Sample], None]:
        """Return the callback that notes requests of a network in the audit log."""

        def listen(sample: zenoh.Sample) -> None:
            if len(sample.payload) <= _MAX_BYTES:
                self._audit.asked(network, str(sample.key_expr), sample.payload.to_bytes())

        return listen

    def _open(self, origin: zenoh.Session, destination: zenoh.Session, key: str) -> None:
        publisher = publisher_of(destination, key)

        def pass_on(sample: zenoh.Sample) -> None:
            is_ours = sample.kind == zenoh.SampleKind.PUT and str(sample.key_expr) == key
            if is_ours and len(sample.payload) <= _MAX_BYTES:
                self.n_passed += 1
                with suppress(zenoh.ZError):  # the session is closed
                    publisher.put(sample.payload)

        self._held.append(origin.declare_subscriber(key, pass_on, allowed_origin=_REMOTE))
