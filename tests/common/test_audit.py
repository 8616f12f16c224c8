"""The audit log: every single change of it is found, and alike happenings are summed."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.audit import FIRST, MAX_PER_SECOND, Chain, Happening, Sums, verify
from tis.common.host_records import AuditNote

_UTC = "2026-01-02T03:04:05.678+00:00"


def _log(n: int, ends: bool = True) -> tuple[list[bytes], list[AuditNote]]:
    chain, lines, notes = Chain(), [], []
    for k in range(n):
        one = Happening("ended") if ends and k == n - 1 else Happening("refused", "no_tls", "west", f"10.0.0.{k}:99")
        lines.append(chain.line(_UTC, k * 1_000_000_000, one, k + 1))
        notes.append(AuditNote(at_ns=k, lines=chain.n_lines, sha256=chain.head))
    return lines, notes


def test_a_log_as_it_was_written_is_whole() -> None:
    lines, notes = _log(5)
    found = verify(lines, notes)
    assert (found.fault, found.has_ended, len(found.entries)) == ("", True, 5)
    assert found.words == "whole: 5 lines"
    assert (found.entries[1].address, found.entries[1].n, found.entries[1].run_s) == ("10.0.0.1:99", 2, 1.0)
    assert verify([]).head == FIRST


@given(st.integers(0, 6), st.data())
def test_every_changed_byte_is_found_at_its_line(at: int, data: st.DataObject) -> None:
    lines, notes = _log(7)
    where = data.draw(st.integers(0, len(lines[at]) - 2))
    value = data.draw(st.integers(0, 255).filter(lambda one: one != lines[at][where]))
    changed = bytearray(lines[at])
    changed[where] = value
    lines[at] = bytes(changed)
    fault = verify(lines, notes[-1:]).fault
    assert fault.startswith((f"changed at line {at + 1}", f"changed at line {at}:")), fault


@pytest.mark.parametrize("at", range(6))
def test_a_line_that_is_taken_out_or_put_in_twice_is_found(at: int) -> None:
    lines, notes = _log(7)
    assert "changed at line" in verify([*lines[:at], *lines[at + 1 :]], notes[-1:]).fault
    assert "changed at line" in verify([*lines[: at + 1], *lines[at:]], notes[-1:]).fault


def test_a_cut_tail_and_a_chain_made_anew_contradict_netems_log() -> None:
    lines, notes = _log(7)
    assert verify(lines[:4]).words == "whole: 4 lines; without an end: netem was killed, or goes on"
    assert verify(lines[:4], notes).fault == "cut: netem's log noted 5 lines, 4 are here"
    assert verify([], notes[-1:]).fault == "cut: netem's log noted 7 lines, 0 are here"
    assert verify([*lines[:3], lines[3][:30]]).fault == "cut within line 4"
    anew = Chain()
    forged = [anew.line(_UTC, None, Happening("connected")) for _ in range(7)]
    assert verify(forged).fault == ""
    assert verify(forged, notes[-1:]).fault == "changed at line 7: netem's log noted another one"


@given(st.lists(st.tuples(st.sampled_from(["a", "b"]), st.integers(1, 3), st.integers(1, 60_000)), max_size=50))
def test_alike_refusals_of_an_address_are_summed_whatever_the_port(found: list[tuple[str, int, int]]) -> None:
    sums = Sums()
    for k, (kind, host, port) in enumerate(found):
        sums.add(k, Happening("refused", kind, "west", f"10.0.0.{host}:{port}"))
    rows = sums.take()
    counted = {(one.what, one.address.rpartition(":")[0]): n for _, one, n in rows}
    assert counted == Counter((kind, f"10.0.0.{host}") for kind, host, _ in found)
    assert sums.take() == []


def test_a_flood_from_many_addresses_takes_a_bounded_number_of_lines_and_loses_no_count() -> None:
    sums = Sums()
    for k in range(100_000):
        sums.add(k, Happening("refused", "no_tls", "west", f"10.{k % 200}.{k % 191}.1:5"))
    rows = sums.take()
    assert len(rows) == MAX_PER_SECOND + 1
    assert sum(n for *_, n in rows) == 100_000
