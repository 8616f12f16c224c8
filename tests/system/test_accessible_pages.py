"""No page has what axe counts as a barrier, in light and in dark, contrast and order of focus included."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.deploy.compare.results.page.made_up import outcome_of
from tests.deploy.compare.results.page.test_comparison_html import AXES, planned
from tests.deploy.studies.admissible.test_page import report as admissible_report
from tests.system.axe import axe_file, violations
from tests.system.browser import chromium, live_page, watched_page
from tests.system.conftest import HOLD, Start
from tests.system.test_view_page import url_of
from tis.deploy.compare.results.files import results_of
from tis.deploy.compare.results.page_html import comparison_html
from tis.deploy.studies.admissible.plots import admissible_html

if TYPE_CHECKING:
    from playwright.sync_api import Page


def _found(page: "Page") -> list[str]:
    return violations(page, "light") + violations(page, "dark")


def test_the_pages_of_studies(tmp_path: Path) -> None:
    axe_file()
    plan = planned(axes=AXES, seeds=7)
    results = results_of(plan, outcome_of(plan), "tis compare")
    pages = {
        "admissible": admissible_html(admissible_report(), b'<svg xmlns="http://www.w3.org/2000/svg"/>'),
        "comparison": comparison_html(results.report, results.sums),
    }
    with chromium() as browser:
        for name, text in pages.items():
            file = tmp_path / f"{name}.html"
            file.write_text(text)
            page, _ = watched_page(browser)
            page.goto(file.as_uri())
            assert _found(page) == [], name
            page.close()


@pytest.mark.live
def test_the_report(start: Start) -> None:
    axe_file()
    run = start("twin", "default", "--duration-s", "6", pages=True)
    assert run.wait()[0] in (0, 5)
    with chromium() as browser:
        page, _ = watched_page(browser)
        page.goto((run.run_dir / "report.html").as_uri())
        page.wait_for_function("() => window.Bokeh && Bokeh.documents.length > 0")
        assert _found(page) == []


@pytest.mark.live
def test_the_page_that_drives(start: Start, model_file: Path) -> None:
    axe_file()
    tis = start("run", "drive", "--view", *HOLD, "--set", f"identification.train={model_file}")
    url = url_of(tis)
    with chromium() as browser:
        page, _ = live_page(browser)
        page.goto(url)
        page.wait_for_function("() => document.getElementById('late').textContent !== '–'")
        page.get_by_label("Delay, ms").fill("abc")
        assert _found(page) == []
    tis.process.terminate()
    tis.wait()
