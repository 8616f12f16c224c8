"""Decoders of what proves who somebody is: certificates, proofs, codes, and who is to be shut out."""

from types import SimpleNamespace
from typing import Any, Final

from tests.fuzz.scratch_folder import scratch_folder
from tis.common.audit import Chain, Happening, verify
from tis.common.messages import Header, encode
from tis.common.node import Arrival
from tis.common.peer_life import Beat
from tis.common.refusal import read_revoked
from tis.common.runtime.control import ControlKeys
from tis.common.runtime.peer_watch import Beats
from tis.common.runtime.signing import Agreement, SharedSecret, identity
from tis.common.scenario.security import Mtls
from tis.common.signing import SECRETS, Hello, RunKeys, attached_proof, said
from tis.common.stop_messages import EmergencyStop
from tis.deploy.tools.certificate_requests import accept, request
from tis.deploy.tools.certificates import issue, new_authority
from tis.patient_side.safety.emergency_stop import EmergencyStops

_FOLDER: Final = scratch_folder()
new_authority(_FOLDER)
for _name in ("surgeon", "patient"):
    issue(_FOLDER, _name)
request(_FOLDER, "operator")
issue(_FOLDER, "operator")
_PENDING: Final = _FOLDER / "requests" / "operator" / "key.pem"
_OPERATOR: Final = {name: (_FOLDER / "operator" / name).read_bytes() for name in ("key.pem", "cert.pem", "ca.pem")}
_SECURITY: Final = Mtls(kind="mtls", folder=str(_FOLDER), sign=True)
_SECRET: Final = SharedSecret(b"s" * 32)
_SURGEON, _PATIENT = identity(_SECURITY, "surgeon"), identity(_SECURITY, "patient")
assert _SURGEON is not None
assert _PATIENT is not None
_SESSION: Final[Any] = SimpleNamespace(
    declare_publisher=lambda *_, **__: None, declare_subscriber=lambda *_, **__: None
)
_STOP: Final = encode(EmergencyStop(stop=True, number=7))
_RELEASE: Final = encode(EmergencyStop(stop=False, number=8, ends=7))
_KEYS: Final = RunKeys(b"p" * 32, (b"s" * 32,))


def _hello(data: bytes) -> None:
    for own in (_SECRET, _PATIENT):
        agreement = Agreement(_SESSION, "tis", "patient", "d", own, lambda: None)  # type: ignore[arg-type]
        agreement._hear(data)
        assert not agreement.is_reached, "nobody has echoed its number"


def _proved(data: bytes) -> None:
    """Take as the attachment of a stop and of a release; no other than the sample's may release."""
    for own in (_SECRET, _PATIENT):
        stops = EmergencyStops("tis", releasers={SECRETS, "surgeon"}, own=own)
        assert stops.take(Arrival("east", "tis/@tis/stop", _STOP, data, 5)).is_done
        stops.take(Arrival("east", "tis/@tis/release", _RELEASE, data, 6))
        assert stops.is_stopped


def _stop(data: bytes) -> None:
    payload, _, attachment = data.partition(b"|")
    stops = EmergencyStops("tis", releasers={SECRETS}, own=_SECRET)
    for at_ns, key in enumerate(stops.keys):
        stops.take(Arrival("east", key, payload, attachment, at_ns))


def _beat(data: bytes) -> None:
    payload, _, attachment = data.partition(b"|")
    beats = Beats("patient", {"east": _SESSION}, ControlKeys("tis"), 7, is_witness=True, signed=_KEYS)

    class Part(bytes):
        def to_bytes(self) -> bytes:
            return bytes(self)

    sample: Any = SimpleNamespace(
        payload=Part(payload), attachment=Part(attachment), key_expr=ControlKeys("tis").beat("surgeon")
    )
    beats._receiver(None)(sample)
    if attachment[20:] != _ATTACHED[20:]:
        assert not [one for one in beats.heard() if one.side == "surgeon"]


def _accepted(certificate: bytes, authorities: bytes) -> None:
    _PENDING.parent.mkdir(exist_ok=True)
    _PENDING.write_bytes(_OPERATOR["key.pem"])
    accept(_FOLDER, "operator", certificate, authorities)


def _audit(data: bytes) -> None:
    found = verify(data.splitlines(keepends=True))
    assert len(found.entries) <= data.count(b"\n") + 1
    assert found.words


def _hellos() -> list[bytes]:
    samples = []
    for own in (_SECRET, _SURGEON):
        assert own is not None
        proof = own.proof(said("surgeon", own.public, "", "d")).hex()
        samples.append(
            encode(Hello(side="surgeon", public=own.public, echo="", certificate=own.certificate, proof=proof))
        )
    return samples


def _lines() -> bytes:
    chain = Chain()
    rows = [Happening("begun"), Happening("refused", "expired", "west", "10.0.0.1:5", "", "", ("a",))]
    return b"".join(chain.line("2026-11-24T00:00:00Z", 5, one) for one in rows)


_BEAT: Final = encode(Beat("surgeon", 5, 5, 7))
_ATTACHED: Final = RunKeys(b"s" * 32).sign(ControlKeys("tis").beat("surgeon"), Header(1, 5, 7).pack(), _BEAT)
_PROOFS: Final = [attached_proof(own, "tis/@tis/stop", "", _STOP) for own in (_SECRET, _SURGEON)]

TRUST_DECODERS: dict[str, tuple[Any, ...]] = {
    "hello": (_hello, _hellos()),
    "proof of a stop": (_proved, _PROOFS),
    "signed stop": (_stop, [_STOP + b"|" + _PROOFS[0], _RELEASE + b"|" + _PROOFS[0]]),
    "signed beat": (_beat, [_BEAT + b"|" + _ATTACHED]),
    "audit log": (_audit, [_lines()]),
    "revoked certificates": (read_revoked, [b"surgeon 1f\noperator # stolen\n"]),
    "certificate that came back": (lambda data: _accepted(data, _OPERATOR["ca.pem"]), [_OPERATOR["cert.pem"]]),
    "authorities that came back": (lambda data: _accepted(_OPERATOR["cert.pem"], data), [_OPERATOR["ca.pem"]]),
}
"""Arguments of `tests.fuzz.decoders.Decoder`, by name."""
