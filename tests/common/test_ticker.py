from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.ticker import PlannedPacket, SendPlan, Ticker
from tis.common.units import sample_instant_ns


def test_due_instants_are_absolute() -> None:
    ticker = Ticker(30, 900, 2_000_000)
    assert [ticker.due_ns(k) for k in (0, 1, 2, 899)] == [2_000_000, 35_333_333, 68_666_666, 29_968_666_666]


def test_a_punctual_run_misses_nothing() -> None:
    ticker = Ticker(30, 3)
    begun = []
    while (due := ticker.next_due_ns()) is not None:
        assert list(ticker.skip_missed(due)) == []
        begun.append(ticker.begin())
    assert begun == [0, 1, 2]
    assert ticker.n_missed == 0


def test_a_tick_is_missed_when_the_next_one_is_due() -> None:
    ticker = Ticker(30, 10)
    assert list(ticker.skip_missed(33_333_332)) == []  # 1 ns before tick 1: tick 0 can still begin
    assert list(ticker.skip_missed(33_333_333)) == [0]
    assert ticker.begin() == 1
    assert ticker.next_due_ns() == 66_666_666


def test_a_stall_to_the_end_misses_the_rest() -> None:
    ticker = Ticker(30, 4)
    ticker.begin()
    assert list(ticker.skip_missed(10**12)) == [1, 2, 3]
    assert ticker.next_due_ns() is None
    assert ticker.n_missed == 3


@settings(deadline=None, max_examples=100)
@given(
    rate_hz=st.integers(1, 1000),
    phase_ns=st.integers(0, 10**6),
    n_ticks=st.integers(0, 40),
    pauses_ns=st.lists(st.integers(0, 2 * 10**9), max_size=20),
)
def test_equals_a_linear_scan_of_all_ticks(rate_hz: int, phase_ns: int, n_ticks: int, pauses_ns: list[int]) -> None:
    """Each wake may begin one tick: the scan looks at every tick whether its period holds the moment."""
    due = [k * 10**9 // rate_hz + phase_ns for k in range(n_ticks + 1)]
    ticker = Ticker(rate_hz, n_ticks, phase_ns)
    begun: set[int] = set()
    missed: set[int] = set()
    now_ns = 0
    for pause_ns in pauses_ns:
        now_ns += pause_ns
        too_late = {k for k in range(n_ticks) if due[k + 1] <= now_ns} - begun - missed
        assert set(ticker.skip_missed(now_ns)) == too_late
        missed |= too_late
        next_due = ticker.next_due_ns()
        if next_due is not None and next_due <= now_ns:
            k = ticker.begin()
            assert due[k] <= now_ns < due[k + 1]
            begun.add(k)
    assert ticker.n_missed == len(missed)


@settings(deadline=None, max_examples=200)
@given(
    rate_hz=st.integers(1, 10_000),
    n_ticks=st.integers(0, 50),
    phase_ns=st.integers(0, 10_000_000),
    from_ns=st.integers(-10_000_000, 60_000_000_000) | st.integers(-10, 10_000_000),
)
def test_a_late_ticker_begins_with_the_first_tick_due_then(
    rate_hz: int, n_ticks: int, phase_ns: int, from_ns: int
) -> None:
    """Oracle: a linear scan."""
    ticker = Ticker(rate_hz, n_ticks, phase_ns)
    ticker.start_at(from_ns)
    assert ticker.k == next((k for k in range(n_ticks) if ticker.due_ns(k) >= from_ns), n_ticks)
    assert ticker.n_missed == 0


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
