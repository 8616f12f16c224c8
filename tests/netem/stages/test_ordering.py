from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.scenario.network.pipeline import Ordering as OrderingName
from tis.netem.stages.ordering import Ordering, build_ordering

# (offered_ns, delay_ns): packet 1 would overtake packet 0, packets 2 and 3 are due at the same instant
PACKETS = ((1_000, 500), (1_100, 100), (2_000, 200), (2_100, 100))


def _releases(ordering: Ordering) -> list[int]:
    return [ordering.schedule(offered_ns + delay_ns) for offered_ns, delay_ns in PACKETS]


def test_fifo_makes_a_packet_wait_for_the_one_before() -> None:
    assert _releases(build_ordering("fifo")) == [1_500, 1_500, 2_200, 2_200]


def test_reorder_and_drop_late_leave_the_instants_alone() -> None:
    assert _releases(build_ordering("reorder")) == [1_500, 1_200, 2_200, 2_200]
    assert _releases(build_ordering("drop_late")) == [1_500, 1_200, 2_200, 2_200]


def test_only_drop_late_refuses_an_overtaken_packet() -> None:
    released = [0, 2, 1, 2, 5, 3, 6]
    expected: dict[OrderingName, list[int]] = {
        "fifo": released,
        "reorder": released,
        "drop_late": [0, 2, 2, 5, 6],  # the second 2 is a duplicate, not late
    }
    for name, passed in expected.items():
        ordering = build_ordering(name)
        assert [seq for seq in released if ordering.passes(seq)] == passed


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(-(10**9), 10**12), max_size=50))
def test_fifo_is_the_running_maximum_of_the_due_instants(due_ns: list[int]) -> None:
    ordering = build_ordering("fifo")
    assert [ordering.schedule(due) for due in due_ns] == [max(due_ns[: i + 1]) for i in range(len(due_ns))]
