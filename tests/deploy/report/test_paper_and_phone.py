"""The reports of scenarios on paper, on a phone and on a desk, in a browser."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pytest
from rich.console import Console

from tests.system.browser import chromium, watched_page
from tis.deploy.run.conclude import Ending, Outputs, conclude
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder

pytestmark = pytest.mark.live

_DRAWN = "() => window.Bokeh && Bokeh.documents.length && Bokeh.documents.every((one) => one.is_idle)"
_TOO_WIDE = """() => [...document.querySelectorAll(".wide")]
  .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.getAttribute("aria-label"))"""
_ORDER = """() => [...document.querySelectorAll("section")]
  .map((one) => [one.getBoundingClientRect(), one.id])
  .filter(([box]) => box.height > 0).sort(([a], [b]) => a.top - b.top).map(([, id]) => id)"""


_HIGHEST_PX: Final = 7000


def _report(path: Path, name: str, settings: Sequence[str] = (), duration_s: float | None = None) -> Path:
    scenario = resolve(name, settings, None, duration_s)
    nodes, models, _ = build_sides(scenario)
    folder.write(path / folder.SCENARIO_FILE, "")
    run_twin(scenario, nodes, models, path)
    conclude(path, scenario, Ending("twin", f"tis twin {name}", 0, {}), Console(quiet=True), Outputs(merge=False))
    return path / folder.REPORT_FILE


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _report(tmp_path_factory.mktemp("default"), "default")


@pytest.mark.parametrize(
    ("name", "settings"),
    [("default", ("source.hands=[left, right]",)), ("touch", ("rate_hz=200",)), ("sight", ())],
)
def test_on_a_desk_the_page_opens_at_a_bounded_height(name: str, settings: Sequence[str], tmp_path: Path) -> None:
    path = _report(tmp_path, name, settings, 10.0)
    with chromium() as browser:
        page, found = watched_page(browser, width=1400)
        page.goto(path.as_uri())
        page.wait_for_function(_DRAWN)
        assert page.evaluate("document.documentElement.scrollHeight") <= _HIGHEST_PX
        assert found == []


@pytest.mark.slow
def test_on_paper_the_answer_comes_first_the_requirements_last_on_four_pages(report: Path) -> None:
    with chromium() as browser:
        page, found = watched_page(browser)
        page.goto(report.as_uri())
        page.wait_for_function(_DRAWN)
        paper = page.pdf(prefer_css_page_size=True)
        page.emulate_media(media="print")
        order = page.evaluate(_ORDER)
        assert found == []
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", paper)) <= 4
    assert (order[0], order[-1]) == ("answer", "requirements")


def test_on_a_phone_nothing_scrolls_sideways(report: Path) -> None:
    with chromium() as browser:
        page, found = watched_page(browser, width=400)
        page.goto(report.as_uri())
        page.wait_for_function(_DRAWN)
        page.evaluate("() => { for (const one of document.querySelectorAll('details')) one.open = true }")
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        assert page.evaluate(_TOO_WIDE) == []
        cell = page.locator("#requirements td").nth(0)
        assert cell.evaluate("one => getComputedStyle(one, '::before').content") == '"verdict: "'
        assert found == []
