"""The files of revoked names, read again and again; what netem cuts: live tests of tests/system.

Without a scenario the files lie beside the certificates, or where the configuration with them lies.
"""

import json
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.netem.bridge.revocation import Revocations, _folders, watch_revoked


def test_a_file_that_cannot_be_read_changes_nothing_and_is_told_once(tmp_path: Path) -> None:
    told: list[str] = []
    audit: Any = SimpleNamespace()
    revocations, file = Revocations([tmp_path], audit, told.append), tmp_path / "revoked.txt"
    file.write_text("watcher 1f\n")
    revocations._look()
    file.unlink()
    file.mkdir()
    for _ in range(3):
        revocations._look()
    assert revocations._names == {"watcher"}
    assert [text.partition(": ")[2] for text in told] == ["cannot be read, what was revoked stays so: Is a directory"]
    file.rmdir()
    revocations._look()
    assert not revocations._names, "its lines are gone"


def test_names_revoked_in_either_file_are_revoked(tmp_path: Path) -> None:
    audit: Any = SimpleNamespace()
    (tmp_path / "netem").mkdir()
    revocations = Revocations([tmp_path / "netem", tmp_path], audit, print)
    (tmp_path / "revoked.txt").write_text("watcher 1f\n")
    (tmp_path / "netem" / "revoked.txt").write_text("operator\n")
    revocations._look()
    assert revocations._names == {"watcher", "operator"}
    (tmp_path / "netem" / "revoked.txt").unlink()
    revocations._look()
    assert revocations._names == {"watcher"}


def test_the_folders_are_those_of_the_certificates_and_of_the_configuration(tmp_path: Path) -> None:
    file = tmp_path / "config" / "netem.json5"
    file.parent.mkdir()
    tls = {"enable_mtls": True, "listen_certificate": str(tmp_path / "own" / "cert.pem")}
    file.write_text(json.dumps({"transport": {"link": {"tls": tls}}}))
    config = configure("client", ZenohOptions(config=file))
    assert _folders(config, file) == [tmp_path / "own", tmp_path, tmp_path / "config"]


def test_what_cannot_be_watched_is_told(tmp_path: Path) -> None:
    def told(cfg: str, *listen: str, config: Path | None = None) -> list[str]:
        found: list[str] = []
        with ExitStack() as stack:
            watch_revoked(stack, ZenohOptions(cfg=[cfg], config=config), None, {}, listen, found.append)
        return found

    asks = "transport/link/tls/enable_mtls:true"
    file = tmp_path / "netem.json5"
    file.write_text("{}")
    assert told("mode:'client'", "tls/127.0.0.1:1") == []
    assert told(asks, "tls/127.0.0.1:1", config=file) == []
    assert [text.partition(",")[0] for text in told(asks, "tls/127.0.0.1:1")] == ["revoked.txt is not watched"]
    said = "revoked names are not refused at quic/127.0.0.1:1: only connections over tls/ are cut"
    assert told(asks, "quic/127.0.0.1:1", config=file) == [said]
