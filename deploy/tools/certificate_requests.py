"""Certificates of another authority, such as a hospital's: requests by name, and what comes back taken into use."""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.credentials import CA_FILE, CERTIFICATE_FILE, KEY_FILE, load_certificates
from tis.deploy.tools.certificates import (
    REQUESTS,
    Certificate,
    asked_for,
    check_hosts,
    check_name,
    check_not_revoked,
    described,
    is_issued_by,
    name_faults,
    pem,
    replace_folder,
    subject_of,
    usage,
)

REQUEST_FILE: Final = "request.pem"


def request(folder: Path, name: str, hosts: Sequence[str] = ()) -> Path:
    """Make a key for a name and a request for its certificate (PKCS #10, RFC 2986); return the request's file.

    The certificate in use stays until `accept`. Raises `InputError`.
    """
    check_name(name)
    check_not_revoked(folder, name)
    check_hosts(hosts)
    key = generate_private_key(SECP256R1())
    purposes, names = asked_for(folder, name, hosts if name == "netem" else ())
    asked = (
        x509.CertificateSigningRequestBuilder()
        .subject_name(subject_of(name))
        .add_extension(usage(signs_certificates=False), critical=True)
        .add_extension(purposes, critical=False)
        .add_extension(names, critical=False)
        .sign(key, SHA256())
    )
    place = folder / REQUESTS / name
    replace_folder(place, {REQUEST_FILE: asked.public_bytes(Encoding.PEM), KEY_FILE: pem(key)})
    return place / REQUEST_FILE


def accept(folder: Path, name: str, certificate: bytes, authorities: bytes) -> Certificate:
    """Take the certificate that an authority made of a request into use; raises `InputError` and `DataError`.

    ``authorities`` are in PEM; one of them issued the certificate. All faults are told at once.
    """
    check_name(name)
    check_not_revoked(folder, name)
    place = folder / REQUESTS / name
    found, known = _parsed("--certificate", certificate)[0], _parsed("--ca", authorities)
    try:
        key = load_pem_private_key((place / KEY_FILE).read_bytes(), None)
    except (OSError, ValueError, TypeError):
        raise DataError(Fault(str(place), "", "holds no request; `tis certs request` makes it")) from None
    faults = list(_use_faults(name, found, known, key.public_key()))
    if faults:
        raise InputError([Fault("tis certs", "--certificate", rule) for rule in faults])
    files = {CA_FILE: authorities, CERTIFICATE_FILE: certificate, KEY_FILE: (place / KEY_FILE).read_bytes()}
    replace_folder(folder / name, files, name == "netem")
    shutil.rmtree(place, ignore_errors=True)
    return described(name, found)


def _parsed(option: str, content: bytes) -> list[x509.Certificate]:
    try:
        return load_certificates(content)
    except ValueError:
        raise InputError(Fault("tis certs", option, "must be certificates in PEM")) from None


def _use_faults(name: str, found: x509.Certificate, authorities: list[x509.Certificate], key: Any) -> Iterator[str]:
    """Yield why a certificate cannot be used for a name with this public key."""
    yield from name_faults(name, found)
    if not any(is_issued_by(found, one) for one in authorities):
        yield "must be issued by a certificate of --ca directly"
    try:
        is_ours = found.public_key() == key
        usage = found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    except x509.ExtensionNotFound:  # for any purpose
        usage = None
    except (ValueError, UnsupportedAlgorithm, x509.DuplicateExtension, x509.UnsupportedGeneralNameType):
        yield "cannot be read"
        return
    if not is_ours:
        yield "must be of the key of this request"
    purposes = {ExtendedKeyUsageOID.CLIENT_AUTH} | ({ExtendedKeyUsageOID.SERVER_AUTH} if name == "netem" else set())
    if usage is not None and not purposes <= set(usage):
        yield f"must be for {'servers and clients' if name == 'netem' else 'clients'} (extended key usage)"
