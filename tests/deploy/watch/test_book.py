"""What an observer knows of a run of which everything is known."""

from collections.abc import Iterator
from statistics import median

import pytest

from tests.deploy.watch.making import LEFT, STARTED_NS, a_book, a_run, pose, sighting
from tests.deploy.watch.test_arms import _arm, _display
from tis.common.channels import Side
from tis.common.messages import Header, encode
from tis.common.peer_life import Beat
from tis.common.runtime.control import ControlKeys
from tis.common.units import NS_PER_MS
from tis.deploy.watch.book import LiveBook, Sighting


def test_delays_losses_ages_and_errors_are_those_of_the_run() -> None:
    """20 ms of delay at 100 Hz and 0.1 m/s: at the tick the newest sample is 22 ms old, and 2.2 mm behind."""
    book = LiveBook("tis")
    for seen in a_run(300, lost=frozenset({250, 251, 252})):
        book.take(seen)
    book.settle(STARTED_NS + 100_000 * NS_PER_MS)
    found = book.figures(window_s=0.995)
    assert found.streams["arm"].n == found.streams["master"].n == 100
    assert found.streams["arm"].n_lost == found.streams["master"].n_lost == 3
    assert found.streams["arm"].delay_p50_ms == found.streams["answers"].delay_p50_ms == 20
    assert found.streams["answers"].n_lost == 0
    assert median(row.age_ms for row in book.ages["PSM2"].all()) == 22
    assert found.end_to_end_p99_ms == pytest.approx(22)  # ticks without a new sample do not count
    errors = sorted({round(row.error_mm, 6) for row in book.tracks["PSM2"].all()})
    assert errors == [2.2, 3.2, 4.2, 5.2]
    assert found.ratio_to_hold == pytest.approx(1.0)


def test_the_masters_movement_is_its_own() -> None:
    rows = a_book(11).masters["MTML"].all()
    assert [row.place_m[0] for row in rows] == pytest.approx([0.002 * i for i in range(11)])


def _beat(side: Side, ticks_missed: int | None) -> Sighting:
    beat = Beat(side=side, at_ns=5, loop_ns=5, ticks_missed=ticks_missed)
    return Sighting("east", ControlKeys("tis").beat(side), 0, b"", encode(beat))


def _without(ticks: range) -> Iterator[Sighting]:
    """Yield a run at 100 Hz of whose patient these ticks were missed: its messages have the numbers of its ticks."""
    return (seen for seen in a_run(400) if seen.key != LEFT.estimated.key("tis") or _seq(seen) not in ticks)


def _seq(seen: Sighting) -> int:
    header = Header.unpack(seen.attachment)
    assert header is not None
    return header.seq


def test_missed_ticks_are_those_that_the_sides_tell() -> None:
    book = LiveBook("tis")
    for seen in (_beat("surgeon", None), _beat("patient", 2), _beat("patient", 1), _beat("patient", 7)):
        book.take(seen)
    assert book.ticks_missed == {"patient": 7}  # a surgeon of others may tell none
    book.take(_beat("surgeon", 3)._replace(key=ControlKeys("tis").beat("patient")))
    assert book.ticks_missed == {"patient": 7}
    book.take(_beat("surgeon", 3))
    assert book.ticks_missed == {"patient": 7, "surgeon": 3}


def test_the_numbers_of_missed_ticks_are_no_packets_that_the_observer_did_not_see() -> None:
    book = LiveBook("tis")
    for seen in _without(range(300, 350)):
        book.take(seen)
    assert not book.figures(window_s=4).keeps_up
    book.take(_beat("patient", 50))
    assert book.figures(window_s=4).keeps_up


@pytest.mark.parametrize("thinning", [1, 4])
def test_what_the_observer_itself_misses_is_no_loss_of_the_network(thinning: int) -> None:
    book = LiveBook("tis")
    book.set_thinning(thinning)
    for i, seen in enumerate(a_run(400)):
        if not (1000 <= i < 1400 and i % 3):  # for a while it sees a third of everything
            book.take(seen)
    book.settle(STARTED_NS + 100_000 * NS_PER_MS)
    found = book.figures(window_s=4)
    assert not found.keeps_up
    assert found.streams["arm"].n_lost is None
    assert found.streams["arm"].loss_pct is None
    assert "No loss is shown: the observer cannot keep up" in found.limit_text


def test_what_is_not_ours_changes_nothing() -> None:
    book = LiveBook("tis")
    whole = sighting("west", LEFT.arm, 0, 0, 0, pose(0, 0.0))
    book.take(whole._replace(key="tis/other/measured_cp"))
    book.take(whole._replace(attachment=b"foreign"))
    book.take(whole._replace(payload=b"{}"))
    assert not book.tracks
    assert book.figures().streams["arm"].n == 0


def test_thinned_out_the_figures_stay_the_same_and_nothing_counts_as_lost() -> None:
    book = LiveBook("tis")
    for i, seen in enumerate(a_run(400)):
        if i == 777:
            book.set_thinning(4)
        book.take(seen)
    book.settle(STARTED_NS + 100_000 * NS_PER_MS)
    found = book.figures(window_s=1)
    assert found.streams["arm"].n == 25
    assert found.streams["arm"].n_lost == 0
    assert found.streams["arm"].delay_p50_ms == 20
    assert median(row.age_ms for row in book.ages["PSM2"].all()) == 22
    assert found.hold_rmse_mm == pytest.approx(2.2)  # hold is not thinned out


def test_a_packet_that_arrived_after_all_is_not_counted_as_lost() -> None:
    book = LiveBook("tis")
    payload = pose(0, 0.0)
    book.take(_beat("patient", 0))  # the other network is heard
    book.take(sighting("west", LEFT.arm, 0, 0, 0, payload))
    book.settle(STARTED_NS + 600 * NS_PER_MS)
    assert book.figures().streams["arm"].n == 0  # it may be under way
    book.settle(STARTED_NS + 2000 * NS_PER_MS)
    assert book.figures().streams["arm"].n_lost == 1
    book.take(sighting("east", LEFT.arm, 0, 0, 700 * NS_PER_MS, payload))
    arm = book.figures().streams["arm"]
    assert (arm.n, arm.n_lost, arm.delay_p50_ms) == (1, 0, 700)


def _arrivals_heard_from(ms: int | None) -> LiveBook:
    """A run of 4 s without loss whose arm's arrivals are heard from an instant on, or never; the master's always."""
    arm, book = LEFT.arm.key("tis"), LiveBook("tis")
    for seen in a_run(400):
        is_early = ms is None or seen.at_ns < STARTED_NS + ms * NS_PER_MS
        if not (seen.key == arm and seen.network == "east" and is_early):
            book.take(seen)
        book.settle(seen.at_ns)
    return book


def test_what_was_sent_before_a_key_is_listened_to_is_not_lost() -> None:
    """A busy observer listens to one key after the other: it heard the master a second before the arm."""
    book = _arrivals_heard_from(1000)
    assert [row for row in book.crossed["arm"].all() if row.delay_ns is None] == []


def test_where_all_is_lost_it_is_told_from_2_s_on() -> None:
    lost = [row.sent_ns for row in _arrivals_heard_from(None).crossed["arm"].all() if row.delay_ns is None]
    assert lost == []  # not yet: the last ones may arrive, the others may not have been listened to
    book = _arrivals_heard_from(None)
    book.settle(STARTED_NS + 7000 * NS_PER_MS)
    lost = [row.sent_ns for row in book.crossed["arm"].all() if row.delay_ns is None]
    assert (min(lost), max(lost)) == (2020 * NS_PER_MS, 3990 * NS_PER_MS)


def test_memory_is_bounded() -> None:
    book = LiveBook("tis")
    book.take(_beat("patient", 0))
    for i in range(9000):
        book.take(Sighting("west", LEFT.command.key("tis"), i, b"", b""))
        book.take(sighting("west", LEFT.command, i, i * NS_PER_MS, i * NS_PER_MS, pose(i * NS_PER_MS, 0.0)))
    book.settle(STARTED_NS + 100_000 * NS_PER_MS)
    assert len(book.masters["MTML"].all()) == len(book.crossed["master"].all()) == 4000


def test_what_arrived_before_a_long_silence_is_not_told_as_of_now() -> None:
    for n, silent_s in ((250, None), (450, 2.51)):  # after sample 199 nothing crosses
        book = LiveBook("tis")
        for seen in a_run(n, lost=frozenset(range(200, 1000))):
            book.take(seen)
        found = book.figures()
        assert found.silent_s == (None if silent_s is None else pytest.approx(silent_s, abs=0.03))
        assert (found.end_to_end_p50_ms is None) == (silent_s is not None)
        assert found.display_silent_s is None, "no display was ever seen"


def test_a_display_that_shows_the_same_answer_for_long_has_no_error_of_now() -> None:
    book = LiveBook("tis")
    displays = (
        (1000, 900),
        (1100, 1000),
        (2000, 1000),
        (3200, 1000),
    )  # instant, newest command behind it, ms
    for k, (t_ms, command_ms) in enumerate(displays):
        for network, channel, payload in (
            ("east", LEFT.measured, _arm(t_ms, 0.0, t_ms)),  # the way there is open
            ("west", LEFT.predicted, _display(t_ms, 0.0, 0.0, t_ms - command_ms)),
            ("west", LEFT.command, pose(t_ms * NS_PER_MS, 0.0)),
        ):
            book.take(sighting(network, channel, k, t_ms * NS_PER_MS, t_ms * NS_PER_MS, payload))  # type: ignore[arg-type]
        if t_ms == 2000:
            assert book.figures().display == (0.0, 0.0)
    assert book.figures().display is None
    assert book.figures().display_silent_s == pytest.approx(2.1)


def test_a_large_age_is_no_gap_and_a_gap_is_told_beside_it() -> None:
    far = a_book(delay_ms=600).figures()
    assert far.age_max_ms == 602
    assert far.gap_max_ms == 10, "samples came all the time"
    book = LiveBook("tis")
    for seen in a_run(300, lost=frozenset(range(150, 230))):
        book.take(seen)
    assert book.figures().gap_max_ms == 810
