"""The plots: what is drawn of figures written by hand."""

import numpy as np

from tests.deploy.studies.methods.made_up import figures, hold, scores
from tis.deploy.studies.methods.plots import (
    FIGURES,
    accuracy_figure,
    disturbance_figure,
    steps_figure,
    training_figure,
)


def line(axes: object, name: str) -> tuple[list[float], list[float]]:
    (found,) = [each for each in axes.lines if each.get_label() == name]  # type: ignore[attr-defined]
    return np.asarray(found.get_xdata()).tolist(), np.asarray(found.get_ydata()).tolist()


def test_each_method_is_a_line_with_a_bar_for_each_interval() -> None:
    (axes,) = accuracy_figure([hold(), figures("moesp_kf")]).axes
    assert line(axes, "moesp_kf") == ([100.0, 500.0], [0.4, 0.8])
    bars = [np.asarray(each.get_ydata()).tolist() for each in axes.lines if str(each.get_label()).startswith("_")]
    assert [0.35, 0.45] in bars
    assert [0.7, 0.9] in bars


def test_losses_and_noises_have_panels_of_their_own() -> None:
    independent, bursts, noise, trained = disturbance_figure([figures("moesp_kf")]).axes
    assert line(independent, "moesp_kf") == ([0.0, 30.0], [0.4, 0.5])
    assert line(bursts, "moesp_kf") == ([30.0], [0.6])
    assert line(noise, "moesp_kf") == ([0.0, 5.0], [0.4, 1.5])
    assert line(trained, "moesp_kf") == ([0.0, 5.0], [0.4, 0.7])


def test_a_method_that_is_useless_everywhere_is_named_instead_of_stretching_the_axis() -> None:
    far = [{"delay_ms": 100.0, **scores(9.0)}, {"delay_ms": 500.0, **scores(3.0)}]
    (axes,) = accuracy_figure([hold(), figures("moesp_kf"), figures("paper", accuracy=far)]).axes
    assert axes.get_title(loc="left") == "above 2: paper"
    assert axes.get_ylim()[1] <= 2.0


def test_training_and_steps_are_drawn_against_what_they_cost() -> None:
    error, time = training_figure([hold(), figures("moesp_kf")]).axes
    assert line(error, "moesp_kf") == ([1000.0, 2000.0, 9000.0], [0.5, 0.41, 0.4])
    assert line(time, "moesp_kf") == ([1000.0, 2000.0, 9000.0], [1.0, 2.0, 9.0])
    (axes,) = steps_figure([hold(), figures("moesp_kf")]).axes
    assert line(axes, "moesp_kf") == ([5.0], [0.4])


def test_nothing_is_drawn_of_methods_without_figures() -> None:
    nothing: dict[str, list[str]] = {name: [] for name in ("accuracy", "loss", "noise", "noise_trained", "data")}
    empty = figures("cnn", step=None, **nothing)
    for draw in FIGURES.values():
        assert all(not axes.lines for axes in draw([empty]).axes)
