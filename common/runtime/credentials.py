"""Credentials of a side, as settings of Zenoh: read from the user's files, never logged or passed as arguments."""

import base64
import json
import os
import stat
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args

from tis.common.channels import Side
from tis.common.errors import Fault, InputError
from tis.common.refusal import MAX_BYTES as MAX_REVOKED_BYTES
from tis.common.refusal import NONE_REVOKED, REVOKED_FILE, Revoked, read_revoked
from tis.common.scenario.security import Mtls, NoSecurity, Password
from tis.common.zenoh_syntax import is_tls

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

    from tis.common.scenario import Scenario

CA_FILE: Final = "ca.pem"
CERTIFICATE_FILE: Final = "cert.pem"
KEY_FILE: Final = "key.pem"
_OWN_FILES: Final = (("certificate", CERTIFICATE_FILE), ("private_key", KEY_FILE))
SOON_DAYS: Final = 7
"""Days before its end from which a certificate is warned of."""
_DAY_S: Final = 86_400
_MAX_BYTES: Final = 100_000
_OF_OTHERS: Final = stat.S_IRWXG | stat.S_IRWXO

Settings = Mapping[str, Any]
"""Settings of Zenoh: key and value, as `zenoh.Config.insert_json5` takes them in JSON."""


def credentials(security: NoSecurity | Mtls | Password, name: str) -> Settings:
    """Return the settings with which ``name`` proves its name as a client, and with which netem asks for proof.

    Raises `InputError` with every missing, unreadable or unprotected file.
    """
    if isinstance(security, Mtls):
        return tls_settings(Path(security.folder) / name, name == "netem", rereads=True)
    if isinstance(security, Password):
        return _password_settings(Path(security.file), name)
    return {}


def tls_settings(folder: Path, listens: bool, rereads: bool = False) -> Settings:
    """Return the TLS settings of the name whose certificate, key and authority lie in ``folder``.

    ``rereads``: the files are read again at each connection, and by each listener, so that a renewed certificate
    counts from the next one.
    """
    found: list[Fault] = []
    authority = _read(folder / CA_FILE, found)
    certificate = _read(folder / CERTIFICATE_FILE, found)
    key = _read(folder / KEY_FILE, found, private=True)
    found = found or _pem_faults(folder)
    if found:
        raise InputError(found)
    tls: dict[str, Any] = {"enable_mtls": True, "verify_name_on_connect": True, "close_link_on_expiration": True}
    if rereads:  # where a renewal is under way, the two do not fit, and the client tries again
        uses = ("connect", "listen") if listens else ("connect",)
        of_each = [(f"{use}_{what}", name) for use in uses for what, name in _OWN_FILES]
        for setting, name in (("root_ca_certificate", CA_FILE), *of_each):
            tls[setting] = str((folder / name).absolute())
        return {"transport/link/tls": tls}
    tls |= {
        "root_ca_certificate_base64": _base64(authority),
        "connect_certificate_base64": _base64(certificate),
        "connect_private_key_base64": _base64(key),
    }
    if listens:
        tls |= {"listen_certificate_base64": _base64(certificate), "listen_private_key_base64": _base64(key)}
    return {"transport/link/tls": tls}


def _pem_faults(folder: Path) -> list[Fault]:
    """Return what OpenSSL says of the files; Zenoh itself would only fail to listen, or to connect."""
    import ssl  # only where certificates are used: loading it takes milliseconds

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(folder / CA_FILE)
    except (ssl.SSLError, ValueError):
        return [Fault(str(folder / CA_FILE), "", "is no certificate")]
    try:
        context.load_cert_chain(folder / CERTIFICATE_FILE, folder / KEY_FILE, lambda: "")
    except (ssl.SSLError, ValueError):
        return [Fault(str(folder / CERTIFICATE_FILE), "", f"is no certificate, or {KEY_FILE} is not its key")]
    return []


def certified_names(scenario: "Scenario") -> list[str]:
    """Return the names that prove themselves in a run: its sides, and the further clients of the scenario."""
    security = scenario.security
    others = () if isinstance(security, NoSecurity) else (*security.control, *security.observers)
    return list(dict.fromkeys((*get_args(Side), *others, *scenario.patient.safety.releasers)))


def read_certificates(*files: Path) -> list[bytes]:
    """Return the contents of files with certificates; raises `InputError` with every one that cannot be read."""
    found: list[Fault] = []
    contents = [_read(file, found) for file in files]
    if found:
        raise InputError(found)
    return contents


def expiry_warnings(security: NoSecurity | Mtls | Password, *names: str) -> list[str]:
    """Return a warning on each certificate that expires within `SOON_DAYS`, or is revoked.

    None without the package cryptography, nor of a certificate that is not here.
    """
    texts: list[str] = []
    if not isinstance(security, Mtls):
        return texts
    for name in names:
        try:
            found = load_certificates((Path(security.folder) / name / CERTIFICATE_FILE).read_bytes())[0]
            until = found.not_valid_after_utc
        except (ImportError, OSError, ValueError):  # what is wrong with it is told elsewhere
            continue
        texts += soon_text(name, (until.timestamp() - time.time()) / _DAY_S)
        if name in revoked_in(Path(security.folder)).names:
            texts.append(f"the certificate of {name} is revoked ({REVOKED_FILE})")
    return texts


def load_certificates(content: bytes) -> "list[Certificate]":
    """Return the certificates in PEM, at least one; raises `ValueError`, and `ImportError` without cryptography."""
    from cryptography.x509 import InvalidVersion, load_pem_x509_certificates

    try:
        return load_pem_x509_certificates(content)
    except InvalidVersion as error:  # no ValueError, as all else that is wrong
        raise ValueError(str(error)) from None


def revoked_in(folder: Path) -> Revoked:
    """Return the revoked certificates of a folder; none without the file."""
    with suppress(OSError), (folder / REVOKED_FILE).open("rb") as opened:
        return read_revoked(opened.read(MAX_REVOKED_BYTES + 1))
    return NONE_REVOKED


def soon_text(name: str, days: float) -> list[str]:
    """Return a warning on a certificate that is valid for so many days more; none where that is long."""
    if days >= SOON_DAYS:
        return []
    return [f"the certificate of {name} expires in {max(days, 0.0):.1f} days: `tis certs issue {name}` renews it"]


def own_client(settings: Settings) -> Settings:
    """Return the settings of a client of this process's own router, whose address need not be in the certificate."""
    tls = settings.get("transport/link/tls")
    return settings if tls is None else {**settings, "transport/link/tls": {**tls, "verify_name_on_connect": False}}


def _password_settings(file: Path, name: str) -> Settings:
    found: list[Fault] = []
    lines = _read(file, found, private=True).decode("utf-8", "replace").splitlines()
    users: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        user, colon, password = line.partition(":")
        if not line.strip():
            continue
        if not (user and colon and password.strip()) or user != user.strip():
            found.append(Fault(str(file), f"line {number}", "must read NAME:PASSWORD"))
        elif user in users:
            found.append(Fault(str(file), f"line {number}", "names somebody who has a password already"))
        users[user] = password
    if not found and name not in users:
        found.append(Fault(str(file), name, "must have a line NAME:PASSWORD"))
    if found:
        raise InputError(found)
    own: dict[str, Any] = {"user": name, "password": users[name]}
    if name == "netem":
        own["dictionary_file"] = str(file.resolve())
    return {"transport/auth/usrpwd": own}


def read_secret(file: Path) -> bytes:
    """Return the secret that a file of its owner only holds, without spaces around it; raises `InputError`."""
    found: list[Fault] = []
    content = _read(file, found, private=True).strip()
    if found:
        raise InputError(found)
    return content


def refuse_plain(where: str, option: str, security: NoSecurity | Mtls | Password, endpoints: tuple[str, ...]) -> None:
    """Raise `InputError` if an endpoint is not encrypted although certificates are asked for."""
    if not isinstance(security, Mtls):
        return
    rule = "must be an endpoint like tls/192.168.1.5:7447 with security mtls"
    found = [Fault(where, option, rule, endpoint) for endpoint in endpoints if not is_tls(endpoint)]
    if found:
        raise InputError(found)


def config_text(settings: Settings) -> str:
    """Return the settings as a configuration file of Zenoh."""
    tree: dict[str, Any] = {}
    for key, value in settings.items():
        *parents, last = key.split("/")
        place = tree
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return json.dumps(tree, indent=2) + "\n"


def _read(file: Path, found: list[Fault], private: bool = False) -> bytes:
    """Return a file's content; faults are added to ``found``."""
    try:
        if file.exists() and not file.is_file():
            found.append(Fault(str(file), "", "must be a file"))
            return b""
        with file.open("rb") as opened:
            if private and os.fstat(opened.fileno()).st_mode & _OF_OTHERS:
                found.append(Fault(str(file), "", f"must be readable by its owner only: chmod 600 {file}"))
            content = opened.read(_MAX_BYTES + 1)
    except OSError as error:
        advice = "; `tis certs` makes it" if file.suffix == ".pem" else ""
        found.append(Fault(str(file), "", f"cannot be read: {error.strerror}{advice}"))
        return b""
    if len(content) > _MAX_BYTES:
        found.append(Fault(str(file), "", f"must have at most {_MAX_BYTES} bytes"))
    return content


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
