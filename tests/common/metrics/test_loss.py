from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from common.metrics.loss import LinkPackets, Packet, account, wilson_interval

K = "tis/MTML/measured_cp"


def p(*seqs: int, key: str = K) -> list[Packet]:
    return [(key, seq) for seq in seqs]


def test_a_link_with_every_kind_of_loss() -> None:
    # of ten packets 9 never reached netem; 2 and 5 were dropped, 8 was still held; 7 got lost behind netem;
    # 4 arrived three times
    packets = LinkPackets(
        sent=p(*range(10)),
        offered=p(*range(9)),
        released=p(0, 1, 3, 4, 6, 7),
        dropped=p(2, 5),
        held_at_end=p(8),
        received=p(0, 1, 4, 3, 4, 6, 4),
    )
    counts, violations = account(packets)
    assert counts == {
        "sent": 10,
        "offered": 9,
        "released": 6,
        "dropped": 2,
        "held_at_end": 1,
        "received": 5,
        "duplicated": 2,
        "unplanned_loss": 2,
    }
    assert violations == ()


def test_equal_numbers_on_two_keys_are_two_packets() -> None:
    both = p(0) + p(0, key="tis/PSM2/setpoint_cp")
    counts, violations = account(LinkPackets(both, both, both, [], [], p(0)))
    assert (counts["sent"], counts["received"], counts["unplanned_loss"]) == (2, 1, 1)
    assert violations == ()


def test_a_link_that_carried_nothing() -> None:
    counts, violations = account(LinkPackets([], [], [], [], [], []))
    assert set(counts.values()) == {0}
    assert violations == ()


BALANCED = LinkPackets(p(0, 1, 2), p(0, 1, 2), p(0), p(1), p(2), p(0))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sent": p(0, 1)}, "1 packets: offered but never sent; the first is tis/MTML/measured_cp seq 2"),
        ({"held_at_end": []}, "1 packets: offered but neither released nor dropped nor held"),
        ({"dropped": p(1, 7)}, "1 packets: released, dropped or held but never offered"),
        ({"dropped": p(0, 1)}, "1 packets: more than one of released, dropped and held"),
        (
            {"received": p(0, 2, 1)},
            "2 packets: received but never released; the first is tis/MTML/measured_cp seq 1",
        ),
        ({"offered": p(0, 0, 0, 1, 2)}, "2 packets stand more than once in offered"),
    ],
)
def test_each_broken_balance_is_named(change: dict[str, list[Packet]], sentence: str) -> None:
    _, violations = account(BALANCED._replace(**change))
    assert len(violations) == 1
    assert violations[0].startswith(sentence)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.sampled_from(["before", "dropped", "held", "behind", "once", "twice"]), max_size=40))
def test_whatever_happens_to_each_packet_is_found_again(lots: Sequence[str]) -> None:
    def those(*names: str) -> list[Packet]:
        return p(*(seq for seq, lot in enumerate(lots) if lot in names))

    packets = LinkPackets(
        sent=p(*range(len(lots))),
        offered=those("dropped", "held", "behind", "once", "twice"),
        released=those("behind", "once", "twice"),
        dropped=those("dropped"),
        held_at_end=those("held"),
        received=those("once", "twice") + those("twice"),
    )
    counts, violations = account(packets)
    assert violations == ()
    assert counts["unplanned_loss"] == lots.count("before") + lots.count("behind")
    assert counts["duplicated"] == lots.count("twice")
    assert counts["offered"] == counts["released"] + counts["dropped"] + counts["held_at_end"]


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 10_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_agrees_with_scipy(case: tuple[int, int]) -> None:
    n_lost, n = case
    interval = wilson_interval(n_lost, n)
    expected = binomtest(n_lost, n).proportion_ci(0.95, method="wilson")
    assert interval == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert interval is not None
    assert 0 <= interval[0] <= n_lost / n <= interval[1] <= 1


def test_wilson_interval_knows_its_confidence_and_nothing_of_nothing() -> None:
    assert wilson_interval(0, 0) is None
    wide, narrow = wilson_interval(10, 100, 0.99), wilson_interval(10, 100, 0.5)
    assert wide is not None
    assert narrow is not None
    assert wide[0] < narrow[0] < 0.1 < narrow[1] < wide[1]
