"""Refused connections and messages: their kinds, and how Zenoh's log reports them to router and client."""

import re
from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

Refusal = Literal[
    "no_certificate", "foreign_authority", "expired", "bad_certificate", "no_tls", "false_netem", "unknown_name",
    "no_password", "wrong_password", "not_permitted", "revoked",
]  # fmt: skip

MEANING: Final[Mapping[Refusal, str]] = {
    "no_certificate": "a client without a certificate",
    "foreign_authority": "a certificate of another authority",
    "expired": "a certificate that has expired, or is not valid yet",
    "bad_certificate": "a certificate that cannot be accepted",
    "no_tls": "a client that does not speak TLS",
    "false_netem": "a client that did not accept netem's certificate",
    "unknown_name": "a name that the scenario does not list",
    "no_password": "a client without a password",
    "wrong_password": "a wrong user or password",
    "not_permitted": "a message that its sender may not say",
    "revoked": "a client whose certificate is revoked",
}

REFUSED: Final = "refused"
"""First part of the names of their counters."""

_COLOUR: Final = re.compile(rb"\x1b\[[0-9;]*m")
_PATTERNS: Final[tuple[tuple[bytes, Refusal | None], ...]] = (
    (b"interceptor: Msg intercepted", "not_permitted"),
    (b"did not match any configured ACL subject", "unknown_name"),
    (b"peer sent no certificates", "no_certificate"),
    (b"certificate expired", "expired"),
    (b"not valid yet", "expired"),
    (b"BadSignature", "foreign_authority"),
    (b"UnknownIssuer", "foreign_authority"),
    (b"invalid peer certificate", "bad_certificate"),
    (b"received fatal alert", "false_netem"),
    (b"tls handshake eof", None),  # the client gave up: a side ends an attempt after 0.4 s, and tries again
    (b"Hint: increase the system open file limit", "no_tls"),  # how the line of each failed handshake ends
    (b"UsrPwd extension - Recv InitSyn", "no_password"),
    (b"UsrPwd extension - Recv OpenSyn", "wrong_password"),
)
_OF_ZENOH: Final = re.compile(rb"^\d{4}-\d\d-\d\dT[\d:.]+Z +(TRACE|DEBUG|INFO|WARN|ERROR) ")


def zenoh_line(line: bytes) -> bytes | None:
    """Return a line of Zenoh's log without colours, None for other output."""
    plain = _COLOUR.sub(b"", line)
    return plain if _OF_ZENOH.match(plain) else None


def refusal_in(line: bytes) -> Refusal | None:
    """Return the kind of refusal that a line of Zenoh's log reports, None if none.

    What a client sends does not stand there. Oracle: real routers, tests/system/test_security.
    """
    plain = zenoh_line(line)
    if plain is None:
        return None
    return next((kind for pattern, kind in _PATTERNS if pattern in plain), None)


class Sender(NamedTuple):
    """Zenoh's number of the client that was refused, its name, and the key; empty where a line does not say."""

    zid: str = ""
    name: str = ""
    key: str = ""


UNAUTHORIZED: Final = b" is unauthorized to "
_SUBJECT: Final = re.compile(rb"([0-9a-f]{1,32}) did not match any configured ACL subject")
_SENDER: Final = re.compile(
    rb"([0-9a-f]{1,32})(?: on \S*?(?:(?:CertCommonName|Username)\(([^)]{1,64})\)\S*)?)? is unauthorized to [^()]+ "
    rb"\(ingress\) on (\S{1,512})"
)


def thread_in(line: bytes) -> bytes:
    """Return which of Zenoh's threads wrote a line."""
    found = re.search(rb"ThreadId\(\d+\)", line)
    return found[0] if found else b""


def sender_in(line: bytes) -> Sender:
    """Return what a line of a refusal says of the sender. Oracle: real routers, tests/system/test_security."""
    found = _SUBJECT.search(line) or _SENDER.search(line)
    return Sender(*(part.decode("utf-8", "replace") for part in found.groups(b""))) if found else Sender()


_NO_CONNECTION: Final = b"Unable to connect to configured peer"
_REFUSED_BY_ROUTER: Final = b"Received a close message"
_TROUBLES: Final[tuple[tuple[bytes, str], ...]] = (
    (
        b"certificate not valid for name",
        "its certificate is not for this address; tis certs issue netem --host ADDRESS",
    ),
    (b"BadSignature", "its certificate is of another authority"),
    (b"UnknownIssuer", "its certificate is of another authority"),
    (b"certificate expired", "its certificate has expired"),
    (b"invalid peer certificate", "its certificate is not netem's"),
    (b"alert: CertificateExpired", "it refuses this side's certificate, which has expired"),
    (b"received fatal alert", "it refuses this side's certificate"),
    (b"in response to an", "it refuses this side's user or password"),
)


def trouble_in(line: bytes) -> str | None:
    """Return the reason that a line of Zenoh's log gives for a failed connection, None without one."""
    plain = zenoh_line(line)
    if plain is None or not (_NO_CONNECTION in plain or _REFUSED_BY_ROUTER in plain):
        return None
    return next((text for pattern, text in _TROUBLES if pattern in plain), None)


# The file of revoked certificates: a line for each, NAME or NAME SERIAL, beside the folders of the names.

REVOKED_FILE: Final = "revoked.txt"
MAX_BYTES: Final = 1_000_000
_LINE: Final = re.compile(r"([A-Za-z0-9_][A-Za-z0-9_.-]{0,63})(?: +([0-9a-f]{1,40}))?")
_MAX_FAULTS: Final = 10


class Revoked(NamedTuple):
    """Revoked names, and the serial numbers of those lines that have one; ``faults`` are of lines that are none."""

    names: frozenset[str] = frozenset()
    serials: frozenset[tuple[str, int]] = frozenset()
    faults: tuple[str, ...] = ()

    def covers(self, name: str, serial: int) -> bool:
        """Tell whether a certificate is revoked: by its serial number, or by a line of its name without one."""
        with_serial = {one for one, _ in self.serials}
        return (name, serial) in self.serials or (name in self.names and name not in with_serial)


NONE_REVOKED: Final = Revoked()


def read_revoked(content: bytes) -> Revoked:
    """Return what a file says; each line that can be read counts, whatever the others hold.

    Oracle: lines made of names and numbers, tests/common/test_revocation.
    """
    names, serials, faults = set[str](), set[tuple[str, int]](), list[str]()
    if len(content) > MAX_BYTES:
        faults.append(f"must have at most {MAX_BYTES} bytes; what is beyond is not read")
    for number, line in enumerate(content[:MAX_BYTES].decode("utf-8", "replace").splitlines(), 1):
        text = line.partition("#")[0].strip()
        found = _LINE.fullmatch(text)
        if found is not None:
            names.add(found[1])
            if found[2]:
                serials.add((found[1], int(found[2], 16)))
        elif text and len(faults) < _MAX_FAULTS:
            faults.append(f"line {number} must read NAME, or NAME SERIAL in hex")
    return Revoked(frozenset(names), frozenset(serials), tuple(faults))
