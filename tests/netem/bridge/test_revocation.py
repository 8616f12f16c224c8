"""The file of revoked names, read again and again; what netem cuts: tests/system/test_living_certificates."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tis.netem.bridge.revocation import Revocations


def test_a_file_that_cannot_be_read_changes_nothing_and_is_told_once(tmp_path: Path) -> None:
    told: list[str] = []
    audit: Any = SimpleNamespace()
    revocations, file = Revocations(tmp_path, audit, told.append), tmp_path / "revoked.txt"
    file.write_text("watcher 1f\n")
    revocations._look()
    file.unlink()
    file.mkdir()
    for _ in range(3):
        revocations._look()
    assert revocations._revoked.names == {"watcher"}
    assert [text.partition(": ")[2] for text in told] == ["cannot be read, what was revoked stays so: Is a directory"]
    file.rmdir()
    revocations._look()
    assert not revocations._revoked.names, "its lines are gone"
