"""Agreement of surgeon and patient on the key of their run (`tis.common.signing`), without trust in netem.

Each side tells its public key until the other one's answer echoes it. A side that is started anew tells a new one,
and both take new keys.
"""

import base64
import hmac
import json
import queue
import secrets
import threading
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, Self

import zenoh
from msgspec import DecodeError

from tis.common.channels import Side
from tis.common.errors import DataError, Fault, InputError
from tis.common.extras import GET_HOSTS
from tis.common.messages import decode, encode
from tis.common.runtime.credentials import (
    CA_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    load_certificates,
    read_secret,
    revoked_in,
)
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.scenario.security import Mtls, Security
from tis.common.signing import (
    MIN_SECRET_BYTES,
    SECRETS,
    SIGNERS,
    Hello,
    Identity,
    RunKeys,
    Signer,
    hello_key,
    run_keys,
    said,
)

SigningSide = Literal["surgeon", "patient"]
_EVERY_S: Final = 0.25
_MAX_HELLO_BYTES: Final = 20_000
_MAX_WAITING: Final = 16
_NOT_PROVED: Final = "its certificate or its signature is not of the run's authority"


_OWN_CERTIFICATE: Final = "transport/link/tls/connect_certificate"


class SharedSecret:
    """A secret that surgeon and patient hold, and netem does not; each agreement has new random numbers."""

    def __init__(self, secret: bytes) -> None:
        self._secret, self.public, self.certificate = secret, secrets.token_hex(32), ""

    def proof(self, content: bytes) -> bytes:
        """Return an HMAC-SHA256."""
        return hmac.digest(self._secret, content, "sha256")

    def signer(self, certificate: str, proof: str, content: bytes) -> Signer:  # noqa: ARG002  (there is none)
        """Return whether somebody who has the secret says these words."""
        with suppress(ValueError):
            if hmac.compare_digest(self.proof(content), bytes.fromhex(proof)):
                return Signer(SECRETS)
        return Signer("", "it does not know the secret")

    def shared(self, public: str) -> bytes:  # noqa: ARG002  (it goes into the salt)
        """Return the secret."""
        return self._secret


class CertifiedKey:
    """A new X25519 key, signed by the key of a certificate; arguments in PEM. Raises `ValueError`, `TypeError`.

    ``authorities`` may be several, as of a hospital: each certificate is issued by one of them directly. ``revoked``
    is the folder with the file of revoked ones, read whenever somebody proves a name.
    """

    def __init__(self, certificate: bytes, key: bytes, authorities: bytes, revoked: Path | None = None) -> None:
        from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

        self._authorities = load_certificates(authorities)
        self._revoked = revoked
        self._agreeing = X25519PrivateKey.generate()
        self.public = self._agreeing.public_key().public_bytes_raw().hex()
        self.renew(certificate, key)

    def renew(self, certificate: bytes, key: bytes) -> None:
        """Prove the name with another certificate from now on."""
        from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        loaded = load_pem_private_key(key, None)
        if not isinstance(loaded, EllipticCurvePrivateKey):
            raise TypeError("its key must be on an elliptic curve")
        self.certificate, self._key = certificate.decode("ascii"), loaded

    def proof(self, content: bytes) -> bytes:
        """Return an ECDSA signature."""
        from cryptography.hazmat.primitives.asymmetric.ec import ECDSA
        from cryptography.hazmat.primitives.hashes import SHA256

        found: bytes = self._key.sign(content, ECDSA(SHA256()))
        return found

    def signer(self, certificate: str, proof: str, content: bytes) -> Signer:
        """Return the name that certificate and signature prove."""
        from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
        from cryptography.hazmat.primitives.asymmetric.ec import ECDSA, EllipticCurvePublicKey
        from cryptography.hazmat.primitives.hashes import SHA256
        from cryptography.x509.oid import NameOID

        try:
            found = load_certificates(certificate.encode())[0]
            if not any(map(partial(_is_issued_by, found), self._authorities)):
                return Signer("", _NOT_PROVED)
            key = found.public_key()
            if not isinstance(key, EllipticCurvePublicKey):
                return Signer("", "its key is not on an elliptic curve")
            key.verify(bytes.fromhex(proof), content, ECDSA(SHA256()))
            named = [str(one.value) for one in found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
        except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
            return Signer("", _NOT_PROVED)
        if not found.not_valid_before_utc <= datetime.now(UTC) <= found.not_valid_after_utc:
            return Signer("", "its certificate has expired, or is not valid yet")
        if len(named) != 1 or named[0] == SECRETS:
            return Signer("", "its certificate has not one name")
        if self._revoked is not None and revoked_in(self._revoked).covers(named[0], found.serial_number):
            return Signer("", "its certificate is revoked")
        return Signer(named[0])

    def shared(self, public: str) -> bytes:
        """Return the secret of the two X25519 keys."""
        from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PublicKey

        return self._agreeing.exchange(X25519PublicKey.from_public_bytes(bytes.fromhex(public)))


def _is_issued_by(certificate: Any, authority: Any) -> bool:
    from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm

    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        return False
    return True


def client_identity(config: zenoh.Config, secret: Path | None) -> Identity | None:
    """Return what proves the name of a client: a secret's file, else the certificate of its configuration.

    None without either, or without the package cryptography. Raises `InputError`.
    """
    if secret is not None:
        return SharedSecret(_long_secret(secret))
    with suppress(ImportError, OSError, ValueError, TypeError):
        names = ("connect_certificate", "connect_private_key", "root_ca_certificate")
        certificate, key, authorities = (_tls_content(config, name) for name in names)
        return CertifiedKey(certificate, key, authorities) if certificate and key and authorities else None
    return None


def shows_certificate(config: zenoh.Config) -> bool:
    """Tell whether a client of this configuration proves its name by a certificate."""
    return any(json.loads(config.get_json(f"{_OWN_CERTIFICATE}{end}")) for end in ("", "_base64"))


def _tls_content(config: zenoh.Config, name: str) -> bytes:
    """Return what a configuration of TLS holds or names, empty where it does neither."""
    held, file = (json.loads(config.get_json(f"transport/link/tls/{name}{end}")) for end in ("_base64", ""))
    return base64.b64decode(held) if held else Path(file).read_bytes() if file else b""


def _long_secret(file: Path) -> bytes:
    secret = read_secret(file)
    if len(secret) < MIN_SECRET_BYTES:
        raise InputError(Fault(str(file), "", f"must have at least {MIN_SECRET_BYTES} bytes: openssl rand -hex 32"))
    return secret


def secret_of(security: Security) -> Path | None:
    """Return the file of the secret by which a run's messages are signed, None where there is none."""
    return None if isinstance(security, Mtls) or not security.sign else Path(security.secret_file)


def identity(security: Security, side: Side) -> Identity | None:
    """Return what proves a side's part, None where messages are not signed; raises `InputError` and `DataError`."""
    if not security.sign:
        return None
    secret = secret_of(security)
    if secret is not None:
        return SharedSecret(_long_secret(secret))
    assert isinstance(security, Mtls)
    folder = Path(security.folder) / side
    try:
        certificate, key, authorities = (
            (folder / name).read_bytes() for name in (CERTIFICATE_FILE, KEY_FILE, CA_FILE)
        )
        return CertifiedKey(certificate, key, authorities, folder.parent)
    except ImportError:
        raise InputError(Fault("security.sign", "", f"needs the package cryptography: {GET_HOSTS}")) from None
    except (OSError, ValueError, TypeError) as error:
        raise DataError(Fault(str(folder), "", f"cannot be read: {error}")) from None


class Agreement:
    """One side's part of the agreement, for as long as the block lasts; ``changed`` is called when it is reached."""

    def __init__(
        self, session: zenoh.Session, prefix: str, side: SigningSide, digest: str, own: Identity,
        changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self.keys: Final = RunKeys()
        self.fault = ""
        """Why the other side's words were not believed last."""
        self._side, self._other, self._digest, self._own, self._changed = side, SIGNERS[side], digest, own, changed
        self._theirs = self._echo = ""
        self._dropped: list[str] = []
        self._waiting: queue.Queue[bytes] = queue.Queue(_MAX_WAITING)
        self._over = threading.Event()
        self._publisher = publisher_of(session, hello_key(prefix, side))
        self._subscriber = session.declare_subscriber(
            hello_key(prefix, self._other), self._take, allowed_origin=zenoh.Locality.REMOTE
        )
        self._thread = threading.Thread(target=self._serve, name="agreement", daemon=True)

    @property
    def is_reached(self) -> bool:
        """Whether both sides have the key."""
        return bool(self._theirs)

    @property
    def _is_settled(self) -> bool:
        """Whether nobody has begun another agreement since."""
        return self.is_reached and self._echo == self._theirs

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(1.0)
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        with suppress(zenoh.ZError):
            self._publisher.undeclare()  # type: ignore[no-untyped-call]

    def _take(self, sample: zenoh.Sample) -> None:
        if len(sample.payload) <= _MAX_HELLO_BYTES:
            with suppress(queue.Full):  # a flood; the other side tells again
                self._waiting.put_nowait(sample.payload.to_bytes())

    def _serve(self) -> None:
        while not self._over.is_set():
            is_asked = False
            with suppress(queue.Empty):
                is_asked = self._hear(self._waiting.get(timeout=_EVERY_S))
            if is_asked or not self._is_settled:
                with suppress(zenoh.ZError):  # the session is closed
                    self._publisher.put(encode(self._hello()))

    def _hello(self) -> Hello:
        own, side = self._own, self._side
        proof = own.proof(said(side, own.public, self._echo, self._digest)).hex()
        return Hello(
            side=side, public=own.public, echo=self._echo, agreed=self._is_settled, certificate=own.certificate,
            proof=proof,
        )  # fmt: skip

    def _hear(self, payload: bytes) -> bool:
        """Take the other side's words, and the keys where it has heard ours; tell whether it wants an answer."""
        try:
            hello = decode(payload, Hello)
        except DecodeError:
            return False
        if hello.side != self._other or not hello.public or hello.public in self._dropped:
            return False
        words = said(hello.side, hello.public, hello.echo, self._digest)
        name, fault = self._own.signer(hello.certificate, hello.proof, words)
        if name not in ("", SECRETS, hello.side):
            fault = "its certificate is of another name"
        if not fault and hello.echo == self._own.public and hello.public != self._theirs:
            fault = self._agree(hello.public)
        if fault:
            self.fault = f": {fault}"
            return False
        self._echo = hello.public
        return not hello.agreed

    def _agree(self, theirs: str) -> str:
        """Take the keys that follow from both public ones; return why there are none."""
        publics = {self._side: self._own.public, self._other: theirs}
        try:
            shared = self._own.shared(theirs)
        except ValueError:
            return "its key is none"
        keys = run_keys(shared, publics["surgeon"], publics["patient"], self._digest)
        self.keys.agree(keys[self._side], keys[self._other])
        if self._theirs:  # a key of before, told again, must not come back
            self._dropped.append(self._theirs)
        self._theirs = theirs
        self._changed()
        return ""
