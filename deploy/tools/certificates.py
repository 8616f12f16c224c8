"""Certificates of the sides and of further clients: a small authority, and a short-lived certificate for each name.

Keys are EC P-256 (RFC 5480). A certificate is for clients; netem's is for servers as well, with the addresses of its
host as alternative names (RFC 5280). Oracle: OpenSSL's chain verification, test_certificates.
"""

import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, EllipticCurvePrivateKey, generate_private_key
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from pydantic import TypeAdapter, ValidationError

from tis.common.errors import DataError, Fault, InputError, file_faults
from tis.common.refusal import REVOKED_FILE, Revoked
from tis.common.runtime.credentials import (
    CA_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    config_text,
    load_certificates,
    revoked_in,
    tls_settings,
)
from tis.common.scenario.security import PersonName

AUTHORITY: Final = "ca"
"""Folder of the authority, beside those of the names."""
REQUESTS: Final = "requests"
"""Folder of the requests to a hospital's authority, a folder for each name."""
CONFIG_FILE: Final = "zenoh.json5"
DAYS: Final = 30
_AUTHORITY_DAYS: Final = 366
_OF_THIS_HOST: Final = ("localhost", "127.0.0.1", "::1")
_TOLERANCE: Final = timedelta(minutes=5)
"""Lag of a host's calendar clock that does no harm."""
_LABEL: Final = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?")
_MAX_NAME_CHARS: Final = 253
_NAME: Final[TypeAdapter[str]] = TypeAdapter(PersonName)


@dataclass(frozen=True)
class Certificate:
    """A certificate as `tis certs show` lists it; ``fault`` says why it cannot be used."""

    name: str
    hosts: tuple[str, ...]
    until: datetime | None
    fault: str | None = None

    def days_left(self, now: datetime) -> float | None:
        """Return the days until it expires, negative afterwards."""
        return None if self.until is None else (self.until - now) / timedelta(days=1)


def new_authority(folder: Path, password: bytes | None = None) -> None:
    """Create the authority in ``folder``, its key encrypted with a password; raises `InputError` if there is one."""
    place = folder / AUTHORITY
    if place.exists():
        raise InputError(Fault(str(place), "", "exists already; remove it to invalidate all its certificates"))
    key, name = generate_private_key(SECP256R1()), subject_of("tis authority")
    subject_key = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    builder = _builder(name, name, key, _AUTHORITY_DAYS)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(usage(signs_certificates=True), critical=True)
    certificate = builder.add_extension(subject_key, critical=False).sign(key, SHA256())
    replace_folder(place, {CA_FILE: certificate.public_bytes(Encoding.PEM), KEY_FILE: pem(key, password)})
    (folder / REVOKED_FILE).unlink(missing_ok=True)  # of an authority before, whose certificates count no more


def issue(
    folder: Path, name: str, hosts: Sequence[str] = (), days: int | None = None, password: bytes | None = None
) -> Certificate:
    """Create or renew the certificate of a name; raises `InputError` and `DataError`.

    Parameters
    ----------
    folder
        Where the authority is, and a folder for each name will be.
    name
        A side, or a further client as the scenario lists it.
    hosts
        Addresses and names of netem's host, by which clients connect; loopback's are among them. Without any, a
        renewed certificate keeps those that it has.
    days
        Validity, at most as long as the authority's; by default `DAYS`.
    password
        Of the authority's key, where that is encrypted.
    """
    check_name(name)
    check_not_revoked(folder, name)
    days = DAYS if days is None else days
    if hosts and name != "netem":
        raise InputError(Fault("tis certs", "--host", "is for netem only: clients are known by their name", hosts))
    check_hosts(hosts)
    authority, authority_key = _authority(folder, password)
    left = (authority.not_valid_after_utc - datetime.now(UTC)) // timedelta(days=1)
    if days > left:
        raise InputError(Fault("tis certs", "--days", f"must be at most {max(left, 0)}, as the authority's", days))
    key = generate_private_key(SECP256R1())
    purposes, names = asked_for(folder, name, hosts)
    authority_id = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key())
    certificate = (
        _builder(subject_of(name), authority.subject, key, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage(signs_certificates=False), critical=True)
        .add_extension(purposes, critical=False)
        .add_extension(names, critical=False)
        .add_extension(authority_id, critical=False)
        .sign(authority_key, SHA256())
    )
    files = {
        CA_FILE: authority.public_bytes(Encoding.PEM),
        CERTIFICATE_FILE: certificate.public_bytes(Encoding.PEM),
        KEY_FILE: pem(key),
    }
    replace_folder(folder / name, files, name == "netem")
    return described(name, certificate)


def asked_for(
    folder: Path, name: str, hosts: Sequence[str]
) -> tuple[x509.ExtendedKeyUsage, x509.SubjectAlternativeName]:
    """Return what the certificate of a name is for: its purposes, and the names and addresses."""
    names, purposes = [name], [ExtendedKeyUsageOID.CLIENT_AUTH]
    if name == "netem":
        names += [*_OF_THIS_HOST, *(hosts or _present_hosts(folder / name))]
        purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)
    alternatives = [_general_name(each) for each in dict.fromkeys(names)]
    return x509.ExtendedKeyUsage(purposes), x509.SubjectAlternativeName(alternatives)


def name_faults(name: str, found: x509.Certificate) -> Iterator[str]:
    """Yield that a certificate is not of this name."""
    try:
        named = [str(each.value) for each in found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    except ValueError:
        named = []
    if named != [name]:
        yield f"is of another name: {', '.join(named) or 'none'}"


def is_issued_by(found: x509.Certificate, authority: x509.Certificate) -> bool:
    """Tell whether an authority issued a certificate directly."""
    try:
        found.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError, UnsupportedAlgorithm):
        return False
    return True


def revoke(folder: Path, name: str) -> str:
    """Add a name to the revoked ones, with its certificate's serial number where that is here; return the line."""
    check_name(name)
    line = name
    if (folder / name / CERTIFICATE_FILE).exists():
        line += f" {_load_certificate(folder / name / CERTIFICATE_FILE).serial_number:x}"
    file = folder / REVOKED_FILE
    with file_faults(file, "cannot be written"):
        content = file.read_bytes() if file.exists() else b""
        if line not in content.decode("utf-8", "replace").splitlines():
            end = b"\n" * (content[-1:] not in (b"", b"\n"))
            partial = file.with_suffix(".part")
            partial.write_bytes(content + end + line.encode() + b"\n")
            partial.replace(file)
    return line


def certificates(folder: Path) -> list[Certificate]:
    """Return the certificates below ``folder``, by name; raises `DataError` without the authority's."""
    file = next(
        (file for file in (folder / AUTHORITY / CA_FILE, *folder.glob(f"*/{CA_FILE}")) if file.exists()), None
    )
    if file is None:
        raise DataError(Fault(str(folder), "", "has no certificates; `tis certs init` makes them"))
    authorities, revoked = file.read_bytes(), revoked_in(folder)
    return [_shown(place, authorities, revoked) for place in sorted(folder.iterdir()) if _is_of_a_name(place)]


def _is_of_a_name(place: Path) -> bool:
    return place.is_dir() and place.name not in (AUTHORITY, REQUESTS) and (place / CERTIFICATE_FILE).exists()


def _shown(place: Path, authorities: bytes, revoked: Revoked) -> Certificate:
    """Return what a folder holds, with the first reason for which it cannot be used."""
    try:
        certificate = _load_certificate(place / CERTIFICATE_FILE)
        tls_settings(place, listens=False)
    except (DataError, InputError) as error:
        return Certificate(place.name, (), None, error.faults[0].rule)
    found = described(place.name, certificate)
    fault = next(_faults(place, certificate, authorities), None)
    if fault is None and place.name in revoked.names:  # netem cannot tell its certificates apart
        fault = "is revoked"
    return Certificate(found.name, found.hosts, found.until, fault)


def _faults(place: Path, certificate: x509.Certificate, authorities: bytes) -> Iterator[str]:
    yield from name_faults(place.name, certificate)
    try:
        known = load_certificates(authorities)
    except ValueError:
        known = []
    if not any(is_issued_by(certificate, one) for one in known):
        yield "is of another authority"
    if (place / CA_FILE).read_bytes() != authorities:
        yield f"its {CA_FILE} is of another authority"
    now = datetime.now(UTC)
    if now > certificate.not_valid_after_utc:
        yield "has expired: `tis certs issue` renews it"
    if now < certificate.not_valid_before_utc:
        yield "is not valid yet: check the clock"


def described(name: str, certificate: x509.Certificate) -> Certificate:
    """Return a certificate as it is listed."""
    try:
        alternatives = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (x509.ExtensionNotFound, x509.DuplicateExtension, x509.UnsupportedGeneralNameType, ValueError):
        alternatives = x509.SubjectAlternativeName([])
    hosts = tuple(str(each.value) for each in alternatives)
    return Certificate(name, hosts, certificate.not_valid_after_utc)


def _present_hosts(place: Path) -> tuple[str, ...]:
    """Return the addresses of the certificate that is there, none without one."""
    try:
        return described(place.name, _load_certificate(place / CERTIFICATE_FILE)).hosts
    except DataError:
        return ()


def check_hosts(hosts: Sequence[str]) -> None:
    """Raise `InputError` with every host that is neither an address nor a name (RFC 1123)."""
    rule = "must be an IP address or a host's name, without protocol and port"
    found = [Fault("tis certs", "--host", rule, host) for host in hosts if not (_is_address(host) or _is_name(host))]
    if found:
        raise InputError(found)


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _is_name(host: str) -> bool:
    return len(host) <= _MAX_NAME_CHARS and all(map(_LABEL.fullmatch, host.split(".")))


def check_name(name: str) -> None:
    """Raise `InputError` for what is no name of a certificate."""
    try:
        _NAME.validate_python(name)
    except ValidationError as error:
        raise InputError(Fault("tis certs", "NAME", error.errors()[0]["msg"], name)) from None
    if name in (AUTHORITY, REQUESTS):
        raise InputError(Fault("tis certs", "NAME", f"must not be {name}, a folder of another use", name))


def check_not_revoked(folder: Path, name: str) -> None:
    """Raise `InputError` for a revoked name: netem would let its certificates before in again, or the new one not."""
    if name in revoked_in(folder).names:
        rule = (
            "is revoked, and netem tells certificates apart by name only: list another name in the scenario for its "
            f"holder; or take its lines out of {REVOKED_FILE} on every host once its old certificates have expired; "
            "for a side make a new authority"
        )
        raise InputError(Fault("tis certs", "NAME", rule, name))


def _authority(folder: Path, password: bytes | None) -> tuple[x509.Certificate, EllipticCurvePrivateKey]:
    place = folder / AUTHORITY
    certificate = _load_certificate(place / CA_FILE)
    try:
        content = (place / KEY_FILE).read_bytes()
        key = load_pem_private_key(content, password if b"ENCRYPTED" in content else None)
    except TypeError:
        rule = "is encrypted: give the file of its password (--password-file)"
        raise InputError(Fault(str(place / KEY_FILE), "", rule)) from None
    except (ValueError, UnsupportedAlgorithm):
        raise DataError(Fault(str(place / KEY_FILE), "", "is no private key, or has another password")) from None
    if not isinstance(key, EllipticCurvePrivateKey):
        raise DataError(Fault(str(place / KEY_FILE), "", "must be a key on an elliptic curve"))
    return certificate, key


def _load_certificate(file: Path) -> x509.Certificate:
    try:
        return load_certificates(file.read_bytes())[0]
    except ValueError:
        raise DataError(Fault(str(file), "", "is no certificate")) from None
    except FileNotFoundError:
        raise DataError(Fault(str(file), "", "is not there; `tis certs init` makes it")) from None


def _builder(
    subject: x509.Name, issuer: x509.Name, key: EllipticCurvePrivateKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _TOLERANCE)
        .not_valid_after(now + timedelta(days=days))
    )


def usage(signs_certificates: bool) -> x509.KeyUsage:
    """Return what a key may sign: certificates, or the messages of a handshake."""
    others: dict[str, Any] = dict.fromkeys(
        ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement", "encipher_only",
         "decipher_only"),
        False,
    )  # fmt: skip
    return x509.KeyUsage(
        digital_signature=not signs_certificates, key_cert_sign=signs_certificates, crl_sign=signs_certificates,
        **others,
    )  # fmt: skip


def subject_of(common: str) -> x509.Name:
    """Return the subject with this common name."""
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _general_name(host: str) -> x509.GeneralName:
    return x509.IPAddress(ip_address(host)) if _is_address(host) else x509.DNSName(host)


def pem(key: EllipticCurvePrivateKey, password: bytes | None = None) -> bytes:
    """Return a key in PEM, encrypted with a password if there is one."""
    kind = NoEncryption() if password is None else BestAvailableEncryption(password)
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, kind)


def replace_folder(place: Path, files: dict[str, bytes], listens: bool = False) -> None:
    """Write a folder that only its user can enter, whole or not at all; an older one is replaced."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        prefix=f".{place.name}.", dir=place.parent, ignore_cleanup_errors=True
    ) as scratch:
        partial, former = Path(scratch, "new"), Path(scratch, "former")
        partial.mkdir(mode=0o700)
        for name, content in files.items():
            _write_private(partial / name, content)
        if CERTIFICATE_FILE in files:
            _write_private(partial / CONFIG_FILE, config_text(tls_settings(partial, listens)).encode())
        if place.exists():
            place.rename(former)
        partial.rename(place)


def _write_private(file: Path, content: bytes) -> None:
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as opened:
        opened.write(content)
