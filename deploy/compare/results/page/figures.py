"""Empty figures of a comparison's page, whose sources the page's script fills."""

from collections.abc import Sequence
from typing import Any, Final

from bokeh.models import ColumnDataSource, FixedTicker, HoverTool, LinearColorMapper
from bokeh.models.annotations import ColorBar, Span
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.deploy.present.palette import AXIS, SOFT, look_of
from tis.deploy.present.plot_style import Figure, plain_figure

CURVES: Final = {"ratio": "3D RMSE over hold's", "rmse": "3D RMSE, mm"}
_COLUMNS: Final = ("x", "y", "low", "high", "at", "band", "ticks", "people", "estimator")
_TOOLTIPS: Final = [
    ("ticks", "@ticks{0,0}"),
    ("people", "@people"),
]
_BAND_ALPHA: Final = 0.14
_LARGEST_RATIO: Final = 1.2


def curve_figures(names: Sequence[str]) -> Figure:
    """Return ratio and RMSE against an axis, a line with a band for each estimator."""
    plots = tuple(_lines(name, label, names, with_bands=True) for name, label in CURVES.items())
    caption = "Pooled over all that is chosen above; the axis is chosen here. The bands are over people."
    return Figure(plots, "Errors along an axis", caption, "Error of each estimator against the chosen axis")


def age_figure(names: Sequence[str]) -> Figure:
    """Return the 3D error against the age of the freshest sample."""
    plot = _lines("age", "3D RMSE, mm", names, with_bands=False)
    plot.xaxis.axis_label = "age of the freshest sample, ms (lower edge of the bin)"
    caption = "Age: how old the freshest sample is that has arrived by the tick."
    return Figure((plot,), "Error against age", caption, "Error of each estimator against age")


def heat_figure() -> Figure:
    """Return the ratio over two axes as a map."""
    columns = ("x", "y", "ratio", "text", "ink", "across", "up", "rmse", "ticks", "people")
    source = ColumnDataSource({name: [] for name in columns}, name="heat")
    plot = plain_figure(380, **_ranges(), name="heat-figure")
    mapper = LinearColorMapper(palette="Viridis256", low=0, high=_LARGEST_RATIO, nan_color="#00000000")
    colour: Any = {"field": "ratio", "transform": mapper}
    drawn = plot.rect("x", "y", 1, 1, source=source, fill_color=colour, line_color=None)
    plot.text(
        "x", "y", "text", source=source, text_color="ink", text_align="center", text_baseline="middle",
        text_font_size="12px",
    )  # fmt: skip
    tips = [("", "@up, @across"), ("ratio", "@ratio{0.000}"), ("3D RMSE, mm", "@rmse{0.000}")]
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=[*tips, ("ticks", "@ticks{0,0}"), ("people", "@people")]))
    bar = ColorBar(color_mapper=mapper, width=12, background_fill_color=None, major_label_text_color=SOFT.light)
    plot.add_layout(bar, "right")
    plot.grid.visible = False
    _fixed(plot)
    caption = "3D RMSE of one estimator over hold's, pooled over all else that is chosen above."
    return Figure((plot,), "Two axes", caption, "Map of the ratio over two axes")


def _lines(name: str, label: str, names: Sequence[str], with_bands: bool) -> figure:
    """Return a figure with a line for each estimator, its source named ``NAME:ESTIMATOR``."""
    plot = plain_figure(320, **_ranges(), y_axis_label=label, name=f"{name}-figure")
    if name == "ratio":
        plot.add_layout(Span(location=1, dimension="width", line_color=AXIS.light, line_dash="dotted"))
    tips = [("", "@estimator"), ("at", "@at"), ("ratio" if name == "ratio" else label, "@y{0.000} @band")]
    for estimator in names:
        look = look_of(estimator, names)
        source = ColumnDataSource({column: [] for column in _COLUMNS}, name=f"{name}:{estimator}")
        if with_bands:
            plot.varea("x", "low", "high", source=source, fill_color=look.tone.light, fill_alpha=_BAND_ALPHA)
        dash: Any = look.dash
        plot.line("x", "y", source=source, line_width=1.8, line_color=look.tone.light, line_dash=dash)
        dots = plot.scatter("x", "y", source=source, size=7, color=look.tone.light)
        plot.add_tools(HoverTool(renderers=[dots], tooltips=[*tips, *_TOOLTIPS], visible=False))
    _fixed(plot)
    return plot


def _ranges() -> dict[str, Range1d]:
    """Return ranges of which the script sets the ends."""
    return {"x_range": Range1d(start=0, end=1), "y_range": Range1d(start=0, end=1)}


def _fixed(plot: figure) -> None:
    """Let the script place the ticks: at the values of an axis, at the edges of bins."""
    for axis in (plot.xaxis[0], plot.yaxis[0]) if plot.name == "heat-figure" else (plot.xaxis[0],):
        axis.ticker = FixedTicker(ticks=[])
