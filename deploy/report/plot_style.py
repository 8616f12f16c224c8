"""How every figure of the report looks: type, colours that colour-blind readers can tell apart, tools."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from bokeh.models.annotations import Legend, LegendItem
from bokeh.models.layouts import LayoutDOM
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.tools import BoxZoomTool
from bokeh.plotting import figure
from bokeh.themes import Theme
from numpy.typing import ArrayLike, NDArray

TRUTH: Final = "#1b1f24"
ACTIVE: Final = "#0072b2"
HOLD: Final = "#d55e00"
LOST: Final = "#c1121f"
FORWARD: Final = "#0072b2"
FEEDBACK: Final = "#009e73"
PALE: Final = "#b9c6d3"
LOST_PALE: Final = "#f6d5d8"
CHANGED: Final = "#e8e8e8"
_OTHERS: Final = ("#009e73", "#cc79a7", "#8c6d31", "#7a5195", "#56b4e9", "#e69f00")
_FONT: Final = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"

THEME: Final = Theme(
    json={
        "attrs": {
            "Plot": {"background_fill_color": "#ffffff", "border_fill_color": "#ffffff", "outline_line_color": None},
            "Axis": {
                "axis_line_color": "#8a949e",
                "major_tick_line_color": "#8a949e",
                "minor_tick_line_color": None,
                "axis_label_text_font": _FONT,
                "axis_label_text_font_style": "normal",
                "axis_label_text_font_size": "13px",
                "axis_label_text_color": "#3b444d",
                "major_label_text_font": _FONT,
                "major_label_text_font_size": "12px",
                "major_label_text_color": "#3b444d",
            },
            "Grid": {"grid_line_color": "#e6eaee"},
            "Legend": {
                "border_line_color": None,
                "label_text_font": _FONT,
                "label_text_font_size": "13px",
                "label_text_color": "#1b1f24",
                "margin": 4,
                "padding": 2,
                "spacing": 8,
                "inactive_fill_alpha": 0.75,
            },
            "Title": {"text_font": _FONT, "text_font_size": "13px", "text_color": "#3b444d"},
            "Label": {"text_font": _FONT, "text_font_size": "12px", "text_color": "#3b444d"},
        }
    }
)


@dataclass(frozen=True)
class Figure:
    """A figure of the report: what is drawn, what it is called, what to see in it, and what a screen reader says."""

    plot: LayoutDOM
    title: str
    says: str
    alt: str


@dataclass(frozen=True)
class LineStyle:
    """How one estimator is drawn; ``shown`` says whether it can be seen before anybody clicks its name."""

    colour: str
    width: float
    dash: str
    shown: bool


def line_styles(names: Sequence[str], active: str) -> dict[str, LineStyle]:
    """Return each estimator's style; the active one and hold are seen first, whatever else is there."""
    others = [name for name in names if name not in (active, "hold")]
    styles = {name: LineStyle(_OTHERS[i % len(_OTHERS)], 1.5, "solid", False) for i, name in enumerate(others)}
    styles["hold"] = LineStyle(HOLD, 1.5, "solid", True)
    if active != "hold":
        styles[active] = LineStyle(ACTIVE, 2.0, "solid", True)
    return {name: styles[name] for name in names}


def time_range(end_s: float) -> Range1d:
    """Return the span of run time that all figures over time share: who zooms in one zooms in all."""
    return Range1d(start=0, end=max(end_s, 1e-3), bounds=(0, max(end_s, 1e-3)))


def time_figure(x_range: Range1d, y_label: str, height: int, with_axis: bool = True) -> figure:
    """Return an empty figure over run time: drag to zoom, wheel and pan along time when chosen."""
    zoom = BoxZoomTool(dimensions="auto")  # along time when the drag is flat
    fig = figure(
        height=height,
        sizing_mode="stretch_width",
        x_range=x_range,
        tools=[zoom, "xpan", "xwheel_zoom", "reset", "save"],
        toolbar_location="above",
        active_drag=zoom,
        min_border_left=74,
        y_axis_label=y_label,
    )
    fig.toolbar.logo = None
    if with_axis:
        fig.xaxis.axis_label = "run time, s"
    else:
        fig.xaxis.major_label_text_font_size = "0px"
    return fig


def plain_figure(height: int, **options: Any) -> figure:
    """Return an empty figure that shares no axis with others."""
    fig = figure(
        height=height, sizing_mode="stretch_width", tools="box_zoom,reset,save", toolbar_location="above", **options
    )
    fig.toolbar.logo = None
    return fig


def add_legend(fig: figure, entries: Mapping[str, "Sequence[GlyphRenderer[Any]]"], mutes: bool = True) -> None:
    """Put names above a figure; with ``mutes`` a click on one dims what it names, or brings it back."""
    items = [LegendItem(label=name, renderers=list(drawn)) for name, drawn in entries.items()]
    legend = Legend(
        items=items,
        orientation="horizontal",
        location="top_left",
        ncols=2 if len(items) == 4 else 3,  # so many fit on a telephone
        click_policy="mute" if mutes else "none",
    )
    fig.add_layout(legend, "above")


def column(values: ArrayLike) -> NDArray[np.float32]:
    """Return what a figure is drawn from: seven digits are more than a screen shows, and half the size."""
    return np.asarray(values, dtype=np.float32)
