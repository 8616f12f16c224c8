"""A netem without a scenario whose clients need certificates."""

import json
import shutil
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
import zenoh

from tests.common.runtime.live_zenoh import soon
from tests.system.conftest import Start, Tis
from tests.system.intruders import a_client, cause_an_outage
from tis.common.audit import AUDIT_FILE, AuditEntry, verify
from tis.common.runtime.credentials import tls_settings
from tis.deploy.tools.certificates import issue, new_authority, revoke

pytestmark = pytest.mark.live


@pytest.fixture
def certs(tmp_path: Path) -> Path:
    folder = tmp_path / "certs"
    new_authority(folder)
    for name in ("netem", "operator", "watcher"):
        issue(folder, name, ("127.0.0.1",) if name == "netem" else ())
    return folder


def _audited(tis: Tis) -> Sequence[AuditEntry]:
    file = tis.run_dir / AUDIT_FILE
    return verify(file.read_bytes().splitlines(keepends=True)).entries if file.exists() else []


def _words(west: str, east: str, certs: Path, duration_s: int) -> tuple[str, ...]:
    file = str(certs / "netem" / "zenoh.json5")
    return ("netem", "--west", west, "--east", east, "--duration-s", str(duration_s), "-c", file, "rob/**")


def test_a_netem_that_nobody_calls_refuses_nobody(start: Start, endpoints: tuple[str, str], certs: Path) -> None:
    """It was its own measurement of its delay that it refused, and so that delay was unknown."""
    west, east = (one.replace("tcp/", "tls/") for one in endpoints)
    tis = start(*_words(west, east, certs, 2))
    code, _, err = tis.wait()
    assert code == 0, err
    assert "refused" not in err
    entries = _audited(tis)
    assert [one.what for one in entries if one.event == "refused"] == []
    assert {one.name for one in entries if one.event == "connected"} == {"", "netem"}


def test_a_netem_without_proof_for_clients_refuses_nobody_either(
    start: Start, endpoints: tuple[str, str], certs: Path
) -> None:
    west, east = (one.replace("tcp/", "tls/") for one in endpoints)
    config = json.loads((certs / "netem" / "zenoh.json5").read_text())
    tls = config["transport"]["link"]["tls"]
    config["transport"]["link"]["tls"] = {key: tls[key] for key in tls if not key.startswith("connect_")}
    (certs / "netem" / "zenoh.json5").write_text(json.dumps(config))
    tis = start(*_words(west, east, certs, 1))
    code, _, err = tis.wait()
    assert code == 0, err
    assert [one.what for one in _audited(tis) if one.event == "refused"] == []


@pytest.mark.parametrize("is_copied", [True, False])
def test_a_revoked_name_is_shut_out_of_a_netem_without_a_scenario(
    start: Start, endpoints: tuple[str, str], certs: Path, is_copied: bool
) -> None:
    """Its certificates are in its configuration file, whose folder is that of the names, or a copy elsewhere."""
    west, east = (one.replace("tcp/", "tls/") for one in endpoints)
    if is_copied:
        shutil.copytree(certs / "netem", certs.parent / "elsewhere" / "netem")
    tis = start(*_words(west, east, certs.parent / "elsewhere" if is_copied else certs, 600))
    operator, watcher = (tls_settings(certs / name, listens=False) for name in ("operator", "watcher"))
    assert soon(lambda: any(one.event == "begun" for one in _audited(tis)) and tis.is_under_way())
    came: list[zenoh.Sample] = []
    with a_client(west, watcher) as sender, a_client(east, operator) as mine:
        assert sender is not None
        assert mine is not None
        held = mine.declare_subscriber("rob/**", came.append)
        assert cause_an_outage(mine)
        assert cause_an_outage(sender)
        sender.get("tis/netem/control/reset")

        def comes() -> bool:
            sender.put("rob/pose", b"")
            time.sleep(0.05)
            return bool(came)

        assert soon(comes)
        revoke(certs, "operator")
        if is_copied:
            shutil.copy(certs / "revoked.txt", certs.parent / "elsewhere" / "netem")
        assert soon(lambda: any(one.what == "revoked" for one in _audited(tis)))
        n_came = len(came)
        for _ in range(8):
            sender.put("rob/pose", b"")
            assert cause_an_outage(mine) == []
            with a_client(west, operator) as again:
                assert again is None or cause_an_outage(again) == []
        assert len(came) == n_came
        assert cause_an_outage(sender), "others are answered"
        held.undeclare()  # type: ignore[no-untyped-call]
    tis.process.send_signal(signal.SIGINT)
    _, _, err = tis.wait()
    assert "netem refused a client whose certificate is revoked from 127.0.0.1:" in err
    entries = _audited(tis)
    refused = {(one.what, one.name, one.network) for one in entries if one.event == "refused"}
    assert refused == {("revoked", "operator", "west"), ("revoked", "operator", "east")}
