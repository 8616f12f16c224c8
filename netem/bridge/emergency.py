"""Emergency stops across netem: passed on at once, beside the emulated links, which may delay or lose everything."""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from tis.common.audit import MAX_PER_SECOND
from tis.common.channels import Network, release_key, stop_key, stopped_key
from tis.common.errors import TisError
from tis.common.runtime.signing import identity
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.scenario.security import Mtls, Security
from tis.common.signing import MAX_PROOF_BYTES, Identity, hello_key, signer_of
from tis.common.units import NS_PER_S
from tis.netem.bridge.audit import AuditTrail

_MAX_BYTES: Final = 20_000
_REMOTE: Final = zenoh.Locality.REMOTE


def _checker(security: Security) -> Identity | None:
    """Return what tells who signed a stop; None without certificates, or without the package cryptography."""
    with suppress(TisError):
        return identity(security, "netem") if isinstance(security, Mtls) else None
    return None


def _proof(sample: zenoh.Sample) -> zenoh.ZBytes | None:
    """Return a message's attachment; what is larger than any proof goes no further, its message does."""
    found = sample.attachment
    return found if found is not None and len(found) <= MAX_PROOF_BYTES else None


class EmergencyLine:
    """Passes requests to the patient's network and their answers back, by Zenoh's highest priority.

    A request that a full queue drops is repeated by its sender until it is answered. Close it before the sessions.
    """

    def __init__(
        self, sessions: Mapping[Network, zenoh.Session], session: str, audit: AuditTrail, security: Security
    ) -> None:
        self.n_passed = 0
        self._signs, self._stop_key, self._own = security.sign, stop_key(session), _checker(security)
        self._second, self._n_checked = 0, 0
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
                key, payload, proof = str(sample.key_expr), sample.payload.to_bytes(), _proof(sample)
                attachment = b"" if proof is None else proof.to_bytes()
                self._audit.asked(network, key, payload, self._signer(key, payload, attachment))

        return listen

    def _signer(self, key: str, payload: bytes, attachment: bytes) -> str:
        """Return who signed a request, as far as netem can tell; the patient alone judges releases."""
        if not self._signs:
            return ""
        if not attachment:
            return "unsigned"
        second = time.monotonic_ns() // NS_PER_S
        self._n_checked = self._n_checked + 1 if second == self._second else 1
        self._second = second
        if self._own is None or key != self._stop_key or self._n_checked > MAX_PER_SECOND:
            return "not checked here"
        return signer_of(self._own, key, "", payload, attachment).name or "unsigned"

    def _open(self, origin: zenoh.Session, destination: zenoh.Session, key: str) -> None:
        publisher = publisher_of(destination, key)

        def pass_on(sample: zenoh.Sample) -> None:
            is_ours = sample.kind == zenoh.SampleKind.PUT and str(sample.key_expr) == key
            if is_ours and len(sample.payload) <= _MAX_BYTES:
                self.n_passed += 1
                with suppress(zenoh.ZError):  # the session is closed
                    publisher.put(sample.payload, attachment=_proof(sample))

        self._held.append(origin.declare_subscriber(key, pass_on, allowed_origin=_REMOTE))
