"""The page on estimators: words for all, and tables from made-up results."""

import shlex
from itertools import pairwise
from typing import Any, get_args

import pytest
import yaml

from common.scenario.patient import EstimatorName
from deploy.compare.page import page_text
from deploy.compare.plan import Plan, make_plan
from deploy.compare.pool import Outcome
from deploy.compare.results import report
from deploy.compare.studies import Study, can_correlate, command_of, studies
from deploy.compare.words import WORDS


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
                "trained": i > 0,
            }

        return {
            "n_scored": 100,
            "sst_m2": [1e-2, 1e-2, 1e-2],
            "range_m": [0.1, 0.1, 0.0],
            "n_by_age": [0, 100] + [0] * 15,
            "age_sum_ns": 100 * 35_000_000,
            "age_ns": {"17379": 100},
            "estimators": {name: entry(i) for i, name in enumerate(plan.estimators)},
        }

    traffic = {"sent_packets": 120, "sent_bytes": 24_000}
    return {"traffic": traffic, "duration_s": 2.0, "hands": {"left": hand()}, "warnings": []}


def _found(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Study, dict[str, Any]]]:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    found = []
    for study in studies():
        plan = make_plan(study.request)
        cells = {cell.digest: _result(plan, 1 + i) for i, cell in enumerate(plan.cells)}
        trainings = {
            digest: {"train_s": dict.fromkeys(plan.estimators, 0.5), "warnings": []} for digest in plan.trainings
        }
        found.append((study, report(plan, Outcome(trainings, cells), command_of(study.request))))
    return found


def test_every_estimator_has_its_words() -> None:
    without = [name for name in get_args(EstimatorName) if name not in WORDS]
    assert without == []
    for name, words in WORDS.items():
        assert words.count(".") >= 2, name
        assert words.endswith(".")


def test_the_page_has_a_table_for_each_study_and_every_row_its_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _found(monkeypatch)
    text = page_text(found)
    assert len(found) == (6 if can_correlate() else 3)
    for name in get_args(EstimatorName):
        assert f"- **`{name}`**: {WORDS[name]}" in text
    for study, made in found:
        assert f"## {study.title}\n" in text
        assert made["command"] in text
    width = 0
    for line in text.splitlines():
        if line.startswith("|"):
            width = width or line.count("|")
            assert line.count("|") == width, line
        else:
            width = 0
    assert "| 2 | 35.00 | 35.00 | 35.00 | 60.00 | 12.00 |" in text  # age, packets and kB of two copies, as made up
    assert "None" not in text


def test_the_best_of_each_setting_is_the_one_with_the_smallest_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    study, made = _found(monkeypatch)[0]
    last = study.request.estimators[-1] if study.request.estimators else ""
    assert f"The smallest error at 33, 100, 200, 500, 1000 has `{last}`." in page_text([(study, made)])


def test_the_commands_ask_for_what_the_studies_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    for study in studies():
        words = shlex.split(command_of(study.request))
        assert words[:3] == ["tis", "compare", "default"]
        settings = [value for option, value in pairwise(words) if option == "--set"]
        assert tuple(settings) == study.request.settings
        for setting in settings:
            yaml.safe_load(setting.partition("=")[2])


def test_recorded_trials_are_compared_where_there_are_any(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TIS_JIGSAWS", "somewhere")
    titles = [study.title for study in studies()]
    assert sum("recorded" in title for title in titles) == len(titles) // 2
