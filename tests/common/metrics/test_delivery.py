from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tis.common.metrics.age_of_information import Arrivals, ages_at_ns
from tis.common.metrics.delivery import KeyPackets, PlannedSamples, Transmissions, account

K = "tis/MTML/measured_cp"


def ints(*values: int) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


def originals(*seqs: int) -> Transmissions:
    return Transmissions.of(*((seq, 0) for seq in seqs))


def packets(**books: object) -> KeyPackets:
    """Packets 0, 1, 2: released and received, dropped, held; what is given differs."""
    plain = {"sent": ints(0, 1, 2), "offered": ints(0, 1, 2), "released": originals(0), "dropped": originals(1)}
    found = {**plain, "received": ints(0), **books}
    n = len(found["offered"])  # type: ignore[arg-type]
    return KeyPackets(**{"copied": np.zeros(n, dtype=np.int64), "corrupted": np.zeros(n, dtype=bool), **found})  # type: ignore[arg-type]


def test_a_key_with_every_kind_of_loss() -> None:
    # of ten messages 9 never reached netem; 2 and 5 were dropped, 8 was still held; 7 got lost behind netem;
    # 4 arrived three times
    counts, lost, violations = account(
        K,
        packets(
            sent=ints(*range(10)),
            offered=ints(*range(9)),
            released=originals(0, 1, 3, 4, 6, 7),
            dropped=originals(2, 5),
            received=ints(0, 1, 4, 3, 4, 6, 4),
        ),
    )
    assert violations == ()
    assert np.flatnonzero(lost).tolist() == [2, 5]
    assert counts == {
        "sent": 10, "offered": 9, "copied": 0, "released": 6, "dropped": 2, "held_at_end": 1, "lost": 2,
        "received": 5, "not_used": 0, "duplicated": 2, "duplicated_by_netem": 0, "corrupted": 0,
        "corrupted_rejected": 0, "lost_before_netem": 1, "lost_after_netem": 1, "unplanned_loss": 2,
    }  # fmt: skip


def test_copies_count_by_themselves_and_one_of_a_message_is_enough() -> None:
    """0: both arrive. 1: original dropped, copy arrives. 2: both dropped. 3: the copy is held. 4: the copy is lost
    behind netem. 5: arrives twice though netem made no copy.
    """
    counts, lost, violations = account(
        K,
        packets(
            sent=ints(*range(6)),
            offered=ints(*range(6)),
            copied=ints(1, 1, 1, 1, 1, 0),
            released=Transmissions.of((0, 0), (0, 1), (1, 1), (3, 0), (4, 0), (4, 1), (5, 0)),
            dropped=Transmissions.of((1, 0), (2, 0), (2, 1)),
            received=ints(0, 0, 1, 3, 4, 5, 5),
        ),
    )
    assert violations == ()
    assert np.flatnonzero(lost).tolist() == [2]
    assert (counts["offered"], counts["copied"]) == (6, 5)
    assert (counts["released"], counts["dropped"], counts["held_at_end"]) == (7, 3, 1)
    assert counts["offered"] + counts["copied"] == counts["released"] + counts["dropped"] + counts["held_at_end"]
    assert (counts["duplicated"], counts["duplicated_by_netem"]) == (2, 1)
    assert (counts["lost_after_netem"], counts["unplanned_loss"]) == (1, 1)


def test_what_the_receiver_refused_for_flipped_bits_is_not_unplanned() -> None:
    """0 and 1 were corrupted and are missing, 2 corrupted and arrived, 3 is missing; the receiver refused one."""
    books = {
        "sent": ints(0, 1, 2, 3),
        "offered": ints(0, 1, 2, 3),
        "corrupted": np.array([True, True, True, False]),
        "released": originals(0, 1, 2, 3),
        "dropped": originals(),
        "received": ints(2),
    }
    counts = account(K, packets(**books, n_rejected=1)).counts
    assert (counts["corrupted"], counts["corrupted_rejected"], counts["unplanned_loss"]) == (3, 1, 2)
    counts = account(K, packets(**books, n_rejected=9)).counts
    assert (counts["corrupted_rejected"], counts["unplanned_loss"]) == (2, 1)


def test_a_key_that_carried_nothing() -> None:
    none = packets(sent=ints(), offered=ints(), released=originals(), dropped=originals(), received=ints())
    counts, lost, violations = account(K, none)
    assert set(counts.values()) == {0}
    assert len(lost) == 0
    assert violations == ()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sent": ints(0, 1)}, "1 packets: offered but never sent; the first is tis/MTML/measured_cp seq 2"),
        ({"dropped": originals(1, 7)}, "1 packets: released or dropped but never offered"),
        ({"released": Transmissions.of((0, 0), (0, 1))}, "1 packets: released or dropped but never offered"),
        (
            {"dropped": originals(0, 1)},
            "1 packets: both released and dropped; the first is tis/MTML/measured_cp seq 0",
        ),
        (
            {"received": ints(0, 2, 1)},
            "2 packets: received but never released; the first is tis/MTML/measured_cp seq 1",
        ),
        ({"offered": ints(0, 0, 0, 1, 2)}, "2 packets appear more than once in offered: tis/MTML/measured_cp"),
        ({"released": originals(0, 0)}, "1 packets appear more than once in released: tis/MTML/measured_cp"),
    ],
)
def test_each_broken_balance_is_named(change: dict[str, object], sentence: str) -> None:
    assert account(K, packets()).violations == ()
    violations = account(K, packets(**change)).violations
    assert len(violations) == 1
    assert violations[0].startswith(sentence)


LOTS = ("before", "dropped", "held", "behind", "once", "twice", "copied", "half", "copy_dropped")


@settings(deadline=None, max_examples=80)
@given(st.lists(st.sampled_from(LOTS), max_size=40))
def test_whatever_happens_to_each_message_is_found_again(lots: Sequence[str]) -> None:
    def those(*names: str) -> list[int]:
        return [seq for seq, lot in enumerate(lots) if lot in names]

    twins = ("copied", "half", "copy_dropped")
    offered = those(*LOTS[1:])
    released = those("behind", "once", "twice", *twins)
    copies = those("copied", "half")
    found = account(
        K,
        packets(
            sent=ints(*range(len(lots))),
            offered=ints(*offered),
            copied=ints(*(lots[seq] in twins for seq in offered)),
            released=Transmissions.of(*((seq, 0) for seq in released), *((seq, 1) for seq in copies)),
            dropped=Transmissions.of(*((s, 0) for s in those("dropped")), *((s, 1) for s in those("copy_dropped"))),
            received=ints(*those("once", "twice", *twins), *those("twice", "copied")),
        ),
    )
    counts, n = found.counts, Counter(lots)
    assert found.violations == ()
    assert counts["unplanned_loss"] == n["before"] + n["behind"] + n["half"]
    assert (counts["duplicated"], counts["duplicated_by_netem"]) == (n["twice"] + n["copied"], n["copied"])
    assert counts["held_at_end"] == n["held"]
    assert counts["lost"] == int(found.lost.sum()) == n["dropped"]
    assert counts["offered"] + counts["copied"] == sum(
        counts[name] for name in ("released", "dropped", "held_at_end")
    )


def test_two_copies_of_three_samples_by_hand() -> None:
    """The copy of each sample leaves after the next sample: packets hold 0, 10, 0, 20, 10, 20."""
    sample_ns = np.array([0, 10, 0, 20, 10, 20])
    planned = PlannedSamples.of(np.arange(6), sample_ns)
    assert planned.sample_ns.tolist() == [0, 10, 20]
    assert planned.is_first.tolist() == [True, True, False, True, False, False]
    second_of_10 = np.array([False, False, False, False, True, False])
    assert planned.carried(second_of_10, 0).tolist() == [False, True, False]
    assert planned.carried(second_of_10, 1).tolist() == [True, True, False]
    assert planned.carried(second_of_10, 9).tolist() == [True, True, False]


def test_of_nothing_nothing_arrives() -> None:
    nothing = np.empty(0, dtype=np.int64)
    planned = PlannedSamples.of(nothing, nothing)
    assert planned.carried(np.empty(0, dtype=np.bool_), 3).tolist() == []


def test_numbers_that_do_not_ascend_are_refused() -> None:
    with pytest.raises(ValueError, match="must ascend"):
        PlannedSamples.of(np.array([1, 1]), np.array([0, 0]))


@settings(max_examples=60)
@given(
    packets=st.lists(st.tuples(st.integers(0, 12), st.booleans()), max_size=30),
    history=st.integers(0, 14),
)
def test_it_is_the_set_of_what_each_packet_brings(packets: list[tuple[int, bool]], history: int) -> None:
    sample_ns = np.array([7 * k for k, _ in packets], dtype=np.int64)
    arrived = np.array([here for _, here in packets], dtype=np.bool_)
    planned = PlannedSamples.of(np.arange(len(packets)), sample_ns)
    taken = sorted({7 * k for k, _ in packets})
    brought: set[int] = set()
    for k, here in packets:
        place = taken.index(7 * k)
        brought |= set(taken[max(0, place - history) : place + 1]) if here else set()
    found = planned.carried(arrived, history)
    assert set(planned.sample_ns[found].tolist()) == brought
    assert int(planned.is_first.sum()) == len(taken)


@settings(max_examples=60)
@given(
    arrivals=st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=20),
    at=st.lists(st.integers(0, 60), max_size=8),
)
def test_an_age_is_that_of_the_freshest_of_all_that_came(arrivals: list[tuple[int, int]], at: list[int]) -> None:
    recv, sample = (np.array([one[i] for one in arrivals], dtype=np.int64) for i in (0, 1))
    found = ages_at_ns(*Arrivals.of(recv, sample), np.array(at, dtype=np.int64))
    for instant, age in zip(at, found.tolist(), strict=True):
        known = [s for r, s in arrivals if r <= instant]
        assert age == (instant - max(known) if known else -1)
