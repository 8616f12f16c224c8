"""What a run's audit log tells beside its chain."""

import json
from pathlib import Path
from typing import Any

import pytest

from tis.common.audit import AUDIT_FILE, Chain, Happening, verify
from tis.deploy.report.subjects.audit import action_table, verify_run


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


_SLOWER = [
    {"direction": way, "change": {"delay": {"kind": "constant", "delay_ms": 50.0}}} for way in ("forward", "both")
]


@pytest.mark.parametrize(
    ("operation", "asked", "words"),
    [
        ("outage", {"direction": "both", "for_ms": 2000.0}, "both directions, from 2.500 s for 2 s: outage"),
        ("set", _SLOWER[0] | {"for_s": 4.0}, "forward, from 2.500 s for 4 s: delay 50 ms"),
        ("set", _SLOWER, "forward, from 2.500 s: delay 50 ms; both directions, from 2.500 s: delay 50 ms"),
        ("reset", {}, "reset to what was asked for at the start"),
        ("reset", "", "reset to what was asked for at the start"),
        ("profile", {"profile": "wifi_bad", "network": {"forward": {"delay": "x" * 600}}}, "profile wifi_bad"),
        ("set", "refused", "refused"),
        ("set", "[" * 300, "[" * 300),
        ("outage", {"direction": "nowhere"}, '{"direction": "nowhere"}'),
    ],
)
def test_a_change_of_the_network_stands_in_words(operation: str, asked: Any, words: str) -> None:
    text = asked if isinstance(asked, str) else json.dumps(asked)
    happening = Happening("network", text, "west", key=f"tis/netem/control/{operation}")
    found = verify([Chain().line("2026-11-24T10:00:01+00:00", 2_500_000_000, happening)], [])
    [row] = action_table(found).rows
    assert row[2] == words
