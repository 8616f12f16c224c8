"""The page's own pooling, in a browser, against `pooled` in Python; and what its filters do to all that it shows."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.deploy.compare.results.page.made_up import outcome_of
from tests.system.browser import chromium, watched_page
from tis.deploy.compare import Study
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results.files import results_of
from tis.deploy.compare.results.page_html import comparison_html
from tis.deploy.compare.results.pooled import person, pooled
from tis.deploy.compare.results.report import report as build_report
from tis.deploy.compare.study import plan_study

if TYPE_CHECKING:
    from playwright.sync_api import Page

DELAY, PROFILE = "network.forward.delay.delay_ms", "surgeon.copies"
AXES: dict[str, Any] = {DELAY: [10, 20, 1000], PROFILE: [1, 2]}
NAMES = ("hold", "damped_velocity", "moesp_kf")
SCORES = ("n_scored", "n_missing", "n_people", "r2_pct", "rmse_3d_mm", "ratio_to_hold", "coverage_pct")
INTERVALS = ("rmse_3d_mm_interval_95", "ratio_to_hold_interval_95")
_POOLED = """([filter, e]) => {
  const { pool } = window.comparison
  return pool.scores(pool.chosen(filter), e)
}"""
_CURVE = """(name) => {
  const data = Bokeh.documents[0].get_model_by_name(name).data
  return Object.fromEntries(["x", "y", "low", "high"].map((column) => [column, Array.from(data[column])]))
}"""
_HEAT = """() => {
  const data = Bokeh.documents[0].get_model_by_name("heat").data
  return { x: Array.from(data.x), ratio: Array.from(data.ratio) }
}"""
_DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def planned(**changes: Any) -> Plan:
    settings: dict[str, Any] = {"network.forward.delay": {"kind": "constant", "delay_ms": 1}}
    return plan_study(Study(scenario="default", settings=settings, estimators=NAMES, duration_s=4, **changes))


@pytest.fixture(scope="module")
def plan() -> Plan:
    return planned(axes=AXES, seeds=7)


@pytest.fixture(scope="module")
def outcome(plan: Plan) -> Outcome:
    return outcome_of(plan)


@pytest.fixture(scope="module")
def page(plan: Plan, outcome: Outcome, tmp_path_factory: pytest.TempPathFactory) -> Iterator["Page"]:
    file = tmp_path_factory.mktemp("page") / "comparison.html"
    results = results_of(plan, outcome, "tis compare </script><b>")
    file.write_text(comparison_html(results.report, results.sums))
    with chromium() as browser:
        page, errors = watched_page(browser)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(file.as_uri())
        yield page
        assert errors == []
        assert {url for url in asked if not url.startswith(("data:", "blob:"))} == {file.as_uri()}


@pytest.fixture(autouse=True)
def _as_opened(request: pytest.FixtureRequest) -> None:
    """Every test begins with the page as it opens."""
    if "page" in request.fixturenames:
        page = request.getfixturevalue("page")
        page.reload()
        page.wait_for_function("() => window.comparison")


def in_python(plan: Plan, outcome: Outcome, name: str, **chosen: Any) -> dict[str, Any]:
    """The scores of what a filter lets through, pooled by person."""
    units: dict[str, list[Any]] = {}
    for cell in plan.cells:
        at = next(point.values for point in plan.points if point.label == cell.setting)
        if not all(at[path] in values for path, values in chosen.get("axes", {}).items()):
            continue
        if person(cell) not in chosen.get("people", [person(cell)]):
            continue
        hands = outcome.cells[cell.digest]["hands"]
        units.setdefault(person(cell), []).extend(hands[hand] for hand in chosen.get("hands", hands))
    return pooled(list(units.values()), name)


def same(found: dict[str, Any], expected: dict[str, Any]) -> None:
    for name in SCORES:
        assert found[name] == pytest.approx(expected[name], rel=1e-9), name
    for name in INTERVALS:
        assert found[name] == pytest.approx(expected[name], rel=1e-9), name


@pytest.mark.parametrize("chosen", [
    {},
    {"hands": ["right"]},
    {"people": ["synthetic 8", "synthetic 10", "synthetic 13"]},
    {"people": ["synthetic 9"]},
    {"axes": {DELAY: ["20"]}},
    {"axes": {DELAY: ["10", "1000"], PROFILE: ["2"]}, "hands": ["left"], "people": ["synthetic 7", "synthetic 8"]},
])  # fmt: skip
def test_what_filters_let_through_is_pooled_as_in_python(
    page: "Page", plan: Plan, outcome: Outcome, chosen: dict[str, Any]
) -> None:
    about = page.evaluate("() => window.comparison.about")
    axes = [
        [axis["values"].index(value) for value in chosen["axes"][axis["path"]]]
        if axis["path"] in chosen.get("axes", {}) else None
        for axis in about["axes"]
    ]  # fmt: skip
    given = {name: chosen[name] for name in ("people", "hands") if name in chosen}
    places = {name: [about[name].index(one) for one in names] for name, names in given.items()}
    for e, name in enumerate(about["estimators"]):
        same(page.evaluate(_POOLED, [{"axes": axes, **places}, e]), in_python(plan, outcome, name, **chosen))


def test_controls_act_on_curves_map_age_and_table_at_once(page: "Page", plan: Plan, outcome: Outcome) -> None:
    page.locator("[data-chip=hands]", has_text="left").click()
    page.locator("[data-chip=estimators]", has_text="damped_velocity").click()
    page.locator("[data-axis='1']").fill("2")
    page.evaluate(_DRAWN)
    chosen: dict[str, Any] = {"axes": {PROFILE: ["2"]}, "hands": ["right"]}
    # curves: to a logarithmic scale, as the values span more than a factor of 20
    curve = page.evaluate(_CURVE, "ratio:moesp_kf")
    assert curve["x"] == pytest.approx([1, 1.30103, 3], abs=1e-5)
    for i, value in enumerate(("10", "20", "1000")):
        expected = in_python(plan, outcome, "moesp_kf", axes=chosen["axes"] | {DELAY: [value]}, hands=["right"])
        assert curve["y"][i] == pytest.approx(expected["ratio_to_hold"])
        assert [curve["low"][i], curve["high"][i]] == pytest.approx(expected["ratio_to_hold_interval_95"])
    assert page.evaluate(_CURVE, "rmse:damped_velocity")["y"] == []
    # table and words
    whole = in_python(plan, outcome, "moesp_kf", **chosen)
    rows = page.locator("#rows tr").all_inner_texts()
    assert [row.split("\t")[0] for row in rows] == ["moesp_kf", "hold"]  # the smallest error first
    assert rows[0].split("\t")[4] == f"{whole['rmse_3d_mm']:.3f}"
    words = f"{whole['n_scored']} scored ticks. Bands: 95 % bootstrap intervals over 7 people, one for each seed."
    assert page.locator("#words").inner_text() == words
    pooled = page.locator(".pooled").all_inner_texts()
    assert len(pooled) == 2  # beside the filters, and above the table
    assert all("(10, 20, 1000). At " in text for text in pooled)
    # map: the chosen row only
    page.locator("#of").select_option("moesp_kf")
    page.evaluate(_DRAWN)
    heat = page.evaluate(_HEAT)
    assert heat["x"] == [1, 1, 1]
    assert heat["ratio"] == pytest.approx(curve["y"])
    # age: as the report of the same cells
    age, about_ages = page.evaluate(_CURVE, "age:moesp_kf"), page.evaluate("() => comparison.about.age_edges_ms")
    one = plan_of(plan, chosen["axes"])
    cells = {name: {**cell, "hands": {"right": cell["hands"]["right"]}} for name, cell in outcome.cells.items()}
    bins: dict[float, list[float]] = {}
    for row in build_report(one, Outcome({}, cells), "")["rows"]:
        for entry in row["rmse_by_age_mm"] if row["estimator"] == "moesp_kf" else ():
            total = bins.setdefault(entry["from_ms"], [0.0, 0.0])
            total[0] += entry["n"]
            total[1] += entry["n"] * entry["rmse_3d_mm"] ** 2
    assert age["x"] == pytest.approx([low + 2 for low in sorted(bins)])  # at the ages there were, not mid-bin
    assert set(bins) <= set(about_ages)
    assert age["y"] == pytest.approx([(bins[low][1] / bins[low][0]) ** 0.5 for low in sorted(bins)])


def plan_of(plan: Plan, axes: dict[str, list[str]]) -> Plan:
    """The part of a plan at some values."""
    points = tuple(point for point in plan.points if all(point.values[path] in axes[path] for path in axes))
    labels = {point.label for point in points}
    cells = tuple(cell for cell in plan.cells if cell.setting in labels)
    return type(plan)(**{**vars(plan), "points": points, "cells": cells})


def test_nothing_chosen_and_one_person_are_said(page: "Page") -> None:
    page.locator("[data-every=people][data-to=false]").click()
    page.evaluate(_DRAWN)
    assert page.locator("#words").inner_text() == "Nothing is chosen that has a scored tick."
    page.locator("[data-chip=people]").nth(2).click()
    page.evaluate(_DRAWN)
    assert "of one person or device. No bands: intervals are over several." in page.locator("#words").inner_text()


def test_the_page_holds_all_that_it_needs_and_no_markup_of_others(plan: Plan, outcome: Outcome) -> None:
    results = results_of(plan, outcome, "tis compare </script><b>")
    text = comparison_html(results.report, results.sums)
    assert "default-src 'none'" in text
    assert "</script><b>" not in text
    about = re.findall(r'id="about">(.*?)</script>', text, re.DOTALL)
    assert json.loads(about[0])["people"] == [f"synthetic {seed}" for seed in range(7, 14)]


def test_along_one_axis_the_table_is_by_setting_and_the_pooled_one_is_folded() -> None:
    plan = planned(axes={DELAY: [10, 20, 1000]}, seeds=2)
    results = results_of(plan, outcome_of(plan), "tis compare")
    [table] = re.findall(
        r'<section id="table".*?</section>', comparison_html(results.report, results.sums), re.DOTALL
    )
    by_setting, _, pooled_one = table.partition("<details>")
    assert re.findall(r'<th scope="col"[^>]*>([^<]*)</th>', by_setting) == ["estimator", "10", "20", "1000"]
    row = next(row for row in results.report["rows"] if (row["estimator"], row["setting"]) == ("moesp_kf", "20"))
    assert f"{row['rmse_3d_mm']:.2f} ({row['ratio_to_hold']:.3f})" in by_setting
    assert 'id="rows"' in pooled_one
    assert 'id="rows"' not in by_setting


def test_a_comparison_without_a_sweep_has_table_and_age_alone(tmp_path: Path) -> None:
    plan = planned(seeds=2)
    results = results_of(plan, outcome_of(plan, ("left",)), "tis compare")
    text = comparison_html(results.report, results.sums)
    assert re.findall(r'<section id="(\w+)"', text) == ["answer", "choose", "age", "table", "repeat"]


def test_without_scripts_the_scores_of_each_setting_are_there() -> None:
    plan = planned(axes=AXES, seeds=2)
    results = results_of(plan, outcome_of(plan), "tis compare")
    page = comparison_html(results.report, results.sums)
    [table] = re.findall(r'<section id="table".*?</section>', page, re.DOTALL)
    [shown] = re.findall(r"<noscript>(.*?)</noscript>", table, re.DOTALL)
    for row in results.report["rows"]:
        assert f">{row['ratio_to_hold']:.3f}</td>" in shown
    assert shown.count("<table") == 6
