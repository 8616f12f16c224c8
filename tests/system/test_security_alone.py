"""A netem without a scenario whose clients need certificates."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.system.conftest import Start, Tis
from tis.common.audit import AUDIT_FILE, AuditEntry, verify
from tis.deploy.tools.certificates import issue, new_authority

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
