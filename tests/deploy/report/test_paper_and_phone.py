"""The report of the default scenario on paper and on a phone, in a browser."""

import re
from pathlib import Path

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


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("default")
    scenario = resolve("default", (), None, None)
    nodes, models, _ = build_sides(scenario)
    folder.write(path / folder.SCENARIO_FILE, "")
    run_twin(scenario, nodes, models, path)
    conclude(path, scenario, Ending("twin", "tis twin default", 0, {}), Console(quiet=True), Outputs(merge=False))
    return path / folder.REPORT_FILE


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
