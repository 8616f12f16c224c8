"""Figures: bounded sources and axes that do not breathe."""

import pytest

from tests.deploy.watch.making import a_book, a_run
from tis.deploy.present.palette import TRUTH, look_of
from tis.deploy.view import plots
from tis.deploy.view.feed import Feed
from tis.deploy.view.plots import Plots, Window
from tis.deploy.watch.book import LiveBook


def test_a_frame_is_drawn_and_the_axes_follow() -> None:
    drawn = Plots()
    drawn.show(Feed().advance(a_book(600, rate_hz=50)))
    assert (drawn.time.start, drawn.time.end) == (11.982 - 10, 11.982)
    assert len(drawn.head.data["t"]) == 1
    assert drawn.head.data["tx"][0] - drawn.head.data["hx"][0] - 2.2 < 1e-9
    x, y = drawn.windows["xy x"], drawn.windows["xy y"]
    assert x.range is drawn.plane_xy.x_range
    assert x.begin < 198 < 1198 < x.end
    assert x.end - x.begin == pytest.approx(y.end - y.begin)  # equal scales
    assert drawn.windows["delay"].end > 20


def test_sources_are_bounded_however_long_the_run() -> None:
    drawn, feed, book = Plots(), Feed(), LiveBook("tis")
    for i, seen in enumerate(a_run(2000, rate_hz=50)):
        book.take(seen)
        if i % 500 == 0:
            book.settle(seen.at_ns)
            drawn.show(feed.advance(book))
    sources = [drawn.track, drawn.trail, drawn.age, *drawn.delays.values(), *drawn.losses.values()]
    assert max(len(source.data["t"]) for source in sources) == 720
    assert len(drawn.trail.data["t"]) == 90


def test_every_figure_says_what_its_axes_are() -> None:
    drawn = Plots()
    flat = {name: fig for name, fig in drawn.roots().items() if name != plots.SCENE}
    for name, fig in flat.items():
        assert str(fig.yaxis[0].axis_label).endswith((", mm", ", ms", ", %", ", °", ", N", ", mJ")), name
    last = [fig.xaxis[0].axis_label for name, fig in flat.items() if name != "position_x"]
    assert last.count("run time, s") == 8


def test_a_window_stays_while_what_it_shows_fits_and_fills_it() -> None:
    window = Window(min_width=2)
    window.fit(10, 20)
    before = (window.begin, window.end)
    assert before == (window.range.start, window.range.end) == (15 - 6.5, 15 + 6.5)
    window.fit(9.5, 20.5)
    assert (window.begin, window.end) == before
    window.fit(11, 30)
    assert window.begin < 11 < 30 < window.end
    window.fit(11, 11.1)
    assert window.end - window.begin == pytest.approx(2 * 0.65 * 2)


def test_the_colours_are_the_reports() -> None:
    assert TRUTH.tone == plots.TRUTH
    assert look_of("hold").tone == plots.HOLD
    assert look_of("innovations_kf").tone == plots.ESTIMATE
