from functools import cache

import numpy as np
import pytest

from tis.common.channels import FOLLOWER, Hand
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.deploy.report.publication.matplotlib_figures import FORMATS, identification_figure, rendered
from tis.patient_side.identification.identify import Identified, identify_with_orders

STARTS = {"svg": b"<?xml", "pdf": b"%PDF", "png": b"\x89PNG"}


@cache
def identified(hand: Hand = "left", method: str = "moesp", order: int | str = "auto") -> Identified:
    rng = np.random.default_rng(0)
    u = np.cumsum(1e-3 * rng.normal(size=(400, 3)), axis=0)
    y = 0.5 * u + 1e-5 * rng.normal(size=u.shape)
    master, arm = (PoseTrack(p, np.tile([0.0, 0.0, 0.0, 1.0], (400, 1)), np.zeros(400)) for p in (u, y))
    recording = Recording("T", 30, (HandRecording(hand, FOLLOWER[hand], master, arm),), 0, "")
    identification = Identification.model_validate({"method": method, "order": order, "block_rows": 5})
    return identify_with_orders([recording], hand, identification, "")


def test_the_figure_shows_the_singular_values_the_rules_and_the_validation_rows() -> None:
    found = identified()
    values, x, y, z = identification_figure([found]).subfigs[0].axes
    assert values.get_yscale() == "log"
    curve = values.get_lines()[0]
    assert np.asarray(curve.get_ydata()) == pytest.approx(found.model.singular_values)
    legend = values.get_legend()
    assert legend is not None
    orders = found.orders
    assert [text.get_text() for text in legend.get_texts()] == [
        f"85 % energy: {orders.energy}",
        f"largest log-gap: {orders.log_gap}",
        f"information criterion: {orders.criterion}",
        f"validation: {orders.validation}",
    ]
    marks = [float(np.asarray(line.get_xdata())[0]) for line in values.get_lines()[1:]]
    assert marks == [orders.energy, orders.log_gap, orders.criterion, orders.validation]
    for axis, plot in enumerate((x, y, z)):
        truth, simulated = plot.get_lines()
        assert np.asarray(truth.get_xdata())[[0, -1]] == pytest.approx([280 / 30, 399 / 30])
        assert np.asarray(truth.get_ydata()) == pytest.approx(1000 * found.validation.truth_m[:, axis])
        assert np.asarray(simulated.get_ydata()) == pytest.approx(1000 * found.validation.simulated_m[:, axis])


def test_of_a_regression_the_error_by_lags_stands_in_place_of_singular_values() -> None:
    found = identified(method="arx", order=2)
    values = identification_figure([found]).subfigs[0].axes[0]
    curve, *marks = values.get_lines()
    assert np.asarray(curve.get_ydata()) == pytest.approx(found.orders.predictions)
    assert [float(np.asarray(line.get_xdata())[0]) for line in marks] == [
        found.orders.criterion,
        found.orders.validation,
    ]
    assert values.get_xlabel() == "lags"
    legend = values.get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "lags used: 2"
    assert found.model.order == 6


def test_a_simulation_that_runs_away_does_not_set_the_scale() -> None:
    found = identified(method="moesp_paper", order=12)
    assert min(found.model.fit_pct) < -1000
    figure = identification_figure([found])
    for axis, plot in enumerate(figure.subfigs[0].axes[1:]):
        truth_mm = 1000 * found.validation.truth_m[:, axis]
        low, high = plot.get_ylim()
        assert high - low < 1.4 * np.ptp(truth_mm)
        assert low < truth_mm.min() < truth_mm.max() < high
    assert "off the scale" in rendered(figure, "svg").decode()


def test_two_hands_are_two_rows() -> None:
    figure = identification_figure([identified(), identified("right")])
    assert [len(row.axes) for row in figure.subfigs] == [4, 4]


@pytest.mark.parametrize("file_format", FORMATS)
def test_the_same_figure_is_the_same_file(file_format: str) -> None:
    one, other = (rendered(identification_figure([identified()]), file_format) for _ in range(2))
    assert one.startswith(STARTS[file_format])
    assert one == other
