"""Signed messages: an authentication code behind the header, under a key that surgeon and patient alone have.

Each run has its own key, agreed by two `Hello` that netem passes on and cannot make: each is signed by the sender's
certificate, or has a code under a secret that both sides share. The code covers key expression, header (sequence
number, sent time, run) and payload, so what is altered, made up, or from another run or key has none.
"""

import hashlib
import hmac
from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple, Protocol

from msgspec import DecodeError, Meta

from tis.common.channels import CONTROL, Side
from tis.common.messages import CODE_BYTES, HEADER_BYTES, Message, decode, encode
from tis.common.units import NS_PER_S

MIN_SECRET_BYTES: Final = 16
_KEY_BYTES: Final = 32
_Public = Annotated[str, Meta(pattern=r"^([0-9a-f]{64})?$(?!\n)")]

CodeFault = Literal["unsigned", "wrong_code"]
SIGNERS: Final[dict[Side, Side]] = {"surgeon": "patient", "patient": "surgeon"}
"""The sides that agree on a key, each with the other one."""


class Hello(Message, frozen=True, kw_only=True):
    """One side's part of the agreement on a key."""

    side: Annotated[Literal["surgeon", "patient"], Meta(description="Side that sends it.")]
    public: Annotated[_Public, Meta(description="X25519 public key (RFC 7748), or random bytes with a secret; hex.")]
    echo: Annotated[_Public, Meta(description="The other side's `public`; empty: not heard yet.")]
    agreed: Annotated[bool, Meta(description="true: it has the run's key, and wants no answer.")] = False
    certificate: Annotated[str, Meta(max_length=16_000, description="In PEM; empty with a secret.")]
    proof: Annotated[
        str,
        Meta(
            pattern=r"^([0-9a-f]{2}){1,1024}$(?!\n)",
            description="ECDSA signature (SHA-256, DER) by the certificate's key, or HMAC-SHA256 by the secret; hex.",
        ),
    ]


class Proof(Message, frozen=True):
    """The attachment of a request to stop or to release, and of its answer: who vouches for the payload."""

    proof: Annotated[str, Meta(max_length=2048, description="As in `Hello`, over `vouched`.")]
    certificate: Annotated[str, Meta(max_length=16_000, description="In PEM; empty with a secret.")] = ""


class Signer(NamedTuple):
    """The name that a proof proves, or why it proves none."""

    name: str
    fault: str = ""


class Identity(Protocol):
    """What proves a name in a run whose messages are signed."""

    public: str
    certificate: str

    def proof(self, content: bytes) -> bytes:
        """Return the proof of own words."""

    def signer(self, certificate: str, proof: str, content: bytes) -> Signer:
        """Return who proves these words."""

    def shared(self, public: str) -> bytes:
        """Return the secret shared with the holder of a public key; raises `ValueError`."""


SECRETS: Final = "the secret"
"""Name of whoever has the shared secret."""
NOBODY: Final = "-"
"""Stands for the name where none is proved; no name begins with it."""
MAX_PROOF_BYTES: Final = 20_000
CHALLENGE_NS: Final = 10 * NS_PER_S
"""Time after which the patient states another challenge; a release counts under this one and the one before."""


def challenge_at(public: str, at_ns: int) -> str:
    """Return the challenge of a process with this `public` at a run time: who holds a release back lets it expire."""
    return hashlib.sha256(f"{public}\n{at_ns // CHALLENGE_NS}".encode()).hexdigest()


def vouched(key: str, challenge: str, payload: bytes) -> bytes:
    """Return what the proof of a request or an answer covers.

    ``challenge`` is what the patient's answers state, in releases and answers: neither can be repeated to another
    process, nor in another run, nor kept for later. It is empty in a stop, which waits for nothing.
    """
    return "\n".join(("tis stop 1", key, challenge)).encode() + b"\n" + payload


def attached_proof(own: Identity, key: str, challenge: str, payload: bytes) -> bytes:
    """Return the attachment with which an identity vouches for a message."""
    proof = own.proof(vouched(key, challenge, payload)).hex()
    return encode(Proof(proof=proof, certificate=own.certificate))


def signer_of(own: Identity, key: str, challenge: str, payload: bytes, attachment: bytes) -> Signer:
    """Return who vouches for a message, by its attachment, as ``own`` can tell."""
    if not attachment:
        return Signer("", "it is not signed")
    try:
        found = decode(attachment[: MAX_PROOF_BYTES + 1], Proof)
    except DecodeError:
        return Signer("", "its proof is none")
    return own.signer(found.certificate, found.proof, vouched(key, challenge, payload))


def hello_key(session: str, side: Side) -> str:
    """Return the key of a side's `Hello`; netem passes them on, outside the emulated network."""
    return f"{session}/{CONTROL}/sign/{side}"


def said(side: Side, public: str, echo: str, digest: str) -> bytes:
    """Return what the proof of a `Hello` covers; ``digest`` is that of the scenario."""
    return "\n".join(("tis hello 1", side, public, echo, digest)).encode()


def run_keys(shared: bytes, surgeon: str, patient: str, digest: str) -> dict[Side, bytes]:
    """Return the key under which each side signs: HKDF-SHA256 (RFC 5869) over the shared secret.

    ``surgeon`` and ``patient`` are the `public` of both. Oracle: the package cryptography, tests/common/test_signing.
    """
    salt = hashlib.sha256("\n".join(("tis run 1", surgeon, patient, digest)).encode()).digest()
    extracted = hmac.digest(salt, shared, "sha256")
    return {side: hmac.digest(extracted, side.encode() + b"\x01", "sha256") for side in SIGNERS}


def code(key: bytes, name: str, header: bytes, payload: bytes) -> bytes:
    """Return the code of a message: the first 16 bytes of an HMAC-SHA256 (RFC 2104).

    ``name`` is the key expression and ``header`` the 20 bytes before the code; neither can run into what follows.
    """
    return hmac.digest(key, header + len(name).to_bytes(4, "little") + name.encode() + payload, "sha256")[:CODE_BYTES]


@dataclass
class RunKeys:
    """The keys of both directions, as one side holds them; ``others`` has the newest first.

    Another thread replaces the keys when the other side was started anew. What still comes under the key before is
    taken until the first message under the new one.
    """

    own: bytes = b""
    others: tuple[bytes, ...] = ()

    def sign(self, name: str, header: bytes, payload: bytes) -> bytes:
        """Return a message's attachment: header and code."""
        return header + code(self.own, name, header, payload)

    def fault(self, name: str, attachment: bytes, payload: bytes) -> CodeFault | None:
        """Return why a message of the other side is not believed, None if it is."""
        if len(attachment) != HEADER_BYTES + CODE_BYTES:
            return "unsigned"
        header, found = attachment[:HEADER_BYTES], attachment[HEADER_BYTES:]
        others = self.others
        for key in others:
            if hmac.compare_digest(code(key, name, header, payload), found):
                if key is others[0] and len(others) > 1 and self.others is others:
                    self.others = others[:1]
                return None
        return "wrong_code"

    def agree(self, own: bytes, other: bytes) -> None:
        """Take new keys."""
        self.own, self.others = own, (other, *self.others[:1])
