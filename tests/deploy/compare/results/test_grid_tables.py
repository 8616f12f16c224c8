"""Tables and figures of a grid: a line for each point, and a map of each estimator."""

from io import StringIO
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tis.deploy.compare.results.figures import ratio_figure
from tis.deploy.compare.results.tables import csv, ratio_table, view


def made_up(n_delays: int) -> dict[str, Any]:
    """A report of delays and two losses, without intervals: the ratio grows with both."""
    rows, abouts = [], []
    for i in range(n_delays):
        for j in range(2):
            at = {"network.delay_ms": str(10 * i), "network.p_loss": f"0.{j}"}
            about = {"setting": ", ".join(at.values()), "at": at}
            traffic = {"age_ms": {"p50": 1.0, "p99": 2.0}, "packets_per_s": 60.0, "bytes_per_s": 1.0}
            abouts.append(about | traffic | {"n_cells": 1})
            for name, ratio in (("hold", 1.0), ("mine", 0.1 * i + 0.01 * j)):
                row = {"estimator": name, "ratio_to_hold": ratio, "ratio_to_hold_interval_95": None, "n_people": 7}
                row |= {"ratio_to_best_interval_95": None}
                row |= {"r2_pct": [1.0, 2.0, 3.0], "rmse_3d_mm": 1.0, "coverage_pct": None, "train_s": None}
                rows.append(about | row | {"step_us": {"p50": 1.0, "p99": 2.0}})
    about_all: dict[str, Any] = {"scenario": "s", "source": "synthetic", "trained_on": "heads", "topologies": []}
    about_all |= {"trials": ["synthetic 7"], "n_trials_asked": 1, "n_seeds": 1, "by_trial": rows}
    return about_all | {
        "sweep": "both",
        "zipped": False,
        "axes": ["network.delay_ms", "network.p_loss"],
        "rows": rows,
        "orientation": [],
        "touch_and_sight": [],
        "settings": abouts,
    }


def test_each_point_is_a_line_with_a_column_for_each_axis() -> None:
    table = ratio_table(made_up(3), intervals=False)
    assert [column.title for column in table.full_columns()] == ["delay_ms", "p_loss", "hold", "mine"]
    lines = list(table.texts())
    assert lines[3] == ["10", "0.1", "1.000", "0.110"]
    assert len(lines) == 6


@pytest.mark.parametrize(("n_delays", "has_all"), [(6, True), (7, False)])
def test_a_terminal_shows_no_table_for_each_of_many_points(n_delays: int, has_all: bool) -> None:
    text = StringIO()
    Console(file=text, width=100).print(view(made_up(n_delays)))
    assert ("delay_ms = 50, p_loss = 0.1: age median" in text.getvalue()) == has_all
    assert ("table.md has a table of each of 14 settings" in text.getvalue()) != has_all
    assert "Ratio to hold, by both" in text.getvalue()


def test_the_csv_has_a_column_for_each_axis() -> None:
    head = csv(made_up(2)["by_trial"]).splitlines()[0].split(",")
    assert head[:3] == ["setting", "at_network.delay_ms", "at_network.p_loss"]


def test_two_axes_are_a_map_of_each_estimator_but_hold() -> None:
    figure = ratio_figure(made_up(3))
    assert figure is not None
    assert ratio_figure(made_up(3) | {"zipped": True}) is None
    (axes, _) = figure.axes
    assert axes.get_title(loc="left") == "mine"
    image = axes.get_images()[0].get_array()
    assert image is not None
    assert np.asarray(image) == pytest.approx(np.array([[0.0, 0.01], [0.1, 0.11], [0.2, 0.21]]))
