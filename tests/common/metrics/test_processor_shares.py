"""Shares by hand, and that they add up whatever was counted."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import convert
from msgspec.structs import asdict

from tis.common.host_records import ProcessorNote
from tis.common.metrics.processor_shares import numbers_of, processor_shares

S = 1_000_000_000
SHARES = ("testbed_pct", "others_pct", "steal_pct", "idle_pct", "iowait_pct")


def a_note(**changes: Any) -> dict[str, Any]:
    """Ten seconds of two processors: 6 s busy, of which 1 s this process; 8 idle, 1 waiting, 5 stolen."""
    known = {"busy_ns": 6 * S, "idle_ns": 8 * S, "iowait_ns": S, "steal_ns": 5 * S}
    base = {"from_ns": -S, "to_ns": 9 * S, "processors": "0-1", "own_ns": S}
    return asdict(convert(base | known | changes, ProcessorNote))


def test_shares_by_hand() -> None:
    found = processor_shares(a_note(quota_processors=0.5, n_periods=100, n_throttled=80, throttled_ns=3 * S))
    assert found is not None
    assert found == {
        "wall_s": 10, "processors": "0-1", "n_processors": 2, "own_pct": 10, "testbed_pct": 5, "others_pct": 25,
        "steal_pct": 25, "idle_pct": 40, "iowait_pct": 5, "throttled_pct": 80, "throttled_ms": 3000,
        "quota_processors": 0.5,
    }  # fmt: skip


def test_what_the_kernel_does_not_count_is_unknown_and_the_rest_is_of_the_rest() -> None:
    found = processor_shares(a_note(steal_ns=None))
    assert found is not None
    assert {found["steal_pct"], found["throttled_pct"], found["throttled_ms"]} == {None}
    assert [found["idle_pct"], found["others_pct"]] == pytest.approx([800 / 15, 500 / 15])


def test_without_proc_stat_the_process_knows_itself_alone() -> None:
    found = processor_shares(a_note(busy_ns=None, idle_ns=None, iowait_ns=None, steal_ns=None))
    assert found is not None
    assert found["own_pct"] == 10
    assert {found[name] for name in SHARES} == {None}


@pytest.mark.parametrize(
    ("mates", "testbed", "others"),
    [
        ([a_note(own_ns=2 * S)], 15, 15),
        ([a_note(own_ns=2 * S, processors="2-3")], 5, 25),  # elsewhere on this host
        ([a_note(own_ns=2 * S, processors="1-2")], 10, 20),
        ([a_note(own_ns=99 * S)], 30, 0),  # more than the kernel's jiffies have
        ([a_note(), None], None, None),  # it was killed, and nobody knows what it used
    ],
)
def test_the_testbeds_other_processes_are_not_other_programs(
    mates: list[dict[str, Any] | None], testbed: float | None, others: float | None
) -> None:
    found = processor_shares(a_note(), mates)
    assert found is not None
    shares = found["testbed_pct"], found["others_pct"]
    assert shares == (testbed and pytest.approx(testbed), others and pytest.approx(others))
    assert found["steal_pct"] == 25


def test_a_note_without_a_duration_tells_nothing() -> None:
    assert processor_shares(a_note(to_ns=-S)) is None


times = st.integers(0, 10**12)


@settings(max_examples=50)
@given(times, times, times, times, times, st.lists(times, max_size=2))
def test_known_shares_add_up_to_the_whole(
    own: int, busy: int, idle: int, iowait: int, steal: int, mates: list[int]
) -> None:
    note = a_note(own_ns=own, busy_ns=busy, idle_ns=idle, iowait_ns=iowait, steal_ns=steal)
    found = processor_shares(note, [a_note(own_ns=mate) for mate in mates])
    assert found is not None
    shares = [found[name] for name in SHARES]
    if busy + idle + iowait + steal == 0:
        assert shares == [None] * 5
        return
    known = [share for share in shares if share is not None]
    assert len(known) == 5
    assert min(known) >= 0
    assert sum(known) == pytest.approx(100)


def test_numbers_of_ranges() -> None:
    assert [sorted(numbers_of(text)) for text in ("", "3", "0-2,6")] == [[], [3], [0, 1, 2, 6]]
    with pytest.raises(ValueError, match="x"):
        numbers_of("x")
