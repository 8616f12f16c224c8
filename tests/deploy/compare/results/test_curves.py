"""Curves with bands against the pooled rows, and intervals over people against a plain loop over people."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tis.deploy.compare import Study, compare
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.results.figures import curves_figure, ratio_figure
from tis.deploy.compare.results.pooled import band_words, resampled
from tis.deploy.compare.results.report import numbers_of, numeric_axes
from tis.deploy.compare.study import plan_study
from tis.deploy.tools.synth import write_trials

DELAY, COPIES = "network.forward.delay.delay_ms", "surgeon.copies"
SCENARIO = """version: 1
name: several
drain_s: 0.2
source: {{kind: jigsaws, path: {path}, hands: [left]}}
network: {{forward: {{delay: {{kind: constant, delay_ms: 100}}}}}}
identification: {{train: own_head, train_samples: 120, block_rows: 4, order: 2}}
estimators: [hold]
active_estimator: hold
"""


def made_up(axes: dict[str, list[str]], n_people: int = 4, zipped: bool = False) -> dict[str, Any]:
    """A report in which an error is the sum of its place's numbers, and its interval 0.1 wide."""
    rows: list[dict[str, Any]] = []
    abouts: list[dict[str, Any]] = []
    for values in zip(*axes.values(), strict=True) if zipped else product(*axes.values()):
        at = dict(zip(axes, values, strict=True))
        abouts.append({"setting": ", ".join(at.values()), "at": at, "n_cells": 1})
        size = sum(float(value) for value in at.values() if numbers_of([value]))
        for name, score in (("hold", 1.0), ("mine", size)):
            row = {"setting": abouts[-1]["setting"], "at": at, "estimator": name, "n_people": n_people}
            row |= {"ratio_to_hold": score, "ratio_to_hold_interval_95": [score - 0.05, score + 0.05]}
            rows.append(row | {"rmse_3d_mm": 2 * score, "rmse_3d_mm_interval_95": None})
    about = {"axes": list(axes), "zipped": zipped, "source": "jigsaws", "sweep": ", ".join(axes)}
    return {"rows": rows, "settings": abouts, **about}


def test_each_numeric_axis_has_panels_for_the_values_of_the_others() -> None:
    figure = curves_figure(made_up({DELAY: ["0", "0.5", "0.2"], COPIES: ["1", "2"], "profile": ["a", "b"]}))
    assert figure is not None
    assert len(figure.subfigs) == 2
    of_delay, of_copies = figure.subfigs
    titles = [axes.get_title(loc="left") for axes in of_delay.axes[: len(of_delay.axes) // 2]]
    assert titles == [f"copies = {copies}, profile = {name}" for copies in (1, 2) for name in "ab"]
    (mine,) = [line for line in of_delay.axes[0].lines if line.get_label() == "mine"]
    assert np.asarray(mine.get_xdata()) == pytest.approx([0, 0.2, 0.5])
    assert np.asarray(mine.get_ydata()) == pytest.approx([1, 1.2, 1.5])
    band = np.asarray(of_delay.axes[0].collections[1].get_paths()[0].vertices)
    assert (np.min(band[:, 1]), np.max(band[:, 1])) == (pytest.approx(0.95), pytest.approx(1.55))
    assert len(of_copies.axes) == 2 * 5
    assert "5 of 6 settings" in str(of_copies.get_suptitle())


def test_what_curves_say_is_said_once() -> None:
    one, words = made_up({DELAY: ["0", "1"]}), made_up({"profile": ["a", "b"]})
    assert (curves_figure(one) is None, ratio_figure(one) is None) == (False, True)
    assert (curves_figure(words) is None, ratio_figure(words) is None) == (True, False)
    side_by_side = curves_figure(made_up({DELAY: ["0", "1"], COPIES: ["1", "2"]}, zipped=True))
    assert side_by_side is not None
    assert len(side_by_side.subfigs) == 1
    assert numeric_axes(made_up({DELAY: ["0", "nan"], COPIES: ["1"]})) == []


def test_the_figure_says_how_many_people_and_what_few_of_them_mean() -> None:
    for n_people, words in (
        (1, "No bands: intervals are over people or devices, and this is a single one."),
        (4, "Bands: 95 % bootstrap intervals over 4 people. So few cover less than 95 %: at most 88 %."),
        (6, "Bands: 95 % bootstrap intervals over 6 people."),
    ):
        report = made_up({DELAY: ["0", "1"]}, n_people)
        assert band_words(report) == words
        figure = curves_figure(report)
        assert figure is not None
        assert words in str(figure.get_suptitle())
    assert "over 4 people, one for each seed." in band_words(made_up({DELAY: ["0", "1"]}) | {"source": "synthetic"})


def test_a_person_is_resampled_with_all_trials_and_seeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None
) -> None:
    monkeypatch.chdir(tmp_path)
    first, second, third = write_trials(tmp_path / "t", 3, "Suturing", 1, 300 / 30, "a test")
    for file, name in ((first, "S001"), (second, "S002"), (third, "T001")):
        file.rename(file.with_name(f"Suturing_{name}.txt"))
    (tmp_path / "several.yaml").write_text(SCENARIO.format(path=tmp_path / "t"))
    study = Study(scenario="several.yaml", settings={"identification.train": "own_head"}, seeds=2)
    (row,) = compare(study, "kept", n_jobs=1).pooled
    assert (row["n_trials"], row["n_people"]) == (3, 2)
    n, squares = dict.fromkeys("ST", 0), dict.fromkeys("ST", 0.0)
    for cell in plan_study(study).cells:
        found = Store(tmp_path / "kept").cell(cell.digest)
        assert found is not None
        (hand,) = found["hands"].values()
        n[cell.trial[0]] += hand["n_scored"]
        squares[cell.trial[0]] += sum(hand["estimators"]["hold"]["sse_m2"])
    drawn = [["ST"[i] for i in chosen] for chosen in resampled(2)]
    again = [1000 * np.sqrt(sum(squares[p] for p in two) / sum(n[p] for p in two)) for two in drawn]
    assert row["rmse_3d_mm_interval_95"] == pytest.approx(np.percentile(again, [2.5, 97.5]), rel=1e-9)
