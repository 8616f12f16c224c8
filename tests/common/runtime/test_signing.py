"""Agreement on a run's keys over a real router, and what does not prove a name."""

import ssl
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from tis.common.errors import InputError
from tis.common.messages import encode
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.signing import Agreement, SharedSecret, SigningSide, identity
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.security import Mtls, NoSecurity
from tis.common.signing import SIGNERS, Hello, Identity, Signer, hello_key, said
from tis.deploy.tools.certificates import issue, new_authority


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certs")
    for place in (folder, folder / "other"):
        new_authority(place)
        for name in ("surgeon", "patient"):
            issue(place, name)
    return folder


def _hello(own: Identity, side: SigningSide, digest: str = "d", public: str | None = None) -> Hello:
    shown = own.public if public is None else public
    proof = own.proof(said(side, shown, "", digest)).hex()
    return Hello(side=side, public=shown, echo="", certificate=own.certificate, proof=proof)


def test_only_the_other_sides_certificate_of_the_runs_authority_proves_its_words(certs: Path) -> None:
    ours = identity(Mtls(kind="mtls", folder=str(certs), sign=True), "patient")
    theirs = identity(Mtls(kind="mtls", folder=str(certs), sign=True), "surgeon")
    foreign = identity(Mtls(kind="mtls", folder=str(certs / "other"), sign=True), "surgeon")
    assert ours is not None
    assert theirs is not None
    assert foreign is not None
    content = said("surgeon", theirs.public, "", "d")

    def told(hello: Hello, content: bytes) -> Signer:
        return ours.signer(hello.certificate, hello.proof, content)

    assert told(_hello(theirs, "surgeon"), content) == Signer("surgeon")
    assert "signature" in told(_hello(theirs, "surgeon", digest="e"), content).fault
    assert "signature" in told(_hello(foreign, "surgeon"), said("surgeon", foreign.public, "", "d")).fault
    assert told(_hello(ours, "surgeon"), said("surgeon", ours.public, "", "d")) == Signer("patient")
    assert ours.shared(theirs.public) == theirs.shared(ours.public)
    with pytest.raises(ValueError, match="shared key"):
        ours.shared("00" * 32)


def test_a_certificate_of_an_unknown_version_proves_nothing(certs: Path) -> None:
    """The package cryptography tells it by an error of its own, which ended the thread that agrees on keys."""
    ours = identity(Mtls(kind="mtls", folder=str(certs), sign=True), "patient")
    assert ours is not None
    der = ssl.PEM_cert_to_DER_cert((certs / "surgeon" / "cert.pem").read_text())
    odd = ssl.DER_cert_to_PEM_cert(der.replace(b"\xa0\x03\x02\x01\x02", b"\xa0\x03\x02\x01\x0e", 1))
    assert ours.signer(odd, "00", b"") == Signer("", "its certificate or its signature is not of the run's authority")


def test_a_secret_is_long_and_its_owners(tmp_path: Path) -> None:
    file = tmp_path / "secret"
    security = NoSecurity(kind="none", sign=True, secret_file=str(file))
    file.write_text("short\n")
    with pytest.raises(InputError, match="owner only"):
        identity(security, "surgeon")
    file.chmod(0o600)
    with pytest.raises(InputError, match="at least 16 bytes"):
        identity(security, "surgeon")
    assert identity(NoSecurity(kind="none"), "surgeon") is None


def _await(met: Callable[[], bool]) -> None:
    for _ in range(400):
        if met():
            return
        time.sleep(0.02)
    raise AssertionError


@pytest.mark.live
def test_both_sides_get_the_same_keys_again_after_one_was_started_anew_and_believe_no_repeated_words() -> None:
    endpoint, _ = free_endpoints()
    with ExitStack() as stack:
        stack.enter_context(zenoh.open(configure("router", ZenohOptions(listen=[endpoint]))))
        sessions = {
            name: stack.enter_context(zenoh.open(configure("client", ZenohOptions(connect=[endpoint]))))
            for name in ("surgeon", "patient", "mallory")
        }
        heard: list[bytes] = []
        sessions["mallory"].declare_subscriber(
            hello_key("tis", "surgeon"), lambda s: heard.append(s.payload.to_bytes())
        )

        def agreement(side: SigningSide, secret: bytes = b"x" * 32) -> Agreement:
            return Agreement(sessions[side], "tis", side, "d", SharedSecret(secret), lambda: None)

        patient = stack.enter_context(agreement("patient"))
        with agreement("surgeon", b"y" * 32):
            _await(lambda: "does not know the secret" in patient.fault)
        assert not patient.is_reached
        with agreement("surgeon") as first:
            _await(lambda: patient.is_reached and first.is_reached)
            assert (first.keys.own, *patient.keys.others[:1]) == (patient.keys.others[0], first.keys.own)
            before = patient.keys.own
        with agreement("surgeon") as second:
            _await(lambda: second.is_reached and patient.keys.own != before)
            assert second.keys.others[0] == patient.keys.own
            now = patient.keys.own
            for words in tuple(heard):
                sessions["mallory"].put(hello_key("tis", "surgeon"), words)
            sessions["mallory"].put(hello_key("tis", "surgeon"), b"{}")
            fake = SharedSecret(b"z" * 32)
            sessions["mallory"].put(hello_key("tis", "surgeon"), encode(_hello(fake, "surgeon")))
            _await(lambda: "does not know" in patient.fault)
            assert patient.keys.own == now
    assert set(SIGNERS) == {"surgeon", "patient"}
