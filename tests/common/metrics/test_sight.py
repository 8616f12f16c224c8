"""Freezes, from hand to eye, touch beside sight and waits in a queue, each against a slow loop."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.metrics.sight import asynchrony_ns, behind_others, freezes, hand_to_eye_ns, onsets

MS = 1_000_000
FRAME = 33 * MS


def ints(*values: int) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def by_definition(shown_ns: list[int], until_ns: int) -> list[tuple[int, int]]:
    """Go through the intervals one by one, with exact means."""
    ends = [*shown_ns, max(until_ns, shown_ns[-1])] if shown_ns else []
    lengths = [b - a for a, b in pairwise(ends)]
    found = []
    for i, length in enumerate(lengths):
        before = lengths[max(0, i - 30) : i]
        if before:
            mean = Fraction(sum(before), len(before))
            if length >= max(3 * mean, mean + 150 * MS):
                found.append((ends[i], length))
    return found


@given(st.lists(st.sampled_from([0, 1, FRAME, 99 * MS, 183 * MS, 400 * MS]), max_size=80), st.integers(0, 10**10))
def test_freezes_are_those_of_the_definition(lengths: list[int], until_ns: int) -> None:
    shown = np.cumsum([5, *lengths]).astype(np.int64)
    found = freezes(shown, until_ns)
    assert [*zip(found.begin_ns.tolist(), found.lasted_ns.tolist(), strict=True)] == by_definition(
        shown.tolist(), until_ns
    )
    assert found.watched_ns == max(until_ns, int(shown[-1])) - 5


def test_a_freeze_begins_150_ms_above_the_mean_and_not_a_nanosecond_before() -> None:
    steady = np.arange(40, dtype=np.int64) * FRAME
    for late, n in ((183 * MS - 1, 0), (183 * MS, 1)):
        shown = np.append(steady, steady[-1] + late)
        assert len(freezes(shown, int(shown[-1])).begin_ns) == n


def test_a_picture_that_never_comes_back_is_a_freeze() -> None:
    shown = np.arange(31, dtype=np.int64) * 100 * MS
    found = freezes(shown, 4000 * MS)
    assert found.begin_ns.tolist() == [3000 * MS]
    assert found.share_pct == pytest.approx(25.0)


def test_without_pictures_there_is_no_freeze() -> None:
    found = freezes(ints(), 100)
    assert len(found.begin_ns) == 0
    assert found.share_pct is None


@given(
    st.lists(st.integers(-1, 6), max_size=8),
    st.lists(st.tuples(st.integers(-1, 6), st.integers(0, 1000)), max_size=20),
    st.dictionaries(st.integers(0, 6), st.integers(-100, 100)),
)
def test_the_first_picture_that_shows_a_command_or_a_later_one_counts(
    drawn: list[int], pictures: list[tuple[int, int]], sent: dict[int, int]
) -> None:
    counted = sorted(number for number in sent if number in drawn)
    shown = {number: [at for command, at in pictures if command >= number] for number in counted}
    longest = max((min(at) - sent[number] for number, at in shown.items() if at), default=None)
    expected = []
    for number, at in shown.items():
        if at:
            expected.append(min(at) - sent[number])
        elif longest is not None and 500 - sent[number] > longest:
            expected.append(500 - sent[number])
    command, at_ns = ints(*(c for c, _ in pictures)), ints(*(at for _, at in pictures))
    assert hand_to_eye_ns(ints(*drawn), command, at_ns, sent, 500).tolist() == expected


def test_contacts_that_chatter_are_one() -> None:
    t_ns = np.arange(0, 1000, 10, dtype=np.int64) * MS
    touches = np.zeros(100, dtype=bool)
    touches[:5] = touches[20:25] = touches[28:30] = touches[60:] = True
    assert onsets(t_ns, touches).tolist() == [200 * MS, 600 * MS]
    assert onsets(t_ns[:1], touches[:1]).tolist() == []


@given(*[st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=12)] * 2)
def test_touch_beside_sight(felt: list[tuple[int, int]], seen: list[tuple[int, int]]) -> None:
    at = [5, 20, 45]
    expected = []
    for onset in at:
        first = [[came for made, came in of if made >= onset] for of in (felt, seen)]
        expected += [min(first[0]) - min(first[1])] if all(first) else []
    columns = [ints(*(one[i] for one in of)) for of in (felt, seen) for i in (0, 1)]
    assert asynchrony_ns(ints(*at), *columns).tolist() == expected


@given(*[st.lists(st.tuples(st.integers(0, 40), st.integers(1, 9)), max_size=12)] * 2)
def test_who_waited_behind_a_frame(ours: list[tuple[int, int]], others: list[tuple[int, int]]) -> None:
    spans, theirs = ([(at, at + n) for at, n in sorted(one)] for one in (ours, others))
    ends = np.maximum.accumulate([end for _, end in theirs]).tolist() if theirs else []  # a queue keeps the order
    theirs = [(at, end) for (at, _), end in zip(theirs, ends, strict=True)]
    expected = [any(a <= at < b <= end for a, b in theirs) for at, end in spans]
    columns = [ints(*(one[i] for one in of)) for of in (spans, theirs) for i in (0, 1)]
    assert behind_others(*columns).tolist() == expected
