"""The page's pace: a browser gets the next frame when it has drawn the last one."""

import re
from importlib.resources import files

import pytest
from bokeh.document import Document

from tests.deploy.watch.making import a_run
from tests.deploy.watch.test_safety import _point
from tis.common.messages import SafetyMode
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.units import NS_PER_S
from tis.deploy.view.page import Page
from tis.deploy.view.page_text import PageContext
from tis.deploy.view.steering import Steering
from tis.deploy.watch.book import LiveBook, Sighting
from tis.deploy.watch.observer import Attendance, Observer


class _Watched(Observer):
    """An observer that is told what it sees."""

    def __init__(self) -> None:
        super().__init__({}, "tis")
        self.met = Attendance()

    def see(self, seen: list[Sighting]) -> None:
        def take(book: LiveBook) -> None:
            for one in seen:
                book.take(one)
            book.settle(seen[-1].at_ns)

        self.read(take)

    def attendance(self) -> Attendance:
        return self.met


def _page(observer: Observer) -> tuple[Page, Document]:
    doc, steering = Document(), Steering(EmulatorAddress("tcp/127.0.0.1:1"))
    page = Page(doc, observer, steering, PageContext(True, "west", "east"), lambda: None)
    return page, doc


def _rows(doc: Document) -> int:
    figure = doc.get_model_by_name("plane_xy")
    assert figure is not None
    return len(figure.renderers[0].data_source.data["t"])  # type: ignore[attr-defined]


def test_a_frame_waits_until_the_browser_has_drawn_the_last_one() -> None:
    seen = list(a_run(300))
    observer = _Watched()
    observer.see(seen[:600])
    page, doc = _page(observer)
    page.refresh()
    first = _rows(doc)
    assert first > 0
    observer.see(seen[600:700])
    page.refresh()
    page.refresh()
    assert _rows(doc) == first
    page.pace.drawn = page.pace.sent
    page.refresh()
    assert _rows(doc) > first


def test_no_frame_is_owed_for_an_answer_that_was_never_asked_for() -> None:
    seen = list(a_run(300))
    observer = _Watched()
    observer.see(seen[:600])
    page, doc = _page(observer)
    page.refresh()
    page.pace.drawn = 10**9  # a browser may send anything
    observer.see(seen[600:700])
    page.refresh()
    rows = _rows(doc)
    observer.see(seen[700:800])
    page.refresh()
    assert _rows(doc) == rows


def test_the_end_is_told_to_a_browser_that_still_draws() -> None:
    observer = _Watched()
    observer.see(list(a_run(100)))
    page, doc = _page(observer)
    page.refresh()
    observer.met = Attendance(connected=True, left=frozenset({"netem"}))
    page.refresh()
    assert "ended" in doc.title


@pytest.mark.parametrize("is_drawing", [False, True])
def test_what_an_arm_does_is_told_at_once(is_drawing: bool) -> None:
    observer = _Watched()
    observer.see(list(a_run(100)))
    page, _ = _page(observer)
    modes: tuple[tuple[SafetyMode, str], ...] = (("safe", "stopped"), ("resuming", "resuming"), ("hold", "holding"))
    for at_s, (mode, word) in enumerate(modes, 1):
        observer.read(lambda book: book.safety.take("PSM2", _point(at_s, mode), NS_PER_S))  # noqa: B023
        page.pace.drawn = page.pace.sent - is_drawing
        page.refresh()
        assert f"<strong>{word}</strong>" in page.words.figures


def test_the_page_calls_surgeon_a_side_only_and_each_age_says_from_when() -> None:
    """What moves may be a drone's operator; the two sides keep their names."""
    template = " ".join(files("tis.deploy.view").joinpath("page.html").read_text(encoding="utf-8").split())
    assert re.findall(r"[^\"> ]+ [Ss]urgeon(?! of_run)[^ ]* \w+", template) == ["the surgeon's side"]
    for age in (
        "old, from its capture until now",
        "late</b>, from the newest command that it answers until it is shown",
    ):
        assert age in template
