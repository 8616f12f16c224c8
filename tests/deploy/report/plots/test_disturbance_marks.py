"""Outages and live changes in the panels over time, and in no other."""

from bokeh.models.annotations import BoxAnnotation
from bokeh.plotting import figure

from tis.deploy.present import plot_style as style
from tis.deploy.present.palette import CHANGED, OUTAGE
from tis.deploy.report.plots.page_plots import marked
from tis.deploy.report.subjects.network.disturbances import Disturbance

FOUND = [
    Disturbance(1.0, 1.5, "outage", "both", live=False),
    Disturbance(3.0, 5.0, "change", "forward", live=True),
]


def _boxes(panel: figure) -> list[tuple[float, float, str]]:
    found = panel.select({"type": BoxAnnotation})
    boxes = [
        box for box in found if isinstance(box, BoxAnnotation) and box.fill_color in (OUTAGE.light, CHANGED.light)
    ]
    return [(float(str(box.left)), float(str(box.right)), str(box.fill_color)) for box in boxes]


def test_panels_over_run_time_are_shaded_and_the_legend_says_so() -> None:
    x_range = style.time_range(10.0)
    over_time, elsewhere = style.time_figure(x_range, "error, mm", 200), style.plain_figure(200)
    drawn = marked(style.Figure((over_time, elsewhere), "Title", "Caption", "Alt"), FOUND, x_range)
    assert drawn is not None
    assert sorted(_boxes(over_time)) == [(1.0, 1.5, OUTAGE.light), (3.0, 5.0, CHANGED.light)]
    assert _boxes(elsewhere) == []
    assert [key.name for key in drawn.keys] == ["outage", "changed while running"]


def test_a_calm_run_has_neither_marks_nor_keys() -> None:
    x_range = style.time_range(10.0)
    figure_ = style.Figure((style.time_figure(x_range, "error, mm", 200),), "Title", "Caption", "Alt")
    assert marked(figure_, [], x_range) is figure_
    assert marked(None, FOUND, x_range) is None


def test_of_very_many_the_longest_are_drawn() -> None:
    x_range = style.time_range(200.0)
    panel = style.time_figure(x_range, "error, mm", 200)
    many = [Disturbance(float(k), k + 0.1 + 0.001 * k, "outage", "both", live=False) for k in range(100)]
    marked(style.Figure((panel,), "Title", "Caption", "Alt"), many, x_range)
    assert min(left for left, _, _ in _boxes(panel)) == 60.0


def test_boxes_are_made_from_the_first_panel_to_the_last() -> None:
    """Their ids stand in the page: in the order of a set they would differ from process to process."""
    x_range = style.time_range(10.0)
    panels = [style.time_figure(x_range, "error, mm", 200) for _ in range(12)]
    marked(
        style.Figure((style.stacked(panels[:6]), style.stacked(panels[6:])), "Title", "Caption", "Alt"),
        FOUND,
        x_range,
    )
    made = [
        int(box.id.removeprefix("p")) for panel in panels for box in panel.center if isinstance(box, BoxAnnotation)
    ]
    assert len(made) == 24
    assert made == sorted(made)
