"""TLS links that are renewed, and refused for another name than netem's, over loopback.

In a whole run on three hosts: tests/system/test_living_certificates.
"""

import queue
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime import tls_links
from tis.common.runtime.credentials import credentials, tls_settings
from tis.common.runtime.emulator_client import EmulatorAddress, connected
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.signing import client_identity
from tis.common.runtime.tls_links import CertificateWatch, CertifiedLink, false_names
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.security import Mtls
from tis.deploy.tools import certificates
from tis.deploy.tools.certificates import asked_for, issue, new_authority
from tis.netem.bridge.revocation import Revocations


def _await(met: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 30
    while not met():
        assert time.monotonic() < until_s
        time.sleep(0.02)


@pytest.mark.live
def test_a_client_uses_a_renewed_certificate_on_the_same_session_and_no_broken_one(tmp_path: Path) -> None:
    endpoint = free_endpoints()[0].replace("tcp/", "tls/")
    new_authority(tmp_path)
    for name in ("netem", "surgeon"):
        issue(tmp_path, name)
    security, told = Mtls(kind="mtls", folder=str(tmp_path)), queue.Queue[str]()
    router = configure("router", ZenohOptions(listen=[endpoint], credentials=credentials(security, "netem")))
    client = configure("client", ZenohOptions(connect=[endpoint], credentials=credentials(security, "surgeon")))
    heard: list[bytes] = []
    with zenoh.open(router) as netem, zenoh.open(client) as surgeon:
        assert false_names(surgeon) == []
        surgeon.declare_subscriber("a/b", lambda sample: heard.append(sample.payload.to_bytes()))
        with CertifiedLink(surgeon, tmp_path / "surgeon", None, told.put):
            before = {link.dst for link in netem.info.links()}
            (tmp_path / "surgeon" / "cert.pem").write_bytes(b"half a file")
            assert told.get(timeout=30).startswith("the renewed certificate is not used: ")
            assert {link.dst for link in netem.info.links()} == before
            issue(tmp_path, "surgeon")
            assert told.get(timeout=30).startswith("the certificate was renewed: the connection to netem was open")
            _await(lambda: not before & {link.dst for link in netem.info.links()})

            def hears() -> bool:
                netem.put("a/b", b"again")
                return b"again" in heard

            _await(hears)


@pytest.mark.live
def test_a_router_of_another_name_is_not_netem_whichever_authority_made_its_certificate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint = free_endpoints()[0].replace("tcp/", "tls/")
    new_authority(tmp_path)
    issue(tmp_path, "surgeon")
    purposes = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    names = x509.SubjectAlternativeName([certificates._general_name("127.0.0.1")])
    monkeypatch.setattr(certificates, "asked_for", lambda *_: (purposes, names))
    issue(tmp_path, "web")
    router = ZenohOptions(listen=[endpoint], credentials=tls_settings(tmp_path / "web", listens=True))
    proof = tls_settings(tmp_path / "surgeon", listens=False)
    with (
        zenoh.open(configure("router", router)),
        zenoh.open(configure("client", ZenohOptions(connect=[endpoint], credentials=proof))) as surgeon,
    ):
        assert false_names(surgeon) == ["web"]
        address = EmulatorAddress(endpoint, options=ZenohOptions(credentials=proof))
        with pytest.raises(PeerError, match=r"certificate is of web, must be netem's"), connected(address):
            pass


@pytest.mark.live
def test_a_client_that_comes_back_does_not_stay_with_a_router_of_another_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint = free_endpoints()[0].replace("tcp/", "tls/")
    new_authority(tmp_path)
    for name in ("netem", "operator"):
        issue(tmp_path, name)
    monkeypatch.setattr(certificates, "asked_for", lambda folder, _, hosts: asked_for(folder, "netem", hosts))
    issue(tmp_path, "web")
    config = {
        name: configure(
            "router", ZenohOptions(listen=[endpoint], credentials=tls_settings(tmp_path / name, listens=True))
        )
        for name in ("netem", "web")
    }
    address = EmulatorAddress(endpoint, options=ZenohOptions(config=tmp_path / "operator" / "zenoh.json5"))
    netem = zenoh.open(config["netem"])
    with connected(address) as remote:
        netem.close()  # type: ignore[no-untyped-call]
        heard: list[object] = []
        with zenoh.open(config["web"]) as web:
            web.declare_subscriber("a", heard.append)
            for _ in range(60):
                remote.session.put("a", b"secret")
                time.sleep(0.05)
        # the client tries again and again, and each link lives until it is seen: uncut, it hears nearly all
        assert len(heard) < 30


@pytest.mark.live
def test_a_client_that_is_refused_does_not_hear_that_there_is_no_emulator(tmp_path: Path) -> None:
    endpoint = free_endpoints()[0].replace("tcp/", "tls/")
    new_authority(tmp_path)
    for name in ("netem", "operator"):
        issue(tmp_path, name)
    (tmp_path / "revoked.txt").write_text("operator\n")
    options = ZenohOptions(listen=[endpoint], credentials=tls_settings(tmp_path / "netem", listens=True))
    address = EmulatorAddress(endpoint, options=ZenohOptions(config=tmp_path / "operator" / "zenoh.json5"))
    told: list[str] = []
    with zenoh.open(configure("router", options)) as netem, ExitStack() as stack:
        Revocations([tmp_path], None, told.append).watch(stack, {"west": netem})
        with pytest.raises(PeerError, match="netem refuses this client"), connected(address) as remote:
            remote.state()
    assert "refused a client whose certificate is revoked" in told[0]


def test_a_client_signs_with_the_certificate_that_its_settings_hold_or_name(tmp_path: Path) -> None:
    new_authority(tmp_path)
    issue(tmp_path, "surgeon")
    for settings in (tls_settings(tmp_path / "surgeon", listens=False, rereads=one) for one in (False, True)):
        own = client_identity(configure("client", ZenohOptions(credentials=settings)), None)
        assert own is not None
        assert own.certificate == (tmp_path / "surgeon" / "cert.pem").read_text()
    assert client_identity(configure("client", ZenohOptions()), None) is None


def test_a_certificate_that_is_not_usable_yet_is_told_once_and_taken_when_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the certificate is written before its key."""
    monkeypatch.setattr(tls_links, "_EVERY_S", 0.001)
    tries, told, taken = 0, list[str](), queue.Queue[bytes]()

    def renew(content: bytes) -> None:
        nonlocal tries
        tries += 1
        if tries < 5:
            raise InputError(Fault("key.pem", "", "does not fit"))
        taken.put(content)

    (tmp_path / "cert.pem").write_bytes(b"old")
    watch = CertificateWatch(tmp_path, renew, told.append)
    (tmp_path / "cert.pem").write_bytes(b"new")
    assert taken.get(timeout=20) == b"new"
    watch.close()
    assert told == ["the renewed certificate is not used: key.pem: does not fit"]
