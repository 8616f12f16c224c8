"""Cumulative distributions: what share of the messages, or of the estimates, was at most how late."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.annotations import Label, Span
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure
from numpy.typing import ArrayLike

from common.channels import Direction
from deploy.report import plot_style as style
from deploy.report.asked import Asked
from deploy.report.delay_plot import COLOURS
from deploy.report.packets import Array, LinkColumns
from deploy.report.thinning import distribution

_SHARES = (0.001, *(i / 100 for i in range(1, 100)), 0.999)


@dataclass(frozen=True)
class _Curve:
    """A distribution: values, or with ``percent`` points of it."""

    values: Sequence[float] | Array
    colour: str
    dash: str = "solid"
    percent: Sequence[float] | None = None
    width: float = 2


def delay_cdf(
    links: Mapping[Direction, LinkColumns], asked: Mapping[Direction, Asked | None], varies: bool
) -> style.Figure | None:
    """Draw the distribution of the delay of each direction: asked for, decided, realised; None when none arrived.

    ``asked`` is what all keys of a direction are asked to have, None where they differ; ``varies``: it changed.
    """
    curves: dict[str, _Curve] = {}
    for direction, link in links.items():
        if not len(realised_ms := link.all("realised_ms")):
            continue
        curves[f"{direction} decided"] = _Curve(link.all("decided_ms"), style.PALE, width=5)
        curves[f"{direction} realised"] = _Curve(realised_ms, COLOURS[direction])
        request = asked.get(direction)
        quantiles_ms = [] if request is None else [ms for ms in request.quantiles_ms(_SHARES) if ms is not None]
        if len(quantiles_ms) == len(_SHARES):
            named = f"{direction} asked" + (" (without changes)" if varies else "")
            curves[named] = _Curve(quantiles_ms, style.TRUTH, "dashed", [100 * share for share in _SHARES])
    if not curves:
        return None
    realised = {name: curve.values for name, curve in curves.items() if name.endswith("realised")}
    return style.Figure(
        plot=_cdf(curves, "delay in netem, ms", None),
        title="How the delays are distributed",
        says="Follow the 99 % line to a curve: 99 of 100 messages took at most that long. Where asked (dashed), "
        "decided (pale) and realised coincide, the network was the one that the scenario describes; queues and "
        "waiting for earlier messages move realised to the right. Lost messages are not in it.",
        alt="Cumulative distribution of the delay asked for, decided and realised. " + _medians(realised),
    )


def latency_cdf(end_to_end_ms: ArrayLike, round_trip_ms: ArrayLike, limit_ms: float | None) -> style.Figure | None:
    """Draw the distributions of end-to-end latency and round trip; None when neither is known."""
    both = {
        "end to end": _Curve(np.asarray(end_to_end_ms, dtype=np.float64), style.ACTIVE),
        "round trip": _Curve(np.asarray(round_trip_ms, dtype=np.float64), style.HOLD),
    }
    curves = {name: curve for name, curve in both.items() if len(curve.values)}
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
        alt="Cumulative distribution of the latency. " + _medians({n: c.values for n, c in curves.items()}),
    )


def _cdf(curves: Mapping[str, _Curve], label: str, limit_ms: float | None) -> figure:
    fig = style.plain_figure(
        320, x_axis_label=label, y_axis_label="share at or below, %", y_range=Range1d(start=0, end=101)
    )
    drawn = {}
    for name, curve in curves.items():
        value, percent = distribution(curve.values) if curve.percent is None else (curve.values, curve.percent)
        # from zero, and a step up at each value: the curve of a constant is a step, and one point would be nothing
        source = ColumnDataSource(
            {"value": style.column([value[0], *value]), "percent": style.column([0.0, *percent])}
        )
        line = fig.step(
            "value", "percent", source=source, mode="after", line_color=curve.colour, line_dash=curve.dash,
            line_width=curve.width, muted_alpha=0,
        )  # fmt: skip
        drawn[name] = [line]
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
        reach = max(float(np.max(curve.values)) for curve in curves.values())
        least = min(float(np.min(curve.values)) for curve in curves.values())
        room = 0.05 * (max(reach, limit_ms) - least)
        fig.x_range = Range1d(start=min(least, limit_ms) - room, end=max(reach, limit_ms) + 3 * room)
    style.add_legend(fig, drawn)
    return fig


def _medians(values: Mapping[str, ArrayLike]) -> str:
    return ", ".join(f"{name}: half within {np.median(np.asarray(v)):.1f} ms" for name, v in values.items()) + "."
