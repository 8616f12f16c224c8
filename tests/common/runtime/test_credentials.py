import json
import os
from pathlib import Path

import pytest

from tis.common.errors import InputError
from tis.common.runtime.credentials import config_text, credentials, expiry_warnings, own_client, refuse_plain
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.security import Mtls, NoSecurity, Password
from tis.deploy.tools.certificates import issue, new_authority

TLS = "transport/link/tls"


def _folder(tmp_path: Path, name: str = "surgeon") -> Mtls:
    if not (tmp_path / "certs").exists():
        new_authority(tmp_path / "certs")
    issue(tmp_path / "certs", name)
    return Mtls(kind="mtls", folder=str(tmp_path / "certs"))


def _faults(security: Mtls | Password, name: str) -> list[str]:
    with pytest.raises(InputError) as raised:
        credentials(security, name)
    return [str(fault) for fault in raised.value.faults]


def test_without_security_there_are_no_credentials() -> None:
    assert credentials(NoSecurity(kind="none"), "surgeon") == {}


def test_a_client_shows_its_certificate_and_netem_asks_for_one(tmp_path: Path) -> None:
    for name in ("surgeon", "netem"):
        security = _folder(tmp_path, name)
        tls = credentials(security, name)[TLS]
        assert tls["enable_mtls"] is tls["verify_name_on_connect"] is tls["close_link_on_expiration"] is True
        place = tmp_path / "certs" / name
        # read again at each connection and by each listener, so that a renewed one counts
        assert (tls["connect_private_key"], tls["root_ca_certificate"]) == (
            str(place / "key.pem"), str(place / "ca.pem"),
        )  # fmt: skip
        assert tls.get("listen_certificate") == (str(place / "cert.pem") if name == "netem" else None)
        assert not [one for one in tls if one.endswith("base64")]


def test_a_client_of_ones_own_router_need_not_know_its_name(tmp_path: Path) -> None:
    settings = credentials(_folder(tmp_path), "surgeon")
    assert own_client(settings)[TLS]["verify_name_on_connect"] is False
    assert settings[TLS]["verify_name_on_connect"] is True
    assert own_client({}) == {}


def test_all_missing_files_are_named_at_once_with_the_command_that_makes_them(tmp_path: Path) -> None:
    faults = _faults(Mtls(kind="mtls", folder=str(tmp_path)), "patient")
    assert [fault.split(": ")[0].rpartition("/")[2] for fault in faults] == ["ca.pem", "cert.pem", "key.pem"]
    assert all("No such file or directory; `tis certs` makes it" in fault for fault in faults)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660])
def test_a_key_that_others_can_read_is_refused(tmp_path: Path, mode: int) -> None:
    security = _folder(tmp_path)
    key = tmp_path / "certs" / "surgeon" / "key.pem"
    key.chmod(mode)
    assert _faults(security, "surgeon") == [f"{key}: must be readable by its owner only: chmod 600 {key}"]


@pytest.mark.parametrize(
    ("file", "rule"),
    [
        ("ca.pem", "is no certificate"),
        ("cert.pem", "is no certificate, or key.pem is not its key"),
        ("key.pem", "is no certificate, or key.pem is not its key"),
    ],
)
def test_what_is_no_certificate_or_another_ones_key_is_named(tmp_path: Path, file: str, rule: str) -> None:
    security = _folder(tmp_path)
    (tmp_path / "certs" / "surgeon" / file).write_text("hi")
    [fault] = _faults(security, "surgeon")
    assert fault.endswith(f"surgeon/{'ca.pem' if file == 'ca.pem' else 'cert.pem'}: {rule}")


def test_the_key_of_another_name_is_named(tmp_path: Path) -> None:
    security = _folder(tmp_path)
    _folder(tmp_path, "patient")
    keys = [tmp_path / "certs" / name / "key.pem" for name in ("surgeon", "patient")]
    keys[0].write_bytes(keys[1].read_bytes())
    assert "key.pem is not its key" in _faults(security, "surgeon")[0]


def test_what_is_no_file_does_not_hold_a_side_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "passwords.txt", 0o600)
    [fault] = _faults(Password(kind="password", file=str(tmp_path / "passwords.txt")), "surgeon")
    assert fault == f"{tmp_path / 'passwords.txt'}: must be a file"


def _passwords(tmp_path: Path, text: str) -> Password:
    file = tmp_path / "passwords.txt"
    file.write_text(text)
    file.chmod(0o600)
    return Password(kind="password", file=str(file))


def test_netem_knows_all_users_and_a_side_itself(tmp_path: Path) -> None:
    security = _passwords(tmp_path, "surgeon:a:b\nnetem:c\n\n")
    assert credentials(security, "surgeon") == {"transport/auth/usrpwd": {"user": "surgeon", "password": "a:b"}}
    assert credentials(security, "netem")["transport/auth/usrpwd"]["dictionary_file"] == security.file


def test_damaged_lines_are_named_without_their_content(tmp_path: Path) -> None:
    security = _passwords(tmp_path, "surgeon:secret\nnetem\n:secret\npatient: \n surgeon:a\nsurgeon:b\n")
    faults = _faults(security, "surgeon")
    assert [fault.split(": ")[1] for fault in faults] == ["line 2", "line 3", "line 4", "line 5", "line 6"]
    assert "secret" not in "".join(faults)
    assert _faults(_passwords(tmp_path, "surgeon:secret\n"), "netem") == [
        f"{tmp_path / 'passwords.txt'}: netem: must have a line NAME:PASSWORD"
    ]


def test_a_file_without_end_is_refused(tmp_path: Path) -> None:
    assert "must have at most 100000 bytes" in _faults(_passwords(tmp_path, "a:b\n" * 30_000), "a")[0]


def test_certificates_need_encrypted_endpoints(tmp_path: Path) -> None:
    security = Mtls(kind="mtls", folder=str(tmp_path))
    refuse_plain("netem", "--listen", security, ("tls/10.0.0.1:1", "quic/10.0.0.1:2"))
    refuse_plain("netem", "--listen", NoSecurity(kind="none"), ("tcp/127.0.0.1:1",))
    with pytest.raises(InputError, match="netem: --listen: must be an endpoint like tls/"):
        refuse_plain("netem", "--listen", security, ("tls/10.0.0.1:1", "tcp/10.0.0.1:2"))


def test_settings_become_a_file_that_zenoh_reads(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(config_text(credentials(_passwords(tmp_path, "surgeon:secret\n"), "surgeon")))
    config = configure("client", ZenohOptions(config=file))
    assert json.loads(config.get_json("transport/auth/usrpwd/user")) == "surgeon"
    assert json.loads(config_text({"a/b": 1, "a/c": {"d": 2}})) == {"a": {"b": 1, "c": {"d": 2}}}


def test_credentials_stand_in_no_text_of_the_options(tmp_path: Path) -> None:
    options = ZenohOptions(credentials=credentials(_passwords(tmp_path, "surgeon:secret\n"), "surgeon"))
    assert "secret" not in f"{options} {options!r}"


def test_a_certificate_is_warned_of_a_week_before_its_end(tmp_path: Path) -> None:
    from tis.deploy.tools.certificates import issue, new_authority

    new_authority(tmp_path)
    security = Mtls(kind="mtls", folder=str(tmp_path))
    issue(tmp_path, "surgeon", days=8)
    assert expiry_warnings(security, "surgeon") == []
    issue(tmp_path, "surgeon", days=3)
    (text,) = expiry_warnings(security, "surgeon")
    assert text.startswith("the certificate of surgeon expires in 3.0 days")
    assert expiry_warnings(security, "netem") == []
    assert expiry_warnings(NoSecurity(kind="none"), "surgeon") == []
