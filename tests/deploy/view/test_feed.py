"""What a page is sent of a run of which everything is known."""

import itertools
from math import isnan

import pytest

from tests.deploy.watch.making import a_book, a_run
from tis.deploy.view.feed import Feed, LossBins, delay_columns
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.streams import Crossing

MS = 1_000_000
S = 1000 * MS


def test_a_frame_has_places_in_mm_and_time_in_s() -> None:
    frame = Feed().advance(a_book(100, rate_hz=50))
    assert (frame.arm, frame.master, frame.arms) == ("PSM2", "MTML", ("PSM2",))
    assert frame.now_s == pytest.approx(99 / 50 + 0.002)
    i = frame.track["t"].index(1.002)
    assert frame.track["tx"][i] == pytest.approx(100.2)
    assert frame.track["hx"][i] == pytest.approx(98.0)  # the sample of 0.98 s is the newest that arrived
    assert frame.track["error"][i] == frame.track["hold_error"][i] == pytest.approx(2.2)
    assert frame.master_track["mx"][:3] == pytest.approx([0.0, 4.0, 8.0])
    assert set(frame.delays["arm"]["delay"]) == {20.0}
    assert set(frame.age["age"]) == {22.0}
    assert len({len(column) for column in frame.track.values()}) == 1


def test_every_packet_of_every_stream_is_told_once_whatever_else_is_drawn() -> None:
    book, feed = LiveBook("tis"), Feed()
    told: dict[str, int] = dict.fromkeys(book.crossed, 0)
    for i, seen in enumerate(a_run(300, rate_hz=50)):
        book.take(seen)
        if i % 41 == 0:
            for name, columns in feed.advance(book).delays.items():
                told[name] += len(columns["t"])
        if i == 400:
            feed.arm = "PSM1"
    for name, columns in feed.advance(book).delays.items():
        told[name] += len(columns["t"])
    assert told == {name: trail.n for name, trail in book.crossed.items()}
    assert told["master"] > 250


def test_the_next_frame_has_only_what_is_new() -> None:
    book, feed = LiveBook("tis"), Feed()
    rows: list[float] = []
    for i, seen in enumerate(a_run(200, rate_hz=50)):
        book.take(seen)
        if i % 37 == 0:
            book.settle(seen.at_ns)
            rows += feed.advance(book).track["t"]
    book.settle(book.now_ns)
    rows += feed.advance(book).track["t"]
    assert feed.advance(book).track["t"] == []
    assert rows == sorted(set(rows))
    assert rows == Feed().advance(book).track["t"]


def test_a_page_that_was_away_gets_what_is_kept_and_no_more() -> None:
    book, feed = LiveBook("tis"), Feed()
    for seen in a_run(6000, rate_hz=50):
        book.take(seen)
    frame = feed.advance(book)
    assert len(frame.delays["arm"]["t"]) == 4000
    assert len(frame.losses["arm"]["t"]) <= 21


def test_a_fast_run_is_thinned_to_what_a_screen_shows() -> None:
    frame = Feed().advance(a_book(1000, rate_hz=1000))
    times = frame.track["t"]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 0.0139
    assert len(times) == pytest.approx(1 / 0.014, abs=3)


def test_another_arm_starts_over_with_what_is_kept() -> None:
    book, feed = a_book(100, rate_hz=50), Feed()
    assert feed.advance(book).starts_over
    book.tracks["PSM1"].append(book.tracks["PSM2"].all()[5])
    assert not feed.advance(book).starts_over
    feed.arm = "PSM1"
    frame = feed.advance(book)
    assert frame.starts_over
    assert (frame.arm, len(frame.track["t"])) == ("PSM1", 1)


def test_an_empty_book_makes_an_empty_frame() -> None:
    frame = Feed().advance(LiveBook("tis"))
    assert (frame.arm, frame.now_s, frame.track["t"], frame.losses["arm"]["loss"]) == (None, 0.0, [], [])


def test_losses_are_counted_in_half_seconds_that_are_decided() -> None:
    """20 packets at 10 Hz; of those in the second half second, three are lost."""
    lost = {6, 7, 8}
    crossings = [Crossing(i * 100 * MS, None if i in lost else MS) for i in range(20)]
    bins = LossBins()
    first = bins.add(crossings, decided_ns=1200 * MS)
    assert first == {"t": [0.25, 0.75], "loss": [0.0, 60.0]}
    assert bins.add([], decided_ns=2000 * MS) == {"t": [1.25, 1.75], "loss": [0.0, 0.0]}


def test_a_half_second_in_which_nothing_was_sent_breaks_the_line() -> None:
    bins = LossBins()
    columns = bins.add([Crossing(0, MS), Crossing(1200 * MS, MS)], decided_ns=2 * S)
    assert columns["t"] == [0.25, 0.75, 1.25, 1.75]
    assert [isnan(value) for value in columns["loss"]] == [False, True, False, True]


def test_a_lost_packet_is_marked_where_no_delay_is() -> None:
    columns = delay_columns([Crossing(S, 5 * MS), Crossing(2 * S, None)])
    assert columns["t"] == [1.0, 2.0]
    assert (columns["delay"][0], columns["lost"][1]) == (5.0, 0.0)
    assert isnan(columns["delay"][1])
    assert isnan(columns["lost"][0])
