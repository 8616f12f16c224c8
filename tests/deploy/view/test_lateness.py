"""The lateness of what the surgeon sees and the network's part of it, of the same messages."""

from tests.deploy.watch.making import LEFT, sighting
from tests.deploy.watch.test_arms import _display
from tis.common.units import NS_PER_MS
from tis.deploy.view.lateness import late_ms, network_ms
from tis.deploy.watch.book import LiveBook
from tis.deploy.watch.streams import Crossing

PERIOD_MS = 33


def _seen(delays_ms: list[int], rest_ms: int = 40, wrong: int = 0) -> LiveBook:
    """Return a book at the end of a run whose command ``k`` needs ``delays_ms[k]``, and its answer as long.

    The observer stamps one command of ``wrong`` far too early.
    """
    book = LiveBook("tis")
    for k, delay_ms in enumerate(delays_ms):
        sent_ms = 1000 + PERIOD_MS * k
        stamped_ms = 5 if wrong and k % wrong == 0 else delay_ms
        book.crossed["master"].append(Crossing(sent_ms * NS_PER_MS, stamped_ms * NS_PER_MS))
        book.crossed["answers"].append(Crossing((sent_ms + delay_ms) * NS_PER_MS, delay_ms * NS_PER_MS))
    for k, delay_ms in enumerate(delays_ms):
        late = 2 * delay_ms + rest_ms
        at_ms = 1000 + PERIOD_MS * k + late
        book.now_ns = at_ms * NS_PER_MS
        book.take(sighting("west", LEFT.predicted, 0, 0, 0, _display(at_ms, 0.0, 0.0, late)))
    return book


def test_the_networks_part_and_the_rest_are_of_the_same_messages() -> None:
    assert network_ms(_seen([100] * 120), "PSM2") == 200.0
    assert network_ms(_seen([100] * 120, wrong=4), "PSM2") == 200.0, "stamps of a busy observer"
    # a queue that fills: what is sent now arrives later than what is seen now
    filling = _seen([100 + 5 * k for k in range(120)])
    late, part = late_ms(filling, "PSM2"), network_ms(filling, "PSM2")
    assert late is not None
    assert part is not None
    assert 30.0 <= late - part <= 50.0


def test_before_anything_is_seen_and_of_a_frozen_picture_there_is_no_part() -> None:
    assert network_ms(LiveBook("tis"), "PSM2") is None
    assert network_ms(LiveBook("tis"), None) is None
    book = _seen([100] * 120)
    book.now_ns += 400 * NS_PER_MS
    assert network_ms(book, "PSM2") is None


def test_lateness_is_the_median_of_new_pictures_and_of_a_frozen_one_its_age() -> None:
    book = LiveBook("tis")
    for k, late in enumerate([210, 240, 210, 500, 210, 240, 210]):
        book.take(sighting("west", LEFT.predicted, 0, 0, 0, _display(1000 + 33 * k, 0.0, 0.0, late)))
    book.now_ns = 1200 * NS_PER_MS
    assert late_ms(book, "PSM2") == 210.0
    for k in range(7, 30):  # nothing new: the same command grows older
        book.take(sighting("west", LEFT.predicted, 0, 0, 0, _display(1000 + 33 * k, 0.0, 0.0, 210 + 33 * (k - 6))))
    assert late_ms(book, "PSM2") == 210.0
    book.now_ns = 1957 * NS_PER_MS
    assert late_ms(book, "PSM2") == 210.0 + 33 * 23
