"""Certificates against OpenSSL's own verification of chains, purposes and names."""

import json
import shutil
import stat
import subprocess
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from tests.deploy.commands import call
from tis.common.errors import InputError
from tis.common.extras import GET_HOSTS
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.deploy.shell import guard
from tis.deploy.tools import certificates as module
from tis.deploy.tools.certificates import certificates, issue, new_authority

OPENSSL = shutil.which("openssl")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    new_authority(tmp_path / "certs")
    return tmp_path / "certs"


def _verifies(folder: Path, name: str, *words: str) -> bool:
    if OPENSSL is None:
        pytest.skip("no openssl command here")
    command = [OPENSSL, "verify", "-x509_strict", "-CAfile", str(folder / "ca" / "ca.pem"), *words]
    return (
        subprocess.run([*command, str(folder / name / "cert.pem")], capture_output=True, check=False).returncode == 0
    )


def test_a_side_is_a_client_and_netem_a_server_at_its_addresses(folder: Path) -> None:
    issue(folder, "surgeon")
    issue(folder, "netem", ("10.1.2.3", "netem.lab"))
    assert _verifies(folder, "surgeon", "-purpose", "sslclient")
    assert not _verifies(folder, "surgeon", "-purpose", "sslserver")
    for address in ("10.1.2.3", "127.0.0.1", "::1"):
        assert _verifies(folder, "netem", "-purpose", "sslserver", "-verify_ip", address)
    assert _verifies(folder, "netem", "-purpose", "sslserver", "-verify_hostname", "netem.lab")
    assert not _verifies(folder, "netem", "-verify_ip", "10.1.2.4")


def test_another_authority_of_the_same_name_does_not_verify_it(folder: Path, tmp_path: Path) -> None:
    issue(folder, "surgeon")
    new_authority(tmp_path / "other")
    shutil.copytree(folder / "surgeon", tmp_path / "other" / "surgeon")
    assert _verifies(folder, "surgeon")
    assert not _verifies(tmp_path / "other", "surgeon")
    [found] = certificates(tmp_path / "other")
    assert found.fault == "is of another authority"


def test_it_is_valid_now_and_for_as_long_as_asked(folder: Path) -> None:
    issued = issue(folder, "surgeon", days=7)
    left = issued.days_left(datetime.now(UTC))
    assert left is not None
    assert 6.99 < left <= 7.0
    soon, later = (str(int((datetime.now(UTC) + timedelta(days=days)).timestamp())) for days in (6.9, 7.1))
    assert _verifies(folder, "surgeon", "-attime", soon)
    assert not _verifies(folder, "surgeon", "-attime", later)


def test_only_its_owner_reads_what_is_written(folder: Path) -> None:
    issue(folder, "surgeon")
    written = [folder / "ca", folder / "surgeon", *(folder / "ca").iterdir(), *(folder / "surgeon").iterdir()]
    assert {stat.S_IMODE(each.stat().st_mode) for each in written} == {0o700, 0o600}
    assert {file.name for file in (folder / "surgeon").iterdir()} == {"ca.pem", "cert.pem", "key.pem", "zenoh.json5"}


def test_zenoh_reads_the_file_for_further_clients(folder: Path) -> None:
    issue(folder, "operator")
    config = configure("client", ZenohOptions(config=folder / "operator" / "zenoh.json5"))
    assert config.get_json("transport/link/tls/enable_mtls") == "true"


def test_renewing_replaces_key_and_certificate_and_leaves_nothing_behind(folder: Path) -> None:
    issue(folder, "surgeon")
    before = {file.name: file.read_bytes() for file in (folder / "surgeon").iterdir()}
    issue(folder, "surgeon")
    after = {file.name: file.read_bytes() for file in (folder / "surgeon").iterdir()}
    assert before["ca.pem"] == after["ca.pem"]
    assert not [name for name in ("cert.pem", "key.pem") if before[name] == after[name]]
    assert {each.name for each in folder.iterdir()} == {"ca", "surgeon"}


def test_renewing_netem_keeps_its_addresses(folder: Path) -> None:
    issue(folder, "netem", ("10.1.2.3",))
    assert "10.1.2.3" in issue(folder, "netem").hosts
    assert "10.1.2.3" not in issue(folder, "netem", ("10.4.5.6",)).hosts


def test_calls_at_once_leave_one_whole_folder(folder: Path) -> None:
    with ThreadPoolExecutor(6) as pool:
        for done in [pool.submit(issue, folder, "surgeon") for _ in range(6)]:
            done.exception()  # a name may be in use by another call
    assert {each.name for each in folder.iterdir()} == {"ca", "surgeon"}
    assert [each.fault for each in certificates(folder)] == [None]


@pytest.mark.parametrize(
    ("name", "hosts", "days", "rule"),
    [
        ("../surgeon", (), 30, "NAME: must be a name of up to 64 letters"),
        ("", (), 30, "NAME: must be a name"),
        ("ca", (), 30, "NAME: must not be ca"),
        ("surgeon", ("10.0.0.1",), 30, "--host: is for netem only"),
        ("netem", ("nämlich",), 30, "--host: must be an IP address or a host's name"),
        ("netem", ("",), 30, "--host: must be"),
        ("netem", ("10.0.0.1:7447",), 30, "--host: must be"),
        ("netem", ("tls/10.0.0.1",), 30, "--host: must be"),
        ("netem", ("10.0.0.0/24",), 30, "--host: must be"),
        ("netem", ("a..b",), 30, "--host: must be"),
        ("surgeon", (), 400, "--days: must be at most 36"),
    ],
)
def test_what_cannot_be_issued_is_one_line(
    folder: Path, name: str, hosts: tuple[str, ...], days: int, rule: str
) -> None:
    with pytest.raises(InputError, match=f"tis certs: {rule}"):
        issue(folder, name, hosts, days)
    assert {each.name for each in folder.iterdir()} == {"ca"}


def test_an_authority_is_not_replaced(folder: Path) -> None:
    with pytest.raises(InputError, match="exists already"):
        new_authority(folder)


def test_the_commands_make_what_a_run_needs_and_show_what_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = ("--folder", str(tmp_path / "certs"))
    code, out, err = call("certs", "init", *where)
    assert code == 0
    assert all(name in out for name in ("surgeon", "netem", "patient", "valid until"))
    assert "netem's certificate is for loopback only" in err
    code, out, _ = call("certs", "show", "--json", *where)
    assert code == 0
    assert [(each["name"], each["fault"]) for each in json.loads(out)] == [
        ("netem", None), ("patient", None), ("surgeon", None),
    ]  # fmt: skip
    # What goes wrong with time, and with copying.
    with monkeypatch.context() as patched:
        patched.setattr(module, "_TOLERANCE", timedelta(days=3))
        issue(tmp_path / "certs", "surgeon", days=-1)
    for file in ("cert.pem", "key.pem"):
        shutil.copy(tmp_path / "certs" / "netem" / file, tmp_path / "certs" / "patient" / file)
    (tmp_path / "certs" / "netem" / "key.pem").chmod(0o644)
    code, out, _ = call("certs", "show", "--json", *where)
    assert code == 4
    faults = {each["name"]: each["fault"] for each in json.loads(out)}
    assert faults["surgeon"] == "has expired: `tis certs issue` renews it"
    assert faults["patient"] == "is of another name: netem"
    assert faults["netem"].startswith("must be readable by its owner only")
    assert call("certs", "init", "--folder", str(tmp_path / "new"), "--host", "a b")[0] == 2
    assert not (tmp_path / "new").exists(), "nothing half done"
    (tmp_path / "certs" / "netem" / "cert.pem").write_text("junk")
    _, out, _ = call("certs", "show", "--json", *where)
    assert {each["name"]: each["fault"] for each in json.loads(out)}["netem"] == "is no certificate"


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "find_spec", lambda _: None)
    code, _, err = call("certs", "show")
    assert code == 2
    assert err.strip() == f"tis: tis certs: needs the package cryptography: {GET_HOSTS}"
