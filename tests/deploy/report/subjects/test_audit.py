"""What a run's audit log tells beside its chain."""

from pathlib import Path

from tis.common.audit import AUDIT_FILE, Chain, Happening
from tis.deploy.report.subjects.audit import verify_run


def test_a_calendar_clock_that_was_set_back_is_told(tmp_path: Path) -> None:
    chain = Chain()
    lines = [
        chain.line(f"2026-11-24T{hour}.500+00:00", at_s * 10**9, Happening("left", str(at_s)))
        for at_s, hour in ((1, "10:00:01"), (9, "10:00:09"), (10, "07:00:10"), (11, "07:00:11"))
    ]
    lines.append(chain.line("no time", 5, Happening("left")))
    file = tmp_path / AUDIT_FILE
    file.write_bytes(b"".join(lines[:2]))
    assert "stepped" not in verify_run(tmp_path)
    file.write_bytes(b"".join(lines))
    assert "; the calendar clock stepped by -10800 s before line 3" in verify_run(tmp_path)
