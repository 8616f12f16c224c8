"""The delay of every message over time, decided and realised, and when messages were lost."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from common.channels import Direction
from common.units import NS_PER_S
from deploy.report import plot_style as style
from deploy.report.load import Ints
from deploy.report.packets import Array, LinkColumns
from deploy.report.thinning import evenly, evenly_and_largest
from netem.conditions import Span

TITLES: Mapping[Direction, str] = {
    "forward": "forward (surgeon to patient)",
    "feedback": "feedback (patient to surgeon)",
}
COLOURS: Mapping[Direction, str] = {"forward": style.FORWARD, "feedback": style.FEEDBACK}


_MOST_SPANS = 2000
_SHADES = ("#e9eef6", "#f4ecd8", "#e6f0e4", "#efe4ee", "#e2eff1")


@dataclass(frozen=True)
class _Dots:
    """One direction's messages, all keys together."""

    sent_s: Array
    seq: Ints
    decided_ms: Array
    realised_ms: Array
    lost_s: Array


def delay_figure(
    links: Mapping[Direction, LinkColumns], x_range: Range1d, spans: Mapping[Direction, Sequence[Span]]
) -> style.Figure | None:
    """Draw a panel for each direction that carried or lost a message; None when none did.

    ``spans`` says which conditions held when; where none but the plain one did, nothing is shaded.
    """
    dots = {direction: _dots(link) for direction, link in links.items()}
    used = {direction: link for direction, link in dots.items() if len(link.sent_s) or len(link.lost_s)}
    if not used:
        return None
    *_, last = used
    panels = [_panel(link, d, x_range, d == last, spans.get(d, ())) for d, link in used.items()]
    says = (
        "A dot is a message, placed where it was offered to the network: pale is the delay that the models drew, "
        "dark the delay that was measured. A dark dot above its pale one waited behind an earlier message, as in a "
        "queue; otherwise they should coincide. A red stroke on the ground line is a message that was lost."
    )
    if any(_is_special(span) for d in used for span in spans.get(d, ())):
        says += (
            " Behind the dots: outages in red, changes by the timeline in grey, each state in a colour of its own."
        )
    if any(len(evenly_and_largest(link.realised_ms)) < len(link.sent_s) for link in used.values()):
        says += " Of this many messages only some are drawn, evenly spaced, and the most delayed ones."
    counts = ", ".join(f"{d}: {len(link.sent_s)} delivered, {len(link.lost_s)} lost" for d, link in used.items())
    return style.Figure(
        plot=gridplot([[panel] for panel in panels], sizing_mode="stretch_width", toolbar_location="above"),
        title="Delay over time",
        says=says,
        alt=f"Scatter charts of each message's delay in netem over run time. {counts}.",
    )


def _dots(link: LinkColumns) -> _Dots:
    order = np.argsort(link.all("sent_s"), kind="stable")
    sent_s, seq, decided_ms, realised_ms = (
        link.all(name)[order] for name in ("sent_s", "seq", "decided_ms", "realised_ms")
    )
    return _Dots(sent_s, seq.astype(np.int64), decided_ms, realised_ms, np.sort(link.all("lost_s")))


def _is_special(span: Span) -> bool:
    return span.outage or span.changed or span.state is not None


def _shade(panel: figure, spans: Sequence[Span], low: float, high: float) -> None:
    """Colour the time in which something special held; of very many spans the longest."""
    special = sorted(filter(_is_special, spans), key=lambda span: span.begin_ns - span.end_ns)[:_MOST_SPANS]
    states = sorted({span.state for span in spans if span.state is not None})
    colours = [
        style.LOST_PALE
        if span.outage
        else _SHADES[states.index(span.state) % len(_SHADES)]
        if span.state is not None
        else style.CHANGED
        for span in special
    ]
    source = ColumnDataSource(
        {
            "left": style.column([span.begin_ns / NS_PER_S for span in special]),
            "right": style.column([span.end_ns / NS_PER_S for span in special]),
            "colour": colours,
        }
    )
    panel.quad("left", "right", low, high, source=source, fill_color="colour", line_color=None, level="underlay")


def _panel(link: _Dots, direction: Direction, x_range: Range1d, with_axis: bool, spans: Sequence[Span]) -> figure:
    panel = style.time_figure(x_range, "delay, ms", 240, with_axis)
    panel.title = TITLES[direction]
    highest_ms = max((float(ms.max()) for ms in (link.decided_ms, link.realised_ms) if len(ms)), default=0.0) or 1.0
    low, high = -0.06 * highest_ms, 1.08 * highest_ms
    panel.y_range = Range1d(start=low, end=high)
    if any(map(_is_special, spans)):
        _shade(panel, spans, low, high)
    kept = evenly_and_largest(link.realised_ms)
    source = ColumnDataSource(
        {
            "t": style.column(link.sent_s[kept]),
            "seq": link.seq[kept].astype(np.int32),
            "decided": style.column(link.decided_ms[kept]),
            "realised": style.column(link.realised_ms[kept]),
        }
    )
    decided = panel.scatter(
        "t", "decided", source=source, size=8, fill_color=style.PALE, line_color=None, muted_fill_alpha=0
    )
    realised = panel.scatter(
        "t", "realised", source=source, size=3.5, fill_color=COLOURS[direction], line_color=None, muted_fill_alpha=0
    )
    entries = {"decided": [decided], "realised": [realised]}
    if len(link.lost_s):
        lost_s = link.lost_s[evenly(len(link.lost_s))]
        entries["lost"] = [
            panel.scatter(
                "t",
                "y",
                source=ColumnDataSource({"t": style.column(lost_s), "y": np.zeros(len(lost_s), dtype=np.float32)}),
                marker="dash",
                angle=0.5 * math.pi,
                size=10,
                line_color=style.LOST,
                line_width=1.5,
                muted_line_alpha=0,
            )
        ]
    tips = [
        ("offered at", "@t{0.000} s"),
        ("number", "@seq"),
        ("decided", "@decided{0.000} ms"),
        ("realised", "@realised{0.000} ms"),
    ]
    panel.add_tools(HoverTool(renderers=[realised], tooltips=tips))
    style.add_legend(panel, entries)
    return panel
