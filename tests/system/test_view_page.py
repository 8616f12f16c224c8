"""The live page beside a real run, in a real browser."""

import logging
import os
import re
import signal
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.system.browser import chromium, live_page, watched_page
from tests.system.conftest import HOLD, Start, StartHere, Tis
from tests.system.test_failures import MODULES, PATIENCE_S, assert_ended_in_order, gone

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.live

_LOG = logging.getLogger(__name__)
_HEAD = "Bokeh.documents[0].get_model_by_name('plane_xy').renderers.at(-1).data_source.get_column"
_PLACE = f"() => JSON.stringify(Array.from({_HEAD}('ex')))"
_AT_S = f"() => {_HEAD}('t')[0]"
_INK = "() => [...Bokeh.documents[0].get_model_by_name('age').renderers].map(r => r.glyph.line_color.value)"
_FOCUSED = """() => {
  let at = document.activeElement
  while (at.shadowRoot?.activeElement) at = at.shadowRoot.activeElement
  return (at.labels?.[0] ?? at).textContent.trim()
}"""


def _tree(page: "Page") -> str:
    tree: str = page.locator("body").aria_snapshot()
    return tree


def url_of(tis: Tis) -> str:
    """Return the address that `tis run` prints, once it does."""
    assert tis.process.stderr is not None
    for line in tis.process.stderr:
        found = re.search(r"http://\S+", line)
        if found is not None:
            return found[0]
    raise AssertionError(tis.process.communicate())


def _is_gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def port_of(url: str) -> int:
    return int(url.rpartition(":")[2].partition("/")[0])


def is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1)
        return probe.connect_ex(("127.0.0.1", port)) != 0


def _open(page: "Page", url: str, begun_s: float) -> float:
    """Open the live page and wait until the arm moves; return the s since ``begun_s``."""
    page.goto(url)
    page.wait_for_function("() => window.Bokeh && Bokeh.documents.length > 0")
    page.wait_for_function(f"() => ({_PLACE})() !== '[]'")
    return time.monotonic() - begun_s


def test_the_page_lives_with_the_run_and_its_buttons_act(start: Start) -> None:
    settings = ("network.forward.loss=null", "network.feedback.loss=null", "estimators=[hold, innovations_kf]")
    words = ["--no-merge", *(word for text in settings for word in ("--set", text))]
    tis = start("run", "default", "--view", "--duration-s", "600", *words, pages=True)  # the test ends it
    url = url_of(tis)
    begun_s = time.monotonic()
    assert url.startswith("http://127.0.0.1:")
    with chromium() as browser:
        page, found = live_page(browser)
        _LOG.warning("live %.1f s after its address was printed", _open(page, url, begun_s))

        before = page.evaluate(_PLACE), page.evaluate(_AT_S)
        page.wait_for_function(f"before => ({_PLACE})() !== before", arg=before[0])
        page.wait_for_function("() => document.title.startsWith('tis live: Running')")
        for side in ("surgeon running", "netem running", "patient running"):
            page.get_by_text(re.compile(side)).first.wait_for()

        # who cannot see is told what each thing is, and who has no mouse comes to each in the order of reading
        assert not re.findall(r"^\s*- (?:button|textbox|combobox|img)\b(?! ['\"])", _tree(page), re.MULTILINE)
        page.get_by_role("button", name="Dark page").focus()
        for name in (
            "the patient's estimate",
            "the arm itself, which no operator can see",
            "Stop the arms",
            "Release",
            "Which way",
            "Outage, ms",
            "Cause an outage",
            "Delay, ms",
            "Set delay",
        ):
            page.keyboard.press("Tab")
            assert page.evaluate(_FOCUSED) == name

        page.get_by_label("Outage, ms").fill("700")
        page.get_by_label("Outage, ms").press("Tab")
        page.get_by_role("button", name="Cause an outage").click()
        page.get_by_text("Cause an outage: done").wait_for()
        page.wait_for_function(
            "() => Bokeh.documents[0].get_model_by_name('loss').renderers"
            ".some(r => Array.from(r.data_source.get_column('loss')).some(v => v > 50))",
        )
        assert page.evaluate(_AT_S) > before[1]
        for width in (1280, 500):
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_function("w => document.documentElement.scrollWidth <= w", arg=width)
        assert found == []
        assert page.evaluate(_INK) == ["#1b1f24"]
        page.get_by_role("button", name="Dark page").click()
        assert page.evaluate(_INK) == ["#e6ebf0"]

        children = tis.children()
        assert len(children) == len(MODULES) + 1  # the page's process is a child like the sides
        sides = [tis.child(module) for module in MODULES.values()]
        assert not is_free(port_of(url))
        tis.process.send_signal(signal.SIGINT)
        assert gone(sides, PATIENCE_S)
        page.wait_for_function("() => document.title.startsWith('tis live: The run has ended')")
        page.get_by_text(str(tis.run_dir / "report.html")).wait_for()
        link = page.get_by_role("link", name="Open the report of this run")
        link.wait_for()
        assert page.get_by_role("button", name="Cause an outage").is_disabled()
        assert gone(children, 2 * PATIENCE_S)
        assert_ended_in_order(tis)
        assert is_free(port_of(url))
        # with the server gone nothing is sent any more, and that is no error
        page.set_viewport_size({"width": 900, "height": 700})
        page.wait_for_function("() => window.live.isOver()")
        assert not page.get_by_role("alert").is_visible()
        assert page.get_by_text("Client connection").count() == 0  # Bokeh's own words
        with page.expect_popup() as opened:
            link.click()
        opened.value.get_by_role("heading", level=1).wait_for()
        assert opened.value.content().count("<section") == (tis.run_dir / "report.html").read_text().count("<section")
        assert found == []
        opened.value.close()
        page.close()
        _assert_report_is_drawn(browser, tis.run_dir / "report.html")

    links = tis.summary()["links"].values()
    # nothing else is lost, and 700 ms of two streams at 30 Hz are 42; a busy surgeon or patient sends fewer
    assert all(0 < link["dropped"] <= 48 for link in links)


def _assert_report_is_drawn(browser: "Browser", report: Path) -> None:
    page, found = watched_page(browser)
    page.goto(report.as_uri())
    page.wait_for_function("() => window.Bokeh && Bokeh.documents.length > 0")
    n_figures = page.evaluate("document.querySelectorAll('figure .plots').length")
    assert n_figures >= 5
    page.wait_for_function("n => document.querySelectorAll('.bk-Figure, .bk-GridPlot').length >= n", arg=n_figures)
    assert found == []


def test_the_page_ends_with_a_run_that_is_killed(start: Start) -> None:
    tis = start("run", "default", "--view", "--duration-s", "30", *HOLD)
    port = port_of(url_of(tis))
    tis.await_log("patient")  # the children are then ours to end, so they must all be there
    view = tis.child("tis.deploy.view")
    children = tis.children()
    assert not is_free(port)
    tis.process.send_signal(signal.SIGKILL)
    until_s = time.monotonic() + 10
    while not (_is_gone(view) and is_free(port)):
        assert time.monotonic() < until_s
        time.sleep(0.05)
    tis.process.wait(10)
    for pid in children:
        if not _is_gone(pid):
            os.kill(pid, signal.SIGKILL)


def test_a_port_that_is_taken_is_said_before_anything_runs(run_here: StartHere) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        tis = run_here("run", "default", "--view", "--port", str(port))
        code, _, err = tis.wait()
    assert code == 2
    assert err.splitlines() == [f"tis: tis view: --port: cannot listen there: Address already in use (got {port})"]
    assert not tis.run_dir.exists()
