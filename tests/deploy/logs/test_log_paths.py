"""Which file is read: the log itself, or what was recovered of it."""

from pathlib import Path

import pytest

from tis.common.node import Record
from tis.common.records import TickNote
from tis.common.runtime.mcap_log import McapLog
from tis.deploy.logs.log_paths import log_file, log_files, recovered_name, recovery_of
from tis.deploy.logs.recover import recover


def _log(path: Path, n: int = 50) -> Path:
    with McapLog(path, {"side": "netem"}) as log:
        for k in range(n):
            log.record(Record("/tis/ticks", k, TickNote(tick=k, due_ns=k, begin_ns=k)))
            log.flush()
    return path


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """Return a folder with a cut log of netem and what was recovered of it."""
    own = _log(tmp_path / "netem.mcap")
    own.write_bytes(own.read_bytes()[:3000])
    recover(own, recovered_name(own))
    return tmp_path


def test_a_log_without_anything_recovered_is_read_itself_also_when_it_is_not_there(tmp_path: Path) -> None:
    assert log_file(tmp_path, "netem") == tmp_path / "netem.mcap"
    assert log_files(tmp_path) == {}
    _log(tmp_path / "netem.mcap")
    assert log_files(tmp_path) == {"netem": (tmp_path / "netem.mcap",)}


def test_what_was_recovered_is_read_in_its_place_and_when_it_is_gone(damaged: Path) -> None:
    recovered = damaged / "netem_recovered.mcap"
    assert log_file(damaged, "netem") == recovered
    (damaged / "netem.mcap").unlink()
    assert log_files(damaged) == {"netem": (recovered,)}


def test_a_log_gathered_again_is_read_itself(damaged: Path) -> None:
    (damaged / "netem.mcap").unlink()
    _log(damaged / "netem.mcap")
    assert log_file(damaged, "netem") == damaged / "netem.mcap"


@pytest.mark.parametrize("content", [b"", b"text", None])
def test_what_does_not_say_that_it_was_recovered_is_not_read(damaged: Path, content: bytes | None) -> None:
    recovered = damaged / "netem_recovered.mcap"
    recovered.unlink()
    if content is None:
        _log(recovered)
    else:
        recovered.write_bytes(content)
    assert recovery_of(recovered) is None
    assert log_file(damaged, "netem") == damaged / "netem.mcap"


def test_a_recovered_log_that_was_torn_in_turn_is_not_read(damaged: Path) -> None:
    recovered = damaged / "netem_recovered.mcap"
    recovered.write_bytes(recovered.read_bytes()[:-50])
    assert log_file(damaged, "netem") == damaged / "netem.mcap"
