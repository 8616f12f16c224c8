"""Cumulative distributions: what share of the messages, or of the estimates, was at most how late."""

from collections.abc import Mapping

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.annotations import Label, Span
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure
from numpy.typing import ArrayLike

from common.channels import Direction
from deploy.report import plot_style as style
from deploy.report.delay_plot import COLOURS
from deploy.report.packets import LinkColumns
from deploy.report.thinning import distribution


def delay_cdf(links: Mapping[Direction, LinkColumns]) -> style.Figure | None:
    """Draw the distribution of the realised delay of each direction; None when nothing was delivered."""
    curves: dict[str, tuple[ArrayLike, str]] = {
        d: (link.realised_ms, COLOURS[d]) for d, link in links.items() if len(link.realised_ms)
    }
    if not curves:
        return None
    return style.Figure(
        plot=_cdf(curves, "delay in netem, ms", None),
        title="How the delays are distributed",
        says="Follow the 99 % line to a curve: 99 of 100 messages took at most that long. A steep curve means little "
        "jitter, a long flat end means that a few messages came very late. Lost messages are not in it.",
        alt="Cumulative distribution of the realised delay. " + _medians({n: c[0] for n, c in curves.items()}),
    )


def latency_cdf(end_to_end_ms: ArrayLike, round_trip_ms: ArrayLike, limit_ms: float | None) -> style.Figure | None:
    """Draw the distributions of end-to-end latency and round trip; None when neither is known."""
    both = {
        "end to end": (np.asarray(end_to_end_ms, dtype=np.float64), style.ACTIVE),
        "round trip": (np.asarray(round_trip_ms, dtype=np.float64), style.HOLD),
    }
    curves = {name: curve for name, curve in both.items() if len(curve[0])}
    if not curves:
        return None
    says = (
        "End to end is how old the freshest command is when the estimate made with it is published; round trip is "
        "the surgeon's wait for the first answer to a command. The steps are the patient's ticks: a sample that "
        "comes just after a tick waits for the next one."
    )
    if limit_ms is not None:
        says += " The dashed line is the limit for the end-to-end latency of 99 % of the samples."
    return style.Figure(
        plot=_cdf(curves, "latency, ms", limit_ms),
        title="How the latency is distributed",
        says=says,
        alt="Cumulative distribution of the latency. " + _medians({n: c[0] for n, c in curves.items()}),
    )


def _cdf(curves: Mapping[str, tuple[ArrayLike, str]], label: str, limit_ms: float | None) -> figure:
    fig = style.plain_figure(
        320, x_axis_label=label, y_axis_label="share at or below, %", y_range=Range1d(start=0, end=101)
    )
    drawn = {}
    for name, (values, colour) in curves.items():
        value, percent = distribution(values)
        # from zero, and a step up at each value: the curve of a constant is a step, and one point would be nothing
        source = ColumnDataSource(
            {"value": style.column([value[0], *value]), "percent": style.column([0.0, *percent])}
        )
        drawn[name] = [
            fig.step("value", "percent", source=source, mode="after", line_color=colour, line_width=2, muted_alpha=0)
        ]
    tips = [("at most", "@value{0.00} ms"), ("share", "@percent{0.0} %")]
    fig.add_tools(HoverTool(renderers=[line for lines in drawn.values() for line in lines], tooltips=tips))
    fig.add_layout(Span(location=99, dimension="width", line_color="#8a949e", line_dash="dotted"))
    fig.add_layout(Label(x=4, x_units="screen", y=99, y_offset=-3, text="99 %", text_baseline="top"))
    if limit_ms is not None:
        fig.add_layout(Span(location=limit_ms, dimension="height", line_color=style.LOST, line_dash="dashed"))
        fig.add_layout(
            Label(
                x=limit_ms,
                y=6,
                text=f"limit {limit_ms:g} ms",
                x_offset=4,
                text_color=style.LOST,
            )
        )
        reach = max(float(np.max(values)) for values, _ in curves.values())
        least = min(float(np.min(values)) for values, _ in curves.values())
        room = 0.05 * (max(reach, limit_ms) - least)
        fig.x_range = Range1d(start=min(least, limit_ms) - room, end=max(reach, limit_ms) + 3 * room)
    style.add_legend(fig, drawn)
    return fig


def _medians(values: Mapping[str, ArrayLike]) -> str:
    return ", ".join(f"{name}: half within {np.median(np.asarray(v)):.1f} ms" for name, v in values.items()) + "."
