"""Common style of figures: fonts, colours, tools and legends."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.layouts import LayoutDOM
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.tools import BoxZoomTool, HoverTool
from bokeh.plotting import figure
from bokeh.themes import Theme
from numpy.typing import ArrayLike

from tis.common.scenario.estimator_names import is_user_defined
from tis.deploy.present.palette import AXIS, GRID, SOFT, Look, Tone, look_of
from tis.deploy.present.thinning import column

FONT: Final = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
THEME: Final = Theme(
    json={
        "attrs": {
            # transparent, so that figures fit light and dark pages
            "Plot": {"background_fill_color": None, "border_fill_color": None, "outline_line_color": None},
            "Axis": {
                "axis_line_color": AXIS.light,
                "major_tick_line_color": AXIS.light,
                "minor_tick_line_color": None,
                "axis_label_text_font": FONT,
                "axis_label_text_font_style": "normal",
                "axis_label_text_font_size": "13px",
                "axis_label_text_color": SOFT.light,
                "major_label_text_font": FONT,
                "major_label_text_font_size": "12px",
                "major_label_text_color": SOFT.light,
            },
            "Grid": {"grid_line_color": GRID.light},
            "Toolbar": {"stylesheets": ["@media print { :host { visibility: hidden; } }"]},
            "Title": {"text_font": FONT, "text_font_size": "13px", "text_color": SOFT.light},
            "Label": {"text_font": FONT, "text_font_size": "12px", "text_color": SOFT.light},
        }
    }
)
Mark = Literal["line", "dashed", "dotted", "dashdot", "dot", "cross", "bar", "stroke"]


@dataclass(frozen=True)
class Key:
    """A legend entry.

    With ``toggles`` a click hides or shows all renderers named ``of``, in every figure of the page.
    """

    name: str
    tone: Tone
    mark: Mark
    toggles: bool = False
    shown: bool = True
    of: str = ""


@dataclass(frozen=True)
class Figure:
    """A figure of the report: plots, title, caption, text for screen readers, and legend.

    ``plots`` are side by side where there is room; each has its own labels. ``controls`` is markup below them. ``of``
    is the part of the page that the figure belongs to (`Page.parts`); ``folds``: it is folded until asked for.
    """

    plots: tuple[LayoutDOM, ...]
    title: str
    caption: str
    alt: str
    keys: tuple[Key, ...] = ()
    controls: str = ""
    of: str = ""
    folds: bool = False


@dataclass(frozen=True)
class LineStyle:
    """The style of one estimator; ``shown``: visible at first."""

    look: Look
    width: float
    shown: bool

    @property
    def colour(self) -> str:
        """Return the colour on a light page."""
        return self.look.tone.light


def line_keys(styles: dict[str, LineStyle], mark: str = "") -> tuple[Key, ...]:
    """Return the legend of lines, each of which can be hidden; ``mark`` ends the names of their renderers."""
    marks: dict[str, Mark] = {"solid": "line", "dashed": "dashed", "dotted": "dotted", "dashdot": "dashdot"}
    return tuple(
        Key(name, style.look.tone, marks[style.look.dash], toggles=True, shown=style.shown, of=f"{name}{mark}")
        for name, style in styles.items()
    )


def time_range(end_s: float) -> Range1d:
    """Return the range of run time that all figures over time share, so that they zoom together."""
    return Range1d(start=0, end=max(end_s, 1e-3), bounds=(0, max(end_s, 1e-3)))


def time_figure(x_range: Range1d, y_label: str, height: int, with_axis: bool = True) -> figure:
    """Return an empty figure over run time: drag zooms; wheel and pan, once chosen, act along time."""
    zoom = BoxZoomTool(dimensions="auto")  # along time when the drag is flat
    fig = figure(
        height=height,
        sizing_mode="stretch_width",
        x_range=x_range,
        tools=[zoom, "xpan", "xwheel_zoom", "reset", "save"],
        toolbar_location="above",
        active_drag=zoom,
        min_border_left=66,
        min_border_right=14,
        y_axis_label=y_label,
    )
    fig.toolbar.logo = None
    if with_axis:
        fig.xaxis.axis_label = "run time, s"
    else:
        fig.xaxis.major_label_text_font_size = "0px"
    return fig


def plain_figure(height: int, **options: Any) -> figure:
    """Return an empty figure with axes of its own."""
    fig = figure(
        height=height,
        sizing_mode="stretch_width",
        tools="box_zoom,reset,save",
        toolbar_location="above",
        min_border_right=14,
        **options,
    )
    fig.toolbar.logo = None
    return fig


def data(**columns: ArrayLike) -> ColumnDataSource:
    """Return a source of columns: real numbers in single precision, as a screen needs, others as they are."""
    real = {name for name, values in columns.items() if np.asarray(values).dtype.kind == "f"}
    return ColumnDataSource({name: column(v) if name in real else v for name, v in columns.items()})


def hover(fig: figure, drawn: "GlyphRenderer[Any]", *tips: tuple[str, str]) -> None:
    """Add tool tips to a renderer: name and format of each."""
    fig.add_tools(HoverTool(renderers=[drawn], tooltips=[*tips]))


def shade(fig: figure, begin_s: float | None, end_s: float, colour: str, **options: Any) -> None:
    """Shade a stretch of run time below the lines, from the figure's edge for a begin of None."""
    place: dict[str, Any] = {"left": begin_s, "right": end_s, "line_color": None, "level": "underlay"}
    fig.add_layout(BoxAnnotation(fill_color=colour, **(place | options)))


def named(name: str, drawn: Iterable["GlyphRenderer[Any]"], shown: bool = True) -> None:
    """Give renderers the name by which a `Key` toggles them."""
    for renderer in drawn:
        renderer.name = name
        renderer.visible = shown


def lines_over_time(
    fig: figure,
    source: ColumnDataSource,
    styles: Mapping[str, LineStyle],
    what: str,
    unit: str,
    mark: str = "",
    *more: tuple[str, str],
) -> None:
    """Draw the columns ``NAME what`` of a source over its column ``t``, with all values at the pointer.

    ``unit`` is a number's format and its unit; ``mark`` ends the names of the renderers; ``more`` are
    further tool tips.
    """
    lines = []
    for name, look in styles.items():
        line = fig.line("t", f"{name} {what}", source=source, line_color=look.colour, line_width=look.width)
        line.glyph.line_dash = look.look.dash
        named(f"{name}{mark}", [line], look.shown)
        lines.append(line)
    tips = [("run time", "@t{0.000} s"), *((name, f"@{{{name} {what}}}{unit}") for name in styles)]
    fig.add_tools(HoverTool(renderers=[*lines[:1]], tooltips=[*tips, *more], mode="vline"))


def stacked(panels: Sequence[figure]) -> LayoutDOM:
    """Return panels below each other with one toolbar."""
    return gridplot([[panel] for panel in panels], sizing_mode="stretch_width", toolbar_location="above")


def line_styles(names: Sequence[str], active: str) -> dict[str, LineStyle]:
    """Return each estimator's style; truth, hold, the active and user-defined ones are visible at first."""
    first = {"truth": 4.0, "hold": 1.5, active: 1.8}
    return {
        name: LineStyle(look_of(name, names), first.get(name, 1.5), name in first or is_user_defined(name))
        for name in names
    }
