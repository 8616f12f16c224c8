"""Runs under attack: who is let in, who may say what, and that the run goes on as if nothing had happened."""

from datetime import timedelta
from pathlib import Path

import pytest
import zenoh

from tests.deploy.commands import call, call_in_one_line
from tests.system.conftest import HOLD, RunHere, Start, StartHere, Tis, is_right_but_for_the_machine
from tests.system.intruders import a_client, cause_an_outage, lie, of_another_run, speak_for_the_patient
from tis.common.audit import AUDIT_FILE, verify
from tis.common.runtime.credentials import credentials, tls_settings
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.security import Password
from tis.deploy.tools import certificates
from tis.deploy.tools.certificates import issue, new_authority

pytestmark = pytest.mark.live
_DURATION_S = "12"


def _words(endpoints: tuple[str, str], *settings: str) -> list[str]:
    west, east = endpoints
    words = [word for setting in settings for word in ("--set", setting)]
    hosts = f"hosts={{west: {west}, east: {east}}}"
    return ["run", "default", "--duration-s", _DURATION_S, *HOLD, "--set", hosts, *words]


def _refused(tis: Tis | RunHere) -> dict[str, int]:
    """Return the refusals of a run that came to its end, whole and undisturbed."""
    code, _, err = tis.wait()
    assert code in (0, 5), err
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert summary["links"]["forward"]["unplanned_loss"] == 0
    assert summary["links"]["forward"]["not_sent"] == summary["links"]["feedback"]["not_sent"] == 0
    return {kind: n for kind, n in summary["refused"].items() if n}


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of certificates, with those of an expired side and of another authority beside."""
    folder = tmp_path_factory.mktemp("certs")
    new_authority(folder)
    for name in ("surgeon", "netem", "patient", "operator", "watcher", "mallory"):
        issue(folder, name)
    new_authority(folder / "other")  # its name is the same
    issue(folder / "other", "surgeon")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(certificates, "_TOLERANCE", timedelta(days=3))
        issue(folder, "late", days=-1)
    return folder


def test_certificates_keep_strangers_out_and_let_nobody_say_more_than_is_theirs(
    start: Start, endpoints: tuple[str, str], certs: Path
) -> None:
    west, east = (endpoint.replace("tcp/", "tls/") for endpoint in endpoints)
    security = f"security={{kind: mtls, folder: {certs}, control: [operator], observers: [watcher]}}"
    tis = start(*_words((west, east), security))
    tis.await_log("surgeon", 10_000)
    mine = tls_settings(certs / "surgeon", listens=False)

    # Who is not let in.
    nobody = {"transport/link/tls": {"root_ca_certificate": str(certs / "ca" / "ca.pem")}}
    of_another = tls_settings(certs / "other" / "surgeon", listens=False)
    stranger = {
        "transport/link/tls": {
            **mine["transport/link/tls"],
            **{name: value for name, value in of_another["transport/link/tls"].items() if name.startswith("connect")},
        }
    }
    for keys in (nobody, stranger, tls_settings(certs / "late", listens=False), of_another):
        with a_client(west, keys) as session:
            assert session is None
    with a_client(west.replace("tls/", "tcp/")) as session:
        assert session is None

    # Who is let in, but may say nothing, or only what is theirs.
    for name, endpoint in (("mallory", west), ("surgeon", east), ("watcher", west), ("surgeon", west)):
        with a_client(endpoint, tls_settings(certs / name, listens=False)) as session:
            assert session is not None
            lie(session)
            speak_for_the_patient(session)
            assert cause_an_outage(session) == []
    for name, shown, changed in (("watcher", 0, 3), ("operator", 0, 0)):
        client = ("-e", west, "-c", str(certs / name / "zenoh.json5"))
        assert call("net", "show", *client)[0] == shown
        code, _, err = call("net", "reset", *client)
        assert code == changed
        assert ("this client may not ask that" in err) == (name == "watcher")

    refused = _refused(tis)
    code, out, err = call("audit", "verify", str(tis.run_dir))
    assert (code, out[:6]) == (0, "whole:"), err
    entries = verify((tis.run_dir / AUDIT_FILE).read_bytes().splitlines(keepends=True)).entries
    named = {(one.what, one.address.rpartition(":")[0], one.name) for one in entries if one.event == "refused"}
    for kind in ("no_certificate", "foreign_authority", "expired", "no_tls", "false_netem"):
        assert (kind, "127.0.0.1", "") in named
    assert ("unknown_name", "127.0.0.1", "mallory") in named
    assert {one.name for one in entries if one.event == "connected"} >= {"surgeon", "patient", "mallory", "operator"}
    assert [one.key for one in entries if one.event == "network"] == ["tis/netem/control/reset"]
    expected = {
        "no_certificate", "foreign_authority", "expired", "no_tls", "false_netem", "unknown_name", "not_permitted",
    }  # fmt: skip
    assert refused.keys() == expected
    assert refused["unknown_name"] == 2
    assert refused["not_permitted"] >= 4 * 5


@pytest.mark.slow
def test_passwords_keep_strangers_out_and_let_nobody_say_more_than_is_theirs(
    run_here: StartHere, endpoints: tuple[str, str], tmp_path: Path
) -> None:
    west, east = endpoints
    file = tmp_path / "passwords.txt"
    file.write_text("".join(f"{name}:{name}-secret\n" for name in ("surgeon", "netem", "patient", "mallory")))
    file.chmod(0o600)
    security = Password(kind="password", file=str(file))

    def intrude(run: RunHere) -> None:
        run.await_log("surgeon", 10_000)
        wrong = {"transport/auth/usrpwd": {"user": "surgeon", "password": "guessed"}}
        for keys in (None, wrong):
            with a_client(west, keys) as session:
                assert session is None
        for name, endpoint in (("mallory", west), ("surgeon", east), ("patient", east)):
            with a_client(endpoint, credentials(security, name)) as session:
                assert session is not None
                lie(session)
                if name != "patient":
                    speak_for_the_patient(session)
                assert cause_an_outage(session) == []

    tis = run_here(*_words(endpoints, f"security={{kind: password, file: {file}}}"), meanwhile=intrude)
    secrets = [f"{name}-secret" for name in ("surgeon", "netem", "patient")]
    refused = _refused(tis)
    assert refused.keys() == {"no_password", "wrong_password", "unknown_name", "not_permitted"}
    assert refused["unknown_name"] == 2
    for written in tis.run_dir.iterdir():
        content = written.read_bytes()
        assert not [secret for secret in secrets if secret.encode() in content], written.name


@pytest.mark.slow
def test_without_security_nobody_but_netem_says_what_is_netems(
    run_here: StartHere, endpoints: tuple[str, str]
) -> None:
    def intrude(run: RunHere) -> None:
        run.await_log("surgeon", 10_000)
        for endpoint in endpoints:
            with a_client(endpoint) as session:
                assert session is not None
                lie(session)
        with a_client(endpoints[0]) as session:
            assert session is not None
            of_another_run(session)

    refused = _refused(run_here(*_words(endpoints), meanwhile=intrude))
    assert refused.keys() == {"not_permitted", "other_run"}
    assert refused["not_permitted"] >= 2 * 4
    assert refused["other_run"] == 1


@pytest.mark.parametrize(
    ("proof", "address", "reason"),
    [
        ("other/netem", "127.0.0.1", "its certificate is of another authority"),
        ("surgeon", "127.0.0.1", "its certificate is not netem's"),
        ("netem", "127.0.0.2", "its certificate is not for this address; tis certs issue netem --host ADDRESS"),
    ],
)
def test_a_side_says_why_it_cannot_connect(
    endpoints: tuple[str, str], certs: Path, tmp_path: Path, proof: str, address: str, reason: str
) -> None:
    """Zenoh itself does not tell a false netem from a silent one."""
    issue(certs / "other", "netem")
    west = endpoints[0].replace("tcp/127.0.0.1", f"tls/{address}")
    false = ZenohOptions(listen=[west], credentials=tls_settings(certs / proof, listens=True))
    scenario = tmp_path / "s.yaml"
    security = f"security: {{kind: mtls, folder: {certs}}}"
    scenario.write_text(f"version: 1\nname: s\nsource: {{kind: synthetic}}\n{security}\n")
    with zenoh.open(configure("router", false)):
        words = (str(scenario), "-e", west, "--wait-s", "1", "--run-dir", str(tmp_path))
        code, _, err = call_in_one_line("surgeon", *words)
    assert code == 3
    assert f"netem at {west} did not answer within 1.0 s: {reason}" in err


def test_a_patient_with_another_scenario_is_told_the_field_and_so_are_the_others(
    start: Start, endpoints: tuple[str, str], certs: Path, tmp_path: Path
) -> None:
    west, east = (endpoint.replace("tcp/", "tls/") for endpoint in endpoints)
    text = (
        f"version: 1\nname: a\nsource: {{kind: synthetic}}\nhosts: {{west: {west}, east: {east}}}\n"
        f"security: {{kind: mtls, folder: {certs}}}\nestimators: [hold]\nactive_estimator: hold\n"
    )
    (tmp_path / "one.yaml").write_text(text)
    (tmp_path / "two.yaml").write_text(text + "rate_hz: 50\n")
    ends = {"surgeon": start("surgeon", str(tmp_path / "one.yaml"), run_dir="s")}
    ends["netem"] = start("netem", str(tmp_path / "one.yaml"), run_dir="n")
    ends["patient"] = start("patient", str(tmp_path / "two.yaml"), run_dir="p")
    said = {side: tis.wait() for side, tis in ends.items()}
    assert {side: code for side, (code, _, _) in said.items()} == dict.fromkeys(ends, 3), said
    assert "netem: scenario: must be the one that patient runs: rate_hz is 30 there, 50 here" in said["patient"][2]
    rule = "patient: scenario: must be the one that netem runs: rate_hz is 50 there, 30 here"
    assert rule in said["netem"][2]
    assert f"the run was ended before it began: {rule}" in said["surgeon"][2]
