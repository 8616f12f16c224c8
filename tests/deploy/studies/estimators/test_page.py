"""The page on estimators: words for all, and tables from made-up results."""

import shlex
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.markdown_tables import ragged_rows
from tis.common.estimators import ESTIMATORS, NAMES
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.plan import Plan, make_plan
from tis.deploy.compare.results.pooled import interval_note
from tis.deploy.compare.results.report import report
from tis.deploy.studies.estimators.page import Section, command_of, page_text, sections


def _result(plan: Plan, worse: float) -> dict[str, Any]:
    def hand() -> dict[str, Any]:
        def entry(i: int) -> dict[str, Any]:
            sse = 1e-4 * worse / (1 + i)
            return {
                "sse_m2": [sse, sse, sse],
                "n_missing": 0,
                "n_covered": 95,
                "n_ellipsoids": 100 if i else 0,
                "sse_by_age_m2": [0.0, 3 * sse] + [0.0] * 15,
                "step_ns": {"900": 7},
                "error_nm": {"1400": 100},
                "trained": i > 0,
            }

        return {
            "n_scored": 100,
            "sst_m2": [1e-2, 1e-2, 1e-2],
            "range_m": [0.1, 0.1, 0.0],
            "n_by_age": [0, 100] + [0] * 15,
            "orientation": {name: _turns(k) for k, name in enumerate(("tangent_ls", "hold"))},
            "age_sum_by_age_ns": [0, 100 * 35_000_000] + [0] * 15,
            "age_sum_ns": 100 * 35_000_000,
            "age_ns": {"17379": 100},
            "estimators": {name: entry(i) for i, name in enumerate(plan.estimators)},
        }

    def _turns(k: int) -> dict[str, Any]:
        counts = {"n_covered": 95, "n_ellipsoids": 100, "n_gripper_covered": 94, "n_gripper_intervals": 100}
        sums = {"sse_rad2": 0.01 * (1 + k), "sse_gripper_rad2": 0.02 * (1 + k)}
        return {**sums, **counts, "n_scored": 100, "n_gripper_scored": 100, "n_missing": 0, "step_ns": {"900": 7}}

    traffic = {"sent_packets": 120, "sent_bytes": 24_000}
    return {"traffic": traffic, "duration_s": 2.0, "hands": {"left": hand()}, "warnings": []}


@pytest.fixture(scope="module")
def found() -> list[tuple[Section, dict[str, Any]]]:
    """The sections where there are no recorded trials, with their made-up results."""
    found = []
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.delenv("TIS_JIGSAWS", raising=False)
        for section in sections():
            plan = make_plan(section.request)
            cells = {cell.digest: _result(plan, 1 + i) for i, cell in enumerate(plan.cells)}
            trainings = {
                digest: {"train_s": dict.fromkeys(plan.estimators, 0.5), "warnings": []} for digest in plan.trainings
            }
            found.append((section, report(plan, Outcome(trainings, cells), command_of(section.request))))
    return found


def test_every_estimator_has_its_words() -> None:
    for name in NAMES:
        assert ESTIMATORS[name].words.count(".") >= 2, name
        assert ESTIMATORS[name].words.endswith(".")


def test_the_page_has_a_table_for_each_section_and_every_row_its_columns(
    found: list[tuple[Section, dict[str, Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    text = page_text(found)
    assert len(found) == 7 + 2 + 1  # and an arm that lags, and orientation
    for name in NAMES:
        assert f"- **`{name}`**: {ESTIMATORS[name].words}" in text
    for section, made in found:
        assert f"## {section.title}\n" in text
        assert made["command"] in text
    assert ragged_rows(text) == []
    assert "| 2 | 35.00 | 35.00 | 35.00 | 60.00 | 12.00 |" in text  # age, packets and kB of two copies, as made up
    assert "None" not in text


def test_the_best_of_each_setting_is_the_one_with_the_smallest_ratio(
    found: list[tuple[Section, dict[str, Any]]],
) -> None:
    section, made = found[0]
    last = section.request.estimators[-1] if section.request.estimators else ""
    assert f"{last} is best at each of the 5 settings: its error is " in page_text([(section, made)])


def test_an_explanation_is_told_once(found: list[tuple[Section, dict[str, Any]]]) -> None:
    section, made = found[0]
    text = page_text([(section, made), (replace(section, title="Again"), made)])
    assert text.count(section.about) == 1
    assert f"## Again\n\nAs in *{section.title}*.\n" in text


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ((8, 4), "rest on 4 people only. They cannot be wider than the range of these people's own figures, which "
         "holds the median of all people with a probability of 88 %; it takes 6 people"),
        ((1,), "There is no interval"),
        ((6, 7), ""),
        ((), ""),
    ],
)  # fmt: skip
def test_intervals_over_few_people_say_so(counts: tuple[int, ...], words: str) -> None:
    note = interval_note([{"n_people": n} for n in counts])
    assert words in note
    assert bool(note) == bool(words)


def test_the_page_says_once_that_people_are_few(found: list[tuple[Section, dict[str, Any]]]) -> None:
    n_people = {row["n_people"] for _, made in found for row in made["rows"]}
    assert n_people == {4}
    assert page_text(found).count("- **Few people**: The 95 % intervals rest on 4 people only.") == 1


def test_the_commands_ask_for_what_the_sections_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    for section in sections():
        words = shlex.split(command_of(section.request))
        assert words[:3] == ["tis", "compare", "default"]
        settings = [value for option, value in pairwise(words) if option == "--set"]
        assert tuple(settings) == section.request.settings
        for setting in settings:
            yaml.safe_load(setting.partition("=")[2])


def test_recorded_trials_are_compared_where_there_are_any(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TIS_JIGSAWS", "somewhere")
    titles = [section.title for section in sections()]
    recorded = [title.removesuffix(", recorded suturing") for title in titles if "recorded" in title]
    synthetic = [title.removesuffix(", synthetic") for title in titles if "recorded" not in title]
    assert [title for title in recorded if title not in synthetic] == [
        "Constant delay, rows taken as even",
        "The paper's rows 1 to 5, delays read as milliseconds",
        "The paper's rows 1 to 5, delays read as samples of 1/30 s",
    ]
    assert [title for title in synthetic if title not in recorded] == [
        "An arm that lags",
        "An arm that lags, commands at once",
    ]


def test_a_section_of_recordings_takes_all_trials_or_the_last_of_each_person(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "Suturing" / "kinematics" / "AllGestures"
    folder.mkdir(parents=True)
    for name in ("C001", "C003", "D002"):
        (folder / f"Suturing_{name}.txt").touch()
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path))
    recorded = [section.request for section in sections() if "recorded" in section.title]
    assert [request.trials for request in recorded] == [
        *[None] * 2,
        *[("C003", "D002")] * 6,
        None,
        *[("C003", "D002")] * 2,
    ]
    assert "--trials C003,D002" in command_of(recorded[-1])


def test_the_papers_figures_stand_beside_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """R² as made up: 100 (1 - sse / sst) is 98 % for the fourth estimator of the first cell, less for later ones."""
    monkeypatch.setenv("TIS_JIGSAWS", "somewhere")
    section = next(section for section in sections() if section.shows == "paper")
    settings = section.request.sweeps[0].values
    row: dict[str, Any] = {
        "estimator": "innovations_kf",
        "r2_pct": [96.0, 96.0, 96.0],
        "rmse_3d_mm": 1.0,
        "ratio_to_hold": 0.5,
        "n_people": 1,
    }
    row |= {"ratio_to_hold_interval_95": None, "coverage_pct": 95.0, "train_s": 1.0}
    row |= {"step_us": {"p50": 5.0, "p99": 6.0}, "rmse_by_age_mm": []}
    rows = [row | {"setting": setting} for setting in settings]
    about = [{"setting": setting, "n_cells": 1} for setting in settings]
    trials = [row | {"setting": settings[0], "trial": "B001", "r2_pct": [90.0, 97.0, 91.0]}]
    made: dict[str, Any] = {
        "rows": rows,
        "settings": about,
        "by_trial": trials,
        "command": "tis compare",
        "sweep": "network.profile",
        "axes": ["network.profile"],
    }
    made |= {"scenario": "default", "source": "jigsaws", "trials": ["B001"], "n_trials_asked": 1, "n_seeds": 1}
    made |= {"trained_on": "others"}
    text = page_text([(section, made)])
    assert "9 of 15 figures are above the paper's:" in text
    assert "| 1 | 96.67 95.13 97.52 | 96.00 96.00 96.00 | 90.00 97.00 91.00 | no yes no |" in text
    assert "| 3 | 98.68 98.70 99.00 | 96.00 96.00 96.00 | - | no no no |" in text
