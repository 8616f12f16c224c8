"""Stops in force, each until a release that names it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import DecodeError

from tis.common.messages import decode, encode
from tis.common.safety_records import StopsInForceNote
from tis.common.stop_messages import LATCH, MAX_IN_FORCE, lock_of
from tis.patient_side.safety.stops_in_force import NOBODYS, Added, Stop, StopsInForce

_LOCK = lock_of("secret")
FIRST = (1 << 52) + 1
"""The first number that a patient gives."""


def test_two_stops_are_in_force_until_each_has_ended() -> None:
    stops = StopsInForce()
    assert stops.add(Stop(7, _LOCK, "smoke")) == Added(7, is_new=True)
    assert stops.add(Stop(9, "", "blood")) == Added(9, is_new=True)
    assert stops.add(Stop(7, _LOCK, "smoke")) == Added(7, is_new=False)
    stops.end(7)
    assert list(stops.by_number) == [9]
    assert stops.add(Stop(7, _LOCK, "smoke")) == Added(0, is_new=False)
    stops.end(9)
    assert not stops.by_number


def test_a_stop_without_a_number_of_its_own_is_given_one() -> None:
    stops = StopsInForce()
    assert stops.add(Stop(0, "", "an old program")) == Added(FIRST, is_new=True)
    assert stops.add(Stop(0, "", "an old program")) == Added(FIRST, is_new=False)
    assert stops.add(Stop(FIRST, "", "a number that is taken")) == Added(FIRST + 1, is_new=True)
    assert stops.add(Stop(LATCH, "", "")) == Added(FIRST + 2, is_new=True)
    assert stops.add(Stop(FIRST, _LOCK, "another lock: another stop")) == Added(FIRST + 3, is_new=True)
    stops.end(FIRST)
    # without a number a repeat cannot be told from a new stop, which must not be refused
    assert stops.add(Stop(0, "", "an old program")) == Added(FIRST + 4, is_new=True)


@pytest.mark.parametrize(
    ("lock", "secret", "anyone", "stopper"),
    [
        (_LOCK, "secret", "", ""),
        (_LOCK, "secre", "", "wrong secret"),
        (_LOCK, "", "", "wrong secret"),
        (_LOCK, "gé\N{SNOWMAN}", "", "wrong secret"),
        ("", "", "", ""),
        ("", "any", "", ""),
        (NOBODYS, "", "", "wrong secret"),
    ],
)
def test_who_may_end_a_stop(lock: str, secret: str, anyone: str, stopper: str) -> None:
    stops = StopsInForce()
    stops.add(Stop(7, lock, ""))
    assert stops.refusal(7, secret, "anyone") == stops.refusal(7, secret, "named") == anyone
    assert stops.refusal(7, secret, "stopper") == stopper
    assert stops.refusal(8, secret, "anyone") == "no such stop in force"


def test_more_stops_than_fit_are_in_force_as_one_that_nobody_has_the_secret_of() -> None:
    stops = StopsInForce()
    for number in range(1, MAX_IN_FORCE + 1):
        assert stops.add(Stop(number, _LOCK, "")).under == number
    assert stops.add(Stop(100, _LOCK, "the 65th")) == Added(FIRST, is_new=True)
    assert stops.add(Stop(101, _LOCK, "the 66th")) == Added(FIRST, is_new=False)
    assert len(stops.by_number) == MAX_IN_FORCE + 1
    for number in range(1, MAX_IN_FORCE + 1):
        stops.end(number)
    assert list(stops.by_number) == [FIRST]
    assert stops.refusal(FIRST, "secret", "stopper") == "wrong secret"
    assert stops.refusal(FIRST, "", "anyone") == ""
    assert stops.is_by_stopper(FIRST, "secret") is False
    stops.end(FIRST)
    assert not stops.by_number


def test_what_a_new_process_needs_is_in_a_note_of_bounded_size() -> None:
    stops = StopsInForce()
    for number in range(1, 13):
        stops.add(Stop(LATCH - number, _LOCK, "x" * 200))
    note = stops.note(5)
    assert note.others == 4
    assert len(encode(note).decode()) < 1000
    again = StopsInForce()
    again.resume(note)
    assert list(again.by_number) == [LATCH - number for number in range(5, 13)] + [FIRST]
    assert again.refusal(LATCH - 12, "secret", "stopper") == ""
    assert again.refusal(FIRST, "secret", "stopper") == "wrong secret"
    # the repeat of a stop of before is no further stop
    assert again.add(Stop(LATCH - 12, _LOCK, "x" * 200)) == Added(LATCH - 12, is_new=False)
    assert again.note(9).others == 1
    # what was given before is given to nobody else
    assert again.add(Stop(0, "", "")).under == FIRST + 1


def test_a_note_of_no_stops_stops_nothing() -> None:
    stops = StopsInForce()
    stops.resume(StopsInForceNote(at_ns=5))
    assert not stops.by_number
    for text in ("7", "7:zz", " ", "a:"):
        with pytest.raises(DecodeError, match="regex"):
            decode(encode(StopsInForceNote(at_ns=5, stops=text)), StopsInForceNote)
    stops.resume(StopsInForceNote(at_ns=5, stops="7: 8:", others=0))
    assert list(stops.by_number) == [7, 8]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 5))))
def test_in_force_is_what_was_added_and_not_ended(steps: list[tuple[bool, int]]) -> None:
    """Oracle: sets of numbers, of stops that carry numbers of their own."""
    stops, expected, ended = StopsInForce(), set[int](), set[int]()
    for is_stop, number in steps:
        if is_stop and number:
            taken = stops.add(Stop(number, "", ""))
            assert taken == Added(0 if number in ended else number, number not in expected | ended)
            expected |= {number} - ended
        elif number in expected:
            stops.end(number)
            expected -= {number}
            ended |= {number}
        else:
            assert stops.refusal(number, "", "anyone") == "no such stop in force"
        assert set(stops.by_number) == expected
