import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.deploy.view.drive.hand_move import HandMove
from tis.deploy.view.drive.hub import MAX_RATE_HZ, Rate, Seat


def _move(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, gripper_rad: float = 0.0, release: bool = False
) -> HandMove:
    return HandMove(moved_mm=[x, y, z], gripper_rad=gripper_rad, release=release)


def test_the_first_page_drives_and_the_second_does_not() -> None:
    seat = Seat()
    assert seat.drive("one", _move(3.0, 4.0, 5.0, 0.5), 10.0)
    assert not seat.drive("two", _move(90.0), 10.1)
    assert (seat.driver, seat.hand_mm, seat.gripper_rad) == ("one", (3.0, 4.0, 5.0), 0.5)


def test_the_next_driver_moves_the_hand_on_from_where_it_is() -> None:
    seat = Seat()
    seat.drive("one", _move(10.0, 0.0, -2.0), 1.0)
    seat.leave("one")
    assert (seat.driver, seat.hand_mm) == (None, (10.0, 0.0, -2.0)), "the hand holds"
    assert seat.drive("two", _move(), 1.1)
    assert seat.hand_mm == (10.0, 0.0, -2.0)
    seat.drive("two", _move(1.0, 1.0, 1.0), 1.2)
    assert seat.hand_mm == (11.0, 1.0, -1.0)


@pytest.mark.parametrize(("waited_s", "is_taken"), [(2.9, False), (3.1, True)])
def test_a_driver_that_is_still_for_three_seconds_loses_the_seat(waited_s: float, is_taken: bool) -> None:
    seat = Seat()
    seat.drive("one", _move(), 5.0)
    assert seat.drive("two", _move(), 5.0 + waited_s) == is_taken
    assert seat.drive("one", _move(), 5.0 + waited_s) != is_taken


def test_a_page_lets_go_with_its_last_move_and_leaves_no_other_pages_seat() -> None:
    seat = Seat()
    seat.drive("one", _move(2.0, release=True), 1.0)
    assert (seat.driver, seat.hand_mm) == (None, (2.0, 0.0, 0.0))
    seat.drive("two", _move(), 1.0)
    seat.leave("one")
    assert seat.driver == "two"


@given(st.lists(st.floats(0.0, 0.5), max_size=300))
def test_no_page_moves_the_hand_faster_than_its_rate(gaps_s: list[float]) -> None:
    rate, now_s, n_taken = Rate(), 0.0, 0
    for gap_s in gaps_s:
        now_s += gap_s
        n_taken += rate.takes(now_s)
    assert n_taken <= 50 + MAX_RATE_HZ * now_s
    assert n_taken + rate.n_dropped == len(gaps_s)


def test_the_pages_own_forty_moves_a_second_are_all_taken() -> None:
    rate = Rate()
    assert all(rate.takes(k / 40) for k in range(400))
    assert rate.n_dropped == 0
