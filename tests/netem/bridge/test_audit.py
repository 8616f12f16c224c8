"""The audit log of a busy netem, without Zenoh."""

import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tis.common.audit import AUDIT_FILE, Happening, verify
from tis.common.host_records import AuditNote
from tis.common.runtime.clock import WallClock
from tis.netem.bridge.audit import AuditTrail


@pytest.fixture
def _hasty_threads() -> Iterator[None]:
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before_s)


@pytest.mark.usefixtures("_hasty_threads")
def test_the_end_is_the_last_line_whatever_happens_and_is_written_meanwhile(tmp_path: Path) -> None:
    for number in range(30):
        folder, over = tmp_path / str(number), threading.Event()
        folder.mkdir()
        audit = AuditTrail([], lambda _: None)
        audit.begin(folder, WallClock(0))

        def be_busy(audit: AuditTrail = audit, over: threading.Event = over) -> None:
            while not over.is_set():
                audit.note(Happening("left", "one"))
                audit._flush()

        others = [threading.Thread(target=be_busy) for _ in range(2)]
        for one in others:
            one.start()
        [noted] = audit.finish()
        assert isinstance(noted.data, AuditNote)
        over.set()
        for one in others:
            one.join()
        audit._close()
        found = verify((folder / AUDIT_FILE).read_bytes().splitlines(keepends=True), [noted.data])
        assert (found.fault, found.has_ended) == ("", True)


def test_a_log_whose_last_line_was_cut_by_a_kill_goes_on_whole(tmp_path: Path) -> None:
    for last in ("begun", "ended"):
        audit = AuditTrail([], lambda _: None)
        audit.begin(tmp_path, WallClock(0))
        list(audit.finish())
        audit._close()
        file = tmp_path / AUDIT_FILE
        found = verify(file.read_bytes().splitlines(keepends=True))
        assert (found.fault, found.has_ended) == ("", True), last
        file.write_bytes(file.read_bytes()[:-30])
    assert [one.event for one in found.entries] == ["begun", "begun", "ended"]
    assert "cut" in found.entries[1].what
