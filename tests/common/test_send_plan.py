"""The plan of the packets against all their instants, sorted."""

from hypothesis import given
from hypothesis import strategies as st

from tis.common.ticker import PlannedPacket, SendPlan
from tis.common.units import sample_instant_ns


def _all(plan: SendPlan) -> list[PlannedPacket]:
    packets = []
    while (due_ns := plan.next_due_ns()) is not None:
        packets.append(plan.pop())
        assert packets[-1].due_ns == due_ns
    return packets


@given(st.integers(1, 1000), st.integers(0, 12), st.integers(1, 5), st.sampled_from([0, 1, 20_000_000, 100_000_000]))
def test_every_copy_has_its_instant_and_numbers_grow_with_time(
    rate_hz: int, n_samples: int, copies: int, spacing_ns: int
) -> None:
    instants = sorted(
        (sample_instant_ns(k, rate_hz) + c * spacing_ns, c, k) for k in range(n_samples) for c in range(copies)
    )
    found = _all(SendPlan(rate_hz, n_samples, copies, spacing_ns))
    assert [(p.due_ns, p.copy, p.k) for p in found] == instants
    assert [p.seq for p in found] == list(range(n_samples * copies))
    plan = SendPlan(rate_hz, n_samples, copies, spacing_ns)
    assert [plan.seq_of(p.k, p.copy) for p in found] == [p.seq for p in found]


def test_spaced_copies_lie_between_later_samples() -> None:
    """At 30 Hz, 50 ms apart: the second copy of sample 0 leaves between samples 1 and 2."""
    found = _all(SendPlan(30, 3, 2, 50_000_000))
    assert [(p.due_ns, p.seq, p.k, p.copy) for p in found] == [
        (0, 0, 0, 0),
        (33_333_333, 1, 1, 0),
        (50_000_000, 2, 0, 1),
        (66_666_666, 3, 2, 0),
        (83_333_333, 4, 1, 1),
        (116_666_666, 5, 2, 1),
    ]


def test_at_once_a_sample_s_copies_have_neighbouring_numbers() -> None:
    found = _all(SendPlan(1000, 2, 3))
    assert [(p.due_ns, p.seq, p.k, p.copy) for p in found][:4] == [
        (0, 0, 0, 0),
        (0, 1, 0, 1),
        (0, 2, 0, 2),
        (1_000_000, 3, 1, 0),
    ]
