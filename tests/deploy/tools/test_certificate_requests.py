"""Certificates of another authority, made here with OpenSSL as a hospital would."""

import shutil
import stat
import subprocess
from pathlib import Path

import pytest

from tests.deploy.commands import call, call_in_one_line
from tis.common.errors import DataError, InputError
from tis.deploy.tools.certificate_requests import accept, request
from tis.deploy.tools.certificates import certificates, issue, new_authority, revoke

OPENSSL = shutil.which("openssl")
pytestmark = pytest.mark.skipif(OPENSSL is None, reason="no openssl command here")


def _openssl(*words: str | Path) -> None:
    assert OPENSSL is not None
    subprocess.run([OPENSSL, *map(str, words)], check=True, capture_output=True)


@pytest.fixture
def hospital(tmp_path: Path) -> Path:
    """Return the folder of an authority of RSA keys, made by OpenSSL."""
    place = tmp_path / "hospital"
    place.mkdir()
    _openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "30", "-subj", "/CN=hospital", "-addext",
             "keyUsage=critical,keyCertSign", "-keyout", place / "key.pem", "-out", place / "ca.pem")  # fmt: skip
    return place


def _signed(hospital: Path, asked: Path) -> bytes:
    out = hospital / "out.pem"
    _openssl("x509", "-req", "-in", asked, "-CA", hospital / "ca.pem", "-CAkey", hospital / "key.pem",
             "-CAcreateserial", "-days", "9", "-copy_extensions", "copy", "-out", out)  # fmt: skip
    return out.read_bytes()


def test_a_hospitals_authority_signs_a_request_and_the_certificate_in_use_stays_until_then(
    tmp_path: Path, hospital: Path
) -> None:
    folder = tmp_path / "certs"
    scenario = tmp_path / "s.yaml"
    security = "security: {kind: mtls, control: [operator]}\nhosts: {west: tls/127.0.0.1:1, east: tls/127.0.0.1:2}"
    scenario.write_text(f"version: 1\nname: s\nsource: {{kind: synthetic}}\n{security}\n")
    where = ("--folder", str(folder))
    code, out, err = call("certs", "request", str(scenario), "--host", "10.1.2.3", *where)
    assert (code, len(out.split())) == (0, 4), err
    requests = {name: folder / "requests" / name / "request.pem" for name in ("surgeon", "netem", "operator")}
    assert stat.S_IMODE((folder / "requests" / "surgeon" / "key.pem").stat().st_mode) == 0o600
    for name, asked in requests.items():
        (hospital / f"{name}.pem").write_bytes(_signed(hospital, asked))
        words = ("certs", "accept", name, "--certificate", str(hospital / f"{name}.pem"))
        code, out, err = call(*words, "--ca", str(hospital / "ca.pem"), *where)
        assert code == 0, err
        assert not asked.exists()
    assert [(one.name, one.fault) for one in certificates(folder)] == [
        ("netem", None), ("operator", None), ("surgeon", None),
    ]  # fmt: skip
    assert "10.1.2.3" in certificates(folder)[0].hosts
    used = (folder / "surgeon" / "cert.pem").read_bytes()
    request(folder, "surgeon")
    assert (folder / "surgeon" / "cert.pem").read_bytes() == used
    code, _, err = call_in_one_line("certs", "request", str(scenario), "--only", "mallory", *where)
    rule = "--only: must be a name of the scenario: surgeon, netem, patient, operator"
    assert (code, rule in err) == (2, True), err


def test_what_cannot_be_used_is_told_with_every_reason(tmp_path: Path, hospital: Path) -> None:
    folder, ca = tmp_path / "certs", (hospital / "ca.pem").read_bytes()
    signed = _signed(hospital, request(folder, "surgeon"))
    new_authority(tmp_path / "other")
    other = (tmp_path / "other" / "ca" / "ca.pem").read_bytes()
    request(folder, "netem")
    with pytest.raises(InputError) as found:
        accept(folder, "netem", signed, other)
    assert [fault.rule for fault in found.value.faults] == [
        "is of another name: surgeon",
        "must be issued by a certificate of --ca directly",
        "must be of the key of this request",
        "must be for servers and clients (extended key usage)",
    ]
    with pytest.raises(InputError, match="--ca: must be certificates in PEM"):
        accept(folder, "surgeon", signed, b"none")
    with pytest.raises(DataError, match="holds no request"):
        accept(folder, "patient", signed, ca)
    assert accept(folder, "surgeon", signed, other + ca).name == "surgeon"  # one of several authorities


def test_an_encrypted_key_of_the_authority_needs_its_password(tmp_path: Path) -> None:
    folder, password = tmp_path / "certs", tmp_path / "password"
    password.touch(mode=0o600)
    password.write_text("open sesame\n")
    where = ("--folder", str(folder))
    assert call("certs", "init", "--password-file", str(password), *where)[0] == 0
    assert b"ENCRYPTED" in (folder / "ca" / "key.pem").read_bytes()
    assert b"ENCRYPTED" not in (folder / "surgeon" / "key.pem").read_bytes()
    code, _, err = call_in_one_line("certs", "issue", "operator", *where)
    assert (code, "is encrypted: give the file of its password (--password-file)" in err) == (2, True), err
    assert call("certs", "issue", "operator", "--password-file", str(password), *where)[0] == 0
    with pytest.raises(DataError, match="has another password"):
        issue(folder, "operator", password=b"guessed")
    password.write_text("\n")
    assert call("certs", "issue", "operator", "--password-file", str(password), *where)[0] == 2


def test_a_revoked_name_is_written_once_and_shown_by_show_and_validate(tmp_path: Path) -> None:
    folder = tmp_path / "certs"
    new_authority(folder)
    issue(folder, "surgeon", days=3)
    code, out, err = call("certs", "revoke", "surgeon", "--folder", str(folder))
    assert (code, "surgeon " in out) == (0, True), err
    revoke(folder, "surgeon")
    revoke(folder, "gone")
    lines = (folder / "revoked.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines] == ["surgeon", "gone"]
    assert certificates(folder)[0].fault == "is revoked"
    scenario = tmp_path / "s.yaml"
    security = f"security: {{kind: mtls, folder: {folder}}}\nhosts: {{west: tls/127.0.0.1:1, east: tls/127.0.0.1:2}}"
    scenario.write_text(f"version: 1\nname: s\nsource: {{kind: synthetic}}\n{security}\n")
    code, _, err = call_in_one_line("validate", str(scenario))
    assert code == 0
    assert "the certificate of surgeon expires in 3.0 days" in err
    assert "the certificate of surgeon is revoked (revoked.txt)" in err


def test_a_revoked_name_gets_no_certificate_before_its_lines_are_gone_or_the_authority_is_new(
    tmp_path: Path, hospital: Path
) -> None:
    folder, ca = tmp_path / "certs", (hospital / "ca.pem").read_bytes()
    new_authority(folder)
    issue(folder, "operator")
    signed = _signed(hospital, request(folder, "operator"))
    revoke(folder, "operator")
    revoke(folder, "surgeon")
    for action in (
        lambda: issue(folder, "operator"), lambda: request(folder, "operator"),
        lambda: accept(folder, "operator", signed, ca), lambda: issue(folder, "surgeon"),
    ):  # fmt: skip
        with pytest.raises(InputError, match="is revoked, and netem tells certificates apart by name only"):
            action()
    (folder / "revoked.txt").write_text("surgeon\noperator 1f\n")
    assert certificates(folder)[0].fault == "is revoked", "netem refuses the name, whatever its number"
    (folder / "revoked.txt").write_text("surgeon\n")
    assert issue(folder, "operator").fault is None
    shutil.rmtree(folder / "ca")
    new_authority(folder)
    issue(folder, "surgeon")
    assert certificates(folder)[1].fault is None
