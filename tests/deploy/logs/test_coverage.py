"""Of which time a log tells: cut, holed, torn in its index, recovered, recovered twice."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.deploy.report.partial import causes
from tis.common.clocks import ClockModel, Envelope
from tis.common.node import Record
from tis.common.records import TickNote
from tis.common.runtime.mcap_log import McapLog
from tis.deploy.logs.coverage import FOREVER, RECOVERED, Coverage, Span, lies_in, recovery_metadata, spans
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.recover import recover

S = 1_000_000_000


def _log(path: Path) -> list[int]:
    """Write a tick a second for 20 s, each in a chunk of its own; return where the chunks end."""
    ends = []
    with McapLog(path, {"side": "netem"}) as log:
        for k in range(20):
            log.record(Record("/tis/ticks", k * S, TickNote(tick=k, due_ns=k * S, begin_ns=k * S)))
            log.flush()
            ends.append(path.stat().st_size)
    return ends


def _coverage(path: Path) -> Coverage:
    log, last_ns = LogFile(path), 0
    for block in log.blocks():
        last_ns = max(last_ns, int(block.log_ns.max(initial=0)))
    return Coverage.of(log, last_ns)


def test_a_whole_log_lacks_nothing(tmp_path: Path) -> None:
    _log(tmp_path / "a.mcap")
    found = _coverage(tmp_path / "a.mcap")
    assert (found.whole, found.void, found.problem) == (True, False, None)
    assert found.summary() == {
        "state": "complete",
        "file": "a.mcap",
        "unknown_s": [],
        "away_s": [],
        "away_counts": True,
        "lost_bytes": None,
    }


def test_a_log_whose_side_goes_on_is_not_called_damaged(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with McapLog(path, {"side": "netem"}) as log:
        log.record(Record("/tis/ticks", 0, TickNote(tick=0, due_ns=0, begin_ns=0)))
        log.flush()
        assert causes([_coverage(path).problem or ""]) == ["log is still being written: the run is going on"]
    assert _coverage(path).problem is None


def test_a_cut_log_is_unknown_from_its_last_message_on_also_when_recovered(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    ends = _log(path)
    path.write_bytes(path.read_bytes()[: ends[7] + 30])
    found = _coverage(path)
    assert found.unknown == ((7 * S, FOREVER),)
    assert found.problem is not None
    assert found.problem.startswith("log is damaged (the file ends early, at byte ")
    assert causes([found.problem])[0].endswith("; nothing is known after 7.000 s, and figures leave that out")
    recover(path, tmp_path / "b.mcap")
    again = _coverage(tmp_path / "b.mcap")
    assert again.unknown == ((7 * S, FOREVER),)
    assert again.damage is None
    assert again.summary()["state"] == "recovered"
    assert again.problem is not None
    assert again.problem.startswith("log was recovered from a damaged one (b.mcap); nothing is known after 7.000 s")


def test_a_hole_is_known_by_its_edges_and_a_second_recovery_forgets_none(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    ends = _log(path)
    data = bytearray(path.read_bytes())
    data[ends[4] + 60 : ends[4] + 64] = b"\x00\x01\x02\x03"  # within the chunk of 5 s
    path.write_bytes(data)
    assert _coverage(path).unknown == ((4 * S, FOREVER),)  # it is read up to the damage only
    assert recover(path, tmp_path / "b.mcap").unknown == ((4 * S, 6 * S),)
    assert _coverage(tmp_path / "b.mcap").unknown == ((4 * S, 6 * S),)
    whole = (tmp_path / "b.mcap").read_bytes()
    at = whole.index(b"zstd")
    (tmp_path / "c.mcap").write_bytes(whole[: at + 40])
    recover(tmp_path / "c.mcap", tmp_path / "d.mcap")
    assert _coverage(tmp_path / "d.mcap").void


def test_a_log_that_lost_its_index_is_damaged_but_lacks_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    _log(path)
    path.write_bytes(path.read_bytes()[:-30])
    found = _coverage(path)
    assert (found.whole, found.summary()["state"]) == (True, "damaged")
    assert recover(path, tmp_path / "b.mcap").unknown == ()
    assert (_coverage(tmp_path / "b.mcap").problem, _coverage(tmp_path / "b.mcap").whole) == (None, True)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.8, 0.97])
def test_of_no_cut_more_is_claimed_than_is_there(tmp_path: Path, share: float) -> None:
    path = tmp_path / "a.mcap"
    _log(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    found, log = _coverage(path), LogFile(path)
    there = [ns for block in log.blocks() for ns in block.log_ns.tolist()]
    lost_ns = [k * S for k in range(20) if k * S not in there]
    for begin_ns, end_ns in found.unknown:
        assert end_ns == FOREVER
        assert begin_ns == max(there, default=0)
    assert not lost_ns or lies_in(np.array(lost_ns), found.unknown, 0, 0).all()


_EDGES = st.lists(st.integers(0, 10**12), min_size=0, max_size=8, unique=True).map(sorted)


@given(_EDGES, st.booleans())
def test_a_mark_is_read_back(edges: list[int], is_open: bool) -> None:
    found: list[Span] = list(zip(edges[::2], edges[1::2], strict=False))
    if is_open and len(edges) % 2:
        found.append((edges[-1], FOREVER))
    entries = recovery_metadata("x", "a.mcap", 5, 3, tuple(found))
    assert spans(entries["unknown_ns"]) == tuple(found)


def test_a_mark_that_cannot_be_read_claims_nothing() -> None:
    assert spans("soon-later") == spans("3") == ((0, FOREVER),)
    assert spans("") == ()


def test_a_hole_is_moved_to_the_reference_s_clock() -> None:
    nothing = Envelope(np.zeros(1, dtype=np.int64), np.zeros(1), 0.0)
    ahead = ClockModel(offset_ns=2.0 * S, above=nothing, below=nothing)
    found = Coverage("x", None, "torn", ((S, 2 * S), (5 * S, FOREVER))).aligned(ahead)
    assert found.unknown == ((3 * S, 4 * S), (7 * S, FOREVER))


def test_the_mark_is_metadata_that_any_reader_sees(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    ends = _log(path)
    path.write_bytes(path.read_bytes()[: ends[3] + 1])
    recover(path, tmp_path / "b.mcap")
    log = LogFile(tmp_path / "b.mcap")
    list(log.blocks())
    assert log.metadata[RECOVERED]["of"] == "a.mcap"
    assert log.metadata[RECOVERED]["until_s"] == "3.000"
    assert log.metadata[RECOVERED]["of_bytes"] == str(ends[3] + 1)
    assert log.metadata["run"] == {"side": "netem"}
