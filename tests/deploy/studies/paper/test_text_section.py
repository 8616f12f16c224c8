"""The figures in the paper's text beside its table and our runs."""

from dataclasses import replace

import pytest

from tests.deploy.studies.paper.test_page import made_up_results
from tests.markdown_tables import ragged_rows
from tis.deploy.studies.paper.cells import ROWS, TEXT, Simulated, SimulationKey
from tis.deploy.studies.paper.page import implied_deviation, nearest_simulation, page


def test_r2_and_rmse_imply_the_deviation_of_the_signal() -> None:
    """99 % of the variance explained and an error of 0.02 leave a deviation of 0.02 / sqrt(0.01) = 0.2."""
    assert implied_deviation((99.0, 75.0, None), (0.02, 0.1, 0.1)) == pytest.approx([0.2, 0.2, None])
    assert implied_deviation((100.0, 0.0), (0.0, 0.3)) == [None, 0.3]
    # sqrt(1 - 0.948) = 0.22804, sqrt(1 - 0.9599) = 0.20025, sqrt(1 - 0.9767) = 0.15264
    assert implied_deviation(TEXT.accuracy_pct, TEXT.rmse) == pytest.approx([0.14515, 0.14831, 0.15919], abs=1e-4)


def test_the_text_is_in_no_row_of_the_table_and_row_2_is_nearest() -> None:
    assert all((row.accuracy_pct, row.rmse) != (TEXT.accuracy_pct, TEXT.rmse) for row in ROWS)
    text = page(made_up_results(90.0)).replace("\n", " ")
    assert "the nearest is row 2, which differs by up to 0.78 points of accuracy" in text  # 95.58 - 94.80
    assert "implies 0.145 to 0.216 for x" in text  # row 6: 0.0811 / sqrt(0.1405)


def test_the_run_nearest_on_every_axis_is_shown_with_its_figures() -> None:
    results = made_up_results(80.0)
    near = {"r2_pct": [94.0, 96.0, 97.0], "rmse_normalized": [0.03, 0.02, 0.01], "ratio_to_hold": 0.5}
    one_axis_far = {"r2_pct": [94.8, 95.99, 90.0], "rmse_normalized": [0.03, 0.02, 0.01], "ratio_to_hold": 0.5}
    unknown = {"r2_pct": [94.8, None, 97.67], "rmse_normalized": [0.03, None, 0.01], "ratio_to_hold": 0.5}
    changed: dict[SimulationKey, Simulated] = {
        ("same_name", 4, "samples", False): Simulated(near, 5.0),
        ("same_name", 4, "samples", True): Simulated({**near, "r2_pct": list(TEXT.accuracy_pct)}, 5.0),
        ("cross", 3, "ms", False): Simulated({**near, "r2_pct": list(TEXT.accuracy_pct)}, 5.0),
        ("same_name", 1, "ms", False): Simulated(one_axis_far, 5.0),
        ("same_name", 2, "ms", False): Simulated(unknown, 5.0),
    }
    results = replace(results, simulated={**results.simulated, **changed})
    assert nearest_simulation(results) == ("same_name", 4, "samples", False)
    text = page(results)
    assert "ours, row 4 read as samples | 94.00 96.00 97.00 | 0.0300 0.0200 0.0100" in text
    assert "within 0.80 points" in text
    assert ragged_rows(text) == []
